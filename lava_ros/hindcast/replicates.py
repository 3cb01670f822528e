# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Replicates: several rotated and mirrored runs of a case, and their agreement.

Where decimetres decide at a fork of a flow, its path depends on rounding errors. The cells that
half of the replicates cover do not depend on them. They are also the same for a rotated case: with
a run for each quarter turn, mirrored and not, a rotated case has the same set of runs.

On a GPU they run as a batch, because one run would not keep it busy; on the CPU they run one by
one.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.hindcast.case import Case
from lava_ros.hindcast.coarse import regridded
from lava_ros.hindcast.run import Result, Run, Settings
from lava_ros.hindcast.score import Score, score_case, score_snapshot
from lava_ros.runs.sinks import TimeSink
from lava_ros.scene import Terrain, Vent
from lava_ros.simulation.batch import side_by_side
from lava_ros.simulation.numerical_error import mean_difference
from lava_ros.simulation.output.snapshot import Snapshot
from lava_ros.simulation.setup.defaults import device_of

#: Maximum number of replicates.
MAX_REPLICATES = 64

#: Displacement of vents for runs beyond the eight directions [m]; any length gives a new sample.
_MOVED = 1e-3

#: Positions are multiples of this [m], so that rotating back and forth is exact, as forks of a
#: flow require.
_STEP = 2.0**-20

Place = tuple[float, float]


@dataclass(frozen=True)
class Orientation:
    """Orientation of a run: rotated by 90 degrees counterclockwise ``quarters`` times.

    With ``mirror``, east and west are exchanged first. Finally vents are moved along the rows by
    ``moved`` [m].
    """

    quarters: int
    mirror: bool = False
    moved: float = 0.0

    def rotate(self, case: Case) -> Case:
        """Rotate terrain, vents and outline of a case; the map origin remains a corner."""
        if self.mirror:
            case = _changed(case, lambda x, y, width, _: (width - x, y), np.fliplr)
        else:
            case = _changed(case, lambda x, y, *_: (x, y), np.asarray)
        for _ in range(self.quarters % 4):
            # row 0 is in the south, so numpy's rotation has the opposite sense
            case = _changed(
                case, lambda x, y, _, height: (height - y, x), lambda grid: np.rot90(grid, -1)
            )
        if self.moved:
            vents = _vents_at(case, lambda place: (place[0] + self.moved, place[1]))
            case = replace(case, scene=replace(case.scene, vents=vents))
        return case

    def rotate_back(self, values: np.ndarray) -> np.ndarray:
        """Rotate a map of the rotated case back, shape [rows, columns] of the case."""
        values = np.rot90(values, self.quarters)
        return np.ascontiguousarray(np.fliplr(values) if self.mirror else values)


