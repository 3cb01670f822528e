# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava plan`: the accuracy that is possible in a given time."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import TYPE_CHECKING

from lava_ros import validation
from lava_ros.cli.console import write_json
from lava_ros.cli.options import argument, command, seconds_of
from lava_ros.cli.scene_options import SCENE
from lava_ros.errors import LavaError

if TYPE_CHECKING:
    from lava_ros.forecast.pilot_runs import Pilot


@command(
    *SCENE,
    argument('--within', 'TIME', 'wall time to use: 30s, 10min', required=True),
    argument(
        '--members', 'N', 'number of members of an ensemble, which run one after the other; auto '
        'takes the number with the smallest error', '1',
    ),
    '--horizon', '--device', '--json',
    horizon='6h',
)
def plan(args: argparse.Namespace) -> int:
    """Find the accuracy that a run, or an ensemble, can have in a given time.

    The command makes coarse pilot runs of a scene on this machine. It prints the preset and the
    spacing with which the run takes the given time, the number of members that an ensemble can
    have, and the expected errors: the numerical error as a fraction of the covered area, and the
    sampling error of a probability.
    """
    from lava_ros.cli.scenes import log_resolution, scene_from_arguments
    from lava_ros.forecast.pilot_runs import spacing_at
    from lava_ros.forecast.planning import plan_within
    from lava_ros.forecast.sampling import MAX_MEMBERS
    from lava_ros.simulation.presets import preset_accuracy

    within = seconds_of('--within', args.within)
    horizon = seconds_of('--horizon', args.horizon)
    members = None
    if args.members != 'auto':
        if not args.members.isdecimal():
            raise LavaError('--members', args.members, 'a whole number at or above 1, or auto')
        members = validation.whole('--members', args.members, at_least=1, at_most=MAX_MEMBERS)
    scene = scene_from_arguments(args)

    def report(pilot: Pilot) -> None:
        spacing = spacing_at(scene, pilot.refinement, horizon)
        print(
            f'pilot: spacing {spacing:.3g} m took {pilot.spent:.3g} s'
            + ('' if pilot.is_done else f', stopped: it would take {pilot.wall_time:.3g} s'),
            flush=True,
        )

    try:
        found = plan_within(
            scene, within=within, horizon=horizon, members=members, device=args.device,
            may_force=True, on_pilot=report,
        )
    except LavaError as error:
        if error.field != 'within':
            raise
        raise LavaError('--within', args.within, error.expected) from None
    print(f'preset {found.preset}, spacing {found.spacing:.3g} m')
    for name, is_on in found.forced.items():
        state = 'on' if is_on else 'off'
        print(f'effect {name} {state}: the choice for the scene takes too long at this spacing')
    print(
        f'{found.members} run{"s" * (found.members > 1)} in about {found.wall_time:.2g} s of '
        f'{within:g} s' + ('; more time would not help' if found.is_finest else '')
    )
    print(
        f'numerical error: about {100.0 * found.error:.2g} % of the covered area, and '
        f'{100.0 * found.cell_error:.2g} % by the cells of {scene.terrain.resolution:g} m'
    )
    if found.members > 1:
        print(f'error of a probability of 50 %: {100.0 * found.sampling_error:.2g} %')
    accuracy = preset_accuracy(found.preset, spacing=found.spacing)
    log_resolution(scene, accuracy, found.forced, horizon)
    write_json(asdict(found), args.json)
    return 0
