# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""When lava comes where, from looks at a flow, on its device.

Lava that was not there at a look and is there at the next came in between. Where it was there but
thin, its thickness grew evenly. Where it was not, the front ran evenly: new cells are numbered by
their distance from the lava of the look before, and each is as early as its number among those of
its branch, up to where that ends. Lava that is connected with none before came at once.
"""

from functools import partial
import math
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from lava_ros.simulation.backend.compiled import quick_kernel
from lava_ros.simulation.backend.memory import zeros
from lava_ros.simulation.backend.streams import read
from lava_ros.simulation.backend.threads import launch_over
from lava_ros.simulation.state import State, TIME

#: Sweeps over the cells in a launch, and launches between two questions whether the last one has
#: changed anything; by whether it is a GPU, whose threads see what others change meanwhile.
_SWEEPS = {True: (192, 2), False: (1, 16)}

# Places in _Looks.count.
_LOOKS = wp.constant(0)
_FLAW = wp.constant(1)
_NUMBERED = wp.constant(2)
_ENDED = wp.constant(3)
_COUNTS = 4

_NEVER = wp.constant(math.nan)

#: What a map cannot show, by its number in ``count[_FLAW]``.
_FLAWS = ('', 'thickness is not a number of metres', 'temperature is not a number of kelvin')


@wp.struct
class _Looks:
    """The arrays of ``Looks``; the lava of the look before, and what is known of each cell.

    ``look`` is the number from 1 on of the look that first saw lava there, 0 before. ``share`` is
    the share of the time between two looks that had passed then, -1 where a front ran. ``place``
    numbers those cells along a front, from 1 on, and ``last`` is the largest number of their
    branch. ``count`` has the looks so far, the number of a flaw, and whether the last sweep has
    changed numbers, and the largest ones. ``rows`` and ``columns`` are 1 where lava was.
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


@wp.func
def _is_beside(i: int, j: int, looks: _Looks) -> bool:
    """Whether there was lava around a cell at the look before."""
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
    """Compare a map with the one before."""
    i = thread // known.shape[1]
    j = thread % known.shape[1]
    if known[i, j] == wp.uint8(0):
        return
    height = thickness[i, j]
    heat = temperature[i, j]
    if not (wp.isfinite(height) and height >= wp.float32(0.0)):
        looks.count[_FLAW] = 1
        return
    if height > looks.thickness[i, j] or wp.isnan(looks.thickness[i, j]):
        looks.thickness[i, j] = height
    if height == wp.float32(0.0):
        return
    if not (wp.isfinite(heat) and heat > wp.float32(0.0)):
        looks.count[_FLAW] = 2
        return
    if heat > looks.temperature[i, j] or wp.isnan(looks.temperature[i, j]):
        looks.temperature[i, j] = heat
    if height < looks.threshold or looks.look[i, j] > 0:
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
def _keep(
    thread: int,
    thickness: wp.array2d(dtype=wp.float32),
    clock: wp.array(dtype=wp.float64),
    looks: _Looks,
):
    """Keep the map for the next look."""
    i = thread // thickness.shape[1]
    j = thread % thickness.shape[1]
    looks.former[i, j] = thickness[i, j]
    if thread == 0:
        looks.times[looks.count[_LOOKS]] = clock[TIME]
        looks.count[_LOOKS] += 1


@quick_kernel(fast_math=False)
def _mark(thread: int, looks: _Looks):
    """Mark the rows and the columns where lava was."""
    i = thread // looks.look.shape[1]
    j = thread % looks.look.shape[1]
    if looks.thickness[i, j] > wp.float32(0.0):
        looks.rows[i] = 1
        looks.columns[j] = 1


