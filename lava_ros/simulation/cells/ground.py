# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The faces of cells by the ground, which solidified lava raises."""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.effects import Effects
from lava_ros.scene import Terrain
from lava_ros.simulation.backend.compiled import callable_name
from lava_ros.simulation.backend.memory import ArrayBlock, shared_array, shared_object
from lava_ros.simulation.cells.spans import WITHIN
from lava_ros.simulation.cells.state import Cells, CellState, FACES, Heat
from lava_ros.simulation.cells.threads import shared, THREADS
from lava_ros.simulation.particles.terrain import ringed_heights

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
    own = _FACTOR.replace('CALL', callable_name(factor)) if factor else '1.0f'
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


class _BareFaces:
    """Faces by the ground without solidified lava, which simulations share."""

    def __init__(self, terrain: Terrain, factor: Any, device: str) -> None:
        shape = tuple(number + 2 for number in terrain.shape)
        self.block = ArrayBlock(dict.fromkeys(FACES, (wp.float32, shape)), device)
        cells, heat = Cells(), Heat()
        (cells.rows, cells.stride), cells.cell = shape, terrain.resolution
        heat.elevation = shared_array(ringed_heights, terrain, wp.float64, device)
        heat.frozen = wp.zeros(shape, dtype=wp.float64, device=device)
        for name in FACES:
            setattr(cells, name, self.block[name])
        _lay(cells, heat, factor, device)


def _lay(cells: Any, heat: Any, factor: Any, device: Any) -> None:
    wp.launch(
        _ground_kernel(factor), dim=THREADS if wp.get_device(device).is_cuda else 1,
        block_dim=THREADS, inputs=[cells, heat], device=device,
    )


def lay_ground(
    state: CellState, heat: Any, effects: Effects, *, is_bare: bool = False
) -> None:
    """Make all faces fit the ground with the solidified lava.

    Args:
        state: The flow, whose faces are replaced if it does not own them.
        heat: The solidified lava (``HeatState``).
        effects: The effects that are on.
        is_bare: True if there is no solidified lava.
    """
    factor = effects.function('factor', wp.float32)
    bare = shared_object(_BareFaces, state.terrain, factor, str(state.device))
    is_shared = is_bare and not effects.any('freezes')
    # steps write to them where lava solidifies
    block = bare.block if is_shared else bare.block.copy()
    for name in FACES:
        setattr(state, name, block[name])
    state.ground = bare
    if not is_bare:
        _lay(state.argument(), heat.argument(), factor, state.device)
