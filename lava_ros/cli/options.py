# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Declaration of commands, their common options, and times with a unit, such as 6h."""

import argparse
from collections.abc import Callable, Iterable, Sequence
from functools import partial
import math
import re
from typing import Any, NamedTuple

from lava_ros import validation
from lava_ros.errors import LavaError, Typed
from lava_ros.simulation.carriers import METHOD_CHOICES, METHOD_MEANING, METHODS

#: Presets and the default one, as in ``simulation.presets``, which is slow to import.
PRESETS = ('draft', 'standard', 'fine', 'reference', 'as-published')
DEFAULT_PRESET = 'standard'

#: Default simulated time of a run, as in ``lava_ros.simulation.resolution``.
HORIZON = '24h'

#: Maps of `lava export`, and formats of maps and shapes, as in ``lava_ros.products.export``.
SOURCES = ('thickness', 'temperature', 'hazard')
MAPS = (*SOURCES, 'arrival', 'inundated', 'peak_thickness')
FORMATS = ('tif', 'geojson', 'gpkg', 'shp', 'kml', 'kmz', 'zip', 'csv', 'nc')

#: Seconds of each unit.
UNITS = {'s': 1.0, 'min': 60.0, 'h': 3600.0, 'd': 86400.0}

#: Names of an argument and its options, both for ``add_argument``.
Argument = tuple[tuple[str, ...], dict[str, Any]]

#: Receives the parsed arguments, and returns the exit status; its docstring is the command's help.
#: Raises LavaError for invalid arguments and files.
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
    """Declare an argument of a command; ``names`` are separated by spaces, ``text`` is its help.

    ``usual`` is the default value, which is added to the text, or the type of a value without one.
    """
    name = long_name(names.split())
    if isinstance(usual, type):
        options['type'] = usual
    elif usual is not None:
        options['default'] = usual
        if isinstance(usual, int | float) and not isinstance(usual, bool):
            options['type'] = float if isinstance(usual, float) else int
        if isinstance(usual, int | float | str) and usual != '' and '(default' not in str(text):
            text = f'{text} (default: %(default){"g" if isinstance(usual, float) else "s"})'
    if metavar is not None:
        options['metavar'] = metavar
    if 'choices' in options:
        options['type'] = _checked(partial(validation.choice, name, allowed=options['choices']))
    elif options.get('type') in (int, float):
        options['type'] = _checked(partial(_number, name, options['type']))
    elif options.get('action', 'append') in ('append', 'extend') and 'type' not in options:
        options['type'] = _without_space
    return tuple(names.split()), {'help': text, **options}


def long_name(names: Sequence[str]) -> str:
    """Return the first long name of an option, or the name of another argument."""
    return next((item for item in names if item.startswith('--')), names[-1])


def _checked(check: Callable[[str], Any]) -> Callable[[str], Any]:
    """Return a check as a type of argparse, which replaces the text of other exceptions."""

    def convert(text: str) -> Any:
        try:
            return check(_without_space(text))
        except LavaError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return convert


def _number(name: str, kind: type, text: str) -> float:
    if kind is float:
        return validation.number(name, text)
    try:
        return int(text)
    except ValueError:
        raise LavaError(name, text, 'a whole number') from None


def epsg_code(text: str) -> int:
    """Return the number in an EPSG code, such as 32633 or EPSG:32633."""
    code = re.fullmatch(r'(?:EPSG:)?(\d+)', text, re.IGNORECASE)
    if code is None:
        raise LavaError('--epsg', text, 'an EPSG code such as 32633')
    return int(code[1])


def _without_space(text: str) -> str:
    """Remove the space that ``main`` puts before a minus."""
    return text[1:] if re.match(r' -\.?\d', text) else text


