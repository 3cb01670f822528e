# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Covered fraction of the terrain's cells, and times of arrival, of lava on cells.

Lava has reached a cell of the solver that is as thick as the threshold at the end of a step. If
the cell is ``EDGE`` times as thick as the thickest of its four neighbours, or thicker, it is
covered wholly. Otherwise it is the edge of a front that has come from that neighbour: the part
next to it is covered, thickness over ``EDGE`` times that of the neighbour. This fraction makes the
area of fronts and of lava that thins out equally accurate (docs/MODEL.md). A square of a cell of
the terrain (``output/covered_cells.py``) is covered if its middle is.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.scene.terrain import HALF, PARTS
from lava_ros.simulation.cells.spans import COLUMNS
from lava_ros.simulation.cells.state import Cells, EDGE
from lava_ros.simulation.cells.threads import shared
from lava_ros.simulation.output.covered_cells import WHOLE


@wp.struct
class Covered:
    """Ground of the terrain's cells that lava has covered (``layout.CELL_MAPS``).

    ``scale`` is the number of the solver's cells along a side of a terrain's cell, a power of two.
    """

    rows: int
    columns: int
    scale: wp.float32
    threshold: wp.float32
    known: wp.array2d(dtype=wp.uint8)
    arrived: wp.array2d(dtype=wp.float32)
    half_inundated: wp.array2d(dtype=wp.float32)
    covered: wp.array2d(dtype=wp.int32)
    bounds: wp.array(dtype=wp.int32)


_NOTE = """{
    const long w = s.stride, rows = record.rows, columns = record.columns;
    const float scale = record.scale, threshold = record.threshold;
    float* arrived = record.arrived.data;
    const float* y = s.stage.data;
    const double* source = s.source.data;
    const float time = (float)s.clock.data[0];
    auto clamped = [](long value, long low, long high) {
        return value < low ? low : value > high ? high : value;
    };
    // rows and columns of the terrain within the window of the solver
    auto of = [&](long place) { return (long)floorf((place - 1) / scale); };
    const long top = clamped(of(s.box.data[0]), 0, rows - 1);
    const long bottom = clamped(of(s.box.data[1]), 0, rows - 1);
    const long left = clamped(of(s.box.data[2]), 0, columns - 1);
    const long right = clamped(of(s.box.data[3]), 0, columns - 1);
    SHARED
    auto extend = [&](int place, long value) {
        if (value > record.bounds.data[place]) record.bounds.data[place] = (int)value;
    };
    if (is_first)
        extend(0, rows - top), extend(1, bottom + 1), extend(2, columns - left),
            extend(3, right + 1);
    COLUMNS
    // places of squares in cells of the solver
    auto place_of = [&](long cell, int part) {
        return (cell + (part + 0.5f) / PARTS) * scale + 1.0f;
    };
    auto row_of = [&](float place) { return clamped((long)place, 1, s.rows - 2); };
    auto column_of = [&](float place) { return clamped((long)place, 1, w - 2); };
    // a cell of the terrain that is no larger than the solver's is in one of them
    const bool is_one = scale <= 1.0f;
    int halvings = 0;
    while (scale * (1 << halvings) < 1.0f) ++halvings;
    auto one_of = [&](long j) { return clamped((j >> halvings) + 1, 1, w - 2); };
    // bits of the squares of a cell that the lava of the solver's cell (r, q) covers
    auto covered_by = [&](long i, long j, long r, long q) {
        const float* at = y + r * w + q;
        const float own = at[0];
        const float south = at[-w], north = at[w], west = at[-1], east = at[1];
        const float beside = west > east ? west : east, across = south > north ? south : north;
        const float whole = EDGE * (beside > across ? beside : across);
        int rows = 0, columns = 0, found = 0;
        for (int n = 0; n < PARTS; ++n) {
            const float up = place_of(i, n), along = place_of(j, n);
            // distance from the neighbour that is thickest, in cells
            const float from_row = south > north ? up - r : 1.0f - (up - r);
            const float from_column = west > east ? along - q : 1.0f - (along - q);
            const bool is_row = own >= whole || beside > across || from_row * whole <= own;
            const bool is_column = own >= whole || !(beside > across)
                || from_column * whole <= own;
            rows |= (is_row && row_of(up) == r) << n;
            columns |= (is_column && column_of(along) == q) << n;
        }
        for (int n = 0; n < PARTS; ++n)
            if (rows >> n & 1) found |= columns << n * PARTS;
        return found;
    };
    for (long i = first_of(top); i <= last_of(bottom); i += lines) {
        const long r_0 = row_of(place_of(i, 0)), r_1 = row_of(place_of(i, PARTS - 1));
        long from = s.box.data[3], to = s.box.data[2];
        for (long r = r_0; r <= r_1; ++r) {
            from = begin_of(r) < from ? begin_of(r) : from;
            to = end_of(r) > to ? end_of(r) : to;
        }
        from = from > to ? right + 1 : clamped(of(from), left, right);
        to = clamped(of(to), left, right);
        for (long j = from + lane; j <= to; j += lanes) {
            const long cell = i * columns + j;
            int bits = record.covered.data[cell];
            if (bits == WHOLE || !record.known.data[cell]) continue;
            // most others are dry
            if (is_one && y[r_0 * w + one_of(j)] < threshold) continue;
            const long q_0 = column_of(place_of(j, 0)), q_1 = column_of(place_of(j, PARTS - 1));
            bool is_touched = false;
            for (long r = r_0; r <= r_1; ++r)
                for (long q = q_0; q <= q_1; ++q) {
                    if (y[r * w + q] < threshold) continue;
                    is_touched = true;
                    bits |= covered_by(i, j, r, q);
                }
            if (!is_touched) continue;
            record.covered.data[cell] = bits;
            if (arrived[cell] < 0.0f) arrived[cell] = time;
            if (counted(bits) >= HALF && record.half_inundated.data[cell] < 0.0f)
                record.half_inundated.data[cell] = time;
        }
    }
    if (is_first_warp)
    for (long i = s.vent_box.data[0]; i <= s.vent_box.data[1]; ++i)
        for (long j = s.vent_box.data[2] + thread; j <= s.vent_box.data[3]; j += threads) {
            const long row = of(i), column = of(j);
            if (source[i * w + j] <= 0.0 || row < 0 || row >= rows || column < 0
                || column >= columns) continue;
            const long cell = row * columns + column;
            if (record.known.data[cell] && arrived[cell] < 0.0f) arrived[cell] = time;
        }
}"""


@lru_cache
def note_function(blocks: int = 1) -> Any:
    """Return the device function that records the ground covered at the end of a step.

    ``blocks`` is the number of blocks of a world on a GPU.
    """
    code = _NOTE
    for name, value in (
        ('SHARED', shared(blocks)), ('COLUMNS', COLUMNS),
        ('WHOLE', WHOLE), ('PARTS', PARTS), ('HALF', HALF), ('EDGE', f'{EDGE}f')
    ):
        code = code.replace(name, str(value))

    @wp.func_native(code)
    def note(s: Cells, record: Covered): ...

    return note
