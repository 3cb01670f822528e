# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A time step of the flow on cells: fluxes through faces, in stages of super-time-stepping.

Between two cells of thickness a and b, whose surfaces differ by S, the flux per cell area is

    rho g / (3 mu) cos^4 (a + b) (a^2 + b^2) / 4 * S / cell^2,

h^3 in its mean over the thicknesses from a to b. It is central, of second order, and steps are
short enough for it. Lava whose speed is not proportional to the slope has the speed of
its law (effects/laws.py) at the mean thickness, times the same mean of h^3 over the cube of it.

A step has several stages (RKL2: Meyer, Balsara & Aslam 2014, doi:10.1016/j.jcp.2013.08.021), in
float32. The recursion is that of the thickness passed through each face, not that of the
thickness: what leaves a cell enters the next one, and the thickness in float64 has no error of
rounding in its sum.

On a CPU a step is one function whose loops over rows the compiler vectorises. It needs pointers
that do not overlap and no branches, so it is C++.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.effects import Effects
from lava_ros.effects.column import column_type
from lava_ros.simulation.cells.state import Cells, FaceLaw, TARGET, TIME

#: Maximum number of stages of a step.
MAX_STAGES = 99

#: Maximum displacement of lava in a step, in cells.
DISPLACEMENT = 2.0

#: The same for lava that carries heat: it passes on at most the heat of a cell.
HEATED_DISPLACEMENT = 0.8

#: Maximum ratio of the lengths of consecutive steps.
GROWTH = 1.5

#: Fall of the surface between two cells over the mean thickness above which steps are no shorter:
#: down walls lava is limited by what the upper cell has.
_STEEPEST = 10.0

#: Fraction of the largest stable step that a step of a number of stages has.
_STABLE = 0.9

#: Maximum number of passes that limit what cells give.
_LIMITS = 4

#: Flux between two cells by the mean of h^3, and its coefficient: flux over fall [1/s].
_NEWTONIAN = """
    auto flux_of = [&](long p, long q, long, float drop, const float* factor, const float*) {
        float a = y[p], b = y[q];
        Flux f;
        f.fall = a - b + drop;
        a = a > film ? a : 0.0f;
        b = b > film ? b : 0.0f;
        f.sum = a + b;
        f.rate = FLUID * f.sum * (a * a + b * b) FACTOR;
        f.stiff = stiffened(f.rate, f.fall, a, b);
        f.most = most * a;
        f.least = -most * b;
        return f;
    };
"""

#: The same with the speed of a law; ``side`` is the distance to the cell beside in the arrays.
_BY_LAW = """
    auto fall_of = [&](long p, long q, const float* drop) {
        const float fall = y[p] - y[q] + drop[p];
        // no lava of a dry cell falls
        return (fall > 0.0f ? y[p] : y[q]) > film ? fall : 0.0f;
    };
    auto flux_of = [&](long p, long q, long side, float drop, const float* cross,
                       const float* beside) {
        float a = y[p], b = y[q];
        Flux f;
        f.fall = a - b + drop;
        a = a > film ? a : 0.0f;
        b = b > film ? b : 0.0f;
        f.sum = a + b;
        const float across = -0.25f * per_cell * (
            fall_of(p - side, p, beside) + fall_of(p, p + side, beside)
            + fall_of(q - side, q, beside) + fall_of(q, q + side, beside));
        // of the lava at the start of the step: what enters a cell within it is as warm as there
        const float had_p = (float)h[p], had_q = (float)h[q];
        const float had = 1.0f / (had_p + had_q + 1e-30f);
        const float fluid = (had_p * fluidity[p] + had_q * fluidity[q]) * had;
        const float held = (had_p * strength[p] + had_q * strength[q]) * had;
        const float share = 1.0f / (f.sum + 1e-30f);
        const auto speed = LAW(
            s.law, s.weight, 0.5f * f.sum, -f.fall * per_cell, across, -drop * per_cell, cross[p],
            fluid, held);
        // mean of h^3 over the cube of the mean
        const float mean = per_cell * per_cell * (a * a + b * b) * share;
        f.rate = f.sum > 0.0f ? mean * speed[0] : 0.0f;
        f.stiff = stiffened(f.sum > 0.0f ? mean * speed[1] : 0.0f, f.fall, a, b);
        f.most = most * a;
        f.least = -most * b;
        return f;
    };
"""

