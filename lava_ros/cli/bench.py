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

"""Measure computing time and memory.

effects: time of a step with each effect, and with all effects, relative to a step without. steps:
time of steps and snapshots, and memory, from few particles to many, beside a reference step.
publishing: time of steps while maps are published ten times a second, and memory on a large map.
choice: twelve scenes with the effects that they need, and with all effects. convergence:
footprints at the presets from coarse to fine, of scenes or of mapped eruptions. members: members
of an ensemble, from one to many at once.
"""

import argparse
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from lava_ros import validation
from lava_ros.cli.options import add_options, device_named
from lava_ros.cli.output import Progress, table_lines, write_json
from lava_ros.errors import LavaError
from lava_ros.files import file_to_write
from lava_ros.hindcast.case import load_case
from lava_ros.verification.measure import machine_name
from lava_ros.verification.rows import as_plain, write_csv

#: Heading, column and format of the statistics that are printed of repeated measurements.
_SPREAD = (
    ('', 'benchmark', ''), ('particles', 'particles', 'd'), ('median', 'value', '.4g'),
    ('low', 'low', '.4g'), ('high', 'high', '.4g'), ('', 'unit', ''),
)

#: The benchmarks that the description above explains, and the columns printed for each.
SHOWN: dict[str, tuple[tuple[str, str, str], ...]] = {
    'effects': (
        ('', 'benchmark', ''), ('', 'value', '.3g'), ('', 'unit', ''),
        ('over bare', 'ratio', '.2f'),
    ),
    'steps': _SPREAD,
    'publishing': _SPREAD,
    'members': _SPREAD,
    'choice': (
        ('scene', 'scene', ''), ('Jaccard', 'jaccard', '.3f'),
        ('halves: chosen', 'noise_auto', '.3f'), ('all', 'noise_all', '.3f'),
        ('chosen [s]', 'seconds_auto', '.2f'), ('all [s]', 'seconds_all', '.2f'),
        ('chosen', 'effects_auto', ''),
    ),
    'convergence': (
        ('scene', 'scene', ''), ('preset', 'preset', ''), ('spacing [m]', 'spacing_m', '.3g'),
        ('across', 'across', '.3g'), ('Jaccard', 'jaccard', '.3f'), ('halves', 'noise', '.3f'),
        ('area ratio', 'area_ratio', '.3f'), ('length ratio', 'length_ratio', '.3f'),
        ('a run [s]', 'seconds', '.2f'),
    ),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('benchmark', choices=tuple(SHOWN), metavar='|'.join(SHOWN))
    add_options(parser, '--device', '--preset', '--json')
    parser.add_argument(
        '--particles', type=int, nargs='+', metavar='N',
        help='number of particles, for effects, steps, publishing and members; steps and members '
        'take several (default: by the device)',
    )
    parser.add_argument(
        '--repetitions', type=int, default=5, metavar='N',
        help='number of measurements, for all but choice and convergence (default: %(default)s)',
    )
    parser.add_argument(
        '--runs', type=int, metavar='N',
        help='number of runs of a footprint (default: 24 for choice, 8 for convergence)',
    )
    parser.add_argument(
        '--case', action='append', default=[], metavar='CASE_DIR',
        help='folder of a mapped eruption, as for lava hindcast, which replaces the scenes of '
        'convergence; may be repeated',
    )
    parser.add_argument('--output', metavar='FILE', help='write the table as CSV')


def run(args: argparse.Namespace) -> int:
    """Run a benchmark."""
    device = device_named(args.device)
    options = _options(args)
    if args.output:
        file_to_write('--output', args.output, ('.csv',))
    origin = {
        'device': device,
        'machine': machine_name(device),
        'command': _command(args.benchmark, device, options),
    }
    with Progress() as progress:
        measured = _module(args.benchmark).measure(device, on_progress=progress.show, **options)
        rows = []
        for row in measured:
            rows.append({**row, **origin})
            if args.output:
                # what is interrupted leaves what it has
                write_csv(rows, Path(args.output))
        progress.show('done', 1.0)
    columns = SHOWN[args.benchmark]
    cells = [[format(row[key], form) for _, key, form in columns] for row in rows]
    sides = ''.join('>' if form else '<' for _, _, form in columns)
    print('\n'.join(table_lines([[head for head, _, _ in columns], *cells], sides)))
    write_json(as_plain(rows), args.json)
    return 0


def _options(args: argparse.Namespace) -> dict[str, Any]:
    """Check the options of a benchmark, except for the device, and return them by name."""
    repetitions = validation.whole('--repetitions', args.repetitions, at_least=1, at_most=1000)
    runs = {'choice': 24}.get(args.benchmark, 8) if args.runs is None else args.runs
    runs = validation.whole('--runs', runs, at_least=2, at_most=1000)
    if args.benchmark == 'choice':
        return {'preset': args.preset, 'runs': runs}
    if args.benchmark == 'convergence':
        return {'runs': runs, 'cases': [load_case(folder) for folder in args.case]}
    particles = args.particles
    for number in particles or ():
        validation.number('--particles', number, at_least=100, at_most=1e8)
    if args.benchmark not in ('steps', 'members') and particles is not None:
        if len(particles) > 1:
            raise LavaError('--particles', particles, f'one number for {args.benchmark}')
        (particles,) = particles
    return {'repetitions': repetitions, 'particles': particles}


def _command(benchmark: str, device: str, options: dict[str, Any]) -> str:
    words = [f'lava bench {benchmark} --device {device}']
    for name, value in options.items():
        if name == 'cases':
            words += [f'--case {case.name}' for case in value]
        elif value is not None:
            numbers = value if isinstance(value, list) else [value]
            words.append(f'--{name} ' + ' '.join(map(str, numbers)))
    return ' '.join(words)


def _module(benchmark: str) -> ModuleType:
    if benchmark == 'publishing':
        return import_module('lava_ros.ros.publishing_benchmark')
    name = {'choice': 'selection'}.get(benchmark, benchmark)
    return import_module(f'lava_ros.verification.benchmarks.{name}')
