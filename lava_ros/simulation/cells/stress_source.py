# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""C++ of the lateral stress of a step on cells; ``flow.py`` replaces the names in capitals."""

#: Fluxes through the faces under lateral viscous stress, by Chebyshev sweeps (``flow.py``).
LATERAL_SOLVER = """
    float* local_of[2] = {s.local_x.data, s.local_y.data};
    float* solved_of[2] = {s.solved_x.data, s.solved_y.data};
    float* others_of[2] = {s.unsolved_x.data, s.unsolved_y.data};
    auto mean_of = [&](long p, long next) {
        const float mean = 0.5f * (y[p] + y[p + next]);
        return mean > film ? mean : 0.0f;
    };
    auto bed_of = [](float a, float b) { return 0.25f * (a + b) * (a * a + b * b); };
    KOREN
    // thickness that a flux through a face carries
    struct Around { long back, ahead; };
    auto around = [&](int axis, long i, long next) {
        // beyond the first and last row there is no lava either
        return Around{axis && i == 0 ? 0 : next, axis && i + 2 >= s.rows ? next : 2 * next};
    };
    auto carried = [&](long p, long next, Around near, float flux) {
        const float a = above_film(y[p]), b = above_film(y[p + next]);
        // from the thicker cell if nothing flows without the other faces
        const bool forward = flux > 0.0f || (flux == 0.0f && a > b);
        const float own = forward ? a : b, other = forward ? b : a;
        const float behind = above_film(forward ? y[p - near.back] : y[p + near.ahead]);
        const float slope = koren(own - behind, other - own);
        // no drag is less than that of the thicker cell, which bounds the number of sweeps
        const float least = bed_of(a, b) / larger(larger(a, b), film);
        return larger(own + 0.5f * slope, sqrtf(least) + film);
    };
    float* drag_of[2] = {s.drag_x.data, s.drag_y.data};
    const double stress = 4.0 / DRAG * thickest * thickest * per_cell * per_cell;
    const double condition = 2.0 * (1.0 + stress), centre = 1.0 + 1.0 / condition;
    const double half = 1.0 - 1.0 / condition;
    // replaces the local fluxes; later stages begin with the speeds of the one before
    auto solve = [&](float* flux_x, float* flux_y, bool is_first_stage) {
        const double logarithm = is_first_stage ? LOGARITHM : LATER;
        int sweeps = 2;
        while (sweeps < MAX_SWEEPS && sweeps < 0.5 * logarithm * sqrtf((float)condition))
            ++sweeps;
        for (long i = first_of(top); i <= last_of(bottom); i += lines)
            faces_of(i, [&](int axis, long from, long to, long next, long, const float*,
                            const float*, const float*) {
                const float* flux = axis ? flux_y : flux_x;
                float* own = local_of[axis];
                float* APART drags = drag_of[axis];
                float* APART solved = solved_of[axis];
                float* APART others = others_of[axis];
                const float* APART steep = axis ? s.factor_y.data : s.factor_x.data;
                const Around near = around(axis, i, next);
                for (long p = from; p <= to; p += lanes) {
                    const float a = above_film(y[p]), b = above_film(y[p + next]);
                    const float full = carried(p, next, near, flux[p]);
                    const float bed = larger(bed_of(a, b), film * film * film);
                    const float drag = DRAGf * s.cell * s.cell * full * full / (bed ON_SLOPE);
                    const float speed = mean_of(p, next) > 0.0f ? flux[p] / full : 0.0f;
                    const float begun = is_first_stage ? speed : solved[p];
                    own[p] = speed, drags[p] = drag, solved[p] = begun, others[p] = begun;
                }
            });
        together();
        double rho = half / centre;
        for (int sweep = 0; sweep < sweeps; ++sweep) {
            const double next_rho = sweep ? 1.0 / (2.0 * centre / half - rho) : rho;
            const float momentum = sweep ? next_rho * rho : 0.0f;
            const float relaxation = sweep ? 2.0 * next_rho / half : 1.0 / centre;
            rho = next_rho;
            for (long i = first_of(top); i <= last_of(bottom); i += lines)
                faces_of(i, [&](int axis, long from, long to, long next, long side,
                                const float*, const float*, const float*) {
                    const float* APART own = local_of[axis];
                    const float* APART solved = solved_of[axis];
                    const float* APART drags = drag_of[axis];
                    float* APART others = others_of[axis];
                    const long back = around(axis, i, next).back;
                    for (long p = from; p <= to; p += lanes) {
                        const float mean = mean_of(p, next), u = solved[p], drag = drags[p];
                        const float a = above_film(y[p]), b = above_film(y[p + next]);
                        const float below = mean_of(p - side, next);
                        const float above = mean_of(p + side, next);
                        // the side of a thick flow is free, also next to a film
                        const float c = 2.0f * mean * below / (mean + below + film);
                        const float d = 2.0f * mean * above / (mean + above + film);
                        // in pairs, so that mirrored flows are mirrored to the last bit
                        const float from_a = a * (solved[p - back] - u);
                        const float from_b = b * (solved[p + next] - u);
                        const float from_c = c * (solved[p - side] - u);
                        const float from_d = d * (solved[p + side] - u);
                        const float pull = (from_a + from_b) + (from_c + from_d);
                        const float sum = (a + b) + (c + d) + drag;
                        const float change = momentum * (u - others[p])
                            + relaxation / sum * (drag * (own[p] - u) + pull);
                        others[p] = mean > 0.0f ? u + change : 0.0f;
                    }
                });
            together();
            for (int axis = 0; axis < 2; ++axis) {
                float* swap = solved_of[axis];
                solved_of[axis] = others_of[axis], others_of[axis] = swap;
            }
        }
        for (long i = first_of(top); i <= last_of(bottom); i += lines)
            faces_of(i, [&](int axis, long from, long to, long next, long, const float*,
                            const float*, const float*) {
                float* APART flux = axis ? flux_y : flux_x;
                const float* own = local_of[axis];
                const float* APART solved = solved_of[axis];
                const Around near = around(axis, i, next);
                for (long p = from; p <= to; p += lanes)
                    flux[p] = solved[p] * carried(p, next, near, own[p]);
            });
        together();
    };
    solve(first_x, first_y, true);
"""

#: Fluxes of a stage after the first, in ``local_x`` and ``local_y``.
LATERAL_STAGE = """
        if (n > 1) {
            for (long i = first_of(top); i <= last_of(bottom); i += lines)
                faces_of(i, [&](int axis, long from, long to, long next, long side,
                                const float* APART drop, const float* APART beside,
                                const float* APART factor) {
                    const float* APART mobility = axis ? mobility_y : mobility_x;
                    const float* APART held = axis ? held_y : held_x;
                    float* APART flux = local_of[axis];
                    for (long p = from; p <= to; p += lanes) {
                        const Flux f = flux_of(
                            p, p + next, side, drop[p], factor, beside, mobility[p], HELD);
                        flux[p] = f.rate * f.fall;
                    }
                });
            together();
            solve(s.local_x.data, s.local_y.data, false);
        }
"""

#: Flux through a face at a stage.
LATERAL_FLUX = """
                    const float flux = limited(
                        local_of[axis][p], above_film(y[p]), above_film(y[p + next]));
"""
