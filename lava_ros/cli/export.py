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

"""`lava export`: the maps of a bag as GeoTIFF, for GIS programs."""

from __future__ import annotations

import argparse
import sys

#: As `lava_ros.export.MAPS`, which takes a while to import.
MAPS = ('height', 'temperature', 'hazard', 'arrival', 'peak_height')


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the `lava` parser."""
    parser = subparsers.add_parser(
        'export',
        help='write the maps of a bag as GeoTIFF',
        description='Write height [m], temperature [Celsius], hazard [0 to 100], arrival (seconds '
        'until lava came) and peak height [m] of a bag as GeoTIFF: north up, in the coordinate '
        'system of the terrain. A bag whose terrain has none gives files without, in the map '
        'frame, unless --epsg and --offset say where it is.',
    )
    parser.add_argument('bag', help='bag directory or .mcap file')
    parser.add_argument(
        '-o', '--output', required=True, metavar='DIR', help='folder to write to: new or empty'
    )
    parser.add_argument(
        '--at',
        type=float,
        metavar='S',
        help='simulated time [s] of the maps; arrival and peak are up to then (default: the last '
        'there is)',
    )
    parser.add_argument(
        '--every',
        action='store_true',
        help='height, temperature and hazard of every frame, numbered, with its time',
    )
    parser.add_argument(
        '--maps',
        nargs='+',
        choices=MAPS,
        default=MAPS,
        metavar='MAP',
        help=f'which of {", ".join(MAPS)} (default: all)',
    )
    parser.add_argument(
        '--threshold',
        type=float,
        default=0.1,
        metavar='M',
        help='thickness from which on lava has arrived [m] (default: 0.1)',
    )
    parser.add_argument(
        '--epsg', type=int, metavar='CODE', help='coordinate system of a bag that has none'
    )
    parser.add_argument(
        '--offset',
        nargs=2,
        type=float,
        metavar=('E', 'N'),
        help="easting and northing [m] of the map frame's origin, for a bag that has none",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Export the bag that the arguments name.

    Raises:
        LavaError: The bag cannot be read, or the files not be written.
    """
    from lava_ros.cli.progress import in_terminal
    from lava_ros.export import export_bag

    with in_terminal() as progress:
        exported = export_bag(
            args.bag,
            args.output,
            maps=args.maps,
            time=args.at,
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
