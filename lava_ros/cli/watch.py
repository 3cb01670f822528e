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

"""Show a running node, or a bag, live in the browser.

The command serves a page with the maps of a running node over shaded relief and a slider over the
maps received so far. Of a bag, even of one that is being recorded, the slider covers all maps. The
page needs no internet. ROS_DOMAIN_ID selects the ROS graph.
"""

import argparse
import signal
import sys

from lava_ros import validation
from lava_ros.cli.ros import require_ros
from lava_ros.errors import LavaError
from lava_ros.files.optional import require
from lava_ros.watch.frames import BagFrames, Frames


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        'bag', nargs='?', help='bag directory or .mcap file (default: the running node)'
    )
    parser.add_argument(
        '--namespace', default='', metavar='NS', help="namespace of the node's topics: /etna"
    )
    parser.add_argument(
        '--address', default='127.0.0.1',
        help='address of the server; 0.0.0.0 shows the page to the whole network (default: '
        '%(default)s, to this machine only)',
    )
    parser.add_argument(
        '--port', type=int, default=5006,
        help='port of the server; 0 takes a free one (default: %(default)s)',
    )


def run(args: argparse.Namespace) -> int:
    """Serve until SIGINT or SIGTERM."""
    validation.number('--port', args.port, at_least=0.0, at_most=65535.0)
    require('bokeh', 'lava watch')
    frames = _frames(args)
    from lava_ros.watch.page import serve

    server = serve(frames, args.address, args.port, on_poll=_Teller(frames).tell)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(
            number, lambda *_: server.io_loop.add_callback_from_signal(server.io_loop.stop)
        )
    print(f'open http://{args.address}:{server.port}/ in a browser; Ctrl+C ends', flush=True)
    server.io_loop.start()
    server.stop()
    return 0


def _frames(args: argparse.Namespace) -> Frames:
    if args.bag is None:
        require_ros()
        from lava_ros.ros.live_frames import LiveFrames

        return LiveFrames(args.namespace)
    if args.namespace:
        raise LavaError('--namespace', args.namespace, 'no --namespace together with a bag')
    return BagFrames(args.bag)


class _Teller:
    """Prints when the source of the frames fails, and when it works again."""

    def __init__(self, frames: Frames) -> None:
        self._frames, self._is_bad = frames, False

    def tell(self) -> None:
        level, words = self._frames.status
        if self._is_bad != (level == level.BAD):
            self._is_bad = not self._is_bad
            print(f'lava watch: {words}', file=sys.stderr, flush=True)
