# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava watch`, `report`, `plot`, `places`, `animate`, `export`: what shows bags and ensembles."""

import argparse
import signal
import sys
from typing import Any

from lava_ros import validation
from lava_ros.cli.options import Argument, argument, command, seconds_of
from lava_ros.cli.output import Progress, table_lines, write_json
from lava_ros.cli.ros import require_ros
from lava_ros.errors import LavaError
from lava_ros.files import file_to_write, PICTURES, write_output
from lava_ros.files.optional import require
from lava_ros.files.vectors import WRITTEN
from lava_ros.maps.animation import animate_bag
from lava_ros.maps.export import export_bag, FORMATS, MAPS
from lava_ros.maps.page_layout import Imprint
from lava_ros.maps.sheet import MAX_SCALE, MIN_SCALE
from lava_ros.pages.arrivals import table_of
from lava_ros.pages.onset import Onset
from lava_ros.pages.pictures import draw_runs
from lava_ros.pages.report.page import write_comparison, write_report
from lava_ros.pages.runs import is_ensemble
from lava_ros.scene import MAX_COORDINATE
from lava_ros.watch.frames import BagFrames, Frames

#: Maps that are animated: as `lava_ros.maps.layers.SOURCES`, by the names of the topics.
ANIMATED = {'height': 'thickness', 'temperature': 'temperature', 'hazard': 'hazard'}

#: Maps that are drawn.
DRAWN = (
    'thickness', 'temperature', 'hazard', 'arrival', 'probability', 'arrival_p10', 'arrival_p90',
)

_RUNS = argument('bag', None, 'bag directory, .mcap file, or folder of an ensemble', nargs='+')

#: Options of pages: what others know and is drawn too, what the maps show, and who publishes them.
_PAGE = (
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
    argument(
        '--onset', 'TIME', 'date and time of the start of the eruption, with its offset from UTC: '
        '2006-07-14T22:00Z; the page then has dates and times',
    ),
    argument(
        '--timezone', 'ZONE', 'zone of local times with --onset: Europe/Rome (default: that of '
        'this machine)',
    ),
    argument('--author', 'TEXT', 'author of the page', ''),
    argument('--agency', 'TEXT', 'agency that publishes the page', ''),
    argument('--logo', 'FILE', 'logo of the agency: .png, .jpg', ''),
)


def _page_options(args: argparse.Namespace) -> dict[str, Any]:
    """The options of ``_PAGE`` as ``draw_runs`` takes them."""
    onset = None
    if args.onset is not None:
        onset = Onset.from_texts(args.onset, args.timezone)
    elif args.timezone is not None:
        raise LavaError('--timezone', args.timezone, 'a zone together with --onset')
    return {
        'overlays': args.overlay,
        'observed': args.observed,
        'extent': args.extent and _extent(args.extent),
        'scale': None if args.scale is None else _scale(args.scale),
        'onset': onset,
        'imprint': Imprint(args.author, args.agency, args.logo),
    }


def _extent(values: list[float]) -> list[float]:
    return [
        validation.number('--extent', value, at_least=-MAX_COORDINATE, at_most=MAX_COORDINATE)
        for value in values
    ]


def _scale(text: str) -> float:
    """The N of 1:N, or of N alone."""
    return validation.number(
        '--scale', text.strip().removeprefix('1:'), at_least=MIN_SCALE, at_most=MAX_SCALE
    )


def formats(shapes: str, default: tuple[str, ...] | None) -> Argument:
    """The argument that says what maps, and shapes of them, are written as."""
    usual = ' '.join(default) if default else 'tif, and geojson in a known coordinate system'
    return argument(
        '--formats', 'FORMAT',
        f'file formats: tif (with styles for QGIS), {", ".join(WRITTEN)} ({shapes}; zip holds a '
        "Shapefile), nc (all maps, by the CF conventions; pip install 'lava_ros[gis]') "
        f'(default: {usual})',
        default, nargs='+', choices=FORMATS,
    )


