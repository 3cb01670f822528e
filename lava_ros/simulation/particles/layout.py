# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Arrays, indices and structs of the kernels, and the one argument of all kernels of a stage."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from lava_ros.effects import EFFECTS, Effects
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
MAX_SOLVED = 2.0

REAL = {'float32': wp.float32, 'float64': wp.float64}


class Form(NamedTuple):
    """Properties of particles and their steps for which kernels are compiled.

    Attributes:
        real: Warp scalar type.
        order: Order of super-time-stepping, 1 for steps of one stage.
        is_staged: True if steps have several stages.
        is_guarded: True if displacements are limited; a step of fixed length is not.
        has_velocity: True if particles have momentum.
        has_remainder: True if they carry rounding errors, with float32.
        has_temperature_remainder: True if they carry the rounding error of the temperature.
        has_mean: True if the mean temperature around a particle decides how it moves.
        has_age: True if particles know their time of emission.
        has_slope: True if the slope of the surface is kept for the heat balance.
        has_surface: True if the gradient needs the surface at the particles. With momentum it is
            always the pairwise energy gradient, which a bore needs.
        has_empty: True if particles without volume, frozen or merged, are dropped. Otherwise no
            pass follows the motion, and the motion itself assigns the particles to cells.
        is_ranked_again: True if particles rank in their cells by number, not in the order of GPU
            atomics.
    """

    real: Any
    order: int
    is_staged: bool
    is_guarded: bool
    has_velocity: bool
    has_remainder: bool
    has_temperature_remainder: bool
    has_mean: bool
    has_age: bool
    has_slope: bool
    has_surface: bool
    has_empty: bool
    is_ranked_again: bool


def array(text: str, dtype: str, *shape: int | str, **options: Any) -> Any:
    """Return a dataclass field for an ``Array``; ``text`` states its contents."""
    one = Array(dtype, shape, **options)
    return field(default=None, repr=False, metadata={'array': one, 'text': text})


def declarations(kind: type) -> dict[str, Array]:
    """Return the arrays that a dataclass declares, by name."""
    return {item.name: item.metadata['array'] for item in fields(kind)}


@dataclass(eq=False)
class Arrays:
    """Every array that the kernels of a step read and write; None if it is not needed.

    Effects declare additional arrays in their own files (``Effect.arrays``).
    """

    # particles: each has the same number in all of these
    particle: wp.array = array(
        "x and y from the terrain's centre [m], volume [m3], temperature [K]", 'vec4', 'particle'
    )
    remainder: wp.array = array(
        'rounding error of the position [m], without which slow lava far from the centre would '
        'never move', 'vec2', 'particle', only_if='has_remainder', is_carried=True,
    )
    temperature_remainder: wp.array = array(
        'rounding error of the temperature [K], without which lava would not cool in short steps',
        'real', 'particle', only_if='has_temperature_remainder', is_carried=True,
    )
    emission_time: wp.array = array(
        'simulated time of the emission [s]; an age is the clock minus this time', 'float64',
        'particle', only_if='has_age', is_carried=True,
    )
    velocity: wp.array = array(
        'velocity in the middle of the latest step [m/s]', 'vec2', 'particle',
        only_if='has_velocity', is_carried=True,
    )
    base: wp.array = array(
        'position at the start of the step, and displacement since then two stages ago [m]',
        'vec4', 'particle', only_if='is_staged', is_carried=True, is_of_step=True,
    )
    drift: wp.array = array(
        'displacement one stage ago [m], and velocity at the start of the step [m/s]', 'vec4',
        'particle', only_if='is_staged', is_carried=True, is_of_step=True,
    )
    mean_temperature: wp.array = array(
        'mean temperature around the particle at the start of the step [K]', 'real', 'particle',
        only_if='has_mean', is_carried=True, is_of_step=True,
    )
    cell: wp.array = array('cell of the neighbour grid', 'int32', 'particle')
    rank: wp.array = array('rank among the particles of its cell', 'int32', 'particle')

    # ordered particles: sorted by the cells of the neighbour grid
    ordered: wp.array = array('as particle', 'vec4', 'particle')
    members: wp.array = array(
        'numbers of the particles of each cell, unsorted', 'int32', 'particle',
        only_if='is_ranked_again',
    )
    flow: wp.array = array('thickness [m], velocity x and y [m/s]', 'vec3', 'particle')
    slope: wp.array = array(
        'gradient of the lava surface', 'vec2', 'particle', only_if='has_slope'
    )
    surface: wp.array = array(
        'elevation of the lava surface [m], and area V / h [m2]', 'vec2', 'particle',
        only_if='has_surface',
    )
    contribution: wp.array = array(
        "contribution to a map: to a cell of unit weight, before the kernel's weight [m^(1/2)], "
        'or to the only cell [m]', 'real', 'particle',
    )
    home: wp.array = array(
        'number of the only cell that receives the volume, -1 if several do', 'int32', 'particle'
    )

    # the step
    clock: wp.array = array(
        'by TIME ... FORMER_STEP [s]: simulated time; step; target time; latest full step (of '
        'stages that idle: the step that would end too late); with inertia the previous step',
        'float64', 5, is_saved=True,
    )
    limit_time: wp.array = array(
        'by LIMIT_TIME, MAX_END [s]: time that no step may pass, at or after the target; time '
        'after which no step may end: one that would is not begun', 'float64', 2,
    )
    counts: wp.array = array(
        'by PARTICLES ... NEWCOMERS: particles; steps; limit of the latest step; 1 if the '
        'capacity was reached; current stage, 0 at the last one; stages of the step; 1 if the '
        'stage is the last; velocity evaluations; current stage including the last, 0 if stages '
        "idle; sides of the neighbour grid's window that particles are near (sum of 1 west, 2 "
        'south, 4 east, 8 north); particles emitted since the cells were built, which are not in '
        'the first count', 'int32', 11, is_saved=True,
    )
    chosen: wp.array = array(
        '1 from when a stage is chosen within its motion (fused_stage.py) until its end', 'int32',
        1,
    )
    stage: wp.array = array(
        'by FORMER ... FIRST_VELOCITY: weights of the current Runge-Kutta stage', 'real', 4,
        is_saved=True,
    )
    rates: wp.array = array(
        'by DIFFUSION, ADVECTION: one over the longest step that each limit allows [1/s]', 'real',
        2, is_saved=True,
    )
    top: wp.array = array(
        "highest ground that lava came from, above the terrain's mean elevation [m]", 'real', 1,
        is_saved=True,
    )
    left: wp.array = array(
        'by BORDER, HOLES, SEA: volume that has left the terrain [m3]', 'float64', 3,
        is_saved=True,
    )


