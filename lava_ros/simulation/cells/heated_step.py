# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Heat of the lava on cells: it moves with the flow, is lost, stiffens the lava, and freezes it.

At the end of a step that has passed the thicknesses g through the faces of a cell (``state.py``),
the lava of the cell has the temperature

    T' = T + sum of g (T_f - T) / h',   g > 0 for what comes in,

h' the thickness after the step. So the heat of all cells changes only by what comes out of vents.
T_f is the temperature of the cell that the lava leaves, plus its difference at the face: half of
the limited slope of third order (Koren 1993), times 1 - C with C the fraction of the cell that
leaves. A cell next to dry ground has no slope. The time of emission moves in the same way.

Then every cell is a column of lava (effects/column.py), with the laws of all other columns. Lava
colder than the solidus becomes ground.

The functions work on a window of cells, in loops over rows that a CPU vectorises.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.effects import EFFECTS, Effects
from lava_ros.effects.column import column_type
from lava_ros.effects.heat import warming_function
from lava_ros.effects.laws import strength_function, viscosity_function
from lava_ros.simulation.backend.compiled import callable_name, on_cuda
from lava_ros.simulation.backend.vector_math import VECTOR_MATH
from lava_ros.simulation.cells.flow import step_function
from lava_ros.simulation.cells.ground import ground_function
from lava_ros.simulation.cells.limiter import KOREN
from lava_ros.simulation.cells.spans import WITHIN
from lava_ros.simulation.cells.state import Cells, EDGE, Heat, WAITING
from lava_ros.simulation.cells.threads import COLDEST, shared, SLOTS

_REAL = wp.float32

#: Instruction to the compiler; float64 in a loop would halve the number of its lanes.
_VECTORISED = '_Pragma("clang loop vectorize_width(8)")'

#: Changes of temperature and time of emission by transport.
_TRANSPORT = """
    SHARED
    WITHIN
    const long w = s.stride;
    const float step = (float)s.clock.data[1], film = s.film;
    const float* APART before = m.former.data;
    const double* APART after = s.thickness.data;
    const float* APART gx = s.flux_x.data;
    const float* APART gy = s.flux_y.data;
    const double* APART source = s.source.data;
    auto smaller = [](float a, float b) { return a < b ? a : b; };
    auto larger = [](float a, float b) { return a > b ? a : b; };
    KOREN
    struct Value { float lava, value; };
    // what g brings into a cell, from a neighbour or by leaving it: behind the neighbour is
    // ``beyond``, and ``opposite`` is the one on the other side
    auto brought = [&](float g, float lava, Value next, Value beyond, Value opposite) {
        const bool comes = g > 0.0f;
        const float given = comes ? next.value : 0.0f;
        const float back = comes ? beyond.value : opposite.value;
        const float ahead = comes ? 0.0f : next.value;
        const float has = comes ? next.lava : lava;
        const float has_back = comes ? beyond.lava : opposite.lava;
        const float has_ahead = comes ? lava : next.lava;
        const float stays = 1.0f - smaller(1.0f, (comes ? g : -g) / larger(has, 1e-9f));
        const float slope = 0.5f * stays * koren(given - back, ahead - given);
        return g * (given + (has_back > film && has_ahead > film ? slope : 0.0f));
    };
    auto transport = [&](long i, long from, long to, const double* APART value, auto fresh_value,
                         float* APART change) {
        // the ring is dry, so lava beyond it has no effect
        const long south = i > 1 ? 2 * w : w, north = i < s.rows - 2 ? 2 * w : w;
        VECTORISED
        for (long p = from; p <= to; p += lanes) {
            auto at = [&](long q) {
                Value v;
                v.lava = before[q], v.value = (float)(value[q] - value[p]);
                return v;
            };
            const Value west = at(p - 1), east = at(p + 1), below = at(p - w), above = at(p + w);
            const float from_west = gx[p - 1], from_east = -gx[p];
            const float from_below = gy[p - w], from_above = -gy[p];
            const float lava = before[p];
            const float fresh = (float)source[p] * step;
            const float own = fresh > 0.0f ? (float)(fresh_value(p) - value[p]) : 0.0f;
            const float total = fresh * own
                + brought(from_west, lava, west, at(p - 2), east)
                + brought(from_east, lava, east, at(p + 2), west)
                + brought(from_below, lava, below, at(p - south), above)
                + brought(from_above, lava, above, at(p + north), below);
            // more may pass through a cell in a step than it contains
            const float a = from_west > 0.0f ? west.value : 0.0f;
            const float b = from_east > 0.0f ? east.value : 0.0f;
            const float c = from_below > 0.0f ? below.value : 0.0f;
            const float d = from_above > 0.0f ? above.value : 0.0f;
            const float low = smaller(smaller(smaller(a, b), smaller(c, d)), smaller(own, 0.0f));
            const float high = larger(larger(larger(a, b), larger(c, d)), larger(own, 0.0f));
            const float h = (float)after[p];
            float moved = smaller(larger(total / larger(h, 1e-9f), low), high);
            CONDUCTION
            change[p] = h > 0.0f ? moved : 0.0f;
        }
    };
    const float* APART given = m.vent_temperature.data;
    FALL
    for (long i = first_of(top); i <= last_of(bottom); i += lines) {
        // only cells with lava
        long from = i * w + first_column(i) + lane, to = i * w + last_column(i);
        while (is_serial && from <= to && after[from] == 0.0) ++from;
        while (is_serial && from <= to && after[to] == 0.0) --to;
        transport(
            i, from, to, m.temperature.data, [&](long p) { return given[p]; }, m.warming.data);
        RENEWAL
        DESCENT
        if (lane == 0) m.cold.data[i] = 0;
    }
    together();
"""

