# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava places`: when lava arrives at places."""

import argparse

from lava_ros.cli.arrivals import print_arrivals, table_of_files
from lava_ros.cli.console import with_units, write_json
from lava_ros.cli.options import argument, command, output_option, seconds_of
from lava_ros.cli.pages import DATES, dates_of, ONE_RUN
from lava_ros.files import file_to_write, write_output


@command(
    ONE_RUN,
    argument(
        'places', 'FILE', 'named points, lines and areas, such as huts, roads and villages: '
        '.geojson, .gpkg, or .csv with x,y or lon,lat and name', nargs='+',
    ),
    '--node',
    '--at', output_option('FILE', 'table to write: .csv'),
    *DATES, '--json',
)
def places(args: argparse.Namespace) -> int:
    """Print when lava arrives at places, and with which probability.

    Of a run, the command prints the time at which lava reached each place, or its distance from
    the front. Of an ensemble, it prints the probability that lava comes, and the times by which it
    has come in 10, 50 and 90 % of the members. It also prints how much of a line or an area the
    lava reaches, and which places are off the map. If the start of the eruption is known, times
    are also dates.
    """
    if args.output is not None:
        file_to_write('--output', args.output, ('.csv',))
    time = None if args.time is None else seconds_of('--at', args.time, may_be_zero=True)
    table = table_of_files(
        args.bag, args.places, field='places', node=args.node, time=time, **dates_of(args)
    )
    if args.output is not None:
        write_output('--output', args.output, table.as_csv())
    write_json(with_units(table.as_dict(), m='spacing usable_spacing'), args.json)
    print_arrivals(table)
    return 0
