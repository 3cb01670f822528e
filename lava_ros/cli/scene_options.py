# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Arguments that describe a scene; ``scenes.py`` makes the scene."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from lava_ros import validation
from lava_ros.cli.options import Argument, argument, HORIZON, refuse_options, shared
from lava_ros.errors import Typed

#: Default lava, as in ``lava_ros.scene.materials``, which is slow to import.
DEFAULT_MATERIAL = 'etna_basalt'

#: Values for the gaps of a table, as in ``lava_ros.scene.effusion_rates``.
GAPS = ('zero', 'interpolate')

#: Methods of measurement of effusion rates, as in ``lava_ros.scene.measurements``.
RATE_METHODS = ('satellite', 'field')

#: Roles of an emplaced flow, as in ``lava_ros.scene.emplaced``.
EMPLACED_KINDS = ('lava', 'ground')


def _rate(text: str) -> float | str:
    try:
        return Typed(float(text), text)
    except ValueError:
        return text


_VENTS = (
    argument(
        '--vent', 'LON,LAT', 'position of a vent: longitude,latitude or easting,northing; '
        'replaces the vents of the scene; may be repeated (default without a scene: the summit)',
        action='append',
    ),
    argument(
        '--vents', 'FILE', 'file of points and lines (fissures), which replace the vents of the '
        'scene: GeoJSON, GeoPackage, Shapefile, KML, or .csv with x,y or lon,lat (of a fissure '
        'also x_end,y_end or lon_end,lat_end); it may give the name, effusion_rate [m3/s], radius '
        '[m] and temperature [K] of each (docs/FORMATS.md)',
    ),
    argument(
        '--effusion-rate --discharge', 'Q', 'effusion rate of each vent [m3/s], or a table of the '
        'rates of all vents together (docs/FORMATS.md)', type=_rate, dest='discharge',
    ),
    argument(
        '--material', 'NAME', "lava by name ('lava materials' lists them); replaces the lava of "
        f'the scene (default where it names none: {DEFAULT_MATERIAL})',
    ),
)


#: Options for reading a table of effusion rates.
_TABLE = (
    shared('--start', 'that of the scene, or the first date in a table of effusion rates'),
    argument(
        '--gaps', None, 'effusion rate in the gaps of a table: zero, or interpolate between its '
        'neighbours (default: zero, with a warning)', choices=GAPS,
    ),
    argument(
        '--porosity', 'P', 'fraction of bubbles in the lava, for a table of dense-rock effusion '
        'rates (default: the rates are bulk rates)', float,
    ),
    argument(
        '--measured', None, 'how the effusion rates of a table without errors were measured, for '
        'their error in an ensemble (default: as by satellite)', choices=RATE_METHODS,
    ),
)

_FILE = 'scene file (YAML), folder of a case, or elevation'

_PARTS: tuple[str | Argument, ...] = (
    argument(
        '--terrain', 'FILE', 'elevation: GeoTIFF or another raster (docs/FORMATS.md), or npz; '
        "replaces the scene's terrain (default without a scene: Mount St. Helens, 7.8 x 7.8 km)",
    ),
    '--epsg',
    '--nodata',
    argument(
        '--fill-holes', None, 'fill pits and inner cells without data from the cells around them',
        action='store_true',
    ),
    argument(
        '--sea-level', 'M', 'elevation at or below which the terrain is sea [m]: lava that enters '
        'it leaves the map and is counted (default: that of the scene, or no sea)', float,
    ),
    argument(
        '--insist', None, 'accept numbers that cannot be, such as an effusion rate above any '
        'known, with a warning', action='store_true',
    ),
    *_VENTS,
    *_TABLE,
    argument(
        '--emplaced-flow', 'FILE', 'flow that is there before the start: a raster of its '
        'thickness [m], such as thickness.tif of lava export, or a file of outlines with '
        '--emplaced-thickness or --emplaced-volume; may be repeated; adds to the flows of the '
        'scene',
        action='append',
    ),
    argument(
        '--emplaced-thickness', 'M', 'thickness [m] of the outlines of emplaced flows', float
    ),
    argument(
        '--emplaced-volume', 'M3', 'volume [m3] of the outlines of an emplaced flow, in place of '
        'a thickness; it thins towards the margin', float,
    ),
    argument(
        '--emplaced-solidified', 'F', 'lower fraction of emplaced lava that is solid, and part of '
        'the ground (default: 0)', float,
    ),
    argument(
        '--emplaced-as', None, 'what emplaced flows are: lava, which starts at the eruption '
        'temperature, or ground (default: lava)', choices=EMPLACED_KINDS,
    ),
    argument(
        '--terrain-at', ('TIME', 'FILE'), 'elevation at and after a simulated time (2h), on the '
        'grid of the terrain; may be repeated; adds to the events of the scene', nargs=2,
        action='append',
    ),
)

#: The arguments that describe a scene.
SCENE = (argument('scene', 'SCENE', _FILE, nargs='?'), *_PARTS)

#: End of a run; None without one, because a case has its own.
UNTIL = shared('--until', f'{HORIZON}; a mapped eruption has its own end', default=None)

#: Options that the folder of a case replaces.
_OF_CASE = (
    '--terrain', '--epsg', '--nodata', '--fill-holes', '--sea-level', '--until', '--start',
    '--gaps', '--porosity', '--measured', '--emplaced-flow', '--emplaced-thickness',
    '--emplaced-volume', '--emplaced-solidified', '--emplaced-as', '--terrain-at',
)


def is_case(args: argparse.Namespace) -> bool:
    """Return True if the scene is the folder of a case."""
    return args.scene is not None and Path(args.scene).is_dir()


def refuse_for_case(
    args: argparse.Namespace, declared: Sequence[Argument], more: Sequence[str] = ()
) -> None:
    """Raise an error for an option that the folder of a case replaces, or one of ``more``.

    Args:
        args: The parsed arguments, whose scene is the folder of a case.
        declared: The arguments of the command.
        more: Further options that do not apply to a case.

    Raises:
        LavaError: If such an option is given.
    """
    reason = f'to {args.scene}, a mapped eruption'
    refuse_options(
        args, declared, (*_OF_CASE, *more), lambda name: validation.surplus(name, reason)
    )
