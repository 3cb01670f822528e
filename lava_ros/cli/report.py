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

    The page is one file that needs no other. Of a single run it has the map with a time slider,
    curves of volume, area, front and temperature, the effects, the contents of the recording, and
    the cost of the accuracy. Of an ensemble, or of several runs, it has the maps of lava plot.
    With --overlay, it has the table of lava places.
    """
    from lava_ros.pages.report.page import write_comparison, write_report
    from lava_ros.pages.runs import is_ensemble

    if len(args.bag) > 1 or is_ensemble(args.bag[0]):
        size = write_comparison(
            args.bag, args.output, node=args.node, **page_options(args)
        )
    elif given := [
        name for names, _ in PAGE
        if (name := names[0]) != '--overlay' and getattr(args, name[2:])
    ]:
        problem = f'{given[0]} does not apply to the report of a single bag'
        raise RefusalError(given[0], problem, 'Leave it out, or draw a page with lava plot')
    else:
        with Progress(has_lines=False) as progress:
            size = write_report(
                args.bag[0], args.output, node=args.node, overlays=args.overlay,
                progress=progress.show,
            )
    print(f'report of {size / 1e3:.0f} kB written to {args.output}')
    return 0
