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

"""Several simulations on one GPU at once.

Few particles do not fill a GPU: while one simulation waits for memory, and for its next launch,
others can go on. Each has a stream of its own, and the host launches them in turn.
"""

from collections import deque
from collections.abc import Iterable, Iterator

import warp as wp

#: Simulations at work at once: more do not make a GPU faster.
AT_ONCE = 32

_END = object()


def interleave(routes: Iterable[Iterator[None]], device: str, *, at_once: int = AT_ONCE) -> None:
    """Take all routes to their ends, some of them at a time.

    A route leaves off whenever it has launched something (``Simulation.advancing``); on the CPU,
    where that has been computed by then, one route follows the other. A route begins only when
    it is its turn.

    Args:
        routes: The routes.
        device: Warp device they launch on.
        at_once: Routes on their way at a time.

    Raises:
        Exception: Whatever a route raises; the others are given up.
    """
    if not wp.get_device(device).is_cuda:
        for route in routes:
            for _ in route:
                pass
        return
    here = wp.get_stream(device)
    streams = [wp.Stream(device) for _ in range(at_once)]
    for stream in streams:
        stream.wait_stream(here)
    waiting = iter(routes)
    under_way = deque(zip(streams, waiting))  # noqa: B905, there may be fewer routes
    try:
        while under_way:
            stream, route = under_way.popleft()
            with wp.ScopedStream(stream, sync_enter=False):
                if next(route, _END) is _END:
                    route = next(waiting, None)
                if route is not None:
                    under_way.append((stream, route))
    finally:
        for stream in streams:
            here.wait_stream(stream)
