# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Arrays of the solver on cells, and the interface between the flow and the heat of a step.

The grid is that of the terrain, with a ring of one cell around it. Every map has the shape
[rows + 2, columns + 2], row 0 southernmost, column 0 westernmost, and is contiguous: cell (i, j)
has the index i * stride + j. Item (i, j) of a map of faces belongs to the face between the cell
(i, j) and the next one along its row (``_x``, eastward) or its column (``_y``, northward).

A step (``flow.py``) leaves, for the heat of the same step (``heated_step.py``):

* ``flux_x``, ``flux_y``: thickness that has passed the face during the step, positive eastward and
  northward [m]. Times ``cell ** 2`` it is a volume, and over ``clock[LENGTH]`` a volume per time.
  Only faces within ``box`` are valid; those on its edge are 0. The thickness at the end of the
  step is exactly that at its start, plus what came in through the four faces, minus what went out,
  plus ``source * clock[LENGTH]``.
* ``clock[TIME]``: time at the end of the step [s], and ``clock[LENGTH]``: length of the step [s].
* ``thickness``: thickness at the end of the step [m]; never negative.
* ``box``: first and last row, first and last column of the window in which the step has moved
  lava. Lava moves by less than two cells in a step, and the window has a margin of two.
* ``source``: rate of emission [m/s], constant during a step.

The flow reads, at the beginning of a step: ``fluidity`` and ``strength`` of all cells of its box,
dry ones included (only lava-filled cells count), which the heat may rewrite after each step, and
``drop_x``, ``drop_y``, the ground. Lava that solidifies lowers ``thickness`` and raises the
ground: ``drop_x[i, j] = elevation[i, j] - elevation[i, j + 1]``, rounded once.