def command(*arguments: str | Argument, **defaults: Any) -> Callable[[Run], Command]:
    """Make a command of a function; a string is the name of an argument in ``_SHARED``.

    A command with a ``bag`` also has ``--incomplete``.
    """
    declared = [_SHARED[item] if isinstance(item, str) else item for item in arguments]
    if any(names == ('bag',) for names, _ in declared):
        declared.append(_SHARED['--incomplete'])
    return lambda run: Command(run, declared, defaults)


def output_option(metavar: str, text: str, usual: str | None = None, **options: Any) -> Argument:
    """Declare ``-o``, which names the file or the folder that a command writes."""
    return argument('-o --output', metavar, text, usual, **options)


def in_group(title: str, *arguments: Argument) -> tuple[Argument, ...]:
    """Return arguments that the help of a command lists under a title."""
    return tuple((names, {**options, 'group': title}) for names, options in arguments)


def shared(name: str, usual: str, **options: Any) -> Argument:
    """Return a shared argument with another default value, which ``usual`` describes."""
    names, known = _SHARED[name]
    text = known['help'].partition(' (default')[0]
    return names, {**known, 'help': f'{text} (default: {usual})', **options}


def refuse_options(
    args: argparse.Namespace, declared: Sequence[Argument], names: Iterable[str],
    error: Callable[[str], LavaError],
) -> None:
    """Raise an error for the first option in ``names`` that has another value than its default.

    Args:
        args: The parsed arguments.
        declared: The arguments of the command.
        names: Options that do not apply.
        error: Returns the error about an option.
    """
    refused = frozenset(names)
    for flags, options in declared:
        name = long_name(flags)
        value = getattr(args, options.get('dest', name.lstrip('-').replace('-', '_')), None)
        # a number may be 0
        if name in refused and value != options.get('default') and value is not False:
            raise error(name)


_SHARED = {item[0][0]: item for item in (
    argument('bag', None, 'folder of a run, bag directory, or .mcap file'),
    argument(
        '--at', 'TIME', 'simulated time of a map: 2h, 90min; its arrival times and peak thickness '
        'cover the time up to it (default: the last)', dest='time',
    ),
    argument(
        '--device', None, 'computing device: cpu, cuda:0, ... (default: the first GPU, else cpu)'
    ),
    argument('--domain', None, 'ROS domain ID (default: a free one)', int),
    argument(
        '--epsg', 'CODE', 'EPSG code of the coordinate system; replaces what the file states',
        type=_checked(epsg_code),
    ),
    argument('--fresh', None, 'ignore the results of earlier runs', action='store_true'),
    argument(
        '--incomplete', None, 'accept a bag that is damaged, cut off or lacks messages: exit with '
        'status 0 instead of 1', action='store_true',
    ),
    argument(
        '--json', 'FILE', 'write the result as JSON to a file, or to stdout without a file or '
        'with -; all other output is then on stderr', nargs='?', const='-',
    ),
    argument(
        '--low-pass', 'M', 'smooth the elevation with a Gaussian of this standard deviation [m]',
        float,
    ),
    argument('--material', 'NAME', 'lava by name; replaces the lava of the case'),
    argument(
        '--method', None, METHOD_MEANING, METHOD_CHOICES[0], choices=METHOD_CHOICES,
    ),
    argument(
        '--node', 'NAME', 'node whose simulation to read, in a bag with several: its full name, '
        'such as /etna/lava, or its namespace (default: the only one)',
    ),
    argument(
        '--nodata', 'VALUE', 'value of cells without data that the terrain does not declare; '
        'none: all such cells are ground',
    ),
    argument(
        '--off', 'EFFECT', 'switch this effect off; may be repeated', [], action='append'
    ),
    argument('--on', 'EFFECT', 'switch this effect on; may be repeated', [], action='append'),
    argument(
        '--places', 'FILE', 'named points, lines and areas, such as villages or roads: GeoJSON, '
        'GeoPackage, Shapefile, KML, or .csv with x,y or lon,lat and name (docs/FORMATS.md); may '
        'be repeated', [], action='append',
    ),
    argument('--preset', None, 'accuracy', DEFAULT_PRESET, choices=PRESETS),
    argument('--seed', 'N', 'seed of the random numbers', 0),
    argument(
        '--spacing', 'M', "distance between particles [m]; replaces the preset's; cells have the "
        "nearest size that is 2^k times that of the terrain's cells", float,
    ),
    argument(
        '--start', 'DATE', 'date of the start of the eruption, which is time 0: '
        '2021-09-19T14:10:00Z, in UTC unless it has a time zone; maps and tables then have dates '
        '(default: that of the run, if it states one)', dest='eruption_start',
    ),
    argument(
        '--threshold', 'M', 'thickness at which lava counts as arrived [m]; by default 0.1 m, or '
        'a fifth of the expected thickness if that is less', float,
    ),
    argument('--until', 'TIME', 'simulated time at which a run ends: 6h, 90min', HORIZON),
    argument(
        '--error', 'PERCENT', 'numerical error of the inundated area to stay below, such as 10%%: '
        'choose the preset and the spacing for it',
    ),
    argument(
        '--within', 'TIME', 'wall time to stay within, such as 60s or 10min: choose the preset '
        'and the spacing for it',
    ),
)}


