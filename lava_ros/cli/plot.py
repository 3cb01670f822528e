# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava plot`: maps on a page to print."""

import argparse

from lava_ros.cli.console import write_json
from lava_ros.cli.options import argument, command, seconds_of, SOURCES
from lava_ros.cli.pages import PAGE, page_options, RUNS
from lava_ros.files import file_to_write, PICTURES

#: Maps that are drawn.
DRAWN = (
    *SOURCES, 'arrival', 'inundation_probability', 'arrival_time_p10', 'arrival_time_p90',
    'arrival_time_earliest', 'largest_thickness',
)


@command(
    RUNS, '--node',
    argument(
        '--layers', 'MAP',
        f'maps to draw: {", ".join(DRAWN)}; of an ensemble, arrival is that of half its '
        'members, and thickness the expected peak thickness (default: all; of several runs the '
        'first)',
        (), nargs='+', choices=DRAWN,
    ),
    argument('--time', 'TIME', 'simulated time of the maps: 2h, 90min (default: the last)'),
    argument('--title', 'TEXT', 'title of the page'),
    argument('--volcano', 'TEXT', 'name of the volcano'),
    argument('--date', 'TEXT', 'date of the eruption or of the map'),
    argument('--source', 'TEXT', 'source of the elevation (default: the name of its file)'),
    *PAGE,
    argument('-o --output', 'FILE', 'picture to write: .png, .pdf, .svg', required=True),
    '--json',
)
def plot(args: argparse.Namespace) -> int:
    """Draw maps of a run, an ensemble, or several of them on a page to print.

    The maps lie over shaded relief, with coordinates, scale, north arrow, legend, and the facts of
    the simulation. Several runs are drawn side by side, with the same colours and the same extent.
    """
    from lava_ros.products.pictures import draw_runs

    file_to_write('--output', args.output, PICTURES)
    drawn = draw_runs(
        args.bag,
        args.output,
        node=args.node,
        layers=args.layers,
        time=None if args.time is None else seconds_of('--time', args.time, may_be_zero=True),
        title=args.title,
        volcano=args.volcano,
        date=args.date,
        source=args.source,
        **page_options(args),
    )
    write_json(drawn, args.json)
    print(f'drawn to {args.output}')
    return 0
