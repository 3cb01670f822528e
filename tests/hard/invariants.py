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

"""What holds of every flow, however hard the scene: checked against a running simulation.

A ``Watch`` looks at a simulation between frames and says which invariant does not hold:

finite  Positions, volumes, temperatures, thicknesses, velocities, cells and the budget.
volume  What the vents gave is held, has left or has frozen, to ``VOLUME`` of it.
vents   What is due has come out: in a conduit is no more than the particles that come next.
climb, fall, place         heights.py
energy, heat, temperature  energy.py
cost                       cost.py

With ``Watch.renew`` a change from outside (a new terrain) is taken as it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain
import math

import numpy as np

from hard.cost import Cost
from hard.energy import Energy, Temperature
from hard.ground import Bound, Moment
from hard.heights import Dry, Heights
from lava_ros.simulation import Simulation, Snapshot

#: Largest share of the lava that may be unaccounted for.
VOLUME = 1e-5


@dataclass(frozen=True)
class Violation:
    """An invariant that does not hold: what was found, and what may be at most, when [s]."""

    invariant: str
    value: float
    bound: float
    time: float
    what: str = ''

    def __str__(self) -> str:
        """Say it in a line."""
        more = f' ({self.what})' if self.what else ''
        return f'{self.invariant} {self.value:.6g} > {self.bound:.6g} at {self.time:g} s{more}'


class InvariantError(AssertionError):
    """A simulation broke an invariant."""

    def __init__(self, violations: Iterable[Violation]) -> None:
        self.violations = tuple(violations)
        super().__init__('; '.join(map(str, self.violations)))


class Watch:
    """Checks a simulation frame by frame.

    Attributes:
        violations: What was found so far.
        largest: The worst value of each invariant over its bound so far, by name.
        cost: Counts steps and evaluations.
    """

    def __init__(
        self, simulation: Simulation, *, dry: Dry | None = None, raises: bool = True
    ) -> None:
        """Take the simulation as it is now, best before its first step.

        ``dry`` is where lava may not be; ``raises``, whether ``check`` raises what it finds.
        """
        self._simulation, self._raises = simulation, raises
        self.violations: list[Violation] = []
        self.largest: dict[str, float] = {}
        self._terrain = simulation.scene.terrain
        self._heights, self._energy, self.cost = Heights(dry), Energy(), Cost()
        self._temperature = Temperature(Moment(simulation))
        self.renew()

    def renew(self) -> None:
        """Take the simulation as it is, after vents or terrain were changed from outside."""
        moment = Moment(self._simulation)
        former, self._terrain = self._terrain, self._simulation.scene.terrain
        self._temperature.renew(moment)
        self._heights.renew(moment, former is not self._terrain)
        self._energy.renew(moment)
        self.cost.renew(moment)

    def look(self) -> None:
        """Take note of how high and thick the lava is at a moment between two checks."""
        moment = Moment(self._simulation)
        if len(moment.lava.volume):
            self._heights.look(moment)
            self._temperature.look(moment)

    def check(self, snapshot: Snapshot | None = None) -> list[Violation]:
        """Check every invariant at this moment, of which this is the snapshot.

        Raises:
            InvariantError: Something does not hold, and the watch raises.
        """
        if self._simulation.scene.terrain is not self._terrain:
            self.renew()
        moment = Moment(self._simulation)
        found = self._broken(moment, _whole(moment, snapshot or self._simulation.snapshot()))
        if not found:
            # numbers that are none say nothing about the rest
            hottest = self._temperature.hottest
            found = self._broken(moment, chain(
                self._temperature.check(moment), self._heights.check(moment),
                self._energy.check(moment, hottest), self.cost.check(moment),
            ))
        self.violations += found
        if found and self._raises:
            raise InvariantError(found)
        return found

    def _broken(self, moment: Moment, bounds: Iterator[Bound]) -> list[Violation]:
        found = []
        for name, value, most, what in bounds:
            share = value / most if most else (math.inf if value > 0.0 else 0.0)
            share = math.inf if math.isnan(value) else share
            self.largest[name] = max(self.largest.get(name, 0.0), share)
            if not value <= most:
                found.append(Violation(name, value, most, moment.time, what))
        return found


def _whole(moment: Moment, snapshot: Snapshot) -> Iterator[Bound]:
    """That there are numbers, and all of the volume."""
    lava, budget, known = moment.lava, snapshot.budget, snapshot.terrain.has_data
    names = ('position', 'volume', 'temperature', 'thickness', 'velocity')
    values = {
        **{name: getattr(lava, name) for name in names},
        'map thickness': snapshot.thickness[known],
        'map temperature': snapshot.temperature[known & (snapshot.thickness > 0.0)],
        'budget': np.array([budget.emitted, budget.held, budget.left, budget.frozen]),
    }
    bad = {name: int((~np.isfinite(array)).sum()) for name, array in values.items()}
    yield 'finite', sum(bad.values()), 0.0, ', '.join(name for name in bad if bad[name])
    yield 'volume', budget.error, VOLUME, ''
    yield 'vents', budget.late, 0.0, 'm3 that wait in them'