@command(
    argument('bag', None, 'bag directory or .mcap file (default: the running node)', nargs='?'),
    argument('--namespace', 'NS', "namespace of the node's topics: /etna", ''),
    argument(
        '--address', None, 'address of the server; 0.0.0.0 shows the page to the whole network '
        '(default: %(default)s, to this machine only)', '127.0.0.1',
    ),
    argument('--port', None, 'port of the server; 0 takes a free one', 5006),
)
def watch(args: argparse.Namespace) -> int:
    """Show a running node, or a bag, live in the browser.

    The command serves a page with the maps of a running node over shaded relief and a slider over
    the maps received so far. Of a bag, even of one that is being recorded, the slider covers all
    maps. The page needs no internet. ROS_DOMAIN_ID selects the ROS graph.
    """
    validation.number('--port', args.port, at_least=0.0, at_most=65535.0)
    require('bokeh', 'lava watch')
    frames = _frames(args)
    from lava_ros.watch.page import serve

    was_bad = False

    def tell() -> None:
        """Print when the source of the frames fails, and when it works again."""
        nonlocal was_bad
        level, words = frames.status
        if was_bad != (level == level.BAD):
            was_bad = not was_bad
            print(f'lava watch: {words}', file=sys.stderr, flush=True)

    server = serve(frames, args.address, args.port, on_poll=tell)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(
            number, lambda *_: server.io_loop.add_callback_from_signal(server.io_loop.stop)
        )
    print(f'open http://{args.address}:{server.port}/ in a browser; Ctrl+C ends', flush=True)
    server.io_loop.start()
    server.stop()
    return 0


def _frames(args: argparse.Namespace) -> Frames:
    if args.bag is None:
        require_ros()
        from lava_ros.ros.live_frames import LiveFrames

        return LiveFrames(args.namespace)
    if args.namespace:
        raise LavaError('--namespace', args.namespace, 'no --namespace together with a bag')
    return BagFrames(args.bag)


@command(
    _RUNS,
    argument('-o --output', 'FILE', 'page to write: .html', required=True),
    *_PAGE,
)
def report(args: argparse.Namespace) -> int:
    """Write an HTML page about a run, an ensemble, or several of them.

    The page is one file that needs no other. Of a single run it has the map with a time slider,
    curves of volume, area, front and temperature, the effects, the contents of the recording, and
    what the accuracy cost. Of an ensemble, or of several runs, it has the maps of lava plot. With
    --overlay, it has the table of lava places.
    """
    if len(args.bag) > 1 or is_ensemble(args.bag[0]):
        size = write_comparison(args.bag, args.output, **_page_options(args))
    elif given := [
        name for names, _ in _PAGE
        if (name := names[0]) != '--overlay' and getattr(args, name[2:])
    ]:
        right = 'absent for a single bag; lava plot draws a page with it'
        raise LavaError(given[0], getattr(args, given[0][2:]), right)
    else:
        with Progress(has_lines=False) as progress:
            size = write_report(
                args.bag[0], args.output, overlays=args.overlay, progress=progress.show
            )
    print(f'report of {size / 1e3:.0f} kB written to {args.output}')
    return 0


@command(
    _RUNS,
    argument(
        '--layers', 'MAP',
        f'maps to draw: {", ".join(DRAWN)}; of an ensemble, arrival is that of half its '
        'members (default: all there are; of several runs the first)',
        (), nargs='+', choices=DRAWN,
    ),
    argument('--time', 'TIME', 'simulated time of the maps: 2h, 90min (default: the last)'),
    argument('--title', 'TEXT', 'title of the page'),
    argument('--volcano', 'TEXT', 'name of the volcano'),
    argument('--date', 'TEXT', 'date of the eruption or of the map'),
    argument('--source', 'TEXT', 'source of the elevation (default: the name of its file)'),
    *_PAGE,
    argument('-o --output', 'FILE', 'picture to write: .png, .pdf, .svg', required=True),
    '--json',
)
def plot(args: argparse.Namespace) -> int:
    """Draw maps of a run, an ensemble, or several of them on a page to print.

    The maps lie over shaded relief, with coordinates, scale, north arrow, legend, and the facts of
    the simulation. Several runs are drawn side by side, with the same colours and the same extent.
    """
    file_to_write('--output', args.output, PICTURES)
    drawn = draw_runs(
        args.bag,
        args.output,
        layers=args.layers,
        time=None if args.time is None else seconds_of('--time', args.time, may_be_zero=True),
        title=args.title,
        volcano=args.volcano,
        date=args.date,
        source=args.source,
        **_page_options(args),
    )
    write_json(drawn, args.json)
    print(f'drawn to {args.output}')
    return 0


