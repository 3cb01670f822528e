# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Arrays, indices and structs of the kernels, and the one argument of all kernels of a stage."""

from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from lava_ros.effects import EFFECTS
from lava_ros.effects.effect import Array, join_names
from lava_ros.effects.heat import heat_type
from lava_ros.effects.laws import law_type
from lava_ros.errors import LavaError
from lava_ros.scene import Terrain

# Indices into State.clock.
TIME, STEP, TARGET, FULL_STEP, FORMER_STEP = range(5)

# Indices into State.limit_time.
LIMIT_TIME, MAX_END = range(2)

# Indices into State.stage: the weights of the current Runge-Kutta stage.
FORMER, BEFORE_FORMER, VELOCITY, FIRST_VELOCITY = range(4)

# Indices into State.counts.
PARTICLES, STEPS, LIMIT, FULL, STAGE, STAGES, IS_LAST, EVALUATIONS = range(8)
CURRENT, NEAR_BORDER, NEWCOMERS = range(8, 11)

# Indices into State.rates: reciprocals of the longest step that each limit allows [1/s].
DIFFUSION, ADVECTION = range(2)

#: Indices into ``left``: over the terrain's border, onto cells without data, and into the sea.
BORDER, HOLES, SEA = range(3)

#: Elevation above, or with a minus sign below, any other [m]; finite, as required in a checkpoint.
FAR = 1e30

#: Thickness over the expected thickness up to which the Helmholtz solve converges fully.
THICKEST = 2.0

#: Items after the last one that sums over neighbours may read (cells.py).
SPARE = 3

REAL = {'float32': wp.float32, 'float64': wp.float64}

#: The solver's own arrays, described in ``State``. A carried array has a twin named ``ordered_``
#: and its name, in the order of the cells.
ARRAYS = {
    'stage': Array('real', 4),
    'rates': Array('real', 2),
    'top': Array('real', 1),
    'share': Array('real'),
    'emission_time': Array('float64', is_carried=True),
    'velocity': Array('vec2', is_carried=True),
    'slope': Array('vec2'),
    'remainder': Array('vec2', is_carried=True),
    'temperature_remainder': Array('real', is_carried=True),
    'surface': Array('vec2'),
    'flow': Array('vec3'),
    'particle': Array('vec4'),
    'ordered': Array('vec4'),
    'base': Array('vec4', is_carried=True),
    'drift': Array('vec4', is_carried=True),
    'mean_temperature': Array('real', is_carried=True),
    'counts': Array('int32', 11),
    'chosen': Array('int32', 1),
    'cell': Array('int32'),
    'rank': Array('int32'),
    'members': Array('int32'),
    'home': Array('int32'),
    'clock': Array('float64', 5),
    'limit_time': Array('float64', 2),
    'left': Array('float64', 3),
}

#: Arrays of the cells of the terrain, which ``covered_cells.CoveredCells`` keeps.
CELL_MAPS = {
    'arrived': wp.array2d(dtype=wp.float32),
    'half_inundated': wp.array2d(dtype=wp.float32),
    'covered': wp.array2d(dtype=wp.int32),
    'bounds': wp.array(dtype=wp.int32),
}

#: Fields that kernels read in addition to arrays of ``State``.
_OTHERS = (*CELL_MAPS, 'ground', 'cells', 'constants', 'law', 'heat')

#: The arrays that effects add, by name.
_MORE_ARRAYS = join_names('arrays', EFFECTS, (*ARRAYS, *_OTHERS))


def kinds_of(real: Any) -> dict[str, Any]:
    """Return the Warp types by the names that an ``Array`` uses for them."""
    vectors = {f'vec{length}': wp.types.vector(length, real) for length in (2, 3, 4)}
    return {'real': real, 'int32': wp.int32, 'float64': wp.float64, **vectors}


@lru_cache
def ground_type(real: Any) -> Any:
    """Return the struct of a terrain: position from its centre [m], cells with data, elevation.

    It has the precision of the kernels that read it: converting numbers in each thread would cost
    more than reading them. ``elevation``, ``known`` and ``sea`` are as in ``StaggeredTerrain``.
    """

    @wp.struct
    class Ground:
        x0: real
        y0: real
        resolution: real
        rows: wp.int32
        columns: wp.int32
        elevation: wp.array2d(dtype=real)
        known: wp.array2d(dtype=wp.uint8)
        sea: wp.array2d(dtype=wp.uint8)

    return Ground