@dataclass(eq=False)
class CellMaps:
    """The ground that lava has covered in each cell of the terrain (``covered_cells.py``)."""

    arrived: wp.array = array(
        'time at which lava touched the cell [s], -1 before', 'float32', 'row', 'column'
    )
    half_inundated: wp.array = array(
        'time at which lava had covered half of the cell [s], -1 before', 'float32', 'row',
        'column',
    )
    covered: wp.array = array(
        'squares of the cell that lava has covered, one bit each', 'int32', 'row', 'column'
    )
    bounds: wp.array = array(
        'rectangle of all cells in which particles have been: rows from the first one to the '
        "terrain's end, rows up to the last one, and the same for columns; 0 without", 'int32', 4,
    )


def _with_twins(arrays: Mapping[str, Array]) -> dict[str, Array]:
    """Return arrays and their twins in the order of the cells, by name."""
    twins = {
        f'ordered_{name}': one._replace(is_carried=False, is_of_step=False)
        for name, one in arrays.items() if one.is_carried
    }
    return {**arrays, **twins}


#: The arrays of the solver, by name, and those that kernels read of the terrain's cells.
ARRAYS, CELL_MAPS = _with_twins(declarations(Arrays)), declarations(CellMaps)

#: Fields that kernels read in addition to arrays of ``State``.
_OTHERS = (*CELL_MAPS, 'ground', 'cells', 'constants', 'law', 'heat')

#: The arrays that effects add, by name.
_MORE_ARRAYS = join_names('arrays', EFFECTS, (*ARRAYS, *_OTHERS))


def declared_arrays(form: Form, effects: Effects) -> dict[str, Array]:
    """Return the arrays of particles with some effects, by name."""
    own = {
        name: one for name, one in ARRAYS.items() if not one.only_if or getattr(form, one.only_if)
    }
    return own | _with_twins(effects.arrays)


def kinds_of(real: Any) -> dict[str, Any]:
    """Return the Warp types by the names that an ``Array`` uses for them."""
    vectors = {f'vec{length}': wp.types.vector(length, real) for length in (2, 3, 4)}
    numbers = {'int32': wp.int32, 'float32': wp.float32, 'float64': wp.float64}
    return {'real': real, **numbers, **vectors}


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
    item after the last cell is the number of particles on the terrain, the next the number of all.
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
    diffusion number [1/m2], ``inverse_diffusion_number`` one over it, ``reach`` the maximum
    displacement in a step [m], ``gravity`` g [m/s2], ``max_mobility`` the maximum du/ds [m/s],
    ``thickest`` the thickness up to which the lateral stress is solved fully [m], and
    ``threshold`` the minimum thickness of lava that inundates ground [m].
    """

    @wp.struct
    class FlowConstants:
        radius: real
        weight: real
        stiffness: real
        inverse_diffusion_number: real
        reach: real
        gravity: real
        max_mobility: real
        thickest: real
        threshold: real

    return FlowConstants


@lru_cache
def arguments_type(real: Any) -> Any:
    """Return the struct that kernels take: arrays of ``State``, ground, cells and constants.

    It is ``m`` in kernels and ``arguments`` on the host. docs/kernels.md lists the members that
    each kernel reads and writes.
    """
    kinds = kinds_of(real)
    types = {
        name: wp.array(dtype=kinds[one.dtype], ndim=len(one.shape))
        for name, one in (CELL_MAPS | ARRAYS | _with_twins(_MORE_ARRAYS)).items()
    }
    types |= {
        'ground': ground_type(real),
        'cells': cell_frame(real),
        'constants': flow_constants_of(real),
        'law': law_type(real),
        'heat': heat_type(real),
    }
    members = {'__annotations__': types, '__module__': __name__}
    return wp.struct(type('StageArguments', (), members))


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
