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

"""`lava verify`: the solver against every exact solution there is."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import asdict
import json
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

from lava_ros import presets, validation
from lava_ros.errors import LavaError
from lava_ros.verification.bounds import bound, BOUNDED_PRESETS

if TYPE_CHECKING:
    from lava_ros.verification.cases import Case, Measurement, Run

#: Exit status when an error is outside its bound.
OUTSIDE = 1


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the `lava` parser."""
    parser = subparsers.add_parser(
        'verify',
        help='compare the solver with exact solutions',
        description='Run flows whose exact solution is known and compare. Each line shows the '
        'quantity that is closest to its bound. The exit status is 1 when one is outside.',
    )
    parser.add_argument(
        '--preset',
        default=presets.DEFAULT,
        metavar='NAME',
        help=f'accuracy: {", ".join(BOUNDED_PRESETS)} (default: {presets.DEFAULT})',
    )
    parser.add_argument(
        '--case',
        action='extend',
        nargs='+',
        metavar='NAME',
        help='only these cases (default: all)',
    )
    parser.add_argument(
        '--json', metavar='FILE', help='also write every measurement to a file, - for stdout'
    )
    parser.add_argument('--device', help='cpu, cuda:0, ... (default: the first GPU, else the CPU)')
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Verify what the arguments name.

    Returns:
        0 when every error is within its bound, else 1.

    Raises:
        LavaError: An argument cannot be used.
    """
    import warp as wp

    from lava_ros.verification.cases import CASES

    validation.choice('--preset', args.preset, BOUNDED_PRESETS)
    accuracy = presets.preset_accuracy(args.preset)
    names = args.case or list(CASES)
    for name in names:
        validation.choice('--case', name, CASES)
    device = args.device or str(wp.get_preferred_device())
    validation.choice('--device', device, [str(known) for known in wp.get_devices()])
    _check_writable(args.json)
    to_stdout = args.json == '-'
    results: list[dict[str, Any]] = []
    outside = 0
    for case in _with_progress([CASES[name] for name in names]):
        result = case.run(accuracy, device)
        judged = [
            (item, bound(args.preset, case.name, item.quantity)) for item in result.measurements
        ]
        # a NaN is within no bound
        outside += sum(not item.error <= limit for item, limit in judged)
        results.append(_as_dict(result, judged))
        if not to_stdout:
            print(_line(case, result, judged), flush=True)
    if not to_stdout:
        total = sum(len(result['measurements']) for result in results)
        print(f'{total - outside} of {total} quantities are within their bounds')
    if args.json:
        report = {'preset': args.preset, 'accuracy': asdict(accuracy), 'device': device}
        _write_json(args.json, {**report, 'within_bounds': not outside, 'runs': results})
    return OUTSIDE if outside else 0


def _line(case: Case, result: Run, judged: Sequence[tuple[Measurement, float]]) -> str:
    def badness(pair: tuple[Measurement, float]) -> float:
        item, limit = pair
        return item.error / limit if item.error == item.error else float('inf')

    item, limit = max(judged, key=badness)
    mark = 'ok' if item.error <= limit else 'OUTSIDE'
    return (
        f'{case.name:17} {item.quantity:22} error {100.0 * item.error:7.3f} %'
        f'  bound {100.0 * limit:7.3f} %  {result.wall_time:7.1f} s  {mark}'
    )


def _as_dict(result: Run, judged: Sequence[tuple[Measurement, float]]) -> dict[str, Any]:
    data = asdict(result)
    data['measurements'] = [
        {**asdict(item), 'error': item.error, 'bound': limit, 'within': item.error <= limit}
        for item, limit in judged
    ]
    return data


def _with_progress(cases: Sequence[Case]) -> Iterator[Case]:
    """The cases, one after the other, with a bar on stderr where that is a terminal."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
    )

    console = Console(stderr=True)
    with Progress(
        TextColumn('{task.description}'),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
        # prints would follow the bar to stderr
        redirect_stdout=sys.stdout.isatty(),
    ) as progress:
        task = progress.add_task('', total=len(cases))
        for case in cases:
            progress.update(task, description=case.title)
            yield case
            progress.advance(task)


def _check_writable(name: str | None) -> None:
    """Refuse a file that cannot be written before the time is spent."""
    if name is not None and name != '-':
        validation.file_to_write('--json', name)


def _write_json(name: str, data: dict[str, Any]) -> None:
    text = json.dumps(data, indent=2)
    if name == '-':
        print(text)
        return
    try:
        Path(name).write_text(text + '\n', encoding='utf-8')
    except OSError as error:
        raise LavaError('--json', name, f'a file that can be written ({error})') from error