#: A whole step. ``FACES`` evaluates flux_of at all faces of row i of the window.
_STEP = """
    struct Flux { float fall, sum, rate, stiff, most, least; };
    const long w = s.stride, last_row = s.rows - 2, last_column = s.stride - 2;
    float* __restrict y = s.stage.data;
    double* __restrict h = s.thickness.data;
    const float* __restrict drop_x = s.drop_x.data;
    const float* __restrict drop_y = s.drop_y.data;
    const float* __restrict side_x = s.SIDE_x.data;
    const float* __restrict side_y = s.SIDE_y.data;
    const float* __restrict fluidity = s.fluidity.data;
    const float* __restrict strength = s.strength.data;
    const unsigned char* __restrict kind = s.kind.data;
    const double* source = s.source.data;
    float* first_x = s.first_x.data;
    float* first_y = s.first_y.data;
    double* clock = s.clock.data;
    int* counts = s.counts.data;
    int* box = s.box.data;
    const int* vents = s.vent_box.data;
    const float film = s.film;
    const float per_cell = 1.0f / s.cell;
    const float fluid = s.weight / 12.0f * per_cell * per_cell UNIFORM;
    auto larger = [](float a, float b) { return a > b ? a : b; };
    auto smaller = [](float a, float b) { return a < b ? a : b; };
    // positive floats are in the order of their bits, and a maximum of integers vectorises
    auto bits = [](float a) { return __builtin_bit_cast(int, a); };

    const long top = box[0], bottom = box[1], left = box[2], right = box[3];
    const long row_0 = top > 1 ? top : 1, row_1 = bottom < last_row ? bottom : last_row;
    const long column_0 = left > 1 ? left : 1;
    const long column_1 = right < last_column ? right : last_column;

    int is_open = 1;
    for (long i = row_0; i <= row_1; ++i) {
        int any = 0;
        for (long j = column_0; j <= column_1; ++j) any |= kind[i * w + j];
        if (any) is_open = 0;
    }

    // a cell may give in a stage what flows down a slope where the ground falls by more than h
    auto stiffened = [&](float rate, float fall, float a, float b) {
        const float thick = larger(larger(a, b), film);
        const float part = larger(fall * a, -fall * b) / (thick * thick);
        return rate * larger(part, 1.0f);
    };
    float most = 0.0f;
    FLUX
    // stiffness and largest displacement a second, at the start of the step
    int stiff = 0, pace = 0;
    for (int turn = 0; turn < 2; ++turn) {
        for (long i = top; i <= bottom; ++i) {
            int highest = 0;
            for (int axis = 0; axis < 2; ++axis) {
                if (axis == 0 ? (i < row_0 || i > row_1) : i == bottom) continue;
                const long from = i * w + (axis ? column_0 : left);
                const long to = i * w + (axis ? column_1 : right - 1);
                const long next = axis ? w : 1, side = axis ? 1 : w;
                const float* __restrict drop = axis ? drop_y : drop_x;
                const float* __restrict beside = axis ? drop_x : drop_y;
                const float* __restrict factor = axis ? side_y : side_x;
                float* __restrict first = axis ? first_y : first_x;
                if (turn == 0) {
                    for (long p = from; p <= to; ++p) {
                        const Flux f = flux_of(p, p + next, side, drop[p], factor, beside);
                        const int one = bits(f.stiff);
                        highest = one > highest ? one : highest;
                    }
                    stiff = highest > stiff ? highest : stiff;
                    continue;
                }
                for (long p = from; p <= to; ++p) {
                    const Flux f = flux_of(p, p + next, side, drop[p], factor, beside);
                    const float amount = larger(smaller(f.rate * f.fall, f.most), f.least);
                    first[p] = amount;
                    const float part = 2.0f / (f.sum + 1000.0f * film);
                    const float steep = part * (f.fall < 0.0f ? -f.fall : f.fall);
                    const float faster = 1.0f + smaller(steep, STEEPEST);
                    const int one = bits((amount < 0.0f ? -amount : amount) * part * faster);
                    highest = one > highest ? one : highest;
                }
                pace = highest > pace ? highest : pace;
            }
        }
        most = __builtin_bit_cast(float, stiff);
    }

    double poured = 0.0;
    for (long i = vents[0]; i <= vents[1]; ++i)
        for (long j = vents[2]; j <= vents[3]; ++j)
            poured = source[i * w + j] > poured ? source[i * w + j] : poured;
    const double thickest = s.peaks.data[0];
    double step = clock[5] > 0.0 ? GROWTH * clock[5] : clock[3];
    // where lava comes out, by half of the thickness at most
    const double added = 0.5 * thickest + 1000.0 * film;
    if (poured * step > added) step = added / poured;
    const double fastest = __builtin_bit_cast(float, pace);
    if (fastest * step > DISPLACEMENT) step = DISPLACEMENT / fastest;
    if (step > clock[3]) step = clock[3];
    double full = step;
    if (step > clock[2] - clock[0]) step = clock[2] - clock[0];
    // lava that comes out makes it stiffer within the step
    const double grown = thickest > 0.0 ? 1.0 + poured * step / thickest : 1.0;
    const double stiffness = 4.0 * most * grown * grown * grown + 1e-30;
    auto reach = [](int n) { return STABLE * 0.25 * (n * n + n - 2.0); };
    int stages = 3;
    while (stages < MAX_STAGES && reach(stages) < step * stiffness) stages += 2;
    if (step > reach(stages) / stiffness) {
        step = reach(stages) / stiffness;
        full = step;
    }
    if (clock[0] + step > clock[6]) {
        clock[7] = step;
        return;
    }
    clock[5] = full;
    s.peaks.data[1] = stiffness;
    most = (float)(0.25 * stiffness);

    const double w1 = 4.0 / (stages * stages + stages - 2.0);
    double b = 1.0 / 3.0, former_b = b, poured_1 = 0.0, poured_2 = 0.0;
    float* newer_x = s.former_x.data;
    float* newer_y = s.former_y.data;
    float* older_x = s.flux_x.data;
    float* older_y = s.flux_y.data;
    for (int n = 1; n <= stages; ++n) {
        const double next_b = n == 1 ? b : (n * n + n - 2.0) / (2.0 * n * (n + 1.0));
        const double mu = n == 1 ? 0.0 : (2 * n - 1) * next_b / (n * b);
        const double nu = n <= 2 ? 0.0 : -(n - 1) * next_b / (n * former_b);
        const double now = n == 1 ? 0.0 : mu * w1 * step;
        const double begin = n == 1 ? b * w1 * step : -(1.0 - b) * mu * w1 * step;
        const double given = mu * poured_1 + nu * poured_2 + now + begin;
        poured_2 = poured_1, poured_1 = given;
        const float m = mu, v = nu, t = now, t0 = begin;
        auto update = [&](long i) {
            if (i < row_0 || i > row_1) return;
            const float* __restrict gx = older_x;
            const float* __restrict gy = older_y;
            for (long p = i * w + column_0; p <= i * w + column_1; ++p)
                y[p] = (float)h[p] + (gx[p - 1] - gx[p] + gy[p - w] - gy[p]);
            if (i >= vents[0] && i <= vents[1])
                for (long p = i * w + vents[2]; p <= i * w + vents[3]; ++p)
                    y[p] += (float)(given * source[p]);
            if (!is_open)
                for (long p = i * w + column_0; p <= i * w + column_1; ++p)
                    y[p] = kind[p] ? 0.0f : y[p];
        };
        for (long i = top; i <= bottom; ++i) {
            for (int axis = 0; axis < 2; ++axis) {
                if (axis == 0 ? (i < row_0 || i > row_1) : i == bottom) continue;
                const long from = i * w + (axis ? column_0 : left);
                const long to = i * w + (axis ? column_1 : right - 1);
                const long next = axis ? w : 1, side = axis ? 1 : w;
                const float* __restrict drop = axis ? drop_y : drop_x;
                const float* __restrict beside = axis ? drop_x : drop_y;
                const float* __restrict factor = axis ? side_y : side_x;
                const float* __restrict first = axis ? first_y : first_x;
                const float* __restrict newer = axis ? newer_y : newer_x;
                float* __restrict older = axis ? older_y : older_x;
                if (n == 1) {
                    for (long p = from; p <= to; ++p) older[p] = t0 * first[p];
                    continue;
                }
                for (long p = from; p <= to; ++p) {
                    const Flux f = flux_of(p, p + next, side, drop[p], factor, beside);
                    const float amount = larger(smaller(f.rate * f.fall, f.most), f.least);
                    older[p] = m * newer[p] + v * older[p] + t * amount + t0 * first[p];
                }
            }
            if (i >= top + LAG) update(i - LAG);
        }
        for (long i = bottom + 1 - LAG; i <= bottom; ++i) update(i);
        float* swap = newer_x;
        newer_x = older_x, older_x = swap;
        swap = newer_y;
        newer_y = older_y, older_y = swap;
        former_b = b, b = next_b;
    }
    // an odd number of stages leaves the last one in the fluxes
    float* __restrict gx = s.flux_x.data;
    float* __restrict gy = s.flux_y.data;

    // no cell gives more than it has
    auto out_of = [&](long p) {
        return larger(gx[p], 0.0f) + larger(-gx[p - 1], 0.0f) + larger(gy[p], 0.0f)
            + larger(-gy[p - w], 0.0f);
    };
    auto after = [&](long p) {
        return h[p] + ((double)gx[p - 1] - (double)gx[p]) + ((double)gy[p - w] - (double)gy[p]);
    };
    for (int turn = 0; turn < LIMITS; ++turn) {
        int is_overdrawn = 0;
        for (long i = row_0; i <= row_1; ++i)
            for (long p = i * w + column_0; p <= i * w + column_1; ++p)
                is_overdrawn |= after(p) < 0.0;
        if (!is_overdrawn) break;
        if (turn == 0) ++counts[3];
        // at last no cell gives more than it had at the start, whatever comes in
        const int is_last = turn == LIMITS - 1;
        for (long i = row_0; i <= row_1; ++i)
            for (long p = i * w + column_0; p <= i * w + column_1; ++p) {
                const float out = out_of(p) + 1e-30f, lacks = (float)after(p);
                const float has = is_last ? (float)h[p] : out + lacks;
                const float part = larger(0.999999f * has / out, 0.0f);
                y[p] = lacks < 0.0f || is_last ? smaller(part, 1.0f) : 1.0f;
            }
        for (long i = top; i <= bottom; ++i) {
            if (i >= row_0 && i <= row_1)
                for (long p = i * w + left; p < i * w + right; ++p)
                    gx[p] *= gx[p] > 0.0f ? y[p] : y[p + 1];
            if (i < bottom)
                for (long p = i * w + column_0; p <= i * w + column_1; ++p)
                    gy[p] *= gy[p] > 0.0f ? y[p] : y[p + w];
        }
    }

    double* lost = s.left.data;
    if (top == 0)
        for (long j = column_0; j <= column_1; ++j) lost[0] -= gy[j];
    if (bottom > last_row)
        for (long j = column_0; j <= column_1; ++j) lost[0] += gy[last_row * w + j];
    for (long i = row_0; i <= row_1; ++i) {
        if (left == 0) lost[0] -= gx[i * w];
        if (right > last_column) lost[0] += gx[i * w + last_column];
    }
    int highest = 0;
    long wet[4] = {top + 2, bottom - 2, left + 2, right - 2};
    for (long i = row_0; i <= row_1; ++i) {
        const long from = i * w + column_0, to = i * w + column_1;
        for (long p = from; p <= to; ++p) h[p] = after(p);
        if (i >= vents[0] && i <= vents[1])
            for (long p = i * w + vents[2]; p <= i * w + vents[3]; ++p) h[p] += step * source[p];
        if (!is_open)
            for (long p = from; p <= to; ++p)
                if (kind[p]) {
                    lost[kind[p] - 1] += h[p];
                    h[p] = 0.0;
                }
        int most_here = 0;
        for (long p = from; p <= to; ++p) {
            y[p] = (float)h[p];
            const int one = bits(y[p]);
            most_here = one > most_here ? one : most_here;
        }
        if (most_here <= bits(film)) continue;
        highest = most_here > highest ? most_here : highest;
        long first = from, last = to;
        while (y[first] <= film) ++first;
        while (y[last] <= film) --last;
        wet[0] = i < wet[0] ? i : wet[0];
        wet[1] = i > wet[1] ? i : wet[1];
        wet[2] = first - i * w < wet[2] ? first - i * w : wet[2];
        wet[3] = last - i * w > wet[3] ? last - i * w : wet[3];
    }
    box[0] = wet[0] > 2 ? wet[0] - 2 : 0;
    box[1] = wet[1] + 2 < s.rows ? wet[1] + 2 : s.rows - 1;
    box[2] = wet[2] > 2 ? wet[2] - 2 : 0;
    box[3] = wet[3] + 2 < w ? wet[3] + 2 : w - 1;
    s.peaks.data[0] = __builtin_bit_cast(float, highest);
    clock[0] = step < clock[2] - clock[0] ? clock[0] + step : clock[2];
    clock[1] = step;
    ++counts[0];
    counts[1] += stages;
    counts[2] = stages;
"""