def directions(runs: int) -> list[Orientation]:
    """Return the directions of some runs: original, rotated, mirrored, then repeated."""
    return [Orientation(n % 4, n // 4 % 2 == 1, n // 8 * _MOVED) for n in range(runs)]


@dataclass(frozen=True, eq=False)
class Agreement:
    """Scores of several runs, and of the cells that the majority of them inundates.

    ``share`` is the fraction of runs that inundate each cell, float64, shape [rows, columns];
    ``thickness`` is the mean thickness where at least half of the runs do, 0 elsewhere [m].
    """

    scores: tuple[Score, ...]
    share: np.ndarray
    thickness: np.ndarray
    majority: Score

    @property
    def chance(self) -> float:
        """Mean difference of two runs: cells in only one of them over cells in either."""
        return mean_difference(self.share, len(self.scores))

    def as_dict(self) -> dict[str, Any]:
        """Return the scores as plain data."""
        found = np.array([item.jaccard for item in self.scores])
        return {
            'count': len(found),
            'chance': self.chance,
            'jaccard': found.tolist(),
            'mean': float(found.mean()),
            'standard_deviation': float(found.std(ddof=1)) if len(found) > 1 else 0.0,
            'lowest': float(found.min()),
            'highest': float(found.max()),
            'length_error': [item.length_error for item in self.scores],
            'majority': asdict(self.majority),
        }


def run_replicates(
    case: Case,
    settings: Settings,
    runs: int,
    *,
    original: Result | None = None,
    folder: Path | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[Result]:
    """Run a case in several directions with ``run_together``.

    ``original`` is the result of the case itself if it has been run with these settings.
    """
    runs = validation.whole('--runs', runs, at_least=2, at_most=MAX_REPLICATES)
    jobs = [(case, direction) for direction in directions(runs)]
    # rounding of positions would make it a different run
    is_same = jobs[0][1].rotate(case).scene.vents == case.scene.vents
    made = [original] if original is not None and is_same else []
    return [*made, *run_together(jobs[len(made):], settings, folder=folder, progress=progress)]


def run_together(
    jobs: Sequence[tuple[Case, Orientation]],
    settings: Settings,
    *,
    folder: Path | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[Result]:
    """Run cases, each in a direction, or resume an interrupted set of runs.

    ``folder`` stores the state for a resume; None stores nothing. ``progress`` is called at each
    map with the simulated fraction of the time. Results are rotated back to the cells of the case.

    Raises:
        LavaError: If ``folder`` belongs to another case or other settings.
    """
    shares = np.zeros(len(jobs))
    results: dict[int, Result] = {}

    def route(number: int, case: Case, direction: Orientation) -> Iterator[None]:
        kept = None if folder is None else folder / f'run_{number:02d}'
        # all directions use the spacing, the thickness and the limit of the original case
        accuracy = settings.accuracy(case)
        same = replace(
            settings, spacing=accuracy.spacing, thickness=accuracy.thickness,
            mobility_limit=accuracy.mobility_limit,
        )
        run = Run(direction.rotate(case), same, folder=kept)

        def show(time: float) -> None:
            shares[number] = time / case.duration
            if progress is not None:
                progress(float(shares.mean()))

        yield from run.parts(TimeSink(settings.map_times(case), show, after=run.time))
        run.keep()
        result = run.result()
        run.close()
        ground = case.scene.ground_at(result.snapshot.time)
        snapshot = regridded(result.snapshot, ground, direction.rotate_back)
        results[number] = replace(result, snapshot=snapshot)

    routes = (route(number, *job) for number, job in enumerate(jobs))
    for _ in side_by_side(routes, str(device_of(settings.device, settings.method))):
        pass
    return [results[number] for number in range(len(jobs))]


def _changed(
    case: Case,
    change: Callable[[float, float, float, float], Place],
    grid: Callable[[np.ndarray], np.ndarray],
) -> Case:
    """Transform positions of a case, (x, y, width, height) from the corner, and its grids."""
    x0, y0, x1, y1 = case.scene.terrain.extent

    def place(point: Place) -> Place:
        from_corner = (_rounded(point[0] - x0), _rounded(point[1] - y0))
        x, y = change(*from_corner, x1 - x0, y1 - y0)
        return (x0 + _rounded(x), y0 + _rounded(y))

    def terrain(ground: Terrain) -> Terrain:
        return replace(ground, elevation=grid(ground.elevation))

    # vents and grids change together: a vent may be off the ground between the two
    bare = replace(case.scene, vents=()).on(terrain)
    # emplaced flows extend over the terrain of the case
    flows = tuple(
        replace(flow, thickness=grid(flow.thickness)) for flow in case.scene.emplaced_flows
    )
    scene = replace(bare, vents=_vents_at(case, place), emplaced_flows=flows)
    outlines = tuple(replace(item, footprint=grid(item.footprint)) for item in case.outlines)
    initial = None if case.initial is None else grid(case.initial)
    return replace(
        case, scene=scene, footprint=grid(case.footprint), outlines=outlines, initial=initial
    )


def _vents_at(case: Case, place: Callable[[Place], Place]) -> tuple[Vent, ...]:
    return tuple(
        replace(vent, position=place(vent.position), end=vent.end and place(vent.end))
        for vent in case.scene.vents
    )


def _rounded(length: float) -> float:
    return round(length / _STEP) * _STEP


def agreement(case: Case, snapshots: Sequence[Snapshot]) -> Agreement:
    """Compare final snapshots with the mapped flow field, one by one and combined."""
    share = np.mean([snapshot.footprint for snapshot in snapshots], axis=0)
    mean = np.mean([np.nan_to_num(snapshot.thickness) for snapshot in snapshots], axis=0)
    thickness = np.where(share >= 0.5, mean, 0.0)
    scores = tuple(score_snapshot(case, snapshot) for snapshot in snapshots)
    return Agreement(scores, share, thickness, score_case(case, thickness, share >= 0.5))