#: The same for the time of emission, that of the middle of the step for lava that comes out.
_RENEWAL = """
        const double middle = s.clock.data[0] - 0.5 * s.clock.data[1];
        transport(
            i, from, to, m.emission_time.data, [&](long) { return middle; }, m.renewal.data);
"""

#: Heat that lava conducts from one cell to another, over the area of a cell.
_CONDUCTION = """
            const float spread = 2.0f * m.diffusivity * step / (s.cell * s.cell);
            // by the thicknesses after the step: a cell that has emptied is not heated by others
            auto conducted = [&](long q, Value v) {
                const float there = (float)after[q], both = there + h;
                return both > 0.0f ? spread * there / both * v.value : 0.0f;
            };
            moved += conducted(p - 1, west) + conducted(p + 1, east) + conducted(p - w, below)
                + conducted(p + w, above);
"""

#: Height by which the lava of a cell falls: that of the potential energy lost at its faces.
_FALL = """
    const float* APART drop_x = s.drop_x.data;
    const float* APART drop_y = s.drop_y.data;
    float* APART descent = m.descent.data;
    auto fallen = [&](long p, long q, float g, float drop) {
        const float a = (float)after[p], b = (float)after[q];
        const float fall = drop + 0.5f * (before[p] + a - before[q] - b);
        // what has left both cells takes its heat with it
        return g * fall / larger(larger(a + b, g > 0.0f ? g : -g), 1e-9f);
    };
"""
_DESCENT = """
        for (long p = from; p <= to; p += lanes)
            descent[p] = fallen(p - 1, p, gx[p - 1], drop_x[p - 1])
                + fallen(p, p + 1, gx[p], drop_x[p])
                + fallen(p - w, p, gy[p - w], drop_y[p - w])
                + fallen(p, p + w, gy[p], drop_y[p]);
"""

#: The column of each cell; marks rows in which one is colder than the solidus.
_EXCHANGE = """
    SHARED
    WITHIN
    const long w = s.stride;
    const float step = (float)s.clock.data[1], film = s.film, per_cell = 1.0f / s.cell;
    const double ended = s.clock.data[0], begun = ended - s.clock.data[1];
    const float* APART gx = s.flux_x.data;
    const float* APART gy = s.flux_y.data;
    const float* APART drop_x = s.drop_x.data;
    const float* APART drop_y = s.drop_y.data;
    const double* APART thickness = s.thickness.data;
    const double* APART source = s.source.data;
    const float* APART warming = m.warming.data;
    const float* APART renewal = m.renewal.data;
    const float* APART descent = m.descent.data;
    float* APART former = m.former.data;
    double* APART temperature = m.temperature.data;
    double* APART emission_time = m.emission_time.data;
    float* APART fluidity = s.fluidity.data;
    float* APART strength = s.strength.data;
    const float* APART y = s.stage.data;
    int coldest = 0;
    auto larger = [](float a, float b) { return a > b ? a : b; };
    for (long i = first_of(top); i <= last_of(bottom); i += lines) {
        // only cells with lava, now or before the step
        long from = i * w + first_column(i) + lane, to = i * w + last_column(i);
        while (is_serial && from <= to && thickness[from] == 0.0 && former[from] == 0.0f) ++from;
        while (is_serial && from <= to && thickness[to] == 0.0 && former[to] == 0.0f) --to;
        int cold = 0;
        EACH
        VECTORISED
        for (long p = from; p <= to; p += lanes) {
            const float h = (float)thickness[p];
            auto column = empty;
            // the edge of a front is thicker than its mean over the cell (covered.py)
            const float beside = larger(larger(y[p - 1], y[p + 1]), larger(y[p - w], y[p + w]));
            // and so is lava that comes out of a vent
            const float thinnest = source[p] > 0.0 ? m.emerging : film;
            column.thickness = larger(larger(h, thinnest), EDGE * beside);
            column.normal_thickness = column.thickness;
            column.slope = 0.0f, column.speed = 0.0f, column.drop = 0.0f, column.age = 0.0f;
            COSINE
            SPEED
            DROP
            AGE
            REACHED
            double now = temperature[p] + warming[p];
            WARM
            temperature[p] = now;
            column.temperature = (float)now;
            VISCOSITY
            STRENGTH
            former[p] = h;
            COLD
        }
        EACH
        MARK
    }
    RAISE
    together();
"""