@lru_cache
def face_law(effects: Effects) -> Any:
    """Return the device function of the speed at a face, None if lava is Newtonian.

    Of weight [N/m3], thickness [m], gradients of surface and ground along and across the flux, the
    fluidity [1/(Pa s)] and the yield strength [Pa] it returns the mobility on the map, u / |grad
    S|, and its bound (``laws.speed_function``) [m/s].
    """
    real = wp.float32
    vec2 = wp.types.vector(2, real)

    @wp.func
    def viscosity(law: FaceLaw, temperature: real) -> real:
        return law.viscosity

    @wp.func
    def held(law: FaceLaw, column: column_type(real)) -> real:
        return law.strength

    strength = held if effects.having('strength') else None
    speed = effects.function(
        'speed', wp, real, FaceLaw, column_type(real), viscosity, strength
    )
    if speed is None:
        return None
    along = effects.function('along', real)
    column_struct = column_type(real)

    @wp.func
    def at_face(
        law: FaceLaw, weight: real, height: real, surface_x: real, surface_y: real,
        ground_x: real, ground_y: real, fluidity: real, strength: real,
    ) -> vec2:
        own = law
        own.viscosity = real(1.0) / wp.max(fluidity, real(1e-30))
        own.strength = strength
        surface = vec2(surface_x, surface_y)
        column = column_struct()
        column.thickness = height
        column.normal_thickness = height
        column.slope = wp.length(surface)
        on_map = real(1.0)
        if wp.static(along is not None):
            layer = along(height, surface, vec2(ground_x, ground_y))
            column.normal_thickness = layer[0]
            column.slope = layer[1]
            on_map = layer[2]
        return on_map * speed(own, weight, column)

    return at_face


