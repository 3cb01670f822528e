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

"""Add a barrier to a terrain, and write the result to a new file.

The command raises the elevation along a line and writes it as GeoTIFF. --low-pass smooths the
elevation before that.
"""

import argparse

from lava_ros.cli.options import add_options
from lava_ros.errors import LavaError
from lava_ros.files import file_to_write
from lava_ros.maps.gis import write_grid
from lava_ros.scene.reshaping import Barrier, low_pass, with_barrier
from lava_ros.scene.terrain_files import load_terrain


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('terrain', metavar='TERRAIN', help='GeoTIFF, ESRI ASCII grid or npz')
    parser.add_argument(
        '-o', '--output', required=True, metavar='FILE', help='elevation to write, .tif'
    )
    parser.add_argument(
        '--line', nargs='+', metavar='E,N',
        help='easting and northing [m] of two or more places along the crest',
    )
    parser.add_argument('--height', type=float, metavar='M', help='height above the ground [m]')
    parser.add_argument(
        '--width', type=float, default=10.0, metavar='M',
        help='width of the crest [m] (default: %(default)g)',
    )
    parser.add_argument(
        '--slope', type=float, default=1.0, metavar='S',
        help='slope of the sides, rise over run (default: %(default)g)',
    )
    add_options(parser, '--low-pass', '--epsg', low_pass=0.0)


def run(args: argparse.Namespace) -> int:
    """Write the terrain."""
    if not args.line and not args.low_pass:
        raise LavaError('--line', None, 'the places of a barrier, or --low-pass')
    output = file_to_write('--output', args.output, ('.tif', '.tiff'))
    terrain = low_pass(load_terrain(args.terrain, epsg=args.epsg), args.low_pass)
    before = terrain
    if args.line:
        if args.height is None:
            raise LavaError('--height', None, 'a height [m]')
        line = tuple(_place(text) for text in args.line)
        terrain = with_barrier(terrain, Barrier(line, args.height, args.width, args.slope))
    meaning = 'elevation of the ground'
    write_grid(output, terrain.elevation, terrain, unit='m', meaning=meaning)
    added = (terrain.elevation - before.elevation)[terrain.has_data]
    volume = float(added.sum(dtype='float64')) * terrain.resolution**2
    raised = int((added > 0.0).sum())
    print(f'{raised} cells raised by up to {added.max():.1f} m: {volume:.0f} m3 of earth')
    print(f'written to {output}')
    return 0


def _place(text: str) -> tuple[float, float]:
    parts = text.split(',')
    try:
        easting, northing = (float(part) for part in parts)
    except ValueError:
        raise LavaError('--line', text, 'easting,northing [m]') from None
    return easting, northing
