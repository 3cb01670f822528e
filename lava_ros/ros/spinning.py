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

"""Runs the callbacks of a node; one that fails does not end it."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import signal
import threading
import time

from rclpy.executors import Executor

#: Wait after a callback that failed: one that always does must not take the processor [s].
PAUSE = 0.01


def spin(
    executor: Executor, *, until: Callable[[], bool], on_error: Callable[[Exception], None]
) -> None:
    """Run callbacks until it is time to stop.

    What the middleware itself calls back, such as a time on /clock that no clock can show, raises
    here. The node goes on without it.

    Args:
        executor: Has the node.
        until: Whether to stop; asked ten times a second and after each callback.
        on_error: Told what a callback raised.
    """
    while not until():
        try:
            executor.spin_once(timeout_sec=0.1)
        except Exception as error:
            on_error(error)
            time.sleep(PAUSE)


@contextmanager
def interrupts_wait() -> Iterator[None]:
    """Have Ctrl+C wait for the end of what rclpy does here.

    A KeyboardInterrupt that comes while rclpy makes a message is lost there: a RuntimeError about
    a call argument is all that is left of it. In threads other than the main one, which no signal
    reaches, nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    handler = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
        if came:
            signal.raise_signal(signal.SIGINT)
