# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava report`: an HTML page about runs and ensembles."""

import argparse

from lava_ros.cli.console import Progress
from lava_ros.cli.options import argument, command
from lava_ros.cli.pages import PAGE, page_options, RUNS
from lava_ros.errors import RefusalError


@command(
    RUNS, '--node',
    argument('-o --output', 'FILE', 'page to write: .html', required=True),
    *PAGE,
)
def report(args: argparse.Namespace) -> int:
    """Write an HTML page about a run, an ensemble, or several of them.

    The page is one file that needs no other. Of a single run it has the maps at the end, the
    first arrival times, charts of volume, area, front and temperature, the effects, the contents
    of the recording, and the cost of the accuracy. lava watch shows the maps over time. Of an
    ensemble, or of several runs, the page has the maps of lava plot. With --overlay, it has the
    table of lava places.
    """
    from lava_ros.products.report.page import write_report

    if args.scale is not None:
        problem = '--scale applies to paper, and a report is for a screen'
        raise RefusalError('--scale', problem, 'Leave it out, or draw a page with lava plot')
    with Progress(has_lines=False) as progress:
        size = write_report(
            args.bag, args.output, node=args.node, progress=progress.show, **page_options(args)
        )
    print(f'report of {size / 1e3:.0f} kB written to {args.output}')
    return 0