#: Parts of the loop that effects need; ``CALL`` is the device function of each.
_PARTS = {
    'COSINE': """
        const float down_x = -0.5f * per_cell * (drop_x[p - 1] + drop_x[p]);
        const float down_y = -0.5f * per_cell * (drop_y[p - w] + drop_y[p]);
        column.normal_thickness *= sqrtf(CALL(wp::vec_t<2, float>(down_x, down_y)));
    """,
    'SPEED': """
        const float mean = larger(0.5f * (former[p] + h), film);
        const float x = gx[p - 1] + gx[p], y = gy[p - w] + gy[p];
        column.speed = 0.5f * s.cell * sqrtf(x * x + y * y)
            / (mean * larger(step, 1e-9f));
    """,
    'DROP': 'column.drop = descent[p] / larger(step, 1e-9f);',
    'AGE': """
        const double time = emission_time[p] + renewal[p];
        emission_time[p] = time;
        const float age = larger((float)(begun - time), 0.0f);
    """,
    'REACHED': """
        // the crust stays where it is: its age counts from when lava reached the cell
        const bool is_new = h >= m.threshold && ended < emission_time[p];
        const double time = is_new ? ended : emission_time[p];
        emission_time[p] = time;
        const float age = larger((float)(begun - time), 0.0f);
    """,
    'WARM': 'now += CALL(m.constants, column, (float)now, age, step);',
    'VISCOSITY': 'fluidity[p] = 1.0f / CALL(m.law, column.temperature);',
    'STRENGTH': 'column.age = age + step; strength[p] = CALL(m.law, column);',
    'COLD': 'cold |= h > 0.0f && column.temperature < m.constants.solidus;',
    'MARK': 'mark(m.cold.data + i, cold); coldest |= cold;',
    'RAISE': f'{SLOTS} raise(slots + {COLDEST}, coldest);',
}

#: A step longer than the age of a column needs a loop, which no compiler vectorises: on a CPU the
#: rows that have such a column.
_YOUNG = """
        int young = 0;
        for (long p = from; is_serial && p <= to; p += lanes)
            young |= IS_LAVA && begun - BEGUN < step;
        if (!is_serial || young) {ANY_STEP} else {EACH}
"""

#: Lava colder than the solidus becomes ground, in the rows that have any.
_FREEZE = """
    SHARED
    WITHIN
    const long w = s.stride;
    for (long i = first_of(top); i <= last_of(bottom); i += lines) {
        if (!m.cold.data[i]) continue;
        for (long p = i * w + first_column(i) + lane; p <= i * w + last_column(i); p += lanes) {
            const double h = s.thickness.data[p];
            if (h > 0.0 && (float)m.temperature.data[p] < m.constants.solidus) {
                m.frozen.data[p] += h;
                s.thickness.data[p] = 0.0;
                s.stage.data[p] = 0.0f;
                m.former.data[p] = 0.0f;
            }
        }
    }
    together();
"""

@dataclass(frozen=True)
class HeatFunctions:
    """Device functions of a window: of ``Cells``, ``Heat``, and first and last row and column.

    ``exchange`` marks the rows (``Heat.cold``) in which lava is colder than the solidus, which
    ``freeze`` makes ground.
    """

    transport: Any
    exchange: Any
    freeze: Any


