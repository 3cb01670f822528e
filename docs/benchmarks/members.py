# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure the wall time of members of an ensemble of a mapped eruption.

The output is members_day_h200.csv and members_cpu.csv:

    python docs/benchmarks/members.py CASE --device cuda:0 --members 256 --machine M
    python docs/benchmarks/members.py CASE --device cpu --members 32 --workers 2 --machine M
    python docs/benchmarks/members.py CASE --device cuda --members 512 --workers 2 --machine M

CASE is a folder for `lava run CASE`, or a pickled case. Members are observed each hour of the
first day, or 24 times within other horizons, on ground not finer than the particles.
"""

import argparse
import csv
from dataclasses import replace
from functools import partial
from pathlib import Path
import pickle
import shlex
from statistics import median
import sys
import time

from lava_ros.forecast.ensemble import run_here, run_in_processes
from lava_ros.forecast.members import make_plan
from lava_ros.forecast.sampling import draw_members
from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.coarse import coarsened
from lava_ros.hindcast.run import FORCED, Settings
from lava_ros.scene.uncertainty import uncertainty_from_dict

DAY = 86400.0

#: Uncertain quantities of the eruption.
UNCERTAIN = {
    'discharge': {'distribution': 'lognormal', 'median': 1.0, 'factor': 1.3},
    'viscosity': {'distribution': 'lognormal', 'median': 1.0, 'factor': 1.5},
    'yield_strength': {'distribution': 'lognormal', 'median': 1.0, 'factor': 1.5},
}


def times(case, args):
    """Return wall times of all members [s]; a first member compiles the kernels."""
    settings = Settings(preset=args.preset, device=args.device, method=args.method)
    ground = coarsened(case.scene.terrain, settings.coarseness(case))
    scene = replace(case.scene, terrain=ground, uncertainty=uncertainty_from_dict(UNCERTAIN))
    plan = make_plan(
        scene, horizon=args.days * DAY, accuracy=settings.accuracy(case), effects=FORCED,
        samples=24,
    )
    members = draw_members(scene, args.members, seed=1)
    list(run_here(plan, members[:1], device=args.device))
    run = partial(run_here, device=args.device)
    if args.workers > 1:
        # GPU processes distribute all GPUs among themselves
        device = args.device if args.device == 'cpu' else None
        run = partial(run_in_processes, workers=args.workers, device=device)
    found = []
    for _ in range(args.repetitions):
        start = time.perf_counter()
        footprints = list(run(plan, members))
        found.append(time.perf_counter() - start)
        assert len(footprints) == len(members)
    return found


def main():
    """Measure, and print a CSV."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('case', type=Path)
    parser.add_argument('--device', default='cpu')
    parser.add_argument('--method', default='particles')
    parser.add_argument('--preset', default='draft')
    parser.add_argument('--days', type=float, default=1.0)
    parser.add_argument('--members', type=int, default=32)
    parser.add_argument('--workers', type=int, default=1)
    parser.add_argument('--repetitions', type=int, default=1)
    parser.add_argument('--machine', required=True)
    args = parser.parse_args()
    pickled = args.case.is_file()
    case = pickle.loads(args.case.read_bytes()) if pickled else load_case(args.case)
    rows = csv.writer(sys.stdout, lineterminator='\n')
    rows.writerow(
        ('benchmark', 'value', 'unit', 'low', 'high', 'repetitions', 'machine', 'command')
    )
    words = ['python', 'docs/benchmarks/members.py', args.case.stem]
    for name in ('device', 'method', 'preset', 'days', 'members', 'workers', 'repetitions'):
        words += [f'--{name}', f'{getattr(args, name)}']
    found = times(case, args)
    many = f'{args.workers} process{"es" if args.workers > 1 else ""}'
    what = f'{case.name}, {args.days:g} days at {args.preset}, {args.method}: '
    what += f'{args.members} members, {many}'
    for unit, values in (('s', found), ('members/s', [args.members / one for one in found])):
        numbers = [f'{number:.4g}' for number in (median(values), min(values), max(values))]
        rows.writerow(
            (what, numbers[0], unit, *numbers[1:], len(found), args.machine, shlex.join(words))
        )


if __name__ == '__main__':
    main()
