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

"""Write the maps of a bag as GeoTIFF.

They are height [m], temperature [Celsius], hazard [0 to 100], arrival (seconds until lava came),
peak height [m]: north up, in the coordinate system of the terrain. A bag whose terrain has none
gives files without, in the map frame, unless --epsg and --offset say where it is.
"""

from __future__ import annotations

import argparse
import sys

from lava_ros.cli.options import add_options, seconds_of

#: As `lava_ros.maps.export.MAPS`, which takes a while to import.
MAPS = ('height', 'temperature', 'hazard', 'arrival', 'peak_height')

#: As `lava_ros.maps.export.FORMATS`.
FORMATS = ('tif', 'geojson', 'gpkg', 'nc')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_options(parser, 'bag', '--threshold', '--epsg')
    parser.add_argument(
        '-o', '--output', required=True, metavar='DIR', help='folder to write to: new or empty'
    )
    parser.add_argument(
        '--at', metavar='TIME',
        help='simulated time of the maps: 2h, 90min; arrival and peak are up to then (default: '
        'the last there is)',
    )
    parser.add_argument(
        '--every', action='store_true',
        help='height, temperature and hazard of every frame, numbered, with its time',
    )
    parser.add_argument(
        '--maps', nargs='+', choices=MAPS, default=MAPS, metavar='MAP',
        help=f'which of {", ".join(MAPS)} (default: all)',
    )
    add_formats_argument(parser, 'outline, isochrones', ('tif',))
    parser.add_argument(
        '--offset', nargs=2, type=float, metavar=('E', 'N'),
        help="easting and northing [m] of the map frame's origin, for a bag that has none",
    )


def add_formats_argument(
    parser: argparse.ArgumentParser, shapes: str, default: tuple[str, ...] | None
) -> None:
    """Add the argument that says what maps are written as, and their shapes."""
    parser.add_argument(
        '--formats', nargs='+', choices=FORMATS, default=default, metavar='FORMAT',
        help=f'tif (with styles for QGIS), geojson and gpkg ({shapes}), nc (all maps, by the CF '
        "conventions); gpkg and nc take pip install 'lava_ros[gis]' (default: "
        + (' '.join(default) if default else 'tif, and geojson where the place is known')
        + ')',
    )


def run(args: argparse.Namespace) -> int:
    """Export the bag that the arguments name."""
    from lava_ros.cli.output import in_terminal
    from lava_ros.maps.export import export_bag

    at = None if args.at is None else seconds_of('--at', args.at, may_be_zero=True)
    with in_terminal() as progress:
        exported = export_bag(
            args.bag,
            args.output,
            maps=args.maps,
            formats=args.formats,
            time=at,
            every=args.every,
            threshold=args.threshold,
            epsg=args.epsg,
            offset=tuple(args.offset) if args.offset else None,
            progress=progress,
        )
    files, placement = exported.files, exported.placement
    if len(files) > len(MAPS):
        print(f'{len(files)} files written to {args.output}')
    else:
        print('\n'.join(f'written to {path}' for path in files))
    if placement.epsg is None:
        where = 'in the map frame' if placement.offset == (0.0, 0.0) else 'with its offset'
        print(
            f'lava export: the bag names no coordinate system: the files have none and are '
            f'{where}; --epsg and --offset say where it is',
            file=sys.stderr,
        )
    return 0
