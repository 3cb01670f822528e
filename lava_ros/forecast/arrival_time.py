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

"""From looks at a flow, one after the other, to when lava came and how much of it."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from lava_ros.errors import LavaError

if TYPE_CHECKING:
    from lava_ros.simulation.simulation import Simulation


class Gathering:
    """First times and largest values, cell by cell.

    Lava that was not there at a look and is there at the next came in between. Where it was there
    but thin, its thickness grew evenly. Where it was not, the front ran evenly: new cells are
    numbered by their distance from the lava of the look before, and each is as early as its
    number among those of its branch, up to where that ends. Lava that is connected with none
    before came at once.

    Attributes:
        arrival: Time of arrival [s], float64, shape [rows, columns]; NaN where there was none.
        thickness: Largest thickness [m], float32, same shape; NaN outside the terrain.
        temperature: Highest temperature [K], float32, same shape; NaN without lava.
    """

    def __init__(self, threshold: float) -> None:
        """Start without looks; lava counts as arrived from ``threshold`` [m] on, above 0."""
        self._threshold = threshold
        self._time = 0.0
        self._last: np.ndarray | None = None
        self.arrival = np.empty((0, 0))
        self.thickness = np.empty((0, 0), dtype=np.float32)
        self.temperature = np.empty((0, 0), dtype=np.float32)

    def look(self, time: float, thickness: np.ndarray, temperature: np.ndarray) -> None:
        """Take a look, later than the one before.

        Args:
            time: When it is [s].
            thickness: Thickness [m], shape [rows, columns], NaN outside the terrain.
            temperature: Temperature [K], same shape, NaN without lava.
        """
        # NaN compares as False.
        is_there = thickness >= self._threshold
        if self._last is None:
            self.arrival = np.where(is_there, time, np.nan)
            self.thickness, self.temperature = thickness.copy(), temperature.copy()
        else:
            is_new = is_there & np.isnan(self.arrival)
            if is_new.any():
                share = passed(self._last, thickness, is_new, self._threshold)
                self.arrival[is_new] = self._time + share * (time - self._time)
            np.fmax(self.thickness, thickness, out=self.thickness)
            np.fmax(self.temperature, temperature, out=self.temperature)
        self._time, self._last = time, thickness


class Looking:
    """A simulation that runs from one look to the next, up to a horizon.

    Attributes:
        simulation: The simulation.
        gathered: What the looks have seen so far.
        steps: Statistics of the time steps, as of the last look.
        budget: Volume budget of the lava, as of the last look.
    """

    def __init__(
        self,
        simulation: 'Simulation',
        due: Sequence[float],
        *,
        threshold: float,
        max_particles: int | None,
        origin: float = 0.0,
        of: str = '',
    ) -> None:
        """Take the first look at once.

        Args:
            simulation: The simulation.
            due: Simulated times of the other looks [s], increasing.
            threshold: Thickness at which lava counts as arrived [m].
            max_particles: Most particles, None for any number.
            origin: Simulated time from which arrival times count [s].
            of: How errors refer to the simulation, such as ' of member 3'.

        Raises:
            LavaError: As in ``advance``.
        """
        self.simulation = simulation
        self.gathered = Gathering(threshold)
        self._due, self._done = due, 0
        self._max_particles, self._origin, self._of = max_particles, origin, of
        self._look()

    @property
    def progress(self) -> float:
        """Share of the looks that have been taken, the first one left out."""
        return self._done / len(self._due)

    @property
    def is_done(self) -> bool:
        """Whether all looks have been taken."""
        return self._done == len(self._due)

    def advance(self, wall_limit: float | None = None) -> None:
        """Run to the next look, or for about a wall time [s].

        Raises:
            LavaError: There are too many particles, or the flow can be shown as no map.
        """
        due = self._due[self._done]
        if self.simulation.advance(due, wall_limit=wall_limit) >= due:
            self._look()
            self._done += 1

    def advancing(self) -> Iterator[None]:
        """Run to the next look, in parts: while a GPU is at work others can go on.

        Raises:
            LavaError: As ``advance``.
        """
        yield from self.simulation.advancing(self._due[self._done])
        self._look()
        self._done += 1

    def _look(self) -> None:
        count = self.simulation.particle_count
        if self._max_particles is not None and count > self._max_particles:
            right = f'at most {self._max_particles} (max_particles)'
            raise LavaError(f'particles{self._of}', count, right)
        snapshot = self.simulation.snapshot()
        flaw = snapshot.flaw()
        if flaw:
            raise LavaError(f'flow{self._of}', flaw, 'one that can be shown as a map')
        self.steps, self.budget = snapshot.steps, snapshot.budget
        time = snapshot.time - self._origin
        self.gathered.look(time, snapshot.thickness, snapshot.temperature)


def passed(
    before: np.ndarray, after: np.ndarray, is_new: np.ndarray, threshold: float
) -> np.ndarray:
    """Say which share of the time between two looks had passed when lava came.

    Args:
        before: Thickness at the first [m], shape [rows, columns].
        after: Thickness at the second [m], same shape.
        is_new: Cells in which it came, bool, same shape.
        threshold: Thickness from which on it is there [m].

    Returns:
        Shares of the cells in ``is_new``, 0 to 1, float64, in the order of the grid.
    """
    rows, columns = (np.nonzero(is_new.any(axis=axis))[0] for axis in (1, 0))
    # with the surroundings, which new lava has come from
    box = np.s_[max(0, rows[0] - 1) : rows[-1] + 2, max(0, columns[0] - 1) : columns[-1] + 2]
    place, last = _branches(before[box] >= threshold, is_new[box])
    new = is_new[box]
    place, last = place[new], last[new]
    ran = np.where(place > 0, (place - 0.5) / np.maximum(last, 1), 0.0)
    first, second = before[is_new].astype(np.float64), after[is_new].astype(np.float64)
    with np.errstate(invalid='ignore'):
        grew = (threshold - first) / (second - first)
    return np.where(first > 0.0, np.clip(grew, 0.0, 1.0), ran)


def _branches(old: np.ndarray, new: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number new cells from the old ones on, and find the last number of each one's branch.

    Returns:
        Numbers from 1, int, shape [rows, columns], 0 for cells that are not new or not connected;
        and the largest number that can be reached from a cell by rising numbers.
    """
    place = np.zeros(new.shape, dtype=np.int32)
    reached, count = old, 0
    while True:
        step = _largest_around(reached) & new & (place == 0)
        if not step.any():
            break
        count += 1
        place[step] = count
        reached = step
    last = place.copy()
    for number in range(count - 1, 0, -1):
        ahead = np.where(place == number + 1, last, 0)
        here = place == number
        last[here] = np.maximum(number, _largest_around(ahead)[here])
    return place, last


def _largest_around(values: np.ndarray) -> np.ndarray:
    """The largest value of a cell and its eight neighbours; of bools whether one is True."""
    result = values.copy()
    np.maximum(result[1:], values[:-1], out=result[1:])
    np.maximum(result[:-1], values[1:], out=result[:-1])
    wide = result.copy()
    np.maximum(wide[:, 1:], result[:, :-1], out=wide[:, 1:])
    np.maximum(wide[:, :-1], result[:, 1:], out=wide[:, :-1])
    return wide
