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

"""Draw maps of a run, an ensemble, or several of them on a page to print.

The maps lie over shaded relief, with coordinates, scale, north arrow, legend, and the facts of the
simulation. Several runs are drawn side by side, with the same colours and the same extent.
"""

import argparse

from lava_ros.cli.options import add_options, seconds_of
from lava_ros.cli.output import write_json
from lava_ros.files import file_to_write, PICTURES
from lava_ros.pages.pictures import draw_runs, Words

#: Maps there can be.
LAYERS = (
    'thickness', 'temperature', 'hazard', 'arrival', 'probability', 'arrival_p10', 'arrival_p90',
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_runs_argument(parser)
    parser.add_argument(
        '--layers', nargs='+', choices=LAYERS, default=(), metavar='MAP',
        help=f'maps to draw: {", ".join(LAYERS)}; of an ensemble, arrival is that of half its '
        'members (default: all there are; of several runs the first)',
    )
    parser.add_argument(
        '--time', metavar='TIME', help='simulated time of the maps: 2h, 90min (default: the last)'
    )
    for name, text in (
        ('title', 'title of the page'),
        ('volcano', 'name of the volcano'),
        ('date', 'date of the eruption or of the map'),
        ('source', 'source of the elevation (default: the name of its file)'),
    ):
        parser.add_argument(f'--{name}', metavar='TEXT', help=text)
    add_overlay_arguments(parser)
    parser.add_argument(
        '-o', '--output', required=True, metavar='FILE', help='picture to write: .png, .pdf, .svg'
    )
    add_options(parser, '--json')


def add_runs_argument(parser: argparse.ArgumentParser) -> None:
    """Add the argument that names runs."""
    parser.add_argument(
        'bag', nargs='+', help='bag directory, .mcap file, or folder of an ensemble'
    )


def add_overlay_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that name what others know."""
    parser.add_argument(
        '--overlay', action='append', default=[], metavar='FILE',
        help='points, lines and areas to draw, such as stations or roads: .geojson, .gpkg, or '
        '.csv with x,y or lon,lat and name; may be repeated',
    )
    parser.add_argument(
        '--observed', metavar='FILE',
        help='observed lava: areas (.geojson, .gpkg), or a raster with values above 0; the page '
        'shows its outline and, of an ensemble, how reliable the probabilities are',
    )


def run(args: argparse.Namespace) -> int:
    """Draw the runs that the arguments name."""
    file_to_write('--output', args.output, PICTURES)
    words = Words(
        layers=args.layers,
        time=None if args.time is None else seconds_of('--time', args.time, may_be_zero=True),
        title=args.title,
        volcano=args.volcano,
        date=args.date,
        source=args.source,
        overlays=args.overlay,
        observed=args.observed,
    )
    drawn = draw_runs(args.bag, args.output, words)
    write_json(drawn, args.json)
    print(f'drawn to {args.output}')
    return 0
