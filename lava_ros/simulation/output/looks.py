# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Peak values and first arrival times of a flow, from successive observations, on its device.

For lava of the thickness that inundates ground, arrival times are those that the simulation
records at its steps (``own_ground.py``). For another thickness they follow from the observations:
lava that is present in one observation but not in the previous one arrived in between. Where the
cell held thin lava before, its thickness grew linearly. Where it held none, the front advanced
evenly: new cells are numbered by their distance from the previous lava, and the arrival time is
proportional to the number of the cell over the largest of its branch. Lava that is not connected
with previous lava arrived at the previous observation.
"""

from functools import partial
import math
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from lava_ros.simulation.backend.compiled import any_in_block, quick_kernel
from lava_ros.simulation.backend.memory import read, zeros
from lava_ros.simulation.backend.threads import launch_over
from lava_ros.simulation.particles.layout import TIME
from lava_ros.simulation.particles.state import State

#: Threads of the block that follows the fronts of an observation.
_THREADS = 1024

# Indices into _Looks.count. The last four describe the rectangle of wet cells: rows from its first
# one to the map's end, and rows up to and including its last one; the same for columns.
_LOOKS = wp.constant(0)
_FLAW = wp.constant(1)
_ROWS_ON = wp.constant(2)
_ROWS = wp.constant(3)
_COLUMNS_ON = wp.constant(4)
_COLUMNS = wp.constant(5)
_COUNTS = 6

_NEVER = wp.constant(math.nan)

#: Reasons why a map cannot be shown, by the value of ``count[_FLAW]``.
_FLAWS = ('', 'thickness is not a number of metres', 'temperature is not a number of kelvin')


@wp.struct
class _Looks:
    """The arrays of ``Looks``: the previous observation, and the results for each cell.

    ``look`` is the number (from 1) of the observation that first had lava there, 0 before.
    ``share`` is the fraction of the time between the last two observations after which lava
    arrived, -1 where a front advanced. ``place`` numbers these cells along a front (from 1), and
    ``last`` is the largest number of their branch. ``count`` contains the number of observations,
    a flaw and the rectangle of wet cells; ``rows`` and ``columns`` are 1 where there was lava.
    ``noted`` contains the times recorded by the simulation; empty to derive them here.
    """

    threshold: wp.float32
    count: wp.array(dtype=wp.int32)
    rows: wp.array(dtype=wp.int32)
    columns: wp.array(dtype=wp.int32)
    times: wp.array(dtype=wp.float64)
    former: wp.array2d(dtype=wp.float32)
    look: wp.array2d(dtype=wp.int32)
    share: wp.array2d(dtype=wp.float32)
    place: wp.array2d(dtype=wp.int32)
    last: wp.array2d(dtype=wp.int32)
    thickness: wp.array2d(dtype=wp.float32)
    temperature: wp.array2d(dtype=wp.float32)
    noted: wp.array2d(dtype=wp.float32)


@wp.func
def _is_beside(i: int, j: int, looks: _Looks) -> bool:
    """Return True if a cell or a neighbour had lava in the previous observation."""
    for row in range(wp.max(i - 1, 0), wp.min(i + 2, looks.former.shape[0])):
        for column in range(wp.max(j - 1, 0), wp.min(j + 2, looks.former.shape[1])):
            if looks.former[row, column] >= looks.threshold:
                return True
    return False


@quick_kernel(fast_math=False)
def _compare(
    thread: int,
    known: wp.array2d(dtype=wp.uint8),
    thickness: wp.array2d(dtype=wp.float32),
    temperature: wp.array2d(dtype=wp.float32),
    looks: _Looks,
):
    """Compare a map with the previous one."""
    i = thread // known.shape[1]
    j = thread % known.shape[1]
    if known[i, j] == wp.uint8(0):
        return
    is_noted = looks.noted.shape[0] > 0
    if is_noted:  # noqa: SIM102, `and` would read an array that is empty
        # lava may have come and drained between two observations
        if looks.noted[i, j] >= wp.float32(0.0):
            looks.rows[i] = 1
            looks.columns[j] = 1
    height = thickness[i, j]
    heat = temperature[i, j]
    if not (wp.isfinite(height) and height >= wp.float32(0.0)):
        looks.count[_FLAW] = 1
        return
    if height > looks.thickness[i, j] or wp.isnan(looks.thickness[i, j]):
        looks.thickness[i, j] = height
    if height == wp.float32(0.0):
        return
    looks.rows[i] = 1
    looks.columns[j] = 1
    if not (wp.isfinite(heat) and heat > wp.float32(0.0)):
        looks.count[_FLAW] = 2
        return
    if heat > looks.temperature[i, j] or wp.isnan(looks.temperature[i, j]):
        looks.temperature[i, j] = heat
    if is_noted or height < looks.threshold or looks.look[i, j] > 0:
        return
    number = looks.count[_LOOKS] + 1
    looks.look[i, j] = number
    if number == 1:
        return
    before = wp.float64(looks.former[i, j])
    looks.share[i, j] = wp.float32(-1.0)
    if before > wp.float64(0.0):
        grew = (wp.float64(looks.threshold) - before) / (wp.float64(height) - before)
        looks.share[i, j] = wp.float32(wp.clamp(grew, wp.float64(0.0), wp.float64(1.0)))
    if _is_beside(i, j, looks):
        looks.place[i, j] = 1


@quick_kernel(fast_math=False)
def _keep(thread: int, thickness: wp.array2d(dtype=wp.float32), looks: _Looks):
    """Store the map for the next observation."""
    i = thread // thickness.shape[1]
    j = thread % thickness.shape[1]
    looks.former[i, j] = thickness[i, j]


@wp.func
def _place_of(i: int, j: int, number: int, looks: _Looks) -> int:
    """Return the number of a new cell: 1 next to lava, else one more than the least around."""
    place = looks.place[i, j]
    for row in range(wp.max(i - 1, 0), wp.min(i + 2, looks.look.shape[0])):
        for column in range(wp.max(j - 1, 0), wp.min(j + 2, looks.look.shape[1])):
            other = looks.place[row, column]
            is_near = other > 0 and looks.look[row, column] == number
            if is_near and (place == 0 or place > other + 1):
                place = other + 1
    return place


@wp.func
def _last_of(i: int, j: int, number: int, looks: _Looks) -> int:
    """Return the largest number that a path of rising numbers reaches from a new cell."""
    place = looks.place[i, j]
    last = wp.max(looks.last[i, j], place)
    for row in range(wp.max(i - 1, 0), wp.min(i + 2, looks.look.shape[0])):
        for column in range(wp.max(j - 1, 0), wp.min(j + 2, looks.look.shape[1])):
            if looks.place[row, column] == place + 1 and looks.look[row, column] == number:
                last = wp.max(last, looks.last[row, column])
    return last


@quick_kernel(fast_math=False, bounds=(_THREADS, 1))
def _follow(thread: int, threads: int, clock: wp.array(dtype=wp.float64), looks: _Looks):
    """Number the new cells along the fronts, in one block, and count the observation."""
    for i in range(thread, looks.look.shape[0], threads):
        if looks.rows[i] == 1:
            wp.atomic_max(looks.count, _ROWS_ON, looks.look.shape[0] - i)
            wp.atomic_max(looks.count, _ROWS, i + 1)
    for j in range(thread, looks.look.shape[1], threads):
        if looks.columns[j] == 1:
            wp.atomic_max(looks.count, _COLUMNS_ON, looks.look.shape[1] - j)
            wp.atomic_max(looks.count, _COLUMNS, j + 1)
    # wait for all threads
    any_in_block(False)
    first_row = looks.look.shape[0] - looks.count[_ROWS_ON]
    first_column = looks.look.shape[1] - looks.count[_COLUMNS_ON]
    # 0 if nothing has been wet: the product of two negative numbers would count cells
    columns = wp.max(looks.count[_COLUMNS] - first_column, 0)
    count = (looks.count[_ROWS] - first_row) * columns
    number = looks.count[_LOOKS] + 1
    has_changed = wp.bool(True)
    while has_changed:
        has_changed = wp.bool(False)
        for n in range(thread, count, threads):
            i = first_row + n // columns
            j = first_column + n % columns
            if looks.look[i, j] == number:
                place = _place_of(i, j, number, looks)
                if place != looks.place[i, j]:
                    looks.place[i, j] = place
                    has_changed = True
        has_changed = any_in_block(has_changed)
    has_changed = wp.bool(True)
    while has_changed:
        has_changed = wp.bool(False)
        for n in range(thread, count, threads):
            i = first_row + n // columns
            j = first_column + n % columns
            if looks.look[i, j] == number and looks.place[i, j] > 0:
                last = _last_of(i, j, number, looks)
                if last != looks.last[i, j]:
                    looks.last[i, j] = last
                    has_changed = True
        has_changed = any_in_block(has_changed)
    if thread == 0:
        looks.times[number - 1] = clock[TIME]
        looks.count[_LOOKS] = number


@quick_kernel(fast_math=False)
def _write(
    thread: int,
    looks: _Looks,
    first_row: int,
    first_column: int,
    columns: int,
    shown: wp.array(dtype=wp.vec3d),
):
    """Write arrival, thickness and temperature of a rectangle of cells."""
    i = first_row + thread // columns
    j = first_column + thread % columns
    arrival = wp.float64(_NEVER)
    look = looks.look[i, j]
    if looks.noted.shape[0] > 0:
        if looks.noted[i, j] >= wp.float32(0.0):
            arrival = wp.max(wp.float64(looks.noted[i, j]), looks.times[0])
    elif look > 0:
        share = wp.float64(looks.share[i, j])
        if share < wp.float64(0.0):
            share = wp.float64(0.0)
            if looks.place[i, j] > 0:
                place = wp.float64(looks.place[i, j]) - wp.float64(0.5)
                share = place / wp.float64(looks.last[i, j])
        before = looks.times[wp.max(look - 2, 0)]
        arrival = before + share * (looks.times[look - 1] - before)
    thickness = wp.float64(looks.thickness[i, j])
    # lava that came and drained between two observations was as thick as the threshold
    if looks.noted.shape[0] > 0 and arrival > looks.times[0]:
        thickness = wp.max(thickness, wp.float64(looks.threshold))
    shown[thread] = wp.vec3d(arrival, thickness, wp.float64(looks.temperature[i, j]))


class Seen(NamedTuple):
    """Results of all observations for a rectangle of cells.

    Attributes:
        corner: Row and column of the first cell.
        arrival: First arrival time [s], float64, shape [rows, columns] of the rectangle; NaN
            without arrival.
        thickness: Largest thickness [m], float32, same shape; NaN where the terrain has no data.
        temperature: Highest temperature [K], float32, same shape; NaN without lava.
        flaw: Reason why an observation cannot be shown as a map; empty if there is none.
    """

    corner: tuple[int, int]
    arrival: np.ndarray
    thickness: np.ndarray
    temperature: np.ndarray
    flaw: str


class Looks:
    """First arrival times and largest values of a flow in each cell."""

    def __init__(
        self,
        shape: tuple[int, int],
        threshold: float,
        most: int,
        device: Any,
        *,
        noted: Any = None,
    ) -> None:
        """Initialize without observations.

        Args:
            shape: Rows and columns.
            threshold: Lava has arrived where its thickness is at or above this value [m], > 0.
            most: Maximum number of observations.
            device: Warp device.
            noted: Times at which lava as thick as the threshold has reached each cell [s], -1
                before, written by the simulation; None to derive them from the observations.
        """
        self._shape, self._cells = shape, shape[0] * shape[1]
        self._looks = _Looks()
        self._looks.threshold = threshold
        maps = ('former', 'look', 'share', 'place', 'last')
        kinds = {name: (_Looks.__annotations__[name].dtype, self._cells) for name in maps}
        kinds['times'] = wp.float64, most
        kinds |= {'rows': (wp.int32, shape[0]), 'columns': (wp.int32, shape[1])}
        kinds['count'] = wp.int32, _COUNTS
        arrays = zeros(kinds, device)
        arrays |= {name: arrays[name].reshape(shape) for name in maps}
        unknown = wp.full((2, *shape), np.nan, dtype=wp.float32, device=device)
        arrays |= {'thickness': unknown[0], 'temperature': unknown[1]}
        if noted is None:
            noted = wp.empty((0, 0), dtype=wp.float32, device=device)
        arrays['noted'] = noted
        for name, array in arrays.items():
            setattr(self._looks, name, array)

    def take(self, state: State, known: Any, thickness: Any, temperature: Any) -> None:
        """Add an observation, later than the previous one.

        Args:
            state: The particles of the flow.
            known: 1 for cells with data, 0 for others, shape [rows, columns].
            thickness: Thickness [m], same shape.
            temperature: Temperature [K], same shape, NaN without lava.
        """
        launch = partial(launch_over, state, count=self._cells)
        launch(_compare, [known, thickness, temperature, self._looks])
        launch(_keep, [thickness, self._looks])
        threads = _THREADS if state.device.is_cuda else 1
        arguments = [threads, state.clock, self._looks]
        state.launches(_follow, arguments, dim=threads, block_dim=_THREADS)

    def flaw(self) -> str:
        """Return why an observation cannot be shown as a map; empty if there is no reason."""
        return _FLAWS[read(self._looks.count)[_FLAW]]

    def seen(self, state: State, *, where_wet: bool = False) -> Seen:
        """Return the results so far, for all cells or for the rectangle of wet ones."""
        counts = read(self._looks.count).tolist()
        first, shape = (0, 0), self._shape
        if where_wet:
            first = shape[0] - counts[_ROWS_ON], shape[1] - counts[_COLUMNS_ON]
            ends = counts[_ROWS], counts[_COLUMNS]
            shape = max(ends[0] - first[0], 0), max(ends[1] - first[1], 0)
        shown = wp.empty(shape[0] * shape[1], dtype=wp.vec3d, device=state.device)
        if shown.size:
            inputs = [self._looks, *first, shape[1], shown]
            launch_over(state, _write, inputs, count=shown.size)
        arrival, thickness, temperature = np.moveaxis(read(shown).reshape(*shape, 3), -1, 0)
        return Seen(
            first,
            np.ascontiguousarray(arrival),
            thickness.astype(np.float32),
            temperature.astype(np.float32),
            _FLAWS[counts[_FLAW]],
        )
