# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The faces of cells by the ground, which solidified lava raises."""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.effects import Effects
from lava_ros.simulation.cells.spans import WITHIN
from lava_ros.simulation.cells.state import Cells, Heat
from lava_ros.simulation.cells.threads import shared, THREADS

#: Faces of rows by the ground with the solidified lava: of all, or beside one that is marked.
_RAISE = """
    SHARED
    WITHIN
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
    const int* cold = m.cold.data;
    for (long i = first_of(top); i <= last_of(bottom); i += lines) {
        if (MARKED && !(cold[i] | cold[i > 0 ? i - 1 : i] | cold[i < last_row ? i + 1 : i]))
            continue;
        const long from = MARKED ? first_column(i) : left, to = MARKED ? last_column(i) : right;
        for (long j = from + lane; j <= to; j += lanes) {
            const long p = i * w + j;
            if (j < w - 1) {
                const double drop = z(i, j) - z(i, j + 1);
                const double cross = 0.5 * (northward(i, j) + northward(i, j + 1));
                s.drop_x.data[p] = (float)drop, s.cross_x.data[p] = (float)cross;
                s.factor_x.data[p] = FACTOR;
            }
            if (i < last_row) {
                const double drop = z(i, j) - z(i + 1, j);
                const double cross = 0.5 * (eastward(i, j) + eastward(i + 1, j));
                s.drop_y.data[p] = (float)drop, s.cross_y.data[p] = (float)cross;
                s.factor_y.data[p] = FACTOR;
            }
        }
    }
    together();
"""

_FACTOR = 'CALL(wp::vec_t<2, float>((float)(drop * per_cell), (float)cross))'


@lru_cache
def ground_function(factor: Any, blocks: int = 1, *, is_whole: bool = False) -> Any:
    """Return the device function that makes the faces of a window fit the ground.

    Its arguments: ``Cells``, ``Heat``, first and last row and column.

    Args:
        factor: Function of effects for the fluxes on a slope, or None.
        blocks: Number of blocks of a world on a GPU.
        is_whole: True for all rows of the window, False for those beside marked ones
            (``Heat.cold``).
    """
    raising = _RAISE.replace('MARKED', 'false' if is_whole else 'true')
    own = _FACTOR.replace('CALL', factor.native_func) if factor else '1.0f'
    raising = raising.replace('FACTOR', own)
    raising = raising.replace('SHARED', shared(blocks)).replace('WITHIN', WITHIN)

    @wp.func_native(f'{{{raising}}}')
    def raise_native(s: Cells, m: Heat, top: int, bottom: int, left: int, right: int): ...

    @wp.func
    def raise_ground(s: Cells, m: Heat, top: int, bottom: int, left: int, right: int):
        if wp.static(factor is not None):  # noqa: SIM102, what is called is compiled before
            if top < 0:
                factor(wp.vec2())
        raise_native(s, m, top, bottom, left, right)

    return raise_ground


@lru_cache
def _ground_kernel(factor: Any) -> Any:
    raise_ground = ground_function(factor, is_whole=True)

    @wp.kernel(
        module='unique', enable_backward=False, grid_stride=False, launch_bounds=THREADS,
        module_options={'enable_backward': False},
    )
    def lay(s: Cells, m: Heat):
        raise_ground(s, m, 0, s.rows - 1, 0, s.stride - 1)

    return lay


def lay_ground(cells: Any, heat: Any, effects: Effects) -> None:
    """Make all faces fit the ground with the solidified lava.

    Args:
        cells: Argument of kernels (``Cells``).
        heat: The same (``Heat``).
        effects: The effects that are on.
    """
    device = heat.elevation.device
    wp.launch(
        _ground_kernel(effects.function('factor', wp.float32)),
        dim=THREADS if device.is_cuda else 1, block_dim=THREADS, inputs=[cells, heat],
        device=device,
    )
