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

"""`lava animate`: a bag as a moving picture."""

from __future__ import annotations

import argparse

#: As `lava_ros.layers.SOURCES`, by the names of the topics people know.
LAYERS = {'height': 'thickness', 'temperature': 'temperature', 'hazard': 'hazard'}


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the `lava` parser."""
    parser = subparsers.add_parser(
        'animate',
        help='make a GIF or MP4 of a bag',
        description='Draw a layer of a bag over shaded relief as a moving picture, evenly over '
        'its simulated time. MP4 needs ffmpeg.',
    )
    parser.add_argument('bag', help='bag directory or .mcap file')
    parser.add_argument(
        '-o', '--output', required=True, metavar='FILE', help='animation to write: .gif, .mp4'
    )
    parser.add_argument(
        '--layer', choices=tuple(LAYERS), default='height', help='what to show (default: height)'
    )
    parser.add_argument(
        '--seconds', type=float, default=10.0, metavar='S', help='how long it lasts (default: 10)'
    )
    parser.add_argument(
        '--fps', type=float, default=12.0, metavar='N', help='pictures a second (default: 12)'
    )
    parser.add_argument(
        '--width', type=int, default=800, metavar='PIXELS', help='its width (default: 800)'
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Animate the bag that the arguments name.

    Raises:
        LavaError: The bag cannot be read, or the animation not be written.
    """
    from lava_ros.animation import animate_bag
    from lava_ros.cli.progress import in_terminal

    with in_terminal() as progress:
        frames = animate_bag(
            args.bag,
            args.output,
            source=LAYERS[args.layer],
            seconds=args.seconds,
            fps=args.fps,
            width=args.width,
            progress=progress,
        )
    print(f'{frames} frames drawn to {args.output}')
    return 0
