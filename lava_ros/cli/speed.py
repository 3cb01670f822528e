# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava check speed`: computing time and memory."""

import argparse
from importlib import import_module
from pathlib import Path

from lava_ros import validation
from lava_ros.cli.console import Progress, table_lines, write_json
from lava_ros.cli.options import argument, command, device_named, output_option, repeating_command
from lava_ros.files import file_to_write

#: The benchmarks, each a module of ``lava_ros.verification.benchmarks``.
BENCHMARKS = ('effects', 'steps', 'members')


@command(
    argument('benchmark', '|'.join(BENCHMARKS), None, choices=BENCHMARKS),
    '--device', '--json',
    argument('--particles', 'N', 'numbers of particles (default: by the device)', int, nargs='+'),
    argument('--repetitions', 'N', 'number of measurements', 5),
    output_option('FILE', 'table to write: .csv'),
)
def speed(args: argparse.Namespace) -> int:
    """Measure computing time and memory.

    effects: time of a step with each effect, and with all effects, relative to a step without.
    steps: time of steps and snapshots, and memory of a GPU, from few particles to many. members:
    members of an ensemble, from one to many at once.
    """
    from lava_ros.verification import measure
    from lava_ros.verification.rows import as_plain, write_csv

    name, device = args.benchmark, device_named(args.device)
    for number in args.particles or ():
        validation.number('--particles', number, at_least=100, at_most=1e8)
    options = {
        'repetitions': validation.whole(
            '--repetitions', args.repetitions, at_least=1, at_most=1000
        ),
        'particles': args.particles,
    }
    if args.output:
        file_to_write('--output', args.output, ('.csv',))
    origin = {
        'device': device,
        'machine': measure.machine_name(device),
        'command': repeating_command(f'check speed {name}', {'device': device, **options}),
    }
    module = import_module(f'lava_ros.verification.benchmarks.{name}')
    rows = []
    with Progress() as progress:
        for row in module.measure(device, on_progress=progress.show, **options):
            rows.append({**row, **origin})
            if args.output:
                # an interrupted command leaves the rows so far
                write_csv(rows, Path(args.output))
        progress.show('done', 1.0)
    columns = [column for column in rows[0] if column not in origin]
    cells = [
        [f'{value:.4g}' if isinstance(value, float) else str(value) for value in row.values()]
        for row in rows
    ]
    sides = ''.join('<' if column in ('benchmark', 'unit') else '>' for column in columns)
    print('\n'.join(table_lines([columns, *(line[: len(columns)] for line in cells)], sides)))
    write_json({'rows': as_plain(rows)}, args.json)
    return 0
