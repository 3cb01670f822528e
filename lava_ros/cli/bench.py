# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava bench`: computing time and memory."""

import argparse
from importlib import import_module
from pathlib import Path
from typing import Any

from lava_ros import validation
from lava_ros.cli.console import Progress, table_lines, write_json
from lava_ros.cli.options import argument, command, device_named, repeating_command
from lava_ros.errors import LavaError
from lava_ros.files import file_to_write

#: Heading, column and format of the statistics that are printed of repeated measurements.
_SPREAD = (
    ('', 'benchmark', ''), ('particles', 'particles', 'd'), ('median', 'value', '.4g'),
    ('low', 'low', '.4g'), ('high', 'high', '.4g'), ('', 'unit', ''),
)

#: The benchmarks that `lava bench --help` explains, and the columns printed for each.
SHOWN: dict[str, tuple[tuple[str, str, str], ...]] = {
    'effects': (
        ('', 'benchmark', ''), ('', 'value', '.3g'), ('', 'unit', ''),
        ('over bare', 'ratio', '.2f'),
    ),
    'steps': _SPREAD,
    'members': _SPREAD,
    'choice': (
        ('scene', 'scene', ''), ('effect', 'effect', ''), ('expected', 'expected', '.2g'),
        ('measured', 'measured', '.2g'), ('threshold', 'threshold', '.2g'),
        ('stated', 'stated', '.2%'), ('changed', 'changed', '.2%'), ('chance', 'chance', '.2%'),
        ('front', 'front_changed', '.2%'), ('chosen [s]', 'seconds', '.2f'),
        ('with it [s]', 'seconds_with', '.2f'),
    ),
    'convergence': (
        ('scene', 'scene', ''), ('preset', 'preset', ''), ('spacing [m]', 'spacing_m', '.3g'),
        ('across', 'across', '.3g'), ('Jaccard', 'jaccard', '.3f'), ('halves', 'noise', '.3f'),
        ('area ratio', 'area_ratio', '.3f'), ('length ratio', 'length_ratio', '.3f'),
        ('a run [s]', 'seconds', '.2f'),
    ),
}

#: The benchmarks whose module has another name.
_MODULES = {'choice': 'selection'}


@command(
    argument('benchmark', '|'.join(SHOWN), None, choices=tuple(SHOWN)),
    '--device', '--preset', '--json',
    argument(
        '--particles', 'N', 'number of particles, for effects, steps and members; steps and '
        'members take several (default: by the device); for choice the largest number of a run '
        '(default: any)', int, nargs='+',
    ),
    argument(
        '--repetitions', 'N', 'number of measurements, for all but choice and convergence', 5
    ),
    argument(
        '--runs', 'N', 'number of runs of a footprint (default: 24 for choice, 8 for convergence)',
        int,
    ),
    argument(
        '--case', 'CASE_DIR', 'folder of a mapped eruption, as for lava hindcast, which replaces '
        'the scenes of convergence; may be repeated', [], action='append',
    ),
    argument('--output', 'FILE', 'write the table as CSV'),
)
def bench(args: argparse.Namespace) -> int:
    """Measure computing time and memory.

    effects: time of a step with each effect, and with all effects, relative to a step without.
    steps: time of steps and snapshots, and memory of a GPU, from few particles to many. members:
    members of an ensemble, from one to many at once. choice: scenes with the effects that they
    call for, with each other effect forced on, and with all effects: the change of the footprint
    and the stated cost. convergence: footprints at the presets from coarse to fine, of scenes or
    of mapped eruptions.
    """
    from lava_ros.verification import measure
    from lava_ros.verification.rows import as_plain, write_csv

    name = args.benchmark
    device = device_named(args.device)
    options = _options(args)
    if args.output:
        file_to_write('--output', args.output, ('.csv',))
    again = {'device': device, **options}
    if 'cases' in again:
        again['case'] = [case.name for case in again.pop('cases')]
    origin = {
        'device': device,
        'machine': measure.machine_name(device),
        'command': repeating_command(f'bench {name}', again),
    }
    module = import_module(f'lava_ros.verification.benchmarks.{_MODULES.get(name, name)}')
    rows = []
    with Progress() as progress:
        for row in module.measure(device, on_progress=progress.show, **options):
            rows.append({**row, **origin})
            if args.output:
                # an interrupted command leaves the rows so far
                write_csv(rows, Path(args.output))
        progress.show('done', 1.0)
    heads, columns, forms = zip(*SHOWN[name], strict=True)
    cells = [
        [format(row[column], form) for column, form in zip(columns, forms, strict=True)]
        for row in rows
    ]
    sides = ''.join('>' if form else '<' for form in forms)
    print('\n'.join(table_lines([heads, *cells], sides)))
    write_json(as_plain(rows), args.json)
    return 0


def _options(args: argparse.Namespace) -> dict[str, Any]:
    """Check the options of a benchmark, except for the device, and return them by name."""
    repetitions = validation.whole('--repetitions', args.repetitions, at_least=1, at_most=1000)
    runs = {'choice': 24}.get(args.benchmark, 8) if args.runs is None else args.runs
    runs = validation.whole('--runs', runs, at_least=2, at_most=1000)
    if args.benchmark == 'convergence':
        # imported for this benchmark alone
        from lava_ros.hindcast.case import load_case

        return {'runs': runs, 'cases': [load_case(folder) for folder in args.case]}
    particles = args.particles
    for number in particles or ():
        validation.number('--particles', number, at_least=100, at_most=1e8)
    if args.benchmark not in ('steps', 'members') and particles is not None:
        if len(particles) > 1:
            raise LavaError('--particles', particles, f'one number for {args.benchmark}')
        (particles,) = particles
    if args.benchmark == 'choice':
        return {'preset': args.preset, 'runs': runs, 'particles': particles}
    return {'repetitions': repetitions, 'particles': particles}