@lru_cache
def step_function(effects: Effects, *, is_uniform: bool) -> Any:
    """Return the device function that takes a step on a CPU.

    Args:
        effects: The effects that are on.
        is_uniform: True if all lava has the same viscosity, that of the first cell. Otherwise it
            carries heat, and steps are shorter.
    """
    law = face_law(effects)
    is_steep = effects.function('factor', wp.float32) is not None
    # of the lava at the start of the step: what enters a cell within it is as warm as there
    own = 'fluid * ((float)h[p] * fluidity[p] + (float)h[q] * fluidity[q])'
    own += ' / ((float)h[p] + (float)h[q] + 1e-30f)'
    parts = {
        'FLUX': _NEWTONIAN if law is None else _BY_LAW,
        'FLUID': 'fluid' if is_uniform else own,
        'UNIFORM': '* fluidity[0]' if is_uniform else '',
        'FACTOR': '* factor[p]' if is_steep else '',
        'SIDE': 'factor' if law is None else 'cross',
        'LAG': '0' if law is None else '1',
        'LAW': '' if law is None else law.native_func,
        'MAX_STAGES': MAX_STAGES,
        'DISPLACEMENT': DISPLACEMENT if is_uniform else HEATED_DISPLACEMENT,
        'GROWTH': GROWTH,
        'STABLE': _STABLE,
        'LIMITS': _LIMITS,
        'STEEPEST': f'{_STEEPEST}f',
    }
    code = _STEP
    for name, text in parts.items():
        code = code.replace(name, str(text))

    @wp.func_native(f'{{{code}}}')
    def take_step(s: Cells): ...

    @wp.func
    def step(s: Cells):
        if wp.static(law is not None):  # noqa: SIM102, what is called is compiled before
            if s.rows < 0:
                law(s.law, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        take_step(s)

    return step


@lru_cache
def step_kernel(effects: Effects, *, is_uniform: bool = True) -> Any:
    """Return the kernel that takes steps on a CPU, of lava whose viscosity does not change.

    It ends at ``clock[TARGET]``, or after a number of steps.
    """
    step = step_function(effects, is_uniform=is_uniform)

    @wp.kernel(
        module='unique', enable_backward=False, grid_stride=False,
        module_options={'enable_backward': False},
    )
    def take_steps(s: Cells, most: int):
        for _ in range(most):
            if s.clock[TIME] >= s.clock[TARGET]:
                break
            step(s)

    return take_steps