@wp.func
def _cell(thread: int, corner: wp.vec2i, columns: int) -> wp.vec2i:
    """Row and column of a cell of a part."""
    return corner + wp.vec2i(thread // columns, thread % columns)


@quick_kernel(fast_math=False)
def _number(
    thread: int, looks: _Looks, corner: wp.vec2i, columns: int, sweeps: int, is_last: bool
):
    """Number the new cells of a look from those beside lava on, whose number is 1."""
    cell = _cell(thread, corner, columns)
    i, j = cell[0], cell[1]
    own = looks.look[i, j]
    if own < 2:
        return
    for _ in range(sweeps):
        place = looks.place[i, j]
        for row in range(wp.max(i - 1, 0), wp.min(i + 2, looks.look.shape[0])):
            for column in range(wp.max(j - 1, 0), wp.min(j + 2, looks.look.shape[1])):
                other = looks.place[row, column]
                is_near = other > 0 and looks.look[row, column] == own
                if is_near and (place == 0 or place > other + 1):
                    place = other + 1
        if place != looks.place[i, j]:
            looks.place[i, j] = place
            if is_last:
                looks.count[_NUMBERED] = 1


@quick_kernel(fast_math=False)
def _end(
    thread: int, looks: _Looks, corner: wp.vec2i, columns: int, sweeps: int, is_last: bool
):
    """Find the largest number that rising numbers lead to."""
    cell = _cell(thread, corner, columns)
    i, j = cell[0], cell[1]
    place = looks.place[i, j]
    if place == 0:
        return
    for _ in range(sweeps):
        last = wp.max(looks.last[i, j], place)
        for row in range(wp.max(i - 1, 0), wp.min(i + 2, looks.look.shape[0])):
            for column in range(wp.max(j - 1, 0), wp.min(j + 2, looks.look.shape[1])):
                is_next = looks.place[row, column] == place + 1
                if is_next and looks.look[row, column] == looks.look[i, j]:
                    last = wp.max(last, looks.last[row, column])
        if last != looks.last[i, j]:
            looks.last[i, j] = last
            if is_last:
                looks.count[_ENDED] = 1


@quick_kernel(fast_math=False)
def _write(
    thread: int,
    looks: _Looks,
    corner: wp.vec2i,
    columns: int,
    shown: wp.array(dtype=wp.vec3d),
):
    """Write arrival, thickness and temperature of a part of the cells."""
    cell = _cell(thread, corner, columns)
    i, j = cell[0], cell[1]
    arrival = wp.float64(_NEVER)
    look = looks.look[i, j]
    if look > 0:
        share = wp.float64(looks.share[i, j])
        if share < wp.float64(0.0):
            share = wp.float64(0.0)
            if looks.place[i, j] > 0:
                place = wp.float64(looks.place[i, j]) - wp.float64(0.5)
                share = place / wp.float64(looks.last[i, j])
        before = looks.times[wp.max(look - 2, 0)]
        arrival = before + share * (looks.times[look - 1] - before)
    thickness, temperature = looks.thickness[i, j], looks.temperature[i, j]
    shown[thread] = wp.vec3d(arrival, wp.float64(thickness), wp.float64(temperature))


class Seen(NamedTuple):
    """What looks have seen of a part of the cells.

    Attributes:
        corner: Row and column of the part's first cell.
        arrival: Time of arrival [s], float64, shape [rows, columns] of the part; NaN where there
            was none.
        thickness: Largest thickness [m], float32, same shape; NaN where the terrain has no data.
        temperature: Highest temperature [K], float32, same shape; NaN without lava.
        flaw: What makes a look unfit to be shown as a map; empty when nothing does.
    """

    corner: tuple[int, int]
    arrival: np.ndarray
    thickness: np.ndarray
    temperature: np.ndarray
    flaw: str


class Looks:
    """First times and largest values of a flow, cell by cell."""

    def __init__(self, shape: tuple[int, int], threshold: float, most: int, device: Any) -> None:
        """Start without looks.

        Args:
            shape: Rows and columns.
            threshold: Thickness from which on lava has arrived [m], above 0.
            most: Looks there can be.
            device: Warp device.
        """
        self._shape, self._cells = shape, shape[0] * shape[1]
        self._looks = _Looks()
        self._looks.threshold = threshold
        maps = ('former', 'look', 'share', 'place', 'last')
        kinds = {name: (_Looks.__annotations__[name].dtype, self._cells) for name in maps}
        kinds['times'] = wp.float64, most
        kinds['noted'] = wp.int32, _COUNTS + sum(shape)
        arrays = zeros(kinds, device)
        arrays |= {name: arrays[name].reshape(shape) for name in maps}
        #: The counts and what ``_mark`` marks: one copy brings all of it to the host.
        self._noted = noted = arrays.pop('noted')
        ends = _COUNTS, _COUNTS + shape[0]
        arrays |= {'count': noted[: ends[0]], 'rows': noted[ends[0] : ends[1]]}
        unknown = wp.full((2, *shape), np.nan, dtype=wp.float32, device=device)
        arrays |= {'columns': noted[ends[1] :], 'thickness': unknown[0], 'temperature': unknown[1]}
        for name, array in arrays.items():
            setattr(self._looks, name, array)

    def take(self, state: State, known: Any, thickness: Any, temperature: Any) -> None:
        """Take a look, later than the one before.

        Args:
            state: The particles of the flow.
            known: 1 for cells with data, 0 for others, shape [rows, columns].
            thickness: Thickness [m], same shape.
            temperature: Temperature [K], same shape, NaN without lava.
        """
        launch = partial(launch_over, state, count=self._cells)
        launch(_compare, [known, thickness, temperature, self._looks])
        launch(_keep, [thickness, state.clock, self._looks])

    def flaw(self) -> str:
        """Say what makes a look unfit to be shown as a map; empty when nothing does."""
        return _FLAWS[read(self._looks.count)[_FLAW]]

    def seen(self, state: State, *, where_wet: bool = False) -> Seen:
        """What has been seen so far, of all cells or of the rectangle of wet ones."""
        launch_over(state, _mark, [self._looks], count=self._cells)
        counts, *marks = np.split(read(self._noted), np.cumsum((_COUNTS, self._shape[0])))
        first, shape = (0, 0), self._shape
        if where_wet:
            rows, columns = (np.flatnonzero(one).tolist() or [0, -1] for one in marks)
            first = rows[0], columns[0]
            shape = rows[-1] + 1 - first[0], columns[-1] + 1 - first[1]
        shown = wp.empty(shape[0] * shape[1], dtype=wp.vec3d, device=self._noted.device)
        if shown.size:
            self._show(state, shown, [self._looks, wp.vec2i(*first), shape[1]])
        arrival, thickness, temperature = np.moveaxis(read(shown).reshape(*shape, 3), -1, 0)
        kept = (one.astype(np.float32) for one in (thickness, temperature))
        return Seen(first, np.ascontiguousarray(arrival), *kept, _FLAWS[counts[_FLAW]])

    def _show(self, state: State, shown: Any, part: list[Any]) -> None:
        """Write arrival, thickness and temperature of a part: looks, corner and columns."""
        launch = partial(launch_over, state, count=shown.size)
        count, (sweeps, launches) = self._looks.count, _SWEEPS[state.device.is_cuda]
        has_changed = True
        while has_changed:
            count[_NUMBERED:].zero_()
            for kernel in (_number, _end):
                for number in range(launches):
                    launch(kernel, [*part, sweeps, number == launches - 1])
            launch(_write, [*part, shown])
            numbered, ended = read(count)[_NUMBERED:]
            if numbered:
                # those of too large numbers
                self._looks.last.zero_()
            has_changed = numbered or ended
