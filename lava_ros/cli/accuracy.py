# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava check accuracy`: error against computing time."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lava_ros import validation
from lava_ros.cli.console import made_folder, Progress, table_lines, with_units, write_json
from lava_ros.cli.options import (
    argument,
    command,
    device_named,
    output_option,
    repeating_command,
    seconds_of,
)
from lava_ros.layers.numbers import percent, seconds

if TYPE_CHECKING:
    from lava_ros.verification.rows import Row


@command(
    argument(
        '--quick', None, 'fewer settings: less than two minutes on two cores', action='store_true'
    ),
    argument(
        '--case', 'NAME', 'case to run, or lateral; may be repeated (default: all)',
        [], action='append',
    ),
    argument('--repetitions', 'N', 'time each short run N times (default: 3)', int),
    argument('--longest', 'TIME', 'leave out runs that would take longer (default: 30s)'),
    output_option(
        'DIR', 'folder for the report, whose files are named after the device',
        'accuracy',
    ),
    argument('--before', 'FILE', 'CSV of an earlier report, to show its fronts in the chart'),
    '--device', '--json',
)
def accuracy(args: argparse.Namespace) -> int:
    """Measure error against computing time.

    The command runs every case with an exact solution at many settings and at the presets. It
    writes the errors and times as CSV and as a chart.
    """
    from lava_ros.verification import cases, measure
    from lava_ros.verification.cases.sheets import LATERAL
    from lava_ros.verification.chart import draw
    from lava_ros.verification.rows import as_plain, read_csv, write_csv

    repetitions, longest = 3, measure.MAX_RUN_TIME
    if args.quick:
        repetitions, longest = 1, measure.QUICK_MAX_RUN_TIME
    if args.repetitions is not None:
        repetitions = args.repetitions
    repetitions = validation.whole('--repetitions', repetitions, at_least=1, at_most=1000)
    if args.longest is not None:
        longest = seconds_of('--longest', args.longest)
    before = [] if args.before is None else read_csv(Path(args.before), '--before')
    order = [*cases.CASES, LATERAL]
    for name in args.case:
        validation.choice('--case', name, order)
    pairs = [
        (case, item)
        for case, item in measure.all_pairs(quick=args.quick)
        if not args.case or case.name in args.case
    ]
    device = device_named(args.device)
    folder, stem = made_folder(args.output), measure.file_stem(device)
    given = {
        'case': args.case, 'device': device, 'repetitions': args.repetitions,
        'longest': args.longest,
    }
    measured: list[Row] = []
    kept: list[Row] = []
    if args.case and (folder / f'{stem}.csv').exists():
        others = set(order) - set(args.case)
        kept = [row for row in read_csv(folder / f'{stem}.csv') if row.case in others]
    rows = kept
    with Progress() as progress:
        for found in measure.measure(
            pairs,
            device=device,
            command=repeating_command('check accuracy' + ' --quick' * args.quick, given),
            repetitions=repetitions,
            longest=longest,
            on_progress=progress.show,
        ):
            # an interrupted command leaves the rows so far
            measured += found
            rows = sorted([*kept, *measured], key=lambda row: order.index(row.case))
            write_csv(rows, folder / f'{stem}.csv')
    for name, is_effect in ((f'{stem}.png', False), (f'{stem}_effects.png', True)):
        shown = [row for row in rows if (row.case in cases.EFFECT_CASES) == is_effect]
        if shown:
            draw(shown, cases.TITLES, folder / name, before)
    write_json({'rows': with_units(as_plain(measured), s='low high')}, args.json)
    _print_presets(measured)
    print(f'written to {folder}: {stem}.csv, {stem}.png')
    return 0


def _print_presets(rows: Sequence[Row]) -> None:
    from lava_ros.verification import cases
    from lava_ros.verification.rows import points, presets_of

    found = {(point.case, point.preset): point for point in points(rows) if point.preset}
    names = presets_of(found.values())
    if not names:
        return
    lines = [['Error in wall time for an hour', *names]]
    for case in dict.fromkeys(case for case, _ in found):
        places = [found.get((case, name)) for name in names]
        texts = [f'{percent(at.error)} in {seconds(at.cost)}' if at else '-' for at in places]
        lines.append([cases.TITLES[case], *texts])
    print('\n'.join(table_lines(lines, '<' + '>' * len(names))))