def forced_effects(args: argparse.Namespace) -> dict[str, bool]:
    """Return the effects that ``--on`` and ``--off`` force, by name.

    Raises:
        LavaError: If an effect is in both.
    """
    for name in set(args.on) & set(args.off):
        raise validation.conflict(f'--on {name}', f'--off {name}')
    return {**dict.fromkeys(args.on, True), **dict.fromkeys(args.off, False)}


def device_named(name: str | None, method: str = METHODS[0]) -> str:
    """Return the Warp device ``name``; for None the default of the method (``device_of``).

    Raises:
        LavaError: If there is no such device.
    """
    import warp as wp

    from lava_ros.simulation.setup.defaults import device_of

    device = str(device_of(None, method)) if name is None else name
    return validation.choice('--device', device, [str(known) for known in wp.get_devices()])


def seconds_of(field: str, text: str, *, may_be_zero: bool = False) -> float:
    """Convert a number with a unit, by default s, to a time [s], of which errors show the text.

    Raises:
        LavaError: If the text is not a finite time > 0 (>= 0 with ``may_be_zero``). The error
            names ``field``.
    """
    match = re.fullmatch(r'\s*([^a-z\s]+(?:e[+-]?\d+)?)\s*([a-z]*)\s*', text)
    if match is None or (match[2] or 's') not in UNITS:
        raise LavaError(field, text, f'a number with a unit, {", ".join(UNITS)}: 6h, 90min')
    above, at_least = (None, 0.0) if may_be_zero else (0.0, None)
    try:
        number = validation.number(field, match[1], above=above, at_least=at_least)
    except LavaError as error:
        raise LavaError(field, text.strip(), f'{error.expected}, with a unit: 6h') from None
    seconds = number * UNITS[match[2] or 's']
    if math.isinf(seconds):
        raise LavaError(field, text, 'a finite time')
    return Typed(seconds, text)


def formats(shapes: str, default: tuple[str, ...] | None) -> Argument:
    """Return the argument for the file formats of maps and of their shapes."""
    usual = ' '.join(default) if default else 'tif, and geojson in a known coordinate system'
    return argument(
        '--formats', 'FORMAT',
        f'file formats: tif (with styles for QGIS), {", ".join(FORMATS[1:-1])} ({shapes}; zip '
        "holds a Shapefile), nc (all maps, by the CF conventions) "
        f'(default: {usual})',
        default, nargs='+', choices=FORMATS,
    )


def repeating_command(words: str, options: dict[str, Any]) -> str:
    """Return a command line that repeats a measurement, without its outputs."""
    for name, value in options.items():
        if name == 'case':
            words += ''.join(f' --case {case}' for case in value)
        elif value is not None:
            values = value if isinstance(value, list) else [value]
            words += ' '.join([f' --{name}', *map(str, values)])
    return f'lava {words}'
