# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava barrier`: a terrain with barriers."""

import argparse
from pathlib import Path

from lava_ros.cli.options import argument, command, output_option
from lava_ros.errors import LavaError
from lava_ros.files import file_to_write


@command(
    argument('terrain', 'TERRAIN', 'GeoTIFF or another raster (docs/FORMATS.md), or npz'),
    output_option('FILE', 'elevation to write, .tif', required=True),
    argument(
        '--line', 'E,N', 'two or more places along the crest: easting,northing [m] or '
        'longitude,latitude', nargs='+',
    ),
    argument(
        '--lines', 'FILE', 'vector file of lines along crests, each with its own height [m], '
        'width [m] and slope or else those below (docs/FORMATS.md)',
    ),
    argument('--height', 'M', 'height above the ground [m]', float),
    argument('--width', 'M', 'width of the crest [m]', 10.0),
    argument('--slope', 'S', 'slope of the sides, rise over run', 1.0),
    '--low-pass', '--epsg', '--nodata',
    low_pass=0.0,
)
def barrier(args: argparse.Namespace) -> int:
    """Add barriers to a terrain, and write the result to a new file.

    The command raises the elevation along a line, or the lines of a file, and writes it as
    GeoTIFF. Where barriers overlap, the highest counts. Maps of runs on this elevation show the
    barriers. --low-pass smooths the elevation before that.
    """
    from lava_ros.cli.scenes import WORDS
    from lava_ros.products.gis import Provenance, write_grid
    from lava_ros.scene.reshaping import Barrier, low_pass, read_barriers, with_barriers
    from lava_ros.scene.source import SceneSource
    from lava_ros.scene.terrain_files import geotiff_tags
    from lava_ros.scene.typed_places import place_as_typed

    if not args.line and not args.lines and not args.low_pass:
        raise LavaError('--line', None, 'the places of a barrier, --lines, or --low-pass')
    output = file_to_write('--output', args.output, ('.tif', '.tiff'))
    words = WORDS | {'terrain': 'terrain'}
    source = SceneSource(
        terrain=args.terrain, epsg=args.epsg, nodata=args.nodata, words=words
    )
    terrain = source.load_terrain()
    assert terrain is not None
    before = low_pass(terrain, args.low_pass)
    barriers = []
    if args.line:
        if args.height is None:
            raise LavaError('--height', None, 'a height [m]')
        line = tuple(place_as_typed('--line', text, terrain) for text in args.line)
        barriers.append(Barrier(line, args.height, args.width, args.slope))
    if args.lines:
        usual = {'height': args.height, 'width': args.width, 'slope': args.slope}
        barriers += read_barriers('--lines', args.lines, before, usual)
    try:
        terrain = with_barriers(before, barriers)
    except LavaError as error:
        # the lines of a file have been checked
        raise error.named('--line') from None
    for item in barriers:
        print(item.text())
    origin = Provenance(Path(args.terrain).name, effects=(), preset='none')
    write_grid(output, 'elevation', terrain.elevation, terrain, origin, geotiff_tags(terrain))
    if barriers:
        added = (terrain.elevation - before.elevation)[terrain.has_data]
        crest = max(item.crest_on(terrain.resolution) for item in barriers)
        if any(item.crest_on(terrain.resolution) > item.width for item in barriers):
            volume = float(added.sum(dtype='float64')) * terrain.resolution**2
            print(f'with the crest widened to {crest:.3g} m, the elevation has {volume:.0f} m3')
        print(f'{int((added > 0.0).sum())} cells raised by up to {added.max():.1f} m')
    print(f'written to {output}')
    return 0
