# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""C++ of a step of the flow on cells; ``flow.py`` replaces the names in capitals."""

#: Constants of a face in a step, of the lava at its start: what enters a cell within the step is
#: as warm as there. A face between Newtonian lava has flux over fall and h^3 [1/(m3 s)].
NEWTONIAN_FACE = """
    auto face_of = [&](long p, long q, const float* factor, float* mobility, float*) {
        const float a = y[p], b = y[q];
        mobility[p] = FLUID FACTOR;
    };
"""

#: Constants of a face for lava with a law of its own: viscosity [Pa s] and yield strength [Pa].
LAW_FACE = """
    auto face_of = [&](long p, long q, const float*, float* mobility, float* held) {
        const float a = y[p], b = y[q], inverse = 1.0f / (a + b + 1e-30f);
        mobility[p] = 1.0f / larger((a * fluidity[p] + b * fluidity[q]) * inverse, 1e-30f);
        held[p] = (a * strength[p] + b * strength[q]) * inverse;
    };
"""

#: Flux between two cells by the mean of h^3, and its coefficient: flux over fall [1/s].
NEWTONIAN = """
    auto flux_of = [&](long p, long q, long, float drop, const float*, const float*,
                       float mobility, float) {
        const float a = above_film(y[p]), b = above_film(y[q]);
        Flux f;
        f.fall = y[p] - y[q] + drop;
        f.rate = mobility * (a + b) * (a * a + b * b);
        f.stiff = stiffened(f.rate, f.fall, a, b);
        f.limited = limited(f.rate * f.fall, a, b);
        return f;
    };
"""

#: The same with the speed of a law; ``side`` is the distance to the cell beside in the arrays.
BY_LAW = """
    auto fall_of = [&](long p, long q, const float* drop) {
        const float fall = y[p] - y[q] + drop[p];
        // no lava of a dry cell falls
        return (fall > 0.0f ? y[p] : y[q]) > film ? fall : 0.0f;
    };
    auto flux_of = [&](long p, long q, long side, float drop, const float* cross,
                       const float* beside, float mobility, float held) {
        const float a = above_film(y[p]), b = above_film(y[q]), sum = a + b;
        Flux f;
        f.fall = y[p] - y[q] + drop;
        const float across = -0.25f * per_cell * (
            fall_of(p - side, p, beside) + fall_of(p, p + side, beside)
            + fall_of(q - side, q, beside) + fall_of(q, q + side, beside));
        const float inverse = 1.0f / (sum + 1e-30f);
        const auto speed = LAW(
            s.law, s.weight, 0.5f * sum, -f.fall * per_cell, across, -drop * per_cell, cross[p],
            mobility, held);
        // mean of h^3 over the cube of the mean
        const float mean = per_cell * per_cell * (a * a + b * b) * inverse;
        f.rate = sum > 0.0f ? mean * speed[0] : 0.0f;
        f.stiff = stiffened(sum > 0.0f ? mean * speed[1] : 0.0f, f.fall, a, b);
        f.limited = limited(f.rate * f.fall, a, b);
        return f;
    };
"""

#: Flux through a face at a stage, by the thicknesses alone.
OWN_FLUX = """
                    const float flux = flux_of(
                        p, p + next, side, drop[p], factor, beside, mobility[p], HELD).limited;
"""

