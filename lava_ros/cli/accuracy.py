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

"""`lava accuracy`: what accuracy costs in time, on this machine."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lava_ros import validation
from lava_ros.cli.progress import Progress
from lava_ros.errors import LavaError

if TYPE_CHECKING:
    from lava_ros.verification.rows import Row


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the `lava` parser."""
    parser = subparsers.add_parser(
        'accuracy',
        help='measure what accuracy costs in time',
        description='Run every case with an exact solution at many settings and at the presets; '
        'write the errors and times as CSV, as Markdown tables and as a chart.',
    )
    parser.add_argument(
        '--quick', action='store_true', help='fewer settings: less than two minutes on two cores'
    )
    parser.add_argument(
        '--case',
        action='append',
        metavar='NAME',
        help="only this case, or 'lateral'; may be given several times (default: all)",
    )
    parser.add_argument('--device', help='cpu, cuda:0, ... (default: the first GPU, else the CPU)')
    parser.add_argument(
        '--repetitions', type=int, metavar='N', help='time a short run N times (default: 3)'
    )
    parser.add_argument(
        '--longest',
        type=float,
        metavar='S',
        help='leave out runs that would take longer than S seconds (default: 30)',
    )
    parser.add_argument(
        '--output',
        default='accuracy',
        metavar='DIR',
        help="folder for the report, named after the device (default: 'accuracy')",
    )
    parser.add_argument('--json', metavar='FILE', help='also write the measurements here')
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Measure and write the report.

    Raises:
        LavaError: An argument cannot be used.
    """
    from lava_ros.verification import measure, settings
    from lava_ros.verification.cases import CASES, EFFECT_CASES
    from lava_ros.verification.chart import draw
    from lava_ros.verification.lateral import NAME
    from lava_ros.verification.report import markdown
    from lava_ros.verification.rows import read_csv, write_csv, write_json

    repetitions, longest = (1, measure.QUICK_LONGEST) if args.quick else (3, measure.LONGEST)
    if args.repetitions is not None:
        repetitions = int(validation.number('--repetitions', args.repetitions, at_least=1))
    if args.longest is not None:
        longest = validation.number('--longest', args.longest, above=0.0, unit='s')
    for name in args.case or ():
        validation.choice('--case', name, (*CASES, NAME))
    pairs = [
        (case, item)
        for case, item in settings.all_pairs(quick=args.quick)
        if not args.case or case.name in args.case
    ]
    order = [*CASES, NAME]
    titles = {case.name: f'{case.title[0].upper()}{case.title[1:]}' for case in CASES.values()}
    device = _device(args.device)
    folder, stem = _folder(args.output), measure.file_stem(device)
    if args.json:
        validation.file_to_write('--json', args.json)
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
            _write('--output', folder / f'{stem}.md', markdown(rows, titles, stem=stem))
    for name, shown in (
        (f'{stem}.png', [row for row in rows if row.case not in EFFECT_CASES]),
        (f'{stem}_effects.png', [row for row in rows if row.case in EFFECT_CASES]),
    ):
        if shown:
            draw(shown, titles, folder / name)
    if args.json:
        write_json(measured, Path(args.json))
    _print_presets(measured, titles)
    print(f'written to {folder}: {stem}.csv, {stem}.md, {stem}.png')
    return 0


def _device(name: str | None) -> str:
    import warp as wp

    if name is None:
        return str(wp.get_preferred_device())
    known = [str(device) for device in wp.get_devices()]
    return validation.choice('--device', name, known)


def _folder(name: str) -> Path:
    folder = Path(name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LavaError('--output', name, f'a folder that can be made ({error})') from error
    return folder


def _command(args: argparse.Namespace, device: str) -> str:
    """The command that gives these numbers again, without where it puts them."""
    words = ['lava accuracy']
    words += ['--quick'] * args.quick
    words += [f'--case {name}' for name in args.case or ()]
    words.append(f'--device {device}')
    for name in ('repetitions', 'longest'):
        if getattr(args, name) is not None:
            words.append(f'--{name} {getattr(args, name):g}')
    return ' '.join(words)


def _write(name: str, path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding='utf-8')
    except OSError as error:
        raise LavaError(name, str(path), f'a file to write ({error})') from error


def _print_presets(rows: Sequence[Row], titles: dict[str, str]) -> None:
    """Print the presets' errors and costs, one line for each case."""
    from lava_ros.verification.front import points, presets_of
    from lava_ros.verification.tables import percent, seconds

    found = {(point.case, point.preset): point for point in points(rows) if point.preset}
    presets = presets_of(found.values())
    if not presets:
        return
    cases = list(dict.fromkeys(case for case, _ in found))
    width = max(len(titles[name]) for name in cases)
    print(f'{"Error in wall time for an hour":{width}}' + ''.join(f'  {p:>18}' for p in presets))
    for name in cases:
        places = [found.get((name, preset)) for preset in presets]
        texts = [f'{percent(at.error)} in {seconds(at.cost)}' if at else '-' for at in places]
        print(f'{titles[name]:{width}}' + ''.join(f'  {text:>18}' for text in texts))
