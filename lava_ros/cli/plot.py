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

"""`lava plot`: draw what a bag holds."""

from __future__ import annotations

import argparse


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the `lava` parser."""
    parser = subparsers.add_parser(
        'plot',
        help='draw what a bag holds over shaded relief',
        description='Draw thickness, temperature and hazard of a bag over shaded relief.',
    )
    parser.add_argument('bag', help='bag directory or .mcap file')
    parser.add_argument(
        '-o', '--output', required=True, metavar='FILE', help='picture to write: .png, .pdf, .svg'
    )
    parser.add_argument(
        '--time', type=float, metavar='S', help='simulated time [s] (default: the last there is)'
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Draw the bag that the arguments name.

    Raises:
        LavaError: The bag cannot be read, or the picture not be written.
    """
    from lava_ros.frames import read_frame
    from lava_ros.plot import plot_frame

    plot_frame(read_frame(args.bag, args.time), args.output)
    print(f'drawn to {args.output}')
    return 0
