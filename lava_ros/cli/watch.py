# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava watch`: the maps of a node or a bag, live in the browser."""

from __future__ import annotations

import argparse
import signal
import sys
from typing import TYPE_CHECKING

from lava_ros import validation
from lava_ros.cli.options import argument, command
from lava_ros.cli.ros import require_ros
from lava_ros.errors import LavaError
from lava_ros.files.optional import require

if TYPE_CHECKING:
    from lava_ros.watch.frames import Frames


@command(
    argument('bag', None, 'bag directory or .mcap file (default: the running node)', nargs='?'),
    argument('--namespace', 'NS', "namespace of the node's topics: /etna", ''),
    argument(
        '--address', None, 'address of the server; 0.0.0.0 shows the page to the whole network '
        '(default: %(default)s, to this machine only)', '127.0.0.1',
    ),
    argument('--port', None, 'port of the server; 0 takes a free one', 5006),
)
def watch(args: argparse.Namespace) -> int:
    """Show a running node, or a bag, live in the browser.

    The command serves a page with the maps of a running node over shaded relief and a slider over
    the maps received so far. Of a bag, even of one that is being recorded, the slider covers all
    maps. The page needs no internet. ROS_DOMAIN_ID selects the ROS graph.
    """
    validation.number('--port', args.port, at_least=0.0, at_most=65535.0)
    require('bokeh', 'lava watch')
    frames = _frames(args)
    from lava_ros.watch.page import serve

    was_bad = False

    def report() -> None:
        """Print when the source of the frames fails, and when it works again."""
        nonlocal was_bad
        level, words = frames.status
        if was_bad != (level == level.BAD):
            was_bad = not was_bad
            print(f'lava watch: {words}', file=sys.stderr, flush=True)

    server = serve(frames, args.address, args.port, on_poll=report)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(
            number, lambda *_: server.io_loop.add_callback_from_signal(server.io_loop.stop)
        )
    print(f'open http://{args.address}:{server.port}/ in a browser; Ctrl+C ends', flush=True)
    server.io_loop.start()
    server.stop()
    return 0


def _frames(args: argparse.Namespace) -> Frames:
    from lava_ros.watch.frames import BagFrames

    if args.bag is None:
        require_ros()
        from lava_ros.ros.live_frames import LiveFrames

        return LiveFrames(args.namespace)
    if args.namespace:
        raise LavaError('--namespace', args.namespace, 'no --namespace together with a bag')
    return BagFrames(args.bag)
