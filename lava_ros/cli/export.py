# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava export`: the maps of a bag as files for a GIS."""

import argparse
import sys

from lava_ros.cli.console import Progress
from lava_ros.cli.options import argument, command, formats, MAPS, output_option, seconds_of
from lava_ros.errors import RefusalError


@command(
    argument('bag', 'RUN', 'folder of a run, bag directory, or .mcap file'),
    '--node', '--threshold', '--epsg',
    output_option('DIR', 'folder to write to: new or empty', required=True),
    '--at',
    argument(
        '--every', None,
        'write thickness, temperature and hazard of every frame, in numbered files',
        action='store_true',
    ),
    argument(
        '--maps', 'MAP',
        f'maps to write: {", ".join(MAPS)} (default: all)',
        MAPS, nargs='+', choices=MAPS,
    ),
    formats('outline, isochrones', ('tif',)),
    argument(
        '--offset', ('E', 'N'), 'easting and northing [m] of the origin of the map frame, for a '
        'bag that names none', float, nargs=2,
    ),
)
def export(args: argparse.Namespace) -> int:
    """Write the maps of a bag as GeoTIFF.

    The maps are lava thickness [m], temperature [Celsius], hazard index (0: no lava, 50: lava has
    drained away, 100: lethal), time of arrival [s] and peak thickness [m], north up, in the
    coordinate system of the terrain. If the terrain of the bag has none, --epsg and --offset give
    it; without them the files are in the map frame.
    """
    from lava_ros.forecast.store import is_ensemble
    from lava_ros.products.export import export_bag

    if is_ensemble(args.bag):
        problem = f'{args.bag} is an ensemble, whose folder has its maps as GeoTIFF'
        raise RefusalError('RUN', problem, 'For other formats, repeat lava run with --formats')
    at = None if args.time is None else seconds_of('--at', args.time, may_be_zero=True)
    with Progress(has_lines=False) as progress:
        exported = export_bag(
            args.bag,
            args.output,
            node=args.node,
            maps=args.maps,
            formats=args.formats,
            time=at,
            every=args.every,
            threshold=args.threshold,
            epsg=args.epsg,
            offset=tuple(args.offset) if args.offset else None,
            progress=progress.show,
        )
    files, georeference = exported.files, exported.georeference
    if len(files) > len(MAPS):
        print(f'{len(files)} files written to {args.output}')
    else:
        print('\n'.join(f'written to {path}' for path in files))
    if georeference.system is None:
        where = 'in the map frame' if georeference.offset == (0.0, 0.0) else 'with its offset'
        print(
            f'lava export: the bag names no coordinate system, so the files have none and are '
            f'{where}; --epsg and --offset set one',
            file=sys.stderr,
        )
    return 0
