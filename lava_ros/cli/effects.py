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

"""`lava effects`: which physics a scene calls for, and why."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
import csv
import json
import math
from pathlib import Path
from typing import Any

from lava_ros import presets, validation
from lava_ros.choice import decide, Decision, HORIZON
from lava_ros.cli.scenes import add_scene_arguments, scene_from_arguments
from lava_ros.errors import LavaError
from lava_ros.share import share_path

#: What effects cost, measured by `lava bench effects`.
COSTS = 'docs/benchmarks/effects_h200.csv'


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the `lava` parser."""
    parser = subparsers.add_parser(
        'effects',
        help='say which physics a scene calls for, and why',
        description='Decide about every effect by a dimensionless number of the scene, and print '
        'the number, its threshold, what the effect costs and what leaving it out would cost.',
    )
    add_scene_arguments(parser, positional=True)
    parser.add_argument(
        '--preset', default=presets.DEFAULT, metavar='NAME', help='accuracy (default: %(default)s)'
    )
    parser.add_argument(
        '--hours',
        type=float,
        default=HORIZON / 3600.0,
        metavar='H',
        help='how far ahead to look (default: %(default)g)',
    )
    parser.add_argument('--on', action='append', default=[], metavar='EFFECT', help='force it on')
    parser.add_argument(
        '--off', action='append', default=[], metavar='EFFECT', help='force it off'
    )
    parser.add_argument('--json', metavar='FILE', help='also write the table to a file')
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the table.

    Raises:
        LavaError: An argument or a file cannot be used.
    """
    validation.choice('--preset', args.preset, presets.PRESETS)
    horizon = 3600.0 * validation.number('--hours', args.hours, above=0.0, unit='h')
    decisions = decide(
        scene_from_arguments(args),
        {**dict.fromkeys(args.on, True), **dict.fromkeys(args.off, False)},
        accuracy=presets.preset_accuracy(args.preset),
        horizon=horizon,
    )
    costs = step_costs()
    _print(decisions, costs)
    if args.json:
        table = [as_dict(item, costs) for item in decisions]
        text = json.dumps(table, indent=1, allow_nan=False)
        try:
            Path(args.json).write_text(text + '\n', encoding='utf-8')
        except OSError as error:
            raise LavaError('--json', args.json, f'a file to write ({error})') from error
    return 0


def step_costs() -> dict[str, float]:
    """Time of a step with each effect alone over that of the bare step, as measured.

    Raises:
        LavaError: The measurements are not where the package's data are.
    """
    with share_path(COSTS).open(newline='', encoding='utf-8') as file:
        return {row['benchmark']: float(row['ratio']) for row in csv.DictReader(file)}


def as_dict(decision: Decision, costs: Mapping[str, float]) -> dict[str, Any]:
    """A decision as plain data, with what the effect costs."""
    criterion = decision.criterion
    return {
        'effect': criterion.effect,
        'title': criterion.title,
        'on': decision.is_on,
        'forced': decision.is_forced,
        'number': criterion.symbol,
        'value': None if math.isnan(decision.value) else decision.value,
        # JSON has no infinity: what is only on when asked for has no threshold
        'threshold': None if math.isinf(criterion.threshold) else criterion.threshold,
        'reason': decision.reason,
        'step_time_over_bare': costs[criterion.effect],
        'without_it': criterion.admits,
        'source': criterion.source,
    }


def _print(decisions: tuple[Decision, ...], costs: Mapping[str, float]) -> None:
    reasons = [item.reason for item in decisions]
    width = max(len(reason) for reason in reasons)
    head = 'without it, below the threshold'
    print(f'{"effect":16} {"":3} {"because":{width}}  {"step":>6}  {head}')
    for item, reason in zip(decisions, reasons, strict=True):
        switch, name = 'on' if item.is_on else '-', item.criterion.effect
        cost = f'x {costs[name]:.2f}'
        print(f'{name:16} {switch:3} {reason:{width}}  {cost:>6}  {item.criterion.admits}')
    print(f'step: time of a step with this effect alone over the bare step ({COSTS})')
