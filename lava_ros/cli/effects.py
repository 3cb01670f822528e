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

"""Print which physical effects a scene needs, and why.

A dimensionless number of the scene decides about each effect. The command prints the number, its
threshold, what the effect costs in time, and what leaving it out costs in accuracy.
"""

import argparse
from collections.abc import Mapping
import csv
import math
from typing import Any

from lava_ros.cli.options import add_options, forced_effects, seconds_of
from lava_ros.cli.output import write_json
from lava_ros.cli.scenes import add_scene_arguments, scene_from_arguments
from lava_ros.files.resources import share_path
from lava_ros.simulation.presets import preset_accuracy
from lava_ros.simulation.selection import decide, Decision

#: What effects cost, measured by `lava bench effects`.
COSTS = 'docs/benchmarks/effects_h200.csv'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_scene_arguments(parser, positional=True)
    add_options(parser, '--preset', '--horizon', '--on', '--off', '--json')


def run(args: argparse.Namespace) -> int:
    """Print the table."""
    horizon = seconds_of('--horizon', args.horizon)
    decisions = decide(
        scene_from_arguments(args),
        forced_effects(args),
        accuracy=preset_accuracy(args.preset),
        horizon=horizon,
    )
    costs = step_costs()
    _print(decisions, costs)
    write_json([as_dict(item, costs) for item in decisions], args.json)
    return 0


def step_costs() -> dict[str, float]:
    """Measured time of a step with each single effect, relative to that of a step without effects.

    Raises:
        LavaError: The file of the measurements is missing from the package's data.
    """
    with share_path(COSTS).open(newline='', encoding='utf-8') as file:
        return {row['benchmark']: float(row['ratio']) for row in csv.DictReader(file)}


def as_dict(decision: Decision, costs: Mapping[str, float]) -> dict[str, Any]:
    """A decision as plain data, with what the effect costs."""
    effect = decision.effect
    return {
        'effect': decision.name,
        'title': effect.title,
        'on': decision.is_on,
        'forced': decision.is_forced,
        'number': effect.symbol,
        'value': None if math.isnan(decision.value) else decision.value,
        # JSON has no infinity: what is only on when asked for has no threshold
        'threshold': None if math.isinf(effect.threshold) else effect.threshold,
        'reason': decision.reason,
        # None where it has not been measured
        'step_time_over_bare': costs.get(decision.name),
        'without_it': effect.admits,
        'source': effect.source,
    }


def _print(decisions: tuple[Decision, ...], costs: Mapping[str, float]) -> None:
    reasons = [item.reason for item in decisions]
    width = max(len(reason) for reason in reasons)
    head = 'without it, below the threshold'
    print(f'{"effect":16} {"":3} {"because":{width}}  {"step":>6}  {head}')
    for item, reason in zip(decisions, reasons, strict=True):
        switch, name = 'on' if item.is_on else '-', item.name
        cost = f'x {costs[name]:.2f}' if name in costs else '?'
        print(f'{name:16} {switch:3} {reason:{width}}  {cost:>6}  {item.effect.admits}')
    print(f'step: time of a step with this effect alone over one without ({COSTS}); ?: unknown')
