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

"""Write an HTML page about a run, an ensemble, or several of them.

The page is one file that needs no other. Of a single run it has the map with a time slider, curves
of volume, area, front and temperature, the effects, the contents of the recording, and what the
accuracy cost. Of an ensemble, or of several runs, it has the maps of lava plot.
"""

import argparse

from lava_ros.cli.output import in_terminal
from lava_ros.cli.plot import add_overlay_arguments, add_runs_argument
from lava_ros.errors import LavaError
from lava_ros.pages.pictures import Words
from lava_ros.pages.report.page import write_report
from lava_ros.pages.report.still import write_comparison
from lava_ros.pages.runs import is_ensemble


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_runs_argument(parser)
    parser.add_argument(
        '-o', '--output', required=True, metavar='FILE', help='page to write: .html'
    )
    add_overlay_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Report on the bag that the arguments name."""
    if len(args.bag) > 1 or is_ensemble(args.bag[0]):
        words = Words(overlays=args.overlay, observed=args.observed)
        size = write_comparison(args.bag, args.output, words)
    elif args.overlay or args.observed:
        right = 'neither for a single bag; lava plot draws them'
        raise LavaError('--overlay, --observed', [*args.overlay, args.observed][0], right)
    else:
        with in_terminal() as progress:
            size = write_report(args.bag[0], args.output, progress=progress)
    print(f'report of {size / 1e3:.0f} kB written to {args.output}')
    return 0
