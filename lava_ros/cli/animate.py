# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava animate`: an animation of a bag."""

import argparse

from lava_ros.cli.console import Progress
from lava_ros.cli.options import argument, command, seconds_of, SOURCES


@command(
    'bag', '--node',
    argument('-o --output', 'FILE', 'animation to write: .gif, .mp4', required=True),
    argument('--layer', None, 'layer to show', 'thickness', choices=SOURCES),
    argument('--seconds', 'TIME', 'duration of the animation', '10s'),
    argument('--fps', 'N', 'frames per second', 12.0),
    argument('--width', 'PIXELS', 'width of the animation', 800),
)
def animate(args: argparse.Namespace) -> int:
    """Write an animation of a bag as GIF or MP4.

    The animation shows a layer over shaded relief at a constant rate of simulated time. MP4 needs
    ffmpeg.
    """
    from lava_ros.products.animation import animate_bag

    with Progress(has_lines=False) as progress:
        frames = animate_bag(
            args.bag,
            args.output,
            node=args.node,
            source=args.layer,
            seconds=seconds_of('--seconds', args.seconds),
            fps=args.fps,
            width=args.width,
            progress=progress.show,
        )
    print(f'{frames} frames drawn to {args.output}')
    return 0
