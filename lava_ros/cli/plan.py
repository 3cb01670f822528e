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

"""Find the accuracy that a run, or an ensemble, can have in a given time.

The command makes coarse pilot runs of a scene on this machine. It prints the preset and the
spacing with which the run takes the given time, the number of members that an ensemble can have,
and the expected errors: the numerical error as a share of the covered area, and the sampling error
of a probability.
"""

import argparse
from dataclasses import asdict

from lava_ros import validation
from lava_ros.cli.options import add_options, seconds_of
from lava_ros.cli.output import write_json
from lava_ros.cli.scenes import add_scene_arguments, scene_from_arguments
from lava_ros.errors import LavaError
from lava_ros.forecast.pilots import Pilot, spacing_at
from lava_ros.forecast.planning import afford
from lava_ros.forecast.sampling import MOST_MEMBERS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_scene_arguments(parser, positional=True)
    parser.add_argument(
        '--within', required=True, metavar='TIME', help='wall time to use: 30s, 10min'
    )
    parser.add_argument(
        '--members', default='1', metavar='N',
        help='number of members of an ensemble, which run one after the other; auto takes the '
        'number with the smallest error (default: %(default)s)',
    )
    add_options(parser, '--horizon', '--device', '--json', horizon='6h')


def run(args: argparse.Namespace) -> int:
    """Print the plan."""
    within = seconds_of('--within', args.within)
    horizon = seconds_of('--horizon', args.horizon)
    members = _members(args.members)
    scene = scene_from_arguments(args)

    def tell(pilot: Pilot) -> None:
        spacing = spacing_at(scene, pilot.refinement, horizon)
        print(
            f'pilot: spacing {spacing:.3g} m took {pilot.spent:.3g} s'
            + ('' if pilot.is_done else f', stopped: it would take {pilot.wall_time:.3g} s'),
            flush=True,
        )

    plan = afford(
        scene, within=within, horizon=horizon, members=members, device=args.device,
        may_force=True, on_pilot=tell,
    )
    print(f'preset {plan.preset}, spacing {plan.spacing:.3g} m')
    for name, is_on in plan.forced.items():
        state = 'on' if is_on else 'off'
        print(f'effect {name} {state}: what the scene calls for takes too long at this spacing')
    print(
        f'{plan.members} run{"s" * (plan.members > 1)} in about {plan.wall_time:.2g} s of '
        f'{within:g} s' + ('; more time would not help' if plan.is_finest else '')
    )
    print(f'numerical error: about {100.0 * plan.error:.2g} % of the covered area')
    if plan.members > 1:
        print(f'error of a probability of 50 %: {100.0 * plan.sampling_error:.2g} %')
    write_json(asdict(plan), args.json)
    return 0


def _members(text: str) -> int | None:
    if text == 'auto':
        return None
    if not text.isdecimal():
        raise LavaError('--members', text, 'a whole number from 1 on, or auto')
    return validation.whole('--members', text, at_least=1, at_most=MOST_MEMBERS)