@lru_cache
def heat_functions(effects: Effects, blocks: int = 1) -> HeatFunctions:
    """Return the device functions of the heat with some effects on.

    ``blocks`` is the number of blocks of a world on a GPU.
    """
    column_struct = column_type(_REAL)
    warming = straight = warming_function(VECTOR_MATH, _REAL, effects, is_straight=True)
    ages = any(EFFECTS[name].needs_age for name in effects.having('terms'))
    if ages:
        warming = warming_function(VECTOR_MATH, _REAL, effects)
    viscosity = viscosity_function(VECTOR_MATH, _REAL, effects)
    strength = strength_function(VECTOR_MATH, _REAL, effects)
    cosine_squared = effects.function('cosine_squared', _REAL)
    has_age, falls = effects.any('needs_age'), effects.any('needs_drop')
    in_place = effects.any('ages_in_place')
    moves_age = has_age and not in_place
    vec2 = wp.types.vector(2, _REAL)

    moving = _TRANSPORT
    for name, part, is_on in (
        ('KOREN', KOREN, True), ('RENEWAL', _RENEWAL, moves_age), ('FALL', _FALL, falls),
        ('CONDUCTION', _CONDUCTION, 'conduction' in effects), ('DESCENT', _DESCENT, falls),
    ):
        moving = moving.replace(name, part if is_on else '')
    exchanging = _EXCHANGE.replace('EDGE', f'{EDGE}f')
    for name, needed in (
        ('COSINE', cosine_squared), ('SPEED', effects.any('needs_speed')), ('DROP', falls),
        ('AGE', moves_age), ('REACHED', in_place), ('WARM', straight), ('VISCOSITY', viscosity),
        ('STRENGTH', strength),
        *((name, effects.any('freezes')) for name in ('COLD', 'MARK', 'RAISE')),
    ):
        part = _PARTS[name] if needed else ''
        if hasattr(needed, 'native_func'):
            part = part.replace('CALL', callable_name(needed))
        exchanging = exchanging.replace(name, part)
    before, each, after = exchanging.split('EACH')
    if ages:
        any_step = each.replace('VECTORISED', '')
        any_step = any_step.replace(callable_name(straight), callable_name(warming))
        is_lava, begun = 'thickness[p] > 0.0', '(emission_time[p] + renewal[p])'
        if in_place:
            is_lava, begun = '(float)thickness[p] >= m.threshold', 'emission_time[p]'
        each = _YOUNG.replace('ANY_STEP', any_step).replace('EACH', each)
        each = each.replace('IS_LAVA', is_lava).replace('BEGUN', begun)
    exchanging = before + each + after
    if not has_age:
        exchanging = exchanging.replace('age + step', '0.0f').replace('age, step', '0.0f, step')
    moving, exchanging, freezing = (
        f'{{{part}}}'.replace('SHARED', shared(blocks)).replace('VECTORISED', _VECTORISED)
        .replace('WITHIN', WITHIN) for part in (moving, exchanging, _FREEZE)
    )

    @wp.func_native(moving)
    def transport(s: Cells, m: Heat, top: int, bottom: int, left: int, right: int): ...

    @wp.func_native(exchanging)
    def exchange_native(
        s: Cells, m: Heat, top: int, bottom: int, left: int, right: int, empty: column_struct
    ): ...

    @wp.func
    def exchange(s: Cells, m: Heat, top: int, bottom: int, left: int, right: int):
        empty = column_struct()
        # never: what the native function calls is compiled before it
        if top < 0:
            if wp.static(warming is not None):
                empty.drop += warming(m.constants, empty, 0.0, 0.0, 0.0)
                empty.drop += straight(m.constants, empty, 0.0, 0.0, 0.0)
            if wp.static(strength is not None):
                empty.drop += strength(m.law, empty)
            if wp.static(cosine_squared is not None):
                empty.drop += cosine_squared(vec2())
            empty.drop += viscosity(m.law, 0.0)
        exchange_native(s, m, top, bottom, left, right, empty)

    @wp.func_native(freezing)
    def freeze(s: Cells, m: Heat, top: int, bottom: int, left: int, right: int): ...

    return HeatFunctions(transport, exchange, freeze)


@lru_cache
def heated_step_function(effects: Effects, blocks: int = 1) -> Any:
    """Return the device function that takes a step of lava that carries heat.

    ``blocks`` is the number of blocks of a world on a GPU.
    """
    step = step_function(effects, is_uniform=False, blocks=blocks)
    functions = heat_functions(effects, blocks)
    transport, exchange = functions.transport, functions.exchange
    freeze, raise_ground = functions.freeze, ground_function(
        effects.function('factor', _REAL), blocks
    )
    freezes = effects.any('freezes')

    @wp.func_native(on_cuda(f'{SLOTS} return slots[{COLDEST}];', 'return 1;'))
    def has_cold_rows(s: Cells) -> int: ...

    @wp.func
    def heated_step(s: Cells, m: Heat):
        # within the edge of the window, at which the step passes nothing
        top, bottom = s.box[0] + 1, s.box[1] - 1
        left, right = s.box[2] + 1, s.box[3] - 1
        step(s)
        if s.clock[WAITING] > wp.float64(0.0):
            return
        transport(s, m, top, bottom, left, right)
        exchange(s, m, top, bottom, left, right)
        # each of them ends with a barrier, and lava rarely freezes
        if wp.static(freezes):  # noqa: SIM102, it is not compiled otherwise
            if has_cold_rows(s) == 1:
                freeze(s, m, top, bottom, left, right)
                raise_ground(s, m, top - 1, bottom + 1, left - 1, right + 1)

    return heated_step
