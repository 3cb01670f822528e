# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava check solver`: the solver against exact solutions."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict
import sys
from typing import Any, TYPE_CHECKING

from lava_ros import validation
from lava_ros.cli.console import accuracy_as_dict, Progress, with_units, write_json
from lava_ros.cli.options import argument, command, DEFAULT_PRESET, device_named
from lava_ros.verification.bounds import bound, BOUNDED_PRESETS

if TYPE_CHECKING:
    from lava_ros.verification.cases import Measurement, Run


@command(
    argument(
        '--preset', 'NAME', f'accuracy: {", ".join(BOUNDED_PRESETS)}', DEFAULT_PRESET
    ),
    argument('--case', 'NAME', 'cases to run (default: all)', action='extend', nargs='+'),
    '--device', '--json',
)
def solver(args: argparse.Namespace) -> int:
    """Compare the solver with exact solutions.

    The command runs flows whose exact solution is known. It prints the quantity of each that is
    closest to its bound. The exit status is 1 if a quantity is outside its bound.
    """
    from lava_ros.simulation import presets
    from lava_ros.verification import cases

    validation.choice('--preset', args.preset, BOUNDED_PRESETS)
    accuracy = presets.preset_accuracy(args.preset)
    names = args.case or list(cases.CASES)
    for name in names:
        validation.choice('--case', name, cases.CASES)
    device = device_named(args.device)
    results: list[dict[str, Any]] = []
    with Progress(sys.stderr) as progress:
        for number, case in enumerate(cases.CASES[name] for name in names):
            progress.show(f'{number + 1} of {len(names)}: {case.title}', number / len(names))
            result = case.run(accuracy, device)
            judged = [
                (item, bound(args.preset, case.name, item.quantity))
                for item in result.measurements
            ]
            results.append(_judged(result, judged))
            print(_line(case.name, result, judged), flush=True)
    quantities = [item for result in results for item in result['measurements']]
    within = sum(item['within'] for item in quantities)
    print(f'{within} of {len(quantities)} quantities are within their bounds')
    outside = within < len(quantities)
    report = {
        'preset': args.preset, 'device': device, 'within_bounds': not outside,
        'accuracy': accuracy_as_dict(accuracy),
        'runs': with_units(results, s='simulated_time wall_time'),
    }
    write_json(report, args.json)
    return int(outside)


def _line(name: str, result: Run, judged: Sequence[tuple[Measurement, float]]) -> str:
    def badness(pair: tuple[Measurement, float]) -> float:
        item, limit = pair
        return item.error / limit if item.error == item.error else float('inf')

    item, limit = max(judged, key=badness)
    mark = 'ok' if item.error <= limit else 'OUTSIDE'
    return (
        f'{name:17} {item.quantity:22} error {100.0 * item.error:7.3f} %'
        f'  bound {100.0 * limit:7.3f} %  {result.wall_time:7.1f} s  {mark}'
    )


def _judged(result: Run, judged: Sequence[tuple[Measurement, float]]) -> dict[str, Any]:
    """Return a run as plain data; an error that is NaN is outside every bound."""
    return asdict(result) | {'measurements': [
        {**asdict(item), 'error': item.error, 'bound': limit, 'within': item.error <= limit}
        for item, limit in judged
    ]}
