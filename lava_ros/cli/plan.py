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

"""`lava plan`: the accuracy one can afford in a time, on this machine."""

from __future__ import annotations

import argparse
from dataclasses import asdict
import json
from pathlib import Path

from lava_ros import validation
from lava_ros.cli.scenes import add_scene_arguments, scene_from_arguments
from lava_ros.errors import LavaError


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the `lava` parser."""
    parser = subparsers.add_parser(
        'plan',
        help='say how accurate a run, or an ensemble, can be in a time',
        description='Run coarse pilots of a scene on this machine, and say with which spacing and '
        'preset it takes the time there is, how many members an ensemble can have, and how large '
        'the errors will be: that of the method, as a share of the covered area, and that of a '
        'probability for having that many members.',
    )
    add_scene_arguments(parser, positional=True)
    parser.add_argument(
        '--within', required=True, metavar='TIME', help='the time there is: 30s, 10min'
    )
    parser.add_argument(
        '--horizon', default='6h', metavar='TIME', help='how far to run (default: %(default)s)'
    )
    parser.add_argument(
        '--members', default='1', metavar='N',
        help='members of an ensemble, one after the other, or auto: as many as err least '
        '(default: %(default)s)',
    )
    parser.add_argument('--device', help='cpu, cuda:0, ... (default: the first GPU, else the CPU)')
    parser.add_argument('--json', metavar='FILE', help='also write the plan to a file')
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the plan.

    Raises:
        LavaError: An argument or a file cannot be used, or the time is too short.
    """
    from lava_ros.cli.durations import seconds_of

    within = seconds_of('--within', args.within)
    horizon = seconds_of('--horizon', args.horizon)
    members = _members(args.members)
    scene = scene_from_arguments(args)
    if args.json:
        # what cannot be written had better be known before
        validation.file_to_write('--json', args.json)
    from lava_ros.forecast.affordable import afford
    from lava_ros.forecast.pilots import Pilot, spacing_at

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
        print(f'effect {name} {"on" if is_on else "off"}: what this spacing calls for is too dear')
    print(
        f'{plan.members} run{"s" * (plan.members > 1)} in about {plan.wall_time:.2g} s of '
        f'{within:g} s' + ('; more time would not help' if plan.is_finest else '')
    )
    print(f'error for being coarse: about {100.0 * plan.error:.2g} % of the covered area')
    if plan.members > 1:
        print(f'error of a probability of 50 %: {100.0 * plan.sampling_error:.2g} %')
    if args.json:
        _write(args.json, json.dumps(asdict(plan), indent=1))
    return 0


def _members(text: str) -> int | None:
    if text == 'auto':
        return None
    if not text.isdecimal() or int(text) < 1:
        raise LavaError('--members', text, 'a whole number from 1 on, or auto')
    return int(text)


def _write(path: str, text: str) -> None:
    try:
        Path(path).write_text(text + '\n', encoding='utf-8')
    except OSError as error:
        raise LavaError('--json', path, f'a file to write ({error})') from error
