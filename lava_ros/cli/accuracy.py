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

"""Measure error against computing time.

The command runs every case with an exact solution at many settings and at the presets. It writes
the errors and times as CSV, as Markdown tables and as a chart.
"""

import argparse
from collections.abc import Sequence

from lava_ros import validation
from lava_ros.cli.options import add_options, device_named, seconds_of
from lava_ros.cli.output import made_folder, Progress, table_lines, write_json
from lava_ros.files import write_output
from lava_ros.maps.numbers import percent, seconds
from lava_ros.verification import measure
from lava_ros.verification.cases import CASES, EFFECT_CASES
from lava_ros.verification.cases.sheets import LATERAL
from lava_ros.verification.chart import draw
from lava_ros.verification.report import markdown
from lava_ros.verification.rows import as_plain, points, presets_of, read_csv, Row, write_csv


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        '--quick', action='store_true', help='fewer settings: less than two minutes on two cores'
    )
    parser.add_argument(
        '--case', action='append', metavar='NAME',
        help='case to run, or lateral; may be repeated (default: all)',
    )
    parser.add_argument(
        '--repetitions', type=int, metavar='N', help='time each short run N times (default: 3)'
    )
    parser.add_argument(
        '--longest', metavar='TIME',
        help='leave out runs that would take longer (default: 30s)',
    )
    parser.add_argument(
        '--output', default='accuracy', metavar='DIR',
        help='folder for the report, whose files are named after the device '
        '(default: %(default)s)',
    )
    add_options(parser, '--device', '--json')


def run(args: argparse.Namespace) -> int:
    """Measure and write the report."""
    repetitions, longest = (1, measure.QUICK_LONGEST) if args.quick else (3, measure.LONGEST)
    if args.repetitions is not None:
        repetitions = args.repetitions
    repetitions = validation.whole('--repetitions', repetitions, at_least=1, at_most=1000)
    if args.longest is not None:
        longest = seconds_of('--longest', args.longest)
    order = [*CASES, LATERAL]
    for name in args.case or ():
        validation.choice('--case', name, order)
    pairs = [
        (case, item)
        for case, item in measure.all_pairs(quick=args.quick)
        if not args.case or case.name in args.case
    ]
    titles = {case.name: f'{case.title[0].upper()}{case.title[1:]}' for case in CASES.values()}
    device = device_named(args.device)
    folder, stem = made_folder(args.output), measure.file_stem(device)
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
            command=_command(args, device),
            repetitions=repetitions,
            longest=longest,
            on_progress=progress.show,
        ):
            # what is interrupted keeps what it has
            measured += found
            rows = sorted([*kept, *measured], key=lambda row: order.index(row.case))
            write_csv(rows, folder / f'{stem}.csv')
            page = markdown(rows, titles, stem=stem)
            write_output('--output', folder / f'{stem}.md', page)
    for name, is_effect in ((f'{stem}.png', False), (f'{stem}_effects.png', True)):
        shown = [row for row in rows if (row.case in EFFECT_CASES) == is_effect]
        if shown:
            draw(shown, titles, folder / name)
    write_json(as_plain(measured), args.json)
    _print_presets(measured, titles)
    print(f'written to {folder}: {stem}.csv, {stem}.md, {stem}.png')
    return 0


def _command(args: argparse.Namespace, device: str) -> str:
    """The command that gives these numbers again, without where it puts them."""
    words = ['lava accuracy']
    words += ['--quick'] * args.quick
    words += [f'--case {name}' for name in args.case or ()]
    words.append(f'--device {device}')
    for name in ('repetitions', 'longest'):
        if getattr(args, name) is not None:
            words.append(f'--{name} {getattr(args, name)}')
    return ' '.join(words)


def _print_presets(rows: Sequence[Row], titles: dict[str, str]) -> None:
    """Print the presets' errors and costs, one line for each case."""
    found = {(point.case, point.preset): point for point in points(rows) if point.preset}
    presets = presets_of(found.values())
    if not presets:
        return
    cases = list(dict.fromkeys(case for case, _ in found))
    lines = [['Error in wall time for an hour', *presets]]
    for name in cases:
        places = [found.get((name, preset)) for preset in presets]
        texts = [f'{percent(at.error)} in {seconds(at.cost)}' if at else '-' for at in places]
        lines.append([titles[name], *texts])
    print('\n'.join(table_lines(lines, '<' + '>' * len(presets))))
