# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The arguments of `lava plot` and `lava report`, which draw pages."""

import argparse
from typing import Any

from lava_ros import validation
from lava_ros.cli.options import argument

RUNS = argument(
    'bag', None, 'folder of a run or of an ensemble, bag directory, or .mcap file', nargs='+',
)

#: Options for dates and local times.
DATES = (
    argument(
        '--onset', 'TIME', 'date and time of the start of the eruption, with its offset from UTC: '
        '2006-07-14T22:00Z; pages and tables then have dates and times (default: that of the run, '
        'if it states one)',
    ),
    argument(
        '--timezone', 'ZONE', 'zone of local times: Europe/Rome (default: that of this machine)',
    ),
)

#: Options of pages: further things to draw, the extent of the maps, and their publisher.
PAGE = (
    argument(
        '--overlay', 'FILE', 'points, lines and areas to show with their names, such as villages '
        'or roads: GeoJSON, GeoPackage, Shapefile, KML, or .csv with x,y or lon,lat and name; may '
        'be repeated (docs/FORMATS.md)',
        [], action='append',
    ),
    argument(
        '--observed', 'FILE', 'observed lava: areas (a vector file as for --overlay), or a raster '
        'with values above 0; the page shows its outline and, of an ensemble, how reliable the '
        'probabilities are',
    ),
    argument(
        '--extent', ('WEST', 'SOUTH', 'EAST', 'NORTH'), 'what the maps show at least, in metres '
        'of the coordinate system or in degrees (default: the lava, and the overlays within twice '
        'its size)', float, nargs=4,
    ),
    argument('--scale', '1:N', 'scale of the maps on A4 paper: 1:25000 (default: the largest)'),
    *DATES,
    argument('--author', 'TEXT', 'author of the page', ''),
    argument('--agency', 'TEXT', 'agency that publishes the page', ''),
    argument('--logo', 'FILE', 'logo of the agency: .png, .jpg', ''),
)


def page_options(args: argparse.Namespace) -> dict[str, Any]:
    """Return the options of ``PAGE`` as keyword arguments of ``draw_runs``."""
    from lava_ros.products.page_layout import Imprint

    return {
        'overlays': args.overlay,
        'observed': args.observed,
        'extent': args.extent and _extent(args.extent),
        'scale': None if args.scale is None else _scale(args.scale),
        **dates_of(args),
        'imprint': Imprint(args.author, args.agency, args.logo),
    }


def dates_of(args: argparse.Namespace) -> dict[str, Any]:
    """Return the options of ``DATES`` as keyword arguments."""
    from lava_ros.scene.onset import Onset, time_zone

    return {
        'onset': None if args.onset is None else Onset.from_text(args.onset),
        'zone': None if args.timezone is None else time_zone(args.timezone),
    }


def _extent(values: list[float]) -> list[float]:
    from lava_ros.scene import MAX_COORDINATE

    return [
        validation.number('--extent', value, at_least=-MAX_COORDINATE, at_most=MAX_COORDINATE)
        for value in values
    ]


def _scale(text: str) -> float:
    from lava_ros.products.sheet import MAX_SCALE, MIN_SCALE

    return validation.number(
        '--scale', text.strip().removeprefix('1:'), at_least=MIN_SCALE, at_most=MAX_SCALE
    )
