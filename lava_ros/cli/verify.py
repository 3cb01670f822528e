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

"""Compare the solver with exact solutions.

The command runs flows whose exact solution is known. It prints the quantity of each that is
closest to its bound. The exit status is 1 if a quantity is outside its bound.
"""

import argparse
from collections.abc import Sequence
from dataclasses import asdict
import sys
from typing import Any

from lava_ros import validation
from lava_ros.cli.options import add_options, device_named
from lava_ros.cli.output import Progress, write_json
from lava_ros.simulation import presets
from lava_ros.verification import cases
from lava_ros.verification.bounds import bound, BOUNDED_PRESETS
from lava_ros.verification.cases import Case, Measurement, Run

#: Exit status when an error is outside its bound.
OUTSIDE = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        '--preset', default=presets.DEFAULT, metavar='NAME',
        help=f'accuracy: {", ".join(BOUNDED_PRESETS)} (default: {presets.DEFAULT})',
    )
    parser.add_argument(
        '--case', action='extend', nargs='+', metavar='NAME',
        help='cases to run (default: all)',
    )
    add_options(parser, '--device', '--json')


def run(args: argparse.Namespace) -> int:
    """Verify what the arguments name.

    Returns:
        0 when every error is within its bound, else 1.
    """
    validation.choice('--preset', args.preset, BOUNDED_PRESETS)
    accuracy = presets.preset_accuracy(args.preset)
    names = args.case or list(cases.CASES)
    for name in names:
        validation.choice('--case', name, cases.CASES)
    device = device_named(args.device)
    to_stdout = args.json == '-'
    results: list[dict[str, Any]] = []
    outside = 0
    with Progress(sys.stderr) as progress:
        for number, case in enumerate(cases.CASES[name] for name in names):
            progress.show(f'{number + 1} of {len(names)}: {case.title}', number / len(names))
            result = case.run(accuracy, device)
            judged = [
                (item, bound(args.preset, case.name, item.quantity))
                for item in result.measurements
            ]
            # a NaN is within no bound
            outside += sum(not item.error <= limit for item, limit in judged)
            results.append(_as_dict(result, judged))
            if not to_stdout:
                print(_line(case, result, judged), flush=True)
    if not to_stdout:
        total = sum(len(result['measurements']) for result in results)
        print(f'{total - outside} of {total} quantities are within their bounds')
    report = {'preset': args.preset, 'accuracy': asdict(accuracy), 'device': device}
    write_json({**report, 'within_bounds': not outside, 'runs': results}, args.json)
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
