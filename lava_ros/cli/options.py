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

"""Options that several commands take, each declared once, and times as people write them: 6h."""

import argparse
import math
import re
from typing import Any

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.simulation.presets import DEFAULT, PRESETS
from lava_ros.simulation.selection import HORIZON

#: Seconds of each unit.
UNITS = {'s': 1.0, 'min': 60.0, 'h': 3600.0, 'd': 86400.0}

_FORCED: dict[str, Any] = {'action': 'append', 'default': [], 'metavar': 'EFFECT'}

_OPTIONS: dict[str, dict[str, Any]] = {
    'bag': {'help': 'bag directory or .mcap file'},
    '--device': {'help': 'computing device: cpu, cuda:0, ... (default: the first GPU, else cpu)'},
    '--domain': {
        'type': int,
        'help': 'ROS domain ID (default: a free one)',
    },
    '--epsg': {
        'type': int,
        'metavar': 'CODE',
        'help': 'EPSG code of the coordinate system, for a file that names none',
    },
    '--fresh': {'action': 'store_true', 'help': 'ignore the results of earlier runs'},
    '--horizon': {
        'default': f'{HORIZON / 3600.0:g}h',
        'metavar': 'TIME',
        'help': 'simulated time of a run: 6h, 90min (default: %(default)s)',
    },
    '--json': {
        'metavar': 'FILE',
        'help': 'write the result as JSON to a file; - writes it to stdout',
    },
    '--low-pass': {
        'type': float,
        'metavar': 'M',
        'help': 'smooth the elevation with a Gaussian of this standard deviation [m]',
    },
    '--off': {**_FORCED, 'help': 'switch this effect off; may be repeated'},
    '--on': {**_FORCED, 'help': 'switch this effect on; may be repeated'},
    '--preset': {
        'choices': tuple(PRESETS),
        'default': DEFAULT,
        'help': 'accuracy (default: %(default)s)',
    },
    '--seed': {
        'type': int,
        'default': 0,
        'metavar': 'N',
        'help': 'seed of the random numbers (default: %(default)s)',
    },
    '--spacing': {
        'type': float,
        'metavar': 'M',
        'help': "distance between particles [m]; replaces the preset's",
    },
    '--threshold': {
        'type': float,
        'default': 0.1,
        'metavar': 'M',
        'help': 'thickness at which lava counts as arrived [m] (default: %(default)s)',
    },
}


def add_options(parser: argparse.ArgumentParser, *names: str, **defaults: Any) -> None:
    """Add shared options, by name, to a parser; ``bag`` is a positional argument.

    ``defaults`` replace the usual default values, by the attribute of the parsed arguments.
    """
    for name in names:
        parser.add_argument(name, **_OPTIONS[name])
    parser.set_defaults(**defaults)


def forced_effects(args: argparse.Namespace) -> dict[str, bool]:
    """The effects that ``--on`` and ``--off`` force, by name."""
    return {**dict.fromkeys(args.on, True), **dict.fromkeys(args.off, False)}


def device_named(name: str | None) -> str:
    """The Warp device that ``--device`` names; for None the first GPU, or the CPU without one.

    Raises:
        LavaError: There is no such device.
    """
    import warp as wp

    import lava_ros.simulation  # noqa: F401  (quietens Warp)

    device = name or str(wp.get_preferred_device())
    return validation.choice('--device', device, [str(known) for known in wp.get_devices()])


def seconds_of(field: str, text: str, *, may_be_zero: bool = False) -> float:
    """Read a time [s] from a number with a unit; without a unit it is in seconds.

    Raises:
        LavaError: The text is not a finite time above 0, or 0 where ``may_be_zero`` is set. The
            error names ``field``.
    """
    match = re.fullmatch(r'\s*([^a-z\s]+(?:e[+-]?\d+)?)\s*([a-z]*)\s*', text)
    if match is None or (match[2] or 's') not in UNITS:
        raise LavaError(field, text, f'a number with a unit, {", ".join(UNITS)}: 6h, 90min')
    above, at_least = (None, 0.0) if may_be_zero else (0.0, None)
    number = validation.number(field, match[1], above=above, at_least=at_least)
    seconds = number * UNITS[match[2] or 's']
    if math.isinf(seconds):
        raise LavaError(field, text, 'a finite time')
    return seconds
