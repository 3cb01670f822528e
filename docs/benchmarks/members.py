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

"""What it gains that members of an ensemble are at work at once, and how many a second there are.

It makes members_h200.csv and members_cpu.csv:

    python docs/benchmarks/members.py --device cuda:0 --members 256 --case CASE --machine M
    python docs/benchmarks/members.py --device cpu --members 32 --workers 2 --case CASE --machine M

Fields: simulations of 10,000 particles each, one after the other and together, by steps a second
of all of them. Day: members of the first day of an eruption (a folder as `lava hindcast` reads it,
or that case pickled) at `draft`, looked at each hour, on ground no finer than the particles.
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
from lava_ros.simulation.batch import interleave
from lava_ros.verification.benchmarks.effects import effect_sets, lava_field

DAY = 86400.0

#: Particles of a field, simulated time of a turn [s], turns, and simulations at once.
FIELD, TURN, TURNS, AT_ONCE = 10_000, 1.0, 5, (1, 4, 16, 32)

#: What is uncertain about the eruption.
UNCERTAIN = {
    'discharge': {'distribution': 'lognormal', 'median': 1.0, 'factor': 1.3},
    'viscosity': {'distribution': 'lognormal', 'median': 1.0, 'factor': 1.5},
    'yield_strength': {'distribution': 'lognormal', 'median': 1.0, 'factor': 1.5},
}


def fields(device):
    """Yield rows of steps a second, and of what it gains to have more at work."""
    for name in ('green', 'bare'):
        alone = None
        for count in AT_ONCE:
            simulations = [lava_field(FIELD, effect_sets()[name], device) for _ in range(count)]
            rates = []
            for turn in range(TURNS + 1):
                steps = sum(item.steps for item in simulations)
                start = time.perf_counter()
                interleave(
                    (item.advancing(item.time + TURN) for item in simulations),
                    device,
                    at_once=count,
                )
                taken = time.perf_counter() - start
                if turn:
                    rates.append((sum(item.steps for item in simulations) - steps) / taken)
            alone = alone or median(rates)
            what = f'{name}: {count} simulations of {FIELD} particles'
            yield what, median(rates), 'steps/s', min(rates), max(rates), TURNS
            yield what, median(rates) / alone, 'of one by one', '', '', TURNS


def day(case, device, count, workers):
    """Yield rows of the wall time of members of the first day."""
    settings = Settings(preset='draft', device=device)
    ground = coarsened(case.scene.terrain, settings.coarseness(case))
    scene = replace(case.scene, terrain=ground, uncertainty=uncertainty_from_dict(UNCERTAIN))
    plan = make_plan(
        scene, horizon=DAY, accuracy=settings.accuracy(case), effects=FORCED, looks=24
    )
    members = draw_members(scene, count, seed=1)
    if workers > 1:
        run = partial(run_in_processes, workers=workers, device=device)
    else:
        # the kernels are there when it counts
        list(run_here(plan, members[:1], device=device))
        run = partial(run_here, device=device)

    start = time.perf_counter()
    footprints = list(run(plan, members))
    taken = time.perf_counter() - start
    assert len(footprints) == count
    what = f'day at draft: {count} members, {workers} process{"es" if workers > 1 else ""}'
    yield what, taken, 's', '', '', 1
    yield what, count / taken, 'members/s', '', '', 1


def main():
    """Measure, and print a CSV."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--device', default='cpu')
    parser.add_argument('--members', type=int, default=32)
    parser.add_argument('--workers', type=int, default=1)
    parser.add_argument('--case', type=Path)
    parser.add_argument('--machine', required=True)
    args = parser.parse_args()
    rows = csv.writer(sys.stdout, lineterminator='\n')
    rows.writerow(
        ('benchmark', 'value', 'unit', 'low', 'high', 'repetitions', 'machine', 'command')
    )
    words = ['python', 'docs/benchmarks/members.py', '--device', args.device]
    command = shlex.join([*words, '--members', f'{args.members}', '--workers', f'{args.workers}'])
    parts = [fields(args.device)] if args.device != 'cpu' else []
    if args.case is not None:
        pickled = args.case.is_file()
        case = pickle.loads(args.case.read_bytes()) if pickled else load_case(args.case)
        parts.append(day(case, args.device, args.members, args.workers))
    for part in parts:
        for what, value, unit, low, high, repetitions in part:
            numbers = [f'{number:.5g}' if number != '' else '' for number in (value, low, high)]
            rows.writerow(
                (what, numbers[0], unit, *numbers[1:], repetitions, args.machine, command)
            )
            sys.stdout.flush()


if __name__ == '__main__':
    main()
