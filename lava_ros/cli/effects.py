# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava effects`: the effects that a scene needs, and why."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
import csv
import logging
import math
from typing import TYPE_CHECKING

from lava_ros.cli.console import Progress, write_json
from lava_ros.cli.options import argument, command, forced_effects, HORIZON, seconds_of
from lava_ros.cli.scene_options import SCENE, UNTIL
from lava_ros.files.resources import share_path
from lava_ros.layers.numbers import percent

if TYPE_CHECKING:
    from lava_ros.effects.effect import Effect
    from lava_ros.scene import Scene
    from lava_ros.simulation.accuracy import Accuracy
    from lava_ros.simulation.resolution import Resolution
    from lava_ros.simulation.selection import Decision

_LOG = logging.getLogger(__name__)

#: Costs of effects, measured by `lava check speed effects`.
COSTS = 'docs/benchmarks/effects_h200.csv'


@command(
    *SCENE, '--preset', UNTIL, '--on', '--off', '--device',
    argument(
        '--measure', None, 'simulate the scene up to --until, and print the numbers of the '
        'flow itself', action='store_true',
    ),
    '--json',
)
def effects(args: argparse.Namespace) -> int:
    """Print the kind of flow, which physical effects a scene needs, and why.

    A dimensionless number decides about each effect. The command prints the number that is
    expected of the flow, its threshold, the time that the effect takes, and the accuracy that
    leaving it out costs. With --measure it also prints the largest number in a run. The effects
    of a mapped eruption are those of its run, to the end of the eruption.
    """
    from lava_ros.cli.scenes import case_from_arguments, scene_from_arguments
    from lava_ros.hindcast.run import Settings, simulated_scene
    from lava_ros.simulation.presets import preset_accuracy
    from lava_ros.simulation.resolution import resolution_of
    from lava_ros.simulation.selection import decide

    forced, accuracy = forced_effects(args), preset_accuracy(args.preset)
    case = case_from_arguments(args, effects.arguments)
    if case is not None:
        settings = Settings(args.preset, forced=forced)
        scene = simulated_scene(case, settings.coarseness(case))
        horizon, forced, accuracy = case.duration, settings.effects, settings.accuracy(case)
    else:
        horizon = seconds_of('--until', args.until or HORIZON)
        scene = scene_from_arguments(args)
    if args.measure:
        decisions, resolution = _measured(scene, forced, accuracy, horizon, args.device)
    else:
        decisions = decide(scene, forced, accuracy=accuracy, horizon=horizon)
        resolution = resolution_of(scene, accuracy, forced, horizon=horizon)
    if resolution.kind is not None:
        print(f'kind of flow: {resolution.kind.text()}')
    costs = step_costs()
    width = max(len(item.reason) for item in decisions)
    line = f'{{:16}} {{:3}} {{:{width}}}  {{:>8}}  {{:>6}}  {{}}'.format
    print(line('effect', '', 'because', 'measured', 'step', 'without it, at the threshold'))
    for item in decisions:
        cost = f'x {costs[item.name]:.2f}' if item.name in costs else '?'
        switch = 'on' if item.is_on else '-'
        measured = '-' if math.isnan(item.measured) else f'{item.measured:.2g}'
        print(line(item.name, switch, item.reason, measured, cost, _without(item.effect)))
    print(f'step: time of a step with this effect alone over one without ({COSTS}); ?: unknown')
    # None where the time of a step has not been measured
    rows = [
        {**item.as_dict(), 'step_time_over_bare': costs.get(item.name)}
        for item in decisions
    ]
    for text in resolution.warnings():
        _LOG.warning(text)
    kind = None if resolution.kind is None else resolution.kind.text()
    write_json({'until_s': horizon, 'flow_kind': kind, 'effects': rows}, args.json)
    return 0


def _measured(
    scene: Scene, forced: Mapping[str, bool], accuracy: Accuracy, horizon: float,
    device: str | None,
) -> tuple[tuple[Decision, ...], Resolution]:
    from lava_ros.effects import EFFECTS
    from lava_ros.runs.drive import drive

    # the solver loads Warp, which the expected numbers do not need
    from lava_ros.simulation.output.measurement import current_resolution
    from lava_ros.simulation.simulation import Simulation

    simulation = Simulation(
        scene, effects=forced, accuracy=accuracy, device=device, horizon=horizon
    )
    with Progress() as progress:
        drive(simulation, horizon, [progress.sink(horizon)])
    simulation.review(EFFECTS)
    resolution = current_resolution(
        simulation.snapshot(), simulation.accuracy, simulation.resolution
    )
    return simulation.decisions(), resolution


def _without(effect: Effect) -> str:
    """Describe the cost of leaving an effect out if its number is at the threshold."""
    if not effect.cost:
        return effect.admits
    footprint, thickness = percent(effect.cost), percent(effect.thickness_cost)
    return f'{effect.admits}; {footprint} of the footprint, {thickness} of the thickness'


def step_costs() -> dict[str, float]:
    """Return the measured time of a step with each single effect over that of one without effects.

    Raises:
        LavaError: If the file of the measurements is missing from the package's data.
    """
    with share_path(COSTS).open(newline='', encoding='utf-8') as file:
        return {row['benchmark']: float(row['ratio']) for row in csv.DictReader(file)}