@command(
    argument('bag', None, 'bag directory, .mcap file, or folder of an ensemble'),
    argument(
        'places', 'FILE', 'named points, lines and areas, such as huts, roads and villages: '
        '.geojson, .gpkg, or .csv with x,y or lon,lat and name', nargs='+',
    ),
    argument('--time', 'TIME', 'use the bag up to this simulated time: 2h, 90min (default: all)'),
    argument('-o --output', 'FILE', 'table to write: .csv'),
    '--json',
)
def places(args: argparse.Namespace) -> int:
    """Print when lava arrives at places, and with which probability.

    Of a run, the command prints the time at which lava reached each place, or its distance from
    the front. Of an ensemble, it prints the probability that lava comes, and the times by which it
    has come in 10, 50 and 90 % of the members. It also prints how much of a line or an area the
    lava reaches, and which places are off the map.
    """
    if args.output is not None:
        file_to_write('--output', args.output, ('.csv',))
    time = None if args.time is None else seconds_of('--time', args.time, may_be_zero=True)
    table = table_of(args.bag, args.places, field='places', time=time)
    if args.output is not None:
        write_output('--output', args.output, table.as_csv())
    write_json(table.as_dict(), args.json)
    if args.json != '-':
        texts = table.as_texts()
        print(table.summary)
        sides = ''.join('<' if name in ('place', 'note') else '>' for name in texts[0])
        print('\n'.join(table_lines(texts, sides)))
    return 0


@command(
    'bag',
    argument('-o --output', 'FILE', 'animation to write: .gif, .mp4', required=True),
    argument('--layer', None, 'layer to show', 'height', choices=tuple(ANIMATED)),
    argument('--seconds', 'TIME', 'duration of the animation', '10s'),
    argument('--fps', 'N', 'frames per second', 12.0),
    argument('--width', 'PIXELS', 'width of the animation', 800),
)
def animate(args: argparse.Namespace) -> int:
    """Write an animation of a bag as GIF or MP4.

    The animation shows a layer over shaded relief at a constant rate of simulated time. MP4 needs
    ffmpeg.
    """
    with Progress(has_lines=False) as progress:
        frames = animate_bag(
            args.bag,
            args.output,
            source=ANIMATED[args.layer],
            seconds=seconds_of('--seconds', args.seconds),
            fps=args.fps,
            width=args.width,
            progress=progress.show,
        )
    print(f'{frames} frames drawn to {args.output}')
    return 0


@command(
    'bag', '--threshold', '--epsg',
    argument('-o --output', 'DIR', 'folder to write to: new or empty', required=True),
    argument(
        '--at', 'TIME', 'write the newest maps up to this simulated time: 2h, 90min; arrival and '
        'peak height cover the time up to it (default: the last)',
    ),
    argument(
        '--every', None, 'write height, temperature and hazard of every frame, in numbered files',
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

    The maps are height [m], temperature [Celsius], hazard [0 to 100], time of arrival [s] and peak
    height [m], north up, in the coordinate system of the terrain. If the terrain of the bag has
    none, --epsg and --offset give it; without them the files are in the map frame.
    """
    at = None if args.at is None else seconds_of('--at', args.at, may_be_zero=True)
    with Progress(has_lines=False) as progress:
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
            progress=progress.show,
        )
    files, placement = exported.files, exported.placement
    if len(files) > len(MAPS):
        print(f'{len(files)} files written to {args.output}')
    else:
        print('\n'.join(f'written to {path}' for path in files))
    if placement.system is None:
        where = 'in the map frame' if placement.offset == (0.0, 0.0) else 'with its offset'
        print(
            f'lava export: the bag names no coordinate system, so the files have none and are '
            f'{where}; --epsg and --offset set one',
            file=sys.stderr,
        )
    return 0