#: A whole step. ``FACES`` evaluates flux_of at all faces of row i of the window.
STEP = """
    int* box = s.box.data;
    const long top = box[0], bottom = box[1], left = box[2], right = box[3];
    SHARED
    COLUMNS
    struct Flux { float fall, rate, stiff, limited; };
    const long w = s.stride, last_row = s.rows - 2, last_column = s.stride - 2;
    float* APART y = s.stage.data;
    double* APART h = s.thickness.data;
    const float* APART drop_x = s.drop_x.data;
    const float* APART drop_y = s.drop_y.data;
    const float* APART side_x = s.SIDE_x.data;
    const float* APART side_y = s.SIDE_y.data;
    const float* APART fluidity = s.fluidity.data;
    const float* APART strength = s.strength.data;
    const unsigned char* APART kind = s.kind.data;
    const double* source = s.source.data;
    float* mobility_x = s.mobility_x.data;
    float* mobility_y = s.mobility_y.data;
    float* held_x = s.held_x.data;
    float* held_y = s.held_y.data;
    float* first_x = s.first_x.data;
    float* first_y = s.first_y.data;
    double* clock = s.clock.data;
    int* counts = s.counts.data;
    const int* vents = s.vent_box.data;
    const float film = s.film;
    const float per_cell = 1.0f / s.cell;
    const float fluid = s.weight / 12.0f * per_cell * per_cell UNIFORM;
    auto larger = [](float a, float b) { return a > b ? a : b; };
    auto smaller = [](float a, float b) { return a < b ? a : b; };
    // positive floats are in the order of their bits, and a maximum of integers vectorises
    auto bits = [](float a) { return __builtin_bit_cast(int, a); };
    const long row_0 = top > 1 ? top : 1, row_1 = bottom < last_row ? bottom : last_row;
    // first and last column of the cells of a row, and of its faces to the next row
    struct Span { long from, to; };
    auto cells_of = [&](long i) {
        const long from = begin_of(i), to = end_of(i);
        return Span{from > 1 ? from : 1, to < last_column ? to : last_column};
    };
    auto both = [](Span a, Span b) {
        return Span{a.from > b.from ? a.from : b.from, a.to < b.to ? a.to : b.to};
    };
    // first column of the vents that this thread has in a row
    auto vents_from = [&](long from) {
        return vents[2] + ((lane - (vents[2] - from)) & (lanes - 1));
    };
    // numbers of maxima; a GPU clears those of the step before
    enum { STIFF, PACE, CLOSED, HIGHEST, SOUTH, NORTH, WEST, EAST, OVERDRAWN };
    SLOTS
    // what is written at the end of the step
    const double time = clock[0], until = clock[2], longest = clock[3], former_step = clock[5];
    const double max_end = clock[6], poured = clock[8], thickest = s.peaks.data[0];

    int is_closed = 0;
    for (long i = first_of(row_0); i <= last_of(row_1); i += lines) {
        const Span span = cells_of(i);
        int any = 0;
        for (long j = span.from + lane; j <= span.to; j += lanes) any |= kind[i * w + j];
        if (any) is_closed = 1;
    }
    raise(slots + CLOSED, is_closed);

    // a cell may give in a stage what flows down a slope where the ground falls by more than h
    auto stiffened = [&](float rate, float fall, float a, float b) {
        const float thick = larger(larger(a, b), film);
        const float part = larger(fall * a, -fall * b) / (thick * thick);
        return rate * larger(part, 1.0f);
    };
    float max_rate = 0.0f;
    // lava that flows, and what may pass a face from a cell of a to one of b
    auto above_film = [&](float a) { return a > film ? a : 0.0f; };
    auto limited = [&](float amount, float a, float b) {
        return larger(smaller(amount, max_rate * a), -max_rate * b);
    };
    FLUX
    // nothing passes the faces at the ends of the spans, to which no stage writes
    for (long i = first_for_warp(top); i <= last_of(bottom); i += warps) {
        const long from = begin_of(i), to = end_of(i);
        for (long n = thread; n < 2 && from <= to; n += threads) {
            const long p = i * w + (n ? to : from > 0 ? from - 1 : to);
            s.flux_x.data[p] = s.former_x.data[p] = first_x[p] = 0.0f;
        }
        if (i == bottom) continue;
        const Span own{from, to}, next{begin_of(i + 1), end_of(i + 1)}, common = both(own, next);
        auto clear = [&](long begin, long end) {
            for (long p = i * w + begin + thread; p <= i * w + end; p += threads)
                s.flux_y.data[p] = s.former_y.data[p] = first_y[p] = 0.0f;
        };
        const long begin = from < next.from ? from : next.from, end = to > next.to ? to : next.to;
        clear(begin, common.from <= common.to ? common.from - 1 : end);
        if (common.from <= common.to) clear(common.to + 1, end);
    }
    // calls a function of the faces of a row, from the first to the last: along the row, then
    // those to the next row
    auto faces_of = [&](long i, auto visit) {
        for (int axis = 0; axis < 2; ++axis) {
            if (axis == 0 ? (i < row_0 || i > row_1) : i == bottom) continue;
            const Span span = axis ? both(cells_of(i), cells_of(i + 1))
                                   : Span{begin_of(i), end_of(i) - 1};
            visit(
                axis, i * w + span.from + lane, i * w + span.to, axis ? w : 1, axis ? 1 : w,
                axis ? drop_y : drop_x, axis ? drop_x : drop_y, axis ? side_y : side_x);
        }
    };
    // fluxes and stiffness, and then largest displacement a second, at the start of the step
    int stiff = 0, pace = 0;
    for (long i = first_of(top); i <= last_of(bottom); i += lines)
        faces_of(i, [&](int axis, long from, long to, long next, long side,
                        const float* APART drop, const float* APART beside,
                        const float* APART factor) {
            float* APART mobility = axis ? mobility_y : mobility_x;
            float* APART held = axis ? held_y : held_x;
            float* APART first = axis ? first_y : first_x;
            for (long p = from; p <= to; p += lanes) face_of(p, p + next, factor, mobility, held);
            int highest = 0;
            for (long p = from; p <= to; p += lanes) {
                const Flux f = flux_of(
                    p, p + next, side, drop[p], factor, beside, mobility[p], HELD);
                first[p] = f.rate * f.fall;
                const int one = bits(f.stiff);
                highest = one > highest ? one : highest;
            }
            stiff = highest > stiff ? highest : stiff;
        });
    raise(slots + STIFF, stiff);
    together();
    CLEAR
    max_rate = __builtin_bit_cast(float, raised(slots + STIFF));
    const bool is_open = !raised(slots + CLOSED);
    SOLVER
    for (long i = first_of(top); i <= last_of(bottom); i += lines)
        faces_of(i, [&](int axis, long from, long to, long next, long,
                        const float* APART drop, const float*, const float*) {
            float* APART first = axis ? first_y : first_x;
            int highest = 0;
            for (long p = from; p <= to; p += lanes) {
                const float fall = y[p] - y[p + next] + drop[p];
                const float a = above_film(y[p]), b = above_film(y[p + next]);
                const float amount = limited(first[p], a, b);
                first[p] = amount;
                const float part = 2.0f / (a + b + 1000.0f * film);
                const float steep = part * (fall < 0.0f ? -fall : fall);
                const float faster = 1.0f + smaller(steep, STEEPEST);
                const int one = bits((amount < 0.0f ? -amount : amount) * part * faster);
                highest = one > highest ? one : highest;
            }
            pace = highest > pace ? highest : pace;
        });
    raise(slots + PACE, pace);
    together();

    double step = former_step > 0.0 ? GROWTH * former_step : longest;
    // where lava comes out, by half of the thickness at most
    const double added = 0.5 * thickest + 1000.0 * film;
    if (poured * step > added) step = added / poured;
    const double fastest = __builtin_bit_cast(float, raised(slots + PACE));
    if (fastest * step > DISPLACEMENT) step = DISPLACEMENT / fastest;
    if (step > longest) step = longest;
    double full = step;
    if (step > until - time) step = until - time;
    // lava that comes out makes it stiffer within the step
    const double grown = thickest > 0.0 ? 1.0 + poured * step / thickest : 1.0;
    const double stiffness = 4.0 * max_rate * grown * grown * grown + 1e-30;
    auto reach = [](int n) { return STABLE * 0.25 * (n * n + n - 2.0); };
    int stages = 3;
    while (stages < MAX_STAGES && reach(stages) < step * stiffness) stages += 2;
    if (step > reach(stages) / stiffness) {
        step = reach(stages) / stiffness;
        full = step;
    }
    // vents emit the integral of their rates: the step is that of the rounded clock
    if (step < until - time && time + step > time) step = (time + step) - time;
    if (time + step > max_end) {
        if (is_first) clock[7] = step;
        together();
        CLEAR_OWN
        return;
    }
    max_rate = (float)(0.25 * stiffness);

    const double w1 = 4.0 / (stages * stages + stages - 2.0);
    double b = 1.0 / 3.0, former_b = b, poured_1 = 0.0, poured_2 = 0.0;
    float* newer_x = s.former_x.data;
    float* newer_y = s.former_y.data;
    float* older_x = s.flux_x.data;
    float* older_y = s.flux_y.data;
    auto thickness_by = [&](long p, const float* gx, const float* gy) {
        return h[p] + ((double)gx[p - 1] - (double)gx[p]) + ((double)gy[p - w] - (double)gy[p]);
    };
    // whether cells would have less than nothing, and first and last row of these, of this thread
    int is_overdrawn = 0;
    long first_over = bottom, last_over = top;
    auto find_overdrawn = [&](long i, const float* APART gx, const float* APART gy) {
        const Span span = cells_of(i);
        int any = 0;
        for (long p = i * w + span.from + lane; p <= i * w + span.to; p += lanes)
            any |= thickness_by(p, gx, gy) < 0.0;
        is_overdrawn |= any;
        if (any && i < first_over) first_over = i;
        if (any && i > last_over) last_over = i;
    };
    for (int n = 1; n <= stages; ++n) {
        const double next_b = n == 1 ? b : (n * n + n - 2.0) / (2.0 * n * (n + 1.0));
        const double mu = n == 1 ? 0.0 : (2 * n - 1) * next_b / (n * b);
        const double nu = n <= 2 ? 0.0 : -(n - 1) * next_b / (n * former_b);
        const double now = n == 1 ? 0.0 : mu * w1 * step;
        const double begin = n == 1 ? b * w1 * step : -(1.0 - b) * mu * w1 * step;
        const double given = mu * poured_1 + nu * poured_2 + now + begin;
        poured_2 = poured_1, poured_1 = given;
        const float m = mu, v = nu, t = now, t0 = begin;
        // a GPU does not wait for the fluxes of the first stage, which others also know
        const bool is_known = !is_serial && n == 1;
        const float scale = is_known ? t0 : 1.0f;
        auto update = [&](long i) {
            if (i < row_0 || i > row_1) return;
            const float* APART gx = is_known ? first_x : older_x;
            const float* APART gy = is_known ? first_y : older_y;
            const Span span = cells_of(i);
            const long from = i * w + span.from + lane, to = i * w + span.to;
            for (long p = from; p <= to; p += lanes)
                y[p] = (float)h[p] + scale * (gx[p - 1] - gx[p] + gy[p - w] - gy[p]);
            if (i >= vents[0] && i <= vents[1])
                for (long p = i * w + vents_from(span.from); p <= i * w + vents[3]; p += lanes)
                    y[p] += (float)(given * source[p]);
            if (!is_open)
                for (long p = from; p <= to; p += lanes) y[p] = kind[p] ? 0.0f : y[p];
            if (n == stages) find_overdrawn(i, gx, gy);
        };
        EVALUATE
        for (long i = first_of(top); i <= last_of(bottom); i += lines) {
            faces_of(i, [&](int axis, long from, long to, long next, long side,
                            const float* APART drop, const float* APART beside,
                            const float* APART factor) {
                const float* APART mobility = axis ? mobility_y : mobility_x;
                const float* APART held = axis ? held_y : held_x;
                const float* APART first = axis ? first_y : first_x;
                const float* APART newer = axis ? newer_y : newer_x;
                float* APART older = axis ? older_y : older_x;
                if (n == 1) {
                    for (long p = from; p <= to; p += lanes) older[p] = t0 * first[p];
                    return;
                }
                for (long p = from; p <= to; p += lanes) {
                    FLOW
                    older[p] = m * newer[p] + v * older[p] + t * flux + t0 * first[p];
                }
            });
            if (is_serial && i >= top + LAG) update(i - LAG);
        }
        if (!is_known) together();
        for (long i = is_serial ? bottom + 1 - LAG : first_of(top); i <= last_of(bottom);
             i += lines)
            update(i);
        if (n == stages) raise(slots + OVERDRAWN, is_overdrawn);
        together();
        float* swap = newer_x;
        newer_x = older_x, older_x = swap;
        swap = newer_y;
        newer_y = older_y, older_y = swap;
        former_b = b, b = next_b;
    }
    // an odd number of stages leaves the last one in the fluxes
    float* APART gx = s.flux_x.data;
    float* APART gy = s.flux_y.data;

    // no cell gives more than it has
    auto out_of = [&](long p) {
        return larger(gx[p], 0.0f) + larger(-gx[p - 1], 0.0f) + larger(gy[p], 0.0f)
            + larger(-gy[p - w], 0.0f);
    };
    auto after = [&](long p) { return thickness_by(p, gx, gy); };
    bool was_overdrawn = false;
    long low = row_0, high = row_1;
    for (int turn = 0; turn < LIMITS; ++turn) {
        if (turn) {
            is_overdrawn = 0, first_over = bottom, last_over = top;
            for (long i = first_of(low); i <= last_of(high); i += lines)
                find_overdrawn(i, gx, gy);
            raise(slots + OVERDRAWN + turn, is_overdrawn);
            together();
        }
        if (!raised(slots + OVERDRAWN + turn)) break;
        was_overdrawn = true;
        // at last no cell gives more than it had at the start, whatever comes in
        const int is_last = turn == LIMITS - 1;
        // one thread knows the rows that change
        const bool is_known = is_serial && !is_last;
        low = is_known && first_over > row_0 ? first_over - 1 : row_0;
        high = is_known && last_over < row_1 ? last_over + 1 : row_1;
        for (long i = first_of(low); i <= last_of(high); i += lines) {
            const Span span = cells_of(i);
            for (long p = i * w + span.from + lane; p <= i * w + span.to; p += lanes) {
                const float out = out_of(p) + 1e-30f, lacks = (float)after(p);
                const float has = is_last ? (float)h[p] : out + lacks;
                const float part = larger(0.999999f * has / out, 0.0f);
                y[p] = lacks < 0.0f || is_last ? smaller(part, 1.0f) : 1.0f;
            }
        }
        together();
        const long begin = low > row_0 ? low : top, end = high < row_1 ? high - 1 : bottom;
        for (long i = first_of(begin); i <= last_of(end); i += lines)
            faces_of(i, [&](int axis, long from, long to, long next, long, const float*,
                            const float*, const float*) {
                float* g = axis ? gy : gx;
                for (long p = from; p <= to; p += lanes)
                    g[p] *= g[p] > 0.0f ? y[p] : y[p + next];
            });
        together();
    }

    double* gone = s.gone.data;
    int highest = 0;
    long wet[4] = {top + 2, bottom - 2, left + 2, right - 2};
    // lava that has left the ground, of each row in the same order for any number of threads
    auto lose = [&](long i) {
        const Span span = cells_of(i);
        double sums[3] = {0.0, 0.0, 0.0};
        for (long p = i * w + span.from + thread; p <= i * w + span.to; p += threads)
            if (kind[p]) {
                for (int n = 0; n < 3; ++n) sums[n] += kind[p] == n + 1 ? h[p] : 0.0;
                h[p] = 0.0;
            }
        for (int n = 0; n < 3; ++n) {
            sums[n] = summed(sums[n]);
            if (thread == 0) gone[3 * i + n] = sums[n];
        }
    };
    auto end_row = [&](long i) {
        const Span span = cells_of(i);
        const long from = i * w + span.from + lane, to = i * w + span.to;
        int most_here = 0;
        for (long p = from; p <= to; p += lanes) {
            y[p] = (float)h[p];
            const int one = bits(y[p]);
            most_here = one > most_here ? one : most_here;
        }
        if (most_here <= bits(film)) return;
        highest = most_here > highest ? most_here : highest;
        long first = from, last = from + (to - from) / lanes * lanes;
        while (y[first] <= film) first += lanes;
        while (y[last] <= film) last -= lanes;
        wet[0] = i < wet[0] ? i : wet[0];
        wet[1] = i > wet[1] ? i : wet[1];
        wet[2] = first - i * w < wet[2] ? first - i * w : wet[2];
        wet[3] = last - i * w > wet[3] ? last - i * w : wet[3];
    };
    for (long i = first_of(row_0); i <= last_of(row_1); i += lines) {
        const Span span = cells_of(i);
        for (long p = i * w + span.from + lane; p <= i * w + span.to; p += lanes) h[p] = after(p);
        if (i >= vents[0] && i <= vents[1])
            for (long p = i * w + vents_from(span.from); p <= i * w + vents[3]; p += lanes)
                h[p] += step * source[p];
        if (is_serial && !is_open) lose(i);
        if (is_serial || is_open) end_row(i);
    }
    if (!is_serial && !is_open) {
        together();
        for (long i = first_for_warp(row_0); i <= last_of(row_1); i += warps) lose(i);
        together();
        for (long i = first_of(row_0); i <= last_of(row_1); i += lines) end_row(i);
    }
    raise(slots + HIGHEST, highest);
    raise(slots + SOUTH, (int)(top + 2 - wet[0]));
    raise(slots + NORTH, (int)(wet[1] - bottom + 2));
    raise(slots + WEST, (int)(left + 2 - wet[2]));
    raise(slots + EAST, (int)(wet[3] - right + 2));
    together();
    // volume that has left over the border, and on cells outside of the ground; one warp sums it
    const bool is_inside = top > 0 && bottom <= last_row && left > 0 && right <= last_column;
    if (is_first_warp && !(is_inside && is_open)) {
        double out = 0.0, sums[3] = {0.0, 0.0, 0.0};
        const Span south = cells_of(row_0), north = cells_of(row_1);
        if (top == 0)
            for (long j = south.from + thread; j <= south.to; j += threads) out -= gy[j];
        if (bottom > last_row)
            for (long j = north.from + thread; j <= north.to; j += threads)
                out += gy[last_row * w + j];
        for (long i = row_0 + thread; i <= row_1; i += threads) {
            if (begin_of(i) == 0) out -= gx[i * w];
            if (end_of(i) > last_column) out += gx[i * w + last_column];
        }
        if (!is_open)
            for (long i = row_0 + thread; i <= row_1; i += threads)
                for (int n = 0; n < 3; ++n) sums[n] += gone[3 * i + n];
        sums[0] += out;
        for (int n = 0; n < 3; ++n) {
            sums[n] = summed(sums[n]);
            if (thread == 0) s.left.data[n] += sums[n];
        }
    }
    if (is_first) {
        wet[0] = top + 2 - raised(slots + SOUTH), wet[1] = bottom - 2 + raised(slots + NORTH);
        wet[2] = left + 2 - raised(slots + WEST), wet[3] = right - 2 + raised(slots + EAST);
        box[0] = wet[0] > 2 ? wet[0] - 2 : 0;
        box[1] = wet[1] + 2 < s.rows ? wet[1] + 2 : s.rows - 1;
        box[2] = wet[2] > 2 ? wet[2] - 2 : 0;
        box[3] = wet[3] + 2 < w ? wet[3] + 2 : w - 1;
        s.peaks.data[0] = __builtin_bit_cast(float, raised(slots + HIGHEST));
        s.peaks.data[1] = stiffness;
        clock[0] = step < until - time ? time + step : until;
        clock[1] = step;
        clock[5] = full;
        ++counts[0];
        counts[1] += stages;
        counts[2] = stages;
        counts[3] += was_overdrawn;
    }
    together();
"""
