# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure the cost and the area of a mapped eruption by the limit of the mobility.

python docs/benchmarks/mobility_limit.py OUT.csv --case DIR [--material NAME] [--until SECONDS]
    [--limit U ...] [--runs N] [--workers N]

Each row is a limit, with the mean of some runs, rotated and mirrored, and the agreement of their
majority with that of the first limit. Scatter of the runs is the part of a difference by chance.
"""

import argparse
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
import platform
import time

from eruptions import version
import numpy as np

from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.replicates import directions, Orientation
from lava_ros.hindcast.run import Run, Settings
from lava_ros.hindcast.score import jaccard
from lava_ros.verification.rows import write_csv

#: Maxima of du/ds [m/s], 0 for none, and spacing [m].
LIMITS, SPACING = (0.0, 16.0, 4.2, 1.4, 0.7, 0.42), 13.9


@dataclass(frozen=True)
class Task:
    """One run."""

    case: str
    material: str
    spacing: float
    until: float
    limit: float
    direction: Orientation


def run(task: Task) -> tuple[np.ndarray, int, float]:
    """Return the footprint on the cells of the case, the steps, and the CPU time [s]."""
    case = load_case(task.case, material=task.material)
    settings = Settings(
        'draft', spacing=task.spacing, device='cpu', maps=1, mobility_limit=task.limit or None
    )
    own = Run(task.direction.rotate(case), settings)
    simulation = own._simulation
    begun = time.process_time()
    simulation.advance(min(task.until, case.duration))
    seconds = time.process_time() - begun
    footprint = own._refined(simulation.snapshot()).footprint
    return task.direction.rotate_back(footprint), simulation.steps, seconds


def row_of(
    args: argparse.Namespace, limit: float, found: Sequence[tuple[np.ndarray, int, float]],
    first: Sequence[tuple[np.ndarray, int, float]],
) -> dict[str, object]:
    """Return the row of a limit."""
    case = load_case(args.case, material=args.material)
    areas = np.array([grid.sum() for grid, *_ in found]) * case.scene.terrain.resolution**2 / 1e6
    majority, wanted = (
        np.mean([grid for grid, *_ in runs], axis=0) >= 0.5 for runs in (found, first)
    )
    pairs = [
        jaccard(one, other) for one, *_ in found for other, *_ in first
        if one is not other or len(found) == 1
    ]
    return {
        'case': case.name, 'material': args.material, 'spacing_m': args.spacing,
        'until_s': min(args.until, case.duration), 'mobility_limit_m_per_s': limit or '',
        'runs': len(found), 'steps': float(np.mean([steps for _, steps, _ in found])),
        'cpu_s': float(np.mean([seconds for *_, seconds in found])),
        'area_km2': float(areas.mean()),
        'area_deviation_km2': float(areas.std(ddof=1)) if len(found) > 1 else '',
        'jaccard_of_majorities': jaccard(majority, wanted),
        'jaccard_of_runs': float(np.mean(pairs)),
        'jaccard_with_map': jaccard(majority, case.footprint),
        'device': 'cpu', 'machine': args.machine, 'version': version(),
        'command': f'python docs/benchmarks/mobility_limit.py --until {args.until:g}',
    }


def main() -> None:
    """Write a row for each limit."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', metavar='OUT.csv', type=Path)
    parser.add_argument('--case', required=True, metavar='DIR')
    parser.add_argument('--material', default='basalt')
    parser.add_argument('--until', type=float, default=216000.0)
    parser.add_argument('--limit', type=float, action='append', dest='limits')
    parser.add_argument('--spacing', type=float, default=SPACING)
    parser.add_argument('--runs', type=int, default=1)
    parser.add_argument('--workers', type=int, default=1)
    parser.add_argument('--machine', default=platform.processor() or platform.machine())
    args = parser.parse_args()
    limits, rows, first = args.limits or LIMITS, [], None
    ways = directions(args.runs)
    tasks = [
        Task(args.case, args.material, args.spacing, args.until, limit, way)
        for limit in limits for way in ways
    ]
    with ProcessPoolExecutor(args.workers, get_context('spawn')) as pool:
        results = pool.map(run, tasks)
        for limit in limits:
            found = [next(results) for _ in ways]
            first = first or found
            rows.append(row_of(args, limit, found, first))
            write_csv(rows, args.output)
            print({key: rows[-1][key] for key in (
                'mobility_limit_m_per_s', 'steps', 'cpu_s', 'area_km2', 'jaccard_of_majorities',
            )}, flush=True)


if __name__ == '__main__':
    main()