@lru_cache
def cell_frame(real: Any) -> Any:
    """Return the struct of the cell grid; positions are relative to the terrain's centre.

    ``rows_per_metre`` and ``columns_per_metre`` are one over a cell's sides [1/m]. ``first_row``
    and ``first_column`` locate the window in the grid of the whole terrain. Lava before column
    ``west`` or row ``south``, or at or beyond ``east`` or ``north``, is near the window's border.
    ``starts`` is the index of each cell's first ordered particle, shape [at least cells + 2]; the
    item after the last cell is the number of particles on the terrain, the next that of all.
    ``sizes`` counts the particles of each cell during binning, and is 0 otherwise.
    """

    @wp.struct
    class CellFrame:
        x0: real
        y0: real
        rows_per_metre: real
        columns_per_metre: real
        first_row: wp.int32
        first_column: wp.int32
        rows: wp.int32
        columns: wp.int32
        west: wp.int32
        south: wp.int32
        east: wp.int32
        north: wp.int32
        starts: wp.array(dtype=wp.int32)
        sizes: wp.array(dtype=wp.int32)

    return CellFrame


@lru_cache
def flow_constants_of(real: Any) -> Any:
    """Return the struct of the constants of the flow's equations.

    ``radius`` is the kernel radius [m], ``weight`` is rho g [N/m3], ``stiffness`` the diffusion
    rate of thickness at the kernel's stiffest wave number, over the diffusivity and over the
    diffusion number [1/m2], ``share`` one over the diffusion number, ``reach`` the maximum
    displacement in a step [m], ``gravity`` g [m/s2], ``mobile`` the maximum du/ds [m/s],
    ``thickest`` the thickness up to which the lateral stress is solved fully [m], and
    ``threshold`` the minimum thickness of lava that inundates ground [m].
    """

    @wp.struct
    class FlowConstants:
        radius: real
        weight: real
        stiffness: real
        share: real
        reach: real
        gravity: real
        mobile: real
        thickest: real
        threshold: real

    return FlowConstants


@lru_cache
def arguments_type(real: Any) -> Any:
    """Return the struct that kernels take: arrays of ``State``, ground, cells and constants."""
    kinds = kinds_of(real)
    types = {
        **CELL_MAPS,
        'ground': ground_type(real),
        'cells': cell_frame(real),
        'constants': flow_constants_of(real),
        'law': law_type(real),
        'heat': heat_type(real),
    }
    for name, array in (ARRAYS | _MORE_ARRAYS).items():
        types[name] = wp.array(dtype=kinds[array.dtype])
        if array.is_carried:
            types[f'ordered_{name}'] = types[name]
    members = {'__annotations__': types, '__module__': __name__}
    return wp.struct(type('MotionArguments', (), members))


@wp.func
def age_at(time: wp.float64, emission_time: wp.float64) -> wp.float64:
    """Return the age of lava [s] at a simulated time, never below 0 by rounding."""
    return wp.max(time - emission_time, wp.float64(0.0))


def count_in(counts: np.ndarray) -> int:
    """Return the number of particles in a copy of ``State.counts``."""
    return int(counts[PARTICLES] + counts[NEWCOMERS])


def fitting(
    name: str, values: np.ndarray | None, shape: tuple[int, ...], dtype: Any
) -> np.ndarray:
    """Return an array of a checkpoint if it has the right shape and type.

    Raises:
        LavaError: If it is missing, or has another shape or type. The error contains ``name``.
    """
    if values is None or (values.shape, values.dtype) != (shape, np.dtype(dtype)):
        found = 'missing' if values is None else f'{values.dtype} of shape {values.shape}'
        raise LavaError(f'checkpoint.{name}', found, f'{np.dtype(dtype)} of shape {shape}')
    return values


def centre_of(terrain: Terrain) -> np.ndarray:
    """Return the map position [m] of the origin of particle positions: the terrain's centre."""
    return np.array(terrain.centre)
