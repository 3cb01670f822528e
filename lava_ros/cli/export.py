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

The maps are height [m], temperature [Celsius], hazard [0 to 100], time of arrival [s] and peak
height [m], north up, in the coordinate system of the terrain. If the terrain of the bag has none,
--epsg and --offset give it; without them the files are in the map frame.
"""

import argparse
import sys

from lava_ros.cli.options import add_options, seconds_of
from lava_ros.cli.output import in_terminal
from lava_ros.maps.export import export_bag, FORMATS, MAPS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_options(parser, 'bag', '--threshold', '--epsg')
    parser.add_argument(
        '-o', '--output', required=True, metavar='DIR', help='folder to write to: new or empty'
    )
    parser.add_argument(
        '--at', metavar='TIME',
        help='simulated time of the maps: 2h, 90min; arrival and peak height cover the time up to '
        'it (default: the last)',
    )
    parser.add_argument(
        '--every', action='store_true',
        help='write height, temperature and hazard of every frame, in numbered files',
    )
    parser.add_argument(
        '--maps', nargs='+', choices=MAPS, default=MAPS, metavar='MAP',
        help=f'maps to write: {", ".join(MAPS)} (default: all)',
    )
    add_formats_argument(parser, 'outline, isochrones', ('tif',))
    parser.add_argument(
        '--offset', nargs=2, type=float, metavar=('E', 'N'),
        help='easting and northing [m] of the origin of the map frame, for a bag that names none',
    )


def add_formats_argument(
    parser: argparse.ArgumentParser, shapes: str, default: tuple[str, ...] | None
) -> None:
    """Add the argument that says what maps are written as, and their shapes."""
    parser.add_argument(
        '--formats', nargs='+', choices=FORMATS, default=default, metavar='FORMAT',
        help=f'file formats: tif (with styles for QGIS), geojson and gpkg ({shapes}), nc (all '
        "maps, by the CF conventions); gpkg and nc need pip install 'lava_ros[gis]' (default: "
        + (' '.join(default) if default else 'tif, and geojson in a known coordinate system')
        + ')',
    )


def run(args: argparse.Namespace) -> int:
    """Export the bag that the arguments name."""
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
            f'lava export: the bag names no coordinate system, so the files have none and are '
            f'{where}; --epsg and --offset set one',
            file=sys.stderr,
        )
    return 0
