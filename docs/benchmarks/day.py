# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure the wall time of the first day of an eruption, and the effect of longer time steps.

The output is day.csv, with a run for each machine:

    python docs/benchmarks/day.py --device cuda:0 --case CASE --machine M

The case is a folder for `lava run CASE`, or a pickled case; effects are those of the whole case.
The Courant numbers are that of `lava run CASE`, 1, and smaller ones; inundated areas are compared
with those of the smallest. Runs with a vent moved by a millionth of a metre measure the random
part of the difference.
"""

import argparse
import csv
from dataclasses import replace
from pathlib import Path
import pickle
from statistics import median
import sys
import time

from choice import jaccard

from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.coarse import coarsened
from lava_ros.hindcast.run import FORCED, Settings
from lava_ros.simulation import Simulation

DAY, SPACING = 86400.0, 10.0

#: Maximum displacement in a step, in cells.
COURANT = (1.0, 0.5, 0.25)


def run(case, device, courant, moved):
    """Run the first day; return the wall time, and the snapshot at its end."""
    settings = Settings(preset='standard', spacing=SPACING, device=device, courant=courant)
    ground = coarsened(case.scene.terrain, settings.coarseness(case))
    vents = tuple(
        replace(vent, position=(vent.position[0] + moved, vent.position[1]))
        for vent in case.scene.vents
    )
    simulation = Simulation(
        replace(case.scene, terrain=ground, vents=vents),
        effects=FORCED,
        accuracy=settings.accuracy(case),
        device=device,
        horizon=case.duration,
    )
    start = time.perf_counter()
    simulation.advance(DAY)
    snapshot = simulation.snapshot()
    return time.perf_counter() - start, snapshot


def main():
    """Measure, and print a CSV."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--device', default='cpu')
    parser.add_argument('--case', type=Path, required=True)
    parser.add_argument('--repetitions', type=int, default=3)
    parser.add_argument('--machine', required=True)
    args = parser.parse_args()
    case = pickle.loads(args.case.read_bytes()) if args.case.is_file() else load_case(args.case)
    rows = csv.writer(sys.stdout, lineterminator='\n')
    names = 'courant', 'quantity', 'value', 'unit', 'low', 'high', 'repetitions'
    rows.writerow((*names, 'machine', 'command'))
    command = f'python docs/benchmarks/day.py --device {args.device}'
    run(case, args.device, COURANT[0], 0.0)
    ends = {
        courant: [run(case, args.device, courant, 1e-6 * n) for n in range(args.repetitions)]
        for courant in COURANT
    }
    inundated = {
        courant: [snapshot.footprint for _, snapshot in found]
        for courant, found in ends.items()
    }
    finest = inundated[min(COURANT)]
    for courant, found in ends.items():
        here = inundated[courant]
        pairs = [(one, other) for one in here for other in finest if one is not other]
        quantities = {
            ('wall time', 's'): [taken for taken, _ in found],
            ('particles', '1'): [snapshot.particle_count for _, snapshot in found],
            ('steps', '1'): [snapshot.steps.count for _, snapshot in found],
            ('velocity evaluations', '1'): [snapshot.steps.evaluations for _, snapshot in found],
            (f'Jaccard with courant {min(COURANT):g}', '1'): [jaccard(*pair) for pair in pairs],
        }
        for (quantity, unit), values in quantities.items():
            if not values:
                # a single run has no pair
                continue
            numbers = [f'{value:.5g}' for value in (median(values), min(values), max(values))]
            row = (courant, quantity, numbers[0], unit, *numbers[1:], len(values))
            rows.writerow((*row, args.machine, command))
        sys.stdout.flush()


if __name__ == '__main__':
    main()
