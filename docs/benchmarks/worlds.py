# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure what members of an ensemble would cost as synchronous worlds of common arrays.

All worlds would take the same number of stages between two observations, that of the slowest,
in arrays padded to the largest, and a change of the arrays of one would stop all. A stage is
assumed to take the same time for any number of members. The output is worlds.csv:

    python docs/benchmarks/worlds.py CASE --members 64
    python docs/benchmarks/worlds.py CASE --members 16 --days 22

CASE is a folder for `lava run CASE`; the members and their 24 observations are those of
members.py.
"""

import argparse
import csv
from dataclasses import replace
from pathlib import Path
import sys

from members import DAY, UNCERTAIN
import numpy as np

from lava_ros.forecast.member_scenes import member_scene
from lava_ros.forecast.members import make_plan
from lava_ros.forecast.sampling import draw_members
from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.coarse import coarsened
from lava_ros.hindcast.run import FORCED, Settings
from lava_ros.scene.uncertainty import uncertainty_from_dict
from lava_ros.simulation import Simulation
from lava_ros.simulation.particles import layout as at


def course_of(plan, member):
    """Return stages so far, particles, and changes of arrays by observation, [observations, 3]."""
    simulation = Simulation(
        member_scene(plan.scene, member), effects=plan.effects, accuracy=plan.accuracy,
        device='cpu', horizon=plan.horizon,
    )
    solver, found, changes = simulation.solver, [], 0
    for number in range(1, plan.samples + 1):
        former = solver.neighbors.cells, solver.capacity
        simulation.advance(number * plan.interval)
        changes += (solver.neighbors.cells is not former[0]) + (solver.capacity != former[1])
        counts = solver.state.read_clock()[1]
        found.append((counts[at.EVALUATIONS], at.count_in(counts), changes))
    return np.array(found)


def main():
    """Measure, and print a CSV."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('case', type=Path)
    parser.add_argument('--days', type=float, default=1.0)
    parser.add_argument('--members', type=int, default=64)
    args = parser.parse_args()
    case, settings = load_case(args.case), Settings(preset='draft', device='cpu')
    ground = coarsened(case.scene.terrain, settings.coarseness(case))
    scene = replace(case.scene, terrain=ground, uncertainty=uncertainty_from_dict(UNCERTAIN))
    plan = make_plan(
        scene, horizon=args.days * DAY, accuracy=settings.accuracy(case), effects=FORCED,
        samples=24,
    )
    courses = [course_of(plan, member) for member in draw_members(scene, args.members, seed=1)]
    so_far, particles, changes = np.moveaxis(np.array(courses), 2, 0)
    stages, total = np.diff(so_far, prepend=0), so_far[:, -1]
    padded = args.members * particles.max(axis=0)
    rows = {
        'stages between observations, of the slowest member in each, over those of the slowest':
            stages.max(axis=0).sum() / total.max(),
        'stages of the slowest member, over the mean': total.max() / total.mean(),
        'rows of padded arrays, over particles': np.median(padded / particles.sum(axis=0)),
        'rows of padded arrays in all stages, over particles in stages':
            (padded * stages.max(axis=0)).sum() / (particles * stages).sum(),
        'changes of arrays, each member': changes[:, -1].mean(),
    }
    writer = csv.writer(sys.stdout, lineterminator='\n')
    writer.writerow(('case', 'days', 'members', 'quantity', 'value'))
    for name, value in rows.items():
        writer.writerow((case.name, f'{args.days:g}', args.members, name, f'{value:.3g}'))


if __name__ == '__main__':
    main()