Cells with ``kind`` > 0 are outside of the ground: lava that enters leaves the simulation, and its
volume is added to ``left``.
"""

from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from lava_ros.effects.column import structure
from lava_ros.effects.heat import heat_type
from lava_ros.effects.laws import filled, law_type, law_values
from lava_ros.scene import Lava, Terrain
from lava_ros.simulation.backend.memory import ArrayBlock, shared_array
from lava_ros.simulation.particles.layout import BORDER, HOLES, SEA

#: Items of ``clock``, in s: time, and length of the latest step; time that no step may pass,
#: as the source changes there; longest step; time at or after which no step begins; length that
#: the latest step would have had without a stop; time after which no step ends; length of the step
#: that has not begun because it would, else 0; and the largest rate of emission [m/s].
TIME, LENGTH, UNTIL, LONGEST, TARGET, FULL, MAX_END, WAITING, POURED = range(9)

#: Items of ``counts``: steps, evaluations of all fluxes, stages of the latest step, steps after
#: which fluxes were reduced so that no cell has less than nothing.
STEPS, EVALUATIONS, STAGES, LIMITED = range(4)

#: Item of ``peaks``: largest thickness at the end of the latest step [m].
LARGEST, RATE = range(2)

#: Parts of a report of a launch (``worlds.py``): clock, counts, largest thickness [m], number of
#: the order, ``box``, ``CellMaps.bounds`` and ``left``.
CLOCK, COUNTS, THICKEST, NUMBER = slice(0, 9), slice(9, 13), 13, 14
BOX, BOUNDS, LEFT = slice(15, 19), slice(19, 23), slice(23, 26)

#: Thickness of a cell that lava covers wholly, over that of its thickest neighbour (covered.py).
EDGE = 0.25

#: ``HeatState.emission_time`` of a cell that lava has not reached, where ages count in place [s].
UNREACHED = 1e300

#: Arrays that the ground alone determines (``ground.lay_ground``).
FACES = 'drop_x', 'drop_y', 'factor_x', 'factor_y', 'cross_x', 'cross_y'

#: Arrays that lateral stress alone needs.
LATERAL = (
    'local_x', 'local_y', 'solved_x', 'solved_y', 'unsolved_x', 'unsolved_y', 'drag_x', 'drag_y',
)

#: Constants of the laws of flow, with viscosity and yield strength of one face.
FaceLaw = structure('FaceLaw', (*law_type(wp.float32).vars, 'strength'), wp.float32)


@wp.struct
class Cells:
    """Argument of all kernels of a step; arrays as in ``CellState``."""

    rows: int
    stride: int
    cell: wp.float32
    weight: wp.float32
    film: wp.float32
    law: FaceLaw
    thickness: wp.array2d(dtype=wp.float64)
    stage: wp.array2d(dtype=wp.float32)
    drop_x: wp.array2d(dtype=wp.float32)
    drop_y: wp.array2d(dtype=wp.float32)
    factor_x: wp.array2d(dtype=wp.float32)
    factor_y: wp.array2d(dtype=wp.float32)
    cross_x: wp.array2d(dtype=wp.float32)
    cross_y: wp.array2d(dtype=wp.float32)
    fluidity: wp.array2d(dtype=wp.float32)
    strength: wp.array2d(dtype=wp.float32)
    source: wp.array2d(dtype=wp.float64)
    flux_x: wp.array2d(dtype=wp.float32)
    flux_y: wp.array2d(dtype=wp.float32)
    former_x: wp.array2d(dtype=wp.float32)
    former_y: wp.array2d(dtype=wp.float32)
    mobility_x: wp.array2d(dtype=wp.float32)
    mobility_y: wp.array2d(dtype=wp.float32)
    held_x: wp.array2d(dtype=wp.float32)
    held_y: wp.array2d(dtype=wp.float32)
    first_x: wp.array2d(dtype=wp.float32)
    first_y: wp.array2d(dtype=wp.float32)
    local_x: wp.array2d(dtype=wp.float32)
    local_y: wp.array2d(dtype=wp.float32)
    solved_x: wp.array2d(dtype=wp.float32)
    solved_y: wp.array2d(dtype=wp.float32)
    unsolved_x: wp.array2d(dtype=wp.float32)
    unsolved_y: wp.array2d(dtype=wp.float32)
    drag_x: wp.array2d(dtype=wp.float32)
    drag_y: wp.array2d(dtype=wp.float32)
    kind: wp.array2d(dtype=wp.uint8)
    box: wp.array(dtype=wp.int32)
    vent_box: wp.array(dtype=wp.int32)
    clock: wp.array(dtype=wp.float64)
    counts: wp.array(dtype=wp.int32)
    peaks: wp.array(dtype=wp.float64)
    left: wp.array(dtype=wp.float64)
    gone: wp.array(dtype=wp.float64)
    slots: wp.array(dtype=wp.int32)
    spans: wp.array(dtype=wp.int32)


@wp.struct
class Heat:
    """Argument of the functions of the heat; arrays as in ``heat.HeatState``."""

    law: law_type(wp.float32)
    constants: heat_type(wp.float32)
    diffusivity: wp.float32
    emerging: wp.float32
    threshold: wp.float32
    temperature: wp.array2d(dtype=wp.float64)
    emission_time: wp.array2d(dtype=wp.float64)
    vent_temperature: wp.array2d(dtype=wp.float32)
    former: wp.array2d(dtype=wp.float32)
    warming: wp.array2d(dtype=wp.float32)
    renewal: wp.array2d(dtype=wp.float32)
    descent: wp.array2d(dtype=wp.float32)
    elevation: wp.array2d(dtype=wp.float64)
    frozen: wp.array2d(dtype=wp.float64)
    cold: wp.array(dtype=wp.int32)


@lru_cache(maxsize=64)
def layout_of(
    kind: Any, shape: tuple[int, int], without: tuple[str, ...] = (), **sizes: int
) -> dict[str, tuple[Any, tuple[int, ...]]]:
    """Return type and shape of the arrays of a struct, by name, for ``ArrayBlock``.

    They are maps of a shape, or have one of the ``sizes``; others have those ``without``.
    """
    return {
        name: (item.type.dtype, (sizes[name],) if name in sizes else shape)
        for name, item in kind.vars.items()
        if isinstance(item.type, wp.array) and name not in without
    }


class KernelState:
    """Arrays and constants of a struct of kernels, as attributes of the same names.

    Attributes:
        STRUCT: The Warp struct.
        block: The arrays. Each becomes an attribute when it is first used; others can replace it.
    """

    STRUCT: Any
    block: ArrayBlock

    def __getattr__(self, name: str) -> Any:
        """Return an array of the block."""
        if name == 'block' or name not in self.block:
            raise AttributeError(f'{type(self).__name__} has no {name}')
        array = self.block[name]
        setattr(self, name, array)
        return array

    def write(self, target: Any) -> None:
        """Write all to a C struct of kernels."""
        own = vars(self)
        for name in self.STRUCT.vars:
            value = own.get(name)
            if value is None and name in self.block:
                self.block.describe(name, target)
            elif value is None:
                # an array that no kernel of this simulation reads
                continue
            elif isinstance(value, dict):
                filled(getattr(target, name), value)
            else:
                setattr(target, name, value.__ctype__() if wp.types.is_array(value) else value)

    def argument(self) -> Any:
        """Return the argument of kernels."""
        struct = self.STRUCT()
        self.write(struct.__ctype__())
        return struct


class CellState(KernelState):
    """Lava on the cells of a terrain, on a device.

    Attributes:
        block: The arrays of this state alone.
        terrain: The ground without lava.
        cell: Side of a cell [m].
        weight: Density times gravity [N/m3].
        film: Thickness below which lava does not flow [m].
        law: Constants of the laws of flow, by name (``FaceLaw``).
        device: The Warp device.
        rows, stride: Shape of the maps.
        kind: 0 for ground, and 1 + ``BORDER``, ``HOLES`` or ``SEA``, uint8, a map.
        thickness: Vertical thickness [m], float64, a map.
        stage: Thickness at a stage of a step [m], float32, a map; may be negative there.
        drop_x, drop_y: Elevation of the ground of a cell minus that of the next one [m], float32,
            maps of faces.
        factor_x, factor_y: cos^4 of the ground's slope with ``steep``, else 1, float32, maps of
            faces.
        cross_x, cross_y: Gradient of the ground along the face, that is northward at faces between
            cells of a row and eastward between cells of a column, float32, maps of faces.
        fluidity: 1 / viscosity [1/(Pa s)], float32, a map.
        strength: Yield strength [Pa], float32, a map.
        source: Rate of emission [m/s], float64, a map; 0 outside of ``vent_box``.
        vent_box: First and last row, first and last column with a source, int32, shape [4].
        flux_x, flux_y: Thickness that has passed a face during the latest step [m], float32, maps
            of faces.
        former_x, former_y, first_x, first_y: Thickness passed until the stage before, and per time
            at the start of the step [m/s], float32, maps of faces.
        mobility_x, mobility_y, held_x, held_y: Constants of the faces in a step (``flow.py``),
            float32, maps of faces.
        local_x, local_y, solved_x, solved_y, unsolved_x, unsolved_y: Speeds by the local balance,
            over the size of a cell, and those of two sweeps of the lateral stress [1/s], float32,
            maps of faces; not allocated before it is on.
        drag_x, drag_y: Drag of the bed on these speeds times the area of a cell [m], float32, maps
            of faces; as these.
        box: First and last row, first and last column of the window, int32, shape [4].
        clock: Times (``TIME`` and following), float64, shape [9].
        counts: Counts (``STEPS`` and following), int32, shape [4].
        peaks: ``LARGEST`` [m] and ``RATE``, the stiffness of the latest step [1/s], float64.
        left: Volume over the cell area [m] that has left by ``BORDER``, ``HOLES``, ``SEA``,
            float64, shape [3].
        gone: The same of a row in the latest step, float64, shape [3 rows].
        slots: Maxima of a step and of the one before, int32, shape [32], on a GPU.
        spans: First and last column of a row that the lava can reach in the latest step, and the
            same that have lava (``spans.py``), int32, shape [4 rows].
        ground: Owner of the faces by the bare ground, which simulations share.
    """

    STRUCT = Cells
    thickness: Any
    stage: Any
    drop_x: Any
    drop_y: Any
    factor_x: Any
    factor_y: Any
    cross_x: Any
    cross_y: Any
    fluidity: Any
    strength: Any
    source: Any
    flux_x: Any
    flux_y: Any
    former_x: Any
    former_y: Any
    mobility_x: Any
    mobility_y: Any
    held_x: Any
    held_y: Any
    first_x: Any
    first_y: Any
    box: Any
    vent_box: Any
    clock: Any
    counts: Any
    peaks: Any
    left: Any
    gone: Any
    slots: Any
    spans: Any

    def __init__(
        self, terrain: Terrain, device: Any, *, lava: Lava, weight: float, film: float
    ) -> None:
        """Allocate for a terrain without lava, at time 0; the faces have no ground yet.

        Args:
            terrain: The ground.
            device: The Warp device.
            weight: Density times gravity [N/m3].
            film: Thickness below which lava does not flow [m].
            lava: The material.
        """
        self.terrain, self.cell, self.device = terrain, terrain.resolution, device
        self.weight, self.film, self.law = weight, film, law_values(lava)
        self.rows, self.stride = (count + 2 for count in terrain.shape)
        self.kind = shared_array(_kinds, terrain, wp.uint8, device)
        layout = layout_of(
            Cells, (self.rows, self.stride), ('kind', *FACES, *LATERAL), box=4, vent_box=4,
            clock=9, counts=4, peaks=2, left=3, gone=3 * self.rows, slots=32, spans=4 * self.rows,
        )
        self.block = ArrayBlock(layout, device)

    def allocate_lateral(self) -> None:
        """Allocate what lateral stress needs, if that is not done."""
        if LATERAL[0] not in vars(self):
            shape = self.rows, self.stride
            block = ArrayBlock(dict.fromkeys(LATERAL, (wp.float32, shape)), self.device)
            vars(self).update({name: block[name] for name in LATERAL})

    def map_of(self, name: str) -> np.ndarray:
        """Copy a map without the ring to the host, shape [rows, columns]."""
        values: np.ndarray = getattr(self, name).numpy()
        return values[1:-1, 1:-1].copy()


def _kinds(terrain: Terrain) -> np.ndarray:
    """Return ``CellState.kind`` of a terrain."""
    kind = np.full(np.add(terrain.shape, 2), 1 + BORDER, dtype=np.uint8)
    inner = np.where(np.isnan(terrain.elevation), 1 + HOLES, 0)
    kind[1:-1, 1:-1] = np.where(terrain.is_sea, 1 + SEA, inner)
    return kind
