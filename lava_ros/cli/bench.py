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

"""Measure what steps and effects cost.

effects: the time of a step with each effect, and with all, over that of the bare step. steps:
steps, memory and snapshots from few particles to many, beside a plain step. publishing: steps
while grids are taken ten times a second, and memory on a large map. choice: twelve scenes with
the effects they call for, and with all there are. convergence: footprints at presets from coarse
to fine, of scenes or of mapped eruptions.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lava_ros import validation
from lava_ros.cli.options import add_options, device_named
from lava_ros.cli.output import Progress, write_json
from lava_ros.errors import LavaError
from lava_ros.files import file_to_write

#: The benchmarks, each of which the description above explains.
BENCHMARKS = ('effects', 'steps', 'publishing', 'choice', 'convergence')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('benchmark', choices=BENCHMARKS, metavar='|'.join(BENCHMARKS))
    add_options(parser, '--device', '--preset', '--json')
    parser.add_argument(
        '--particles',
        type=int,
        nargs='+',
        metavar='N',
        help='effects, steps, publishing: particles, of steps several (default: by the device)',
    )
    parser.add_argument(
        '--repetitions', type=int, default=5, metavar='N', help='not choice (default: 5)'
    )
    parser.add_argument(
        '--runs',
        type=int,
        metavar='N',
        help='runs of a footprint (default: 24 of choice, 8 of convergence)',
    )
    parser.add_argument(
        '--case',
        action='append',
        default=[],
        metavar='CASE_DIR',
        help='convergence: a mapped eruption, as of lava hindcast, in place of the scenes',
    )
    parser.add_argument('--output', metavar='FILE', help='write the table as CSV')


def run(args: argparse.Namespace) -> int:
    """Run a benchmark."""
    from lava_ros.verification.rows import as_plain, write_csv

    device = device_named(args.device)
    repetitions = validation.whole('--repetitions', args.repetitions, at_least=1, at_most=1000)
    runs = {'choice': 24}.get(args.benchmark, 8) if args.runs is None else args.runs
    runs = validation.whole('--runs', runs, at_least=2, at_most=1000)
    for particles in args.particles or ():
        validation.number('--particles', particles, at_least=100, at_most=1e8)
    if args.benchmark != 'steps' and len(args.particles or ()) > 1:
        raise LavaError('--particles', args.particles, f'one number for {args.benchmark}')
    if args.output:
        file_to_write('--output', args.output, ('.csv',))
    with Progress() as progress:
        if args.benchmark == 'convergence':
            rows = _convergence(device, args.case, runs, progress)
        elif args.benchmark == 'choice':
            rows = _choice(device, args.preset, runs, progress)
        else:
            rows = _rows(args, device, repetitions, progress)
    if args.output:
        write_csv(rows, Path(args.output))
    write_json(as_plain(rows), args.json)
    return 0


def _rows(
    args: argparse.Namespace, device: str, repetitions: int, progress: Progress
) -> Sequence[Any]:
    from lava_ros.ros import publishing_benchmark as publishing
    from lava_ros.verification.benchmarks import effects, steps

    modules = {'effects': effects, 'steps': steps, 'publishing': publishing}
    particles = args.particles
    if args.benchmark != 'steps':
        particles = particles[0] if particles else None
    rows = list(
        modules[args.benchmark].measure(
            device,
            command=_command(args, device, repetitions),
            particles=particles,
            repetitions=repetitions,
            on_progress=progress.show,
        )
    )
    if args.benchmark == 'effects':
        print(f'{"effects":24}  {rows[0].unit:>24}  over bare')
        for row in rows:
            print(f'{row.benchmark:24}  {row.value:24.3g}  {row.ratio:9.2f}')
        return rows
    width = max(len(row.benchmark) for row in rows)
    print(f'{"":{width}}  particles     median        low       high')
    for row in rows:
        print(
            f'{row.benchmark:{width}}  {row.particles:9}  {row.value:9.4g}  {row.low:9.4g}'
            f'  {row.high:9.4g}  {row.unit}'
        )
    return rows


def _command(args: argparse.Namespace, device: str, repetitions: int) -> str:
    """What made the rows."""
    command = f'lava bench {args.benchmark} --device {device} --repetitions {repetitions}'
    if args.particles:
        command += ' --particles ' + ' '.join(str(number) for number in args.particles)
    return command


def _convergence(
    device: str, folders: Sequence[str], runs: int, progress: Progress
) -> Sequence[Any]:
    from lava_ros.hindcast.case import load_case
    from lava_ros.verification.benchmarks import convergence

    cases = [load_case(folder) for folder in folders]
    rows = convergence.run(device, cases, progress.show, runs)
    width = max(len(row.scene) for row in rows)
    print(
        f'{"scene":{width}}  preset    spacing  across  Jaccard  halves  area ratio  length ratio'
        '  a run [s]'
    )
    for row in rows:
        print(
            f'{row.scene:{width}}  {row.preset:8}  {row.spacing_m:5.3g} m  {row.across:6.3g}'
            f'  {row.jaccard:7.3f}  {row.noise:6.3f}  {row.area_ratio:10.3f}'
            f'  {row.length_ratio:12.3f}  {row.seconds:9.2f}'
        )
    return rows


def _choice(device: str, preset: str, runs: int, progress: Progress) -> Sequence[Any]:
    from lava_ros.verification.benchmarks import selection as choice

    rows = choice.run(device, progress.show, preset, runs)
    width = max(len(row.scene) for row in rows)
    print(f'{"scene":{width}}  Jaccard  halves: chosen    all  chosen [s]  all [s]  chosen')
    for row in rows:
        print(
            f'{row.scene:{width}}  {row.jaccard:7.3f}  {row.noise_auto:14.3f}'
            f'  {row.noise_all:5.3f}  {row.seconds_auto:10.2f}  {row.seconds_all:7.2f}'
            f'  {row.effects_auto}'
        )
    return rows
