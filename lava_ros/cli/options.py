# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""What commands are, options that several take, and times as people write them: 6h."""

import argparse
from collections.abc import Callable
import math
import re
from typing import Any, NamedTuple

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.simulation.presets import DEFAULT, PRESETS
from lava_ros.simulation.selection import HORIZON

#: Seconds of each unit.
UNITS = {'s': 1.0, 'min': 60.0, 'h': 3600.0, 'd': 86400.0}

#: Names of an argument and its options, as ``add_argument`` takes them.
Argument = tuple[tuple[str, ...], dict[str, Any]]

#: Gets the parsed arguments, and returns the exit status; its docstring is the command's help. It
#: raises LavaError for arguments and files that cannot be used.
Run = Callable[[argparse.Namespace], int]


class Command(NamedTuple):
    """A command, its arguments, and default values that replace the usual ones, by attribute."""

    run: Run
    arguments: list[Argument]
    defaults: dict[str, Any]


def argument(
    names: str, metavar: str | tuple[str, ...] | None, text: str | None, usual: Any = None,
    **options: Any,
) -> Argument:
    """An argument of a command: its names, what stands for its value, and what it is.

    ``usual`` is its value by default, which the text then names, or the type of one without.
    """
    if isinstance(usual, type):
        options['type'] = usual
    elif usual is not None:
        options['default'] = usual
        if type(usual) in (int, float):
            options['type'] = type(usual)
        if isinstance(usual, int | float | str) and usual != '' and '(default' not in str(text):
            text = f'{text} (default: %(default){"g" if isinstance(usual, float) else "s"})'
    if metavar is not None:
        options['metavar'] = metavar
    return tuple(names.split()), {'help': text, **options}


def command(*arguments: str | Argument, **defaults: Any) -> Callable[[Run], Command]:
    """Make a command of a function; a name alone is an argument that several commands take.

    A command that takes a bag takes ``--incomplete`` as well.
    """
    declared = [_SHARED[item] if isinstance(item, str) else item for item in arguments]
    if any(names == ('bag',) for names, _ in declared):
        declared.append(_SHARED['--incomplete'])
    return lambda run: Command(run, declared, defaults)


_SHARED = {item[0][0]: item for item in (
    argument('bag', None, 'bag directory or .mcap file'),
    argument(
        '--device', None, 'computing device: cpu, cuda:0, ... (default: the first GPU, else cpu)'
    ),
    argument('--domain', None, 'ROS domain ID (default: a free one)', int),
    argument(
        '--epsg', 'CODE', 'EPSG code of the coordinate system; replaces what the file states', int
    ),
    argument('--fresh', None, 'ignore the results of earlier runs', action='store_true'),
    argument('--horizon', 'TIME', 'simulated time of a run: 6h, 90min', f'{HORIZON / 3600.0:g}h'),
    argument(
        '--incomplete', None, 'accept a bag that is damaged or lacks messages: exit with status 0 '
        'instead of 1', action='store_true',
    ),
    argument('--json', 'FILE', 'write the result as JSON to a file; - writes it to stdout'),
    argument(
        '--low-pass', 'M', 'smooth the elevation with a Gaussian of this standard deviation [m]',
        float,
    ),
    argument(
        '--nodata', 'VALUE', 'value of cells without data that the terrain does not declare; '
        'none: all such cells are ground',
    ),
    argument(
        '--off', 'EFFECT', 'switch this effect off; may be repeated', [], action='append'
    ),
    argument('--on', 'EFFECT', 'switch this effect on; may be repeated', [], action='append'),
    argument('--preset', None, 'accuracy', DEFAULT, choices=tuple(PRESETS)),
    argument('--seed', 'N', 'seed of the random numbers', 0),
    argument('--spacing', 'M', "distance between particles [m]; replaces the preset's", float),
    argument('--threshold', 'M', 'thickness at which lava counts as arrived [m]', 0.1),
)}


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
