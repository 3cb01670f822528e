# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava map`: maps of runs as a page to print, an animation, or an HTML page."""

import argparse
from typing import Any

from lava_ros.cli.console import Progress, write_json
from lava_ros.cli.options import (
    argument,
    command,
    output_option,
    refuse_options,
    seconds_of,
    SOURCES,
)
from lava_ros.cli.pages import DATES, page_options, RUNS
from lava_ros.errors import LavaError
from lava_ros.files import file_to_write, PICTURES
from lava_ros.validation import surplus

#: Maps of a page.
DRAWN = (
    *SOURCES, 'arrival', 'inundation_probability', 'arrival_time_p10', 'arrival_time_p90',
    'arrival_time_earliest', 'largest_thickness',
)

#: Suffixes of animations and of HTML pages.
FILMS, PAGES = ('.gif', '.mp4'), ('.html',)

#: Options of a page to print, of all pages, and of animations.
_PAPER = ('--at', '--title', '--volcano', '--date', '--source', '--scale')
_PAGE = (
    '--places', '--observed', '--extent', '--start', '--timezone', '--author', '--agency', '--logo'
)
_FILM = ('--seconds', '--fps', '--width')


@command(
    RUNS, '--node',
    output_option(
        'FILE', 'file to write: .png, .pdf or .svg, a page to print; .gif or .mp4, an animation '
        'of one run; .html, a page for a screen', required=True,
    ),
    argument(
        '--layers', 'MAP',
        f'maps to draw: {", ".join(DRAWN)}; of an ensemble, arrival is that of half its '
        'members, and thickness the expected peak thickness; an animation shows one (default: '
        'all; of several runs the first; in an animation thickness)',
        (), nargs='+', choices=DRAWN,
    ),
    '--at', '--places',
    argument(
        '--observed', 'FILE', 'observed lava: areas (a vector file as for --places), or a raster '
        'with values above 0; the page shows its outline and, of an ensemble, how reliable the '
        'probabilities are',
    ),
    argument(
        '--extent', ('WEST', 'SOUTH', 'EAST', 'NORTH'), 'what the maps show at least, in metres '
        'of the coordinate system or in degrees (default: the lava, and the places within twice '
        'its size)', float, nargs=4,
    ),
    argument('--scale', '1:N', 'scale of the maps on A4 paper: 1:25000 (default: the largest)'),
    *DATES,
    argument('--title', 'TEXT', 'title of the page'),
    argument('--volcano', 'TEXT', 'name of the volcano'),
    argument('--date', 'TEXT', 'date of the eruption or of the map'),
    argument('--source', 'TEXT', 'source of the elevation (default: the name of its file)'),
    argument('--author', 'TEXT', 'author of the page', ''),
    argument('--agency', 'TEXT', 'agency that publishes the page', ''),
    argument('--logo', 'FILE', 'logo of the agency: .png, .jpg', ''),
    argument('--seconds', 'TIME', 'duration of an animation', '10s'),
    argument('--fps', 'N', 'frames of an animation per second', 12.0),
    argument('--width', 'PIXELS', 'width of an animation', 800),
    '--json',
)
def draw(args: argparse.Namespace) -> int:
    """Draw maps of runs and ensembles: a page to print, an animation, or an HTML page.

    The suffix of the file decides. A page to print has maps over shaded relief, with coordinates,
    scale, north arrow, legend, and the facts of the simulation; several runs are drawn side by
    side, with the same colours and the same extent. An animation shows a layer of one run at a
    constant rate of simulated time; MP4 needs ffmpeg. An HTML page is one file that needs no
    other: of a single run it has the maps at the end, the first arrival times, charts of volume,
    area, front and temperature, the effects, the contents of the recording, and the cost of the
    accuracy; with --places, it has the table of lava places. lava watch shows the maps over time.
    """
    suffix = file_to_write('--output', args.output, (*PICTURES, *FILMS, *PAGES)).suffix.lower()
    kind, words, unused = _paper, 'a page to print', list(_FILM)
    if suffix in FILMS:
        kind, words, unused = _film, 'an animation', [*_PAPER, *_PAGE]
    elif suffix in PAGES:
        kind, words, unused = _page, 'a page for a screen', [*_PAPER, *_FILM, '--layers']
    refuse_options(
        args, draw.arguments, unused, lambda name: surplus(name, f'to {suffix}, {words}')
    )
    write_json({'output': args.output, **kind(args)}, args.json)
    return 0


def _paper(args: argparse.Namespace) -> dict[str, Any]:
    from lava_ros.products.pictures import draw_runs

    drawn = draw_runs(
        args.bag,
        args.output,
        node=args.node,
        layers=args.layers,
        time=None if args.time is None else seconds_of('--at', args.time, may_be_zero=True),
        title=args.title,
        volcano=args.volcano,
        date=args.date,
        source=args.source,
        **page_options(args),
    )
    print(f'drawn to {args.output}')
    return drawn


def _film(args: argparse.Namespace) -> dict[str, Any]:
    from lava_ros.products.animation import animate_bag

    if len(args.bag) > 1:
        raise LavaError('RUN', ' '.join(args.bag), 'one run, for an animation')
    (source,) = args.layers if len(args.layers) == 1 else (SOURCES[0],)
    if len(args.layers) > 1 or source not in SOURCES:
        expected = f'one of {", ".join(SOURCES)}, for an animation'
        raise LavaError('--layers', ' '.join(args.layers), expected)
    with Progress(has_lines=False) as progress:
        frames = animate_bag(
            args.bag[0],
            args.output,
            node=args.node,
            source=source,
            seconds=seconds_of('--seconds', args.seconds),
            fps=args.fps,
            width=args.width,
            progress=progress.show,
        )
    print(f'{frames} frames drawn to {args.output}')
    return {'frames': frames}


def _page(args: argparse.Namespace) -> dict[str, Any]:
    from lava_ros.products.report.page import write_report

    with Progress(has_lines=False) as progress:
        size = write_report(
            args.bag, args.output, node=args.node, progress=progress.show, **page_options(args)
        )
    print(f'page of {size / 1e3:.0f} kB written to {args.output}')
    return {'size_bytes': size}
