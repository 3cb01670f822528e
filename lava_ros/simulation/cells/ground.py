# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The faces of cells by the ground, which solidified lava raises."""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.effects import Effects
from lava_ros.simulation.cells.state import Cells, Heat

#: Faces of a part of a row, by the ground with the solidified lava.
_RAISE = """
    const long w = s.stride, last_row = s.rows - 1;
    const double per_cell = 1.0 / s.cell;
    auto z = [&](long row, long j) {
        return m.elevation.data[row * w + j] + m.frozen.data[row * w + j];
    };
    auto eastward = [&](long row, long j) {
        const long a = j > 0 ? j - 1 : j, b = j < w - 1 ? j + 1 : j;
        return (z(row, b) - z(row, a)) * per_cell / (b - a);
    };
    auto northward = [&](long row, long j) {
        const long a = row > 0 ? row - 1 : row, b = row < last_row ? row + 1 : row;
        return (z(b, j) - z(a, j)) * per_cell / (b - a);
    };
    for (long j = first; j <= last; ++j) {
        const long p = i * w + j;
        if (j < w - 1) {
            const double drop = z(i, j) - z(i, j + 1);
            const double cross = 0.5 * (northward(i, j) + northward(i, j + 1));
            s.drop_x.data[p] = (float)drop, s.cross_x.data[p] = (float)cross;
            FACTOR_X
        }
        if (i < last_row) {
            const double drop = z(i, j) - z(i + 1, j);
            const double cross = 0.5 * (eastward(i, j) + eastward(i + 1, j));
            s.drop_y.data[p] = (float)drop, s.cross_y.data[p] = (float)cross;
            FACTOR_Y
        }
    }
"""

_FACTOR = """
            s.factor_AXIS.data[p] = CALL(wp::vec_t<2, float>(
                (float)(drop * per_cell), (float)cross));
"""


@lru_cache
def ground_function(effects: Effects) -> Any:
    """Return the device function that makes the faces of a part of a row fit the ground.

    Its arguments: ``Cells``, ``Heat``, row, first and last column.
    """
    factor = effects.function('factor', wp.float32)
    raising = _RAISE
    for axis in 'XY':
        part = _FACTOR.replace('AXIS', axis.lower()) if factor else ''
        raising = raising.replace(f'FACTOR_{axis}', part)
    raising = raising.replace('CALL', factor.native_func if factor else '')

    @wp.func_native(f'{{{raising}}}')
    def raise_native(s: Cells, m: Heat, i: int, first: int, last: int): ...

    @wp.func
    def raise_ground(s: Cells, m: Heat, i: int, first: int, last: int):
        if wp.static(factor is not None):  # noqa: SIM102, what is called is compiled before
            if i < 0:
                factor(wp.vec2())
        raise_native(s, m, i, first, last)

    return raise_ground


@lru_cache
def ground_kernel(effects: Effects) -> Any:
    """Return the kernel that makes the faces of a row, one per thread, fit the ground."""
    raise_ground = ground_function(effects)

    @wp.kernel(module='unique', enable_backward=False)
    def lay_ground(s: Cells, m: Heat):
        raise_ground(s, m, wp.tid(), 0, s.stride - 1)

    return lay_ground
