# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava effects`: the effects that a scene needs, and why."""

from __future__ import annotations

import argparse
import csv
from typing import TYPE_CHECKING

from lava_ros.cli.console import write_json
from lava_ros.cli.options import command, forced_effects, seconds_of
from lava_ros.cli.scene_options import SCENE
from lava_ros.files.resources import share_path
from lava_ros.maps.numbers import percent

if TYPE_CHECKING:
    from lava_ros.effects.effect import Effect

#: Costs of effects, measured by `lava bench effects`.
COSTS = 'docs/benchmarks/effects_h200.csv'


@command(
    *SCENE, '--preset', '--horizon', '--on', '--off', '--json',
)
def effects(args: argparse.Namespace) -> int:
    """Print which physical effects a scene needs, and why.

    A dimensionless number decides about each effect. The command prints the number that is
    expected of the flow, its threshold, the time that the effect takes, and the accuracy that
    leaving it out costs.
    """
    from lava_ros.cli.scenes import scene_from_arguments
    from lava_ros.simulation.presets import preset_accuracy
    from lava_ros.simulation.selection import decide, decision_as_dict

    horizon = seconds_of('--horizon', args.horizon)
    scene, forced = scene_from_arguments(args), forced_effects(args)
    accuracy = preset_accuracy(args.preset)
    decisions = decide(scene, forced, accuracy=accuracy, horizon=horizon)
    costs = step_costs()
    width = max(len(item.reason) for item in decisions)
    line = f'{{:16}} {{:3}} {{:{width}}}  {{:>6}}  {{}}'.format
    print(line('effect', '', 'because', 'step', 'without it, at the threshold'))
    for item in decisions:
        cost = f'x {costs[item.name]:.2f}' if item.name in costs else '?'
        switch = 'on' if item.is_on else '-'
        print(line(item.name, switch, item.reason, cost, _without(item.effect)))
    print(f'step: time of a step with this effect alone over one without ({COSTS}); ?: unknown')
    # None where the time of a step has not been measured
    rows = [
        {**decision_as_dict(item), 'step_time_over_bare': costs.get(item.name)}
        for item in decisions
    ]
    write_json(rows, args.json)
    return 0


def _without(effect: Effect) -> str:
    """Describe the cost of leaving an effect out if its number is at the threshold."""
    if not effect.cost:
        return effect.admits
    return f'{effect.admits}; {percent(effect.cost)} of the footprint'


def step_costs() -> dict[str, float]:
    """Return the measured time of a step with each single effect over that of one without effects.

    Raises:
        LavaError: If the file of the measurements is missing from the package's data.
    """
    with share_path(COSTS).open(newline='', encoding='utf-8') as file:
        return {row['benchmark']: float(row['ratio']) for row in csv.DictReader(file)}
