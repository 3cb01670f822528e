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

"""`lava report`: a run as one page of HTML."""

from __future__ import annotations

import argparse


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the `lava` parser."""
    parser = subparsers.add_parser(
        'report',
        help='make a page of a bag that any browser opens',
        description='Write one HTML file that needs nothing else: the map with a time slider, '
        'curves of volume, area, front and temperature, the effects, what was recorded, and what '
        'the accuracy cost.',
    )
    parser.add_argument('bag', help='bag directory or .mcap file')
    parser.add_argument(
        '-o', '--output', required=True, metavar='FILE', help='page to write: .html'
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Report on the bag that the arguments name.

    Raises:
        LavaError: The bag cannot be read, or the page not be written.
    """
    from lava_ros.cli.progress import in_terminal
    from lava_ros.report import write_report

    with in_terminal() as progress:
        size = write_report(args.bag, args.output, progress=progress)
    print(f'report of {size / 1e3:.0f} kB written to {args.output}')
    return 0
