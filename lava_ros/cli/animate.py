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

"""Write an animation of a bag as GIF or MP4.

The animation shows a layer over shaded relief at a constant rate of simulated time. MP4 needs
ffmpeg.
"""

import argparse

from lava_ros.cli.options import add_options, seconds_of
from lava_ros.cli.output import in_terminal
from lava_ros.maps.animation import animate_bag

#: As `lava_ros.maps.layers.SOURCES`, by the names of the topics people know.
LAYERS = {'height': 'thickness', 'temperature': 'temperature', 'hazard': 'hazard'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_options(parser, 'bag')
    parser.add_argument(
        '-o', '--output', required=True, metavar='FILE', help='animation to write: .gif, .mp4'
    )
    parser.add_argument(
        '--layer', choices=tuple(LAYERS), default='height', help='layer to show (default: height)'
    )
    parser.add_argument(
        '--seconds', default='10s', metavar='TIME',
        help='duration of the animation (default: %(default)s)',
    )
    parser.add_argument(
        '--fps', type=float, default=12.0, metavar='N', help='frames per second (default: 12)'
    )
    parser.add_argument(
        '--width', type=int, default=800, metavar='PIXELS',
        help='width of the animation (default: %(default)s)',
    )


def run(args: argparse.Namespace) -> int:
    """Animate the bag that the arguments name."""
    with in_terminal() as progress:
        frames = animate_bag(
            args.bag,
            args.output,
            source=LAYERS[args.layer],
            seconds=seconds_of('--seconds', args.seconds),
            fps=args.fps,
            width=args.width,
            progress=progress,
        )
    print(f'{frames} frames drawn to {args.output}')
    return 0
