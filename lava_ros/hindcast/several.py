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


"""Several runs of a case at once, turned and mirrored, and what they agree on.

A flow forks where decimetres decide, and which way it goes depends on the last digits of a sum.
Which cells half of the runs cover does not, and those of a case and of the same case turned are
the same: a run for each quarter turn, mirrored or not, makes the same set for both.

The runs lie side by side on one terrain, with cells without data between them: one simulation of
many small flows keeps a GPU busy that one of them would not.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
import math
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.choice import effects_for
from lava_ros.hindcast.case import Case
from lava_ros.hindcast.coarse import coarsened, refined
from lava_ros.hindcast.run import FORCED, Run, Settings
from lava_ros.hindcast.score import judge, Score, THRESHOLD
from lava_ros.hindcast.turned import restored, turned
from lava_ros.scene import Terrain
from lava_ros.simulation.snapshot import Snapshot

#: Most runs side by side.
MOST = 64

#: How far vents are moved for runs beyond the eight directions [m]: any length is a new draw.
_MOVED = 1e-3


@dataclass(frozen=True)
class Direction:
    """How a run lies to the case.

    Attributes:
        quarters: How often it is turned by 90 degrees, counterclockwise.
        mirror: Whether east and west are exchanged before.
        moved: How far its vents are moved eastwards [m].
    """

    quarters: int
    mirror: bool
    moved: float


def directions(runs: int) -> list[Direction]:
    """Directions of some runs: as it is, turned, mirrored and turned, and all of them again."""
    return [Direction(n % 4, n // 4 % 2 == 1, n // 8 * _MOVED) for n in range(runs)]


@dataclass(frozen=True, eq=False)
class Agreement:
    """What several runs have come to.

    Attributes:
        scores: The comparison of each run with the map.
        share: Share of the runs that cover each cell, float64, shape [rows, columns].
        thickness: Mean thickness, where at least half of the runs cover a cell, 0 elsewhere [m].
        majority: The comparison of where at least half of them do.
    """

    scores: tuple[Score, ...]
    share: np.ndarray
    thickness: np.ndarray
    majority: Score

    def as_dict(self) -> dict[str, Any]:
        """The numbers."""
        found = np.array([item.jaccard for item in self.scores])
        return {
            'count': len(found),
            'jaccard': [float(value) for value in found],
            'mean': float(found.mean()),
            'standard_deviation': float(found.std(ddof=1)) if len(found) > 1 else 0.0,
            'lowest': float(found.min()),
            'highest': float(found.max()),
            'length_error': [item.length_error for item in self.scores],
            'majority': self.majority.as_dict(),
        }


class Several:
    """Several runs on their way."""

    def __init__(
        self, case: Case, settings: Settings, runs: int, *, folder: Path | None = None
    ) -> None:
        """Begin, or go on where they were cut off.

        Args:
            case: The case.
            settings: How it is run.
            runs: How many there are.
            folder: Where what is needed to go on is kept, None for nowhere.

        Raises:
            LavaError: A setting is not usable, or the folder is of other runs.
        """
        runs = int(validation.number('--runs', runs, at_least=2, at_most=MOST))
        self.case = case
        self.directions = directions(runs)
        self._factor = settings.coarseness(case)
        self._accuracy = settings.accuracy(case)
        side_by_side = self._side_by_side()
        chosen = effects_for(
            replace(case.scene, terrain=coarsened(case.scene.terrain, self._factor)),
            {**FORCED, **settings.forced},
            accuracy=self._accuracy,
            horizon=case.duration,
        )
        settings = replace(settings, spacing=self._accuracy.spacing, forced=asdict(chosen))
        self.run = Run(side_by_side, settings, folder=folder)

    def maps(self) -> Iterator[tuple[float, list[np.ndarray] | None]]:
        """Simulate.

        Yields:
            The share of the time that is simulated, from time to time, and at each map the
            thickness of each run [m], shape [rows, columns] of the case.
        """
        for share, snapshot in self.run.snapshots():
            yield share, None if snapshot is None else self._apart(snapshot)

    def agreement(self) -> Agreement:
        """What they have come to."""
        return agreement(self.case, self._apart(self.run.result().snapshot))

    def _side_by_side(self) -> Case:
        """One case of all: on the coarser cells, as square as they can be put."""
        cases = [self._directed(item) for item in self.directions]
        ground = cases[0].scene.terrain
        accuracy = self._accuracy
        assert accuracy.spacing is not None
        gap = 2 + math.ceil(2.0 * accuracy.ratio * accuracy.spacing / ground.resolution)
        side = max(ground.shape) + gap
        across = math.ceil(math.sqrt(len(cases)))
        down = -(-len(cases) // across)
        self._corners = [(n // across * side, n % across * side) for n in range(len(cases))]
        shape = (down * side, across * side)

        def joined(grids: list[np.ndarray], nothing: float | bool) -> np.ndarray:
            whole = np.full(shape, nothing)
            for (row, column), grid in zip(self._corners, grids, strict=True):
                whole[row : row + grid.shape[0], column : column + grid.shape[1]] = grid
            return whole

        def joined_terrain(grounds: list[Terrain]) -> Terrain:
            elevation = joined([item.elevation for item in grounds], np.nan)
            return replace(ground, elevation=elevation, origin=(0.0, 0.0))

        vents = []
        for (row, column), case in zip(self._corners, cases, strict=True):
            x0, y0 = case.scene.terrain.origin
            right, up = column * ground.resolution - x0, row * ground.resolution - y0
            for vent in case.scene.vents:
                position = (vent.position[0] + right, vent.position[1] + up)
                end = vent.end and (vent.end[0] + right, vent.end[1] + up)
                vents.append(replace(vent, position=position, end=end))
        terrain = joined_terrain([case.scene.terrain for case in cases])
        return replace(
            self.case,
            scene=replace(self.case.scene, terrain=terrain, vents=tuple(vents)),
            footprint=np.zeros(shape, dtype=bool),
            events=tuple(
                replace(event, terrain=joined_terrain([c.events[n].terrain for c in cases]))
                for n, event in enumerate(self.case.events)
            ),
        )

    def _directed(self, direction: Direction) -> Case:
        case = self.case
        vents = tuple(
            replace(
                vent,
                position=(vent.position[0] + direction.moved, vent.position[1]),
                end=vent.end and (vent.end[0] + direction.moved, vent.end[1]),
            )
            for vent in case.scene.vents
        )
        case = replace(case, scene=replace(case.scene, vents=vents))
        case = turned(case, direction.quarters, mirror=direction.mirror)
        ground = coarsened(case.scene.terrain, self._factor)
        return replace(
            case,
            scene=replace(case.scene, terrain=ground),
            events=tuple(
                replace(event, terrain=coarsened(event.terrain, self._factor))
                for event in case.events
            ),
        )

    def _apart(self, snapshot: Snapshot) -> list[np.ndarray]:
        """Thickness of each run on the cells of the case."""
        found = []
        for direction, (row, column) in zip(self.directions, self._corners, strict=True):
            ground = turned(self.case, direction.quarters, mirror=direction.mirror).scene.terrain
            rows, columns = (-(-side // self._factor) for side in ground.shape)
            part = np.s_[row : row + rows, column : column + columns]
            alone = replace(
                snapshot,
                terrain=ground,
                thickness=snapshot.thickness[part],
                temperature=snapshot.temperature[part],
                frozen=None,
            )
            fine = refined(alone, ground, self._factor).thickness
            found.append(restored(fine, direction.quarters, mirror=direction.mirror))
        return found


def agreement(case: Case, maps: list[np.ndarray]) -> Agreement:
    """Compare runs with the map of their case, each and together.

    Args:
        case: The case.
        maps: Thickness of each run [m], shape [rows, columns].
    """
    covered = [np.nan_to_num(thickness) >= THRESHOLD for thickness in maps]
    share = np.mean(covered, axis=0)
    mean = np.mean([np.nan_to_num(thickness) for thickness in maps], axis=0)
    # a mean over runs that leave it dry may be less than what counts as covered
    thickness = np.where(share >= 0.5, np.maximum(mean, THRESHOLD), 0.0)
    return Agreement(
        scores=tuple(judge(case, thickness) for thickness in maps),
        share=share,
        thickness=thickness,
        majority=judge(case, thickness),
    )
