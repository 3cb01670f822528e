# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava watch`: the lava of a node, a bag or an ensemble, in 3-D in the browser."""

from __future__ import annotations

import argparse
import signal
import threading
from typing import TYPE_CHECKING

from lava_ros import validation
from lava_ros.cli.options import argument, command
from lava_ros.cli.ros import require_ros
from lava_ros.errors import RefusalError
from lava_ros.files.optional import require

if TYPE_CHECKING:
    from lava_ros.watch.frames import Frames


@command(
    argument(
        'bag', 'RUN', 'folder of a run or of an ensemble, bag directory, or .mcap file (default: '
        'the running node)', nargs='?',
    ),
    '--node',
    argument('--namespace', 'NS', "namespace of the node's topics: /etna", ''),
    argument('--port', None, 'port of the server; 0 takes a free one', 5006),
    argument(
        '--drape', 'FILE', 'picture on the ground in place of its relief: a GeoTIFF, or a PNG or '
        'JPEG with a world file or of exactly the terrain, north at the top',
    ),
    argument(
        '--control', None, 'let the page open vents with a click, and pause, step and reset the '
        'node', action='store_true',
    ),
)
def watch(args: argparse.Namespace) -> int:
    """Show a running node, a bag or an ensemble in 3-D in the browser.

    The command serves a page with the lava of a running node on its ground and a slider over the
    maps received so far. Of a bag, even of one that is being recorded, the slider covers all
    maps. Only this machine can open the page, which needs no internet. ROS_DOMAIN_ID selects the
    ROS graph.
    """
    validation.number('--port', args.port, at_least=0.0, at_most=65535.0)
    require('viser', 'lava watch')
    frames = _frames(args)
    from lava_ros.scene.on_terrain import read_placed_picture
    from lava_ros.watch.server import Server

    drape = None if args.drape is None else read_placed_picture(args.drape, field='--drape')
    server, ended = Server(frames, args.port, drape=drape, control=args.control), threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    print(f'open http://127.0.0.1:{server.port}/ in a browser; Ctrl+C ends', flush=True)
    server.run(ended)
    return 0


def _frames(args: argparse.Namespace) -> Frames:
    if args.bag is None:
        if args.node is not None:
            problem = '--node chooses a node of a bag, and no bag is given'
            raise RefusalError('--node', problem, 'Choose a running node with --namespace')
        require_ros()
        from lava_ros.clients.live_frames import LiveFrames

        return LiveFrames(args.namespace)
    for name in ('namespace', 'control'):
        if getattr(args, name):
            raise validation.conflict(f'--{name}', 'a bag or an ensemble')
    from lava_ros.forecast.store import is_ensemble
    from lava_ros.watch.frames import BagFrames, ensemble_frames

    make = ensemble_frames if is_ensemble(args.bag) else BagFrames
    return make(args.bag, node=args.node)
