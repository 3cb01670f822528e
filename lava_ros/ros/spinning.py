# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs the callbacks of a node; one that fails does not end it. What nodes have in the graph."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import signal
import threading
import time
from typing import Any

import rclpy
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node

from lava_ros.ros.arguments import start_ros

#: Wait after a callback that failed: one that always does must not take the processor [s].
PAUSE = 0.01


def now_ns(node: Node) -> int:
    """The time on a node's clock [ns]."""
    return int(node.get_clock().now().nanoseconds)


def spin(
    executor: Executor, *, until: Callable[[], bool], on_error: Callable[[Exception], None]
) -> None:
    """Run callbacks until ``until`` returns true, asked at least ten times a second.

    Errors go to ``on_error``, and the node continues. They include those that the middleware
    raises itself, for example for a time on /clock that no clock can represent.
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


class Entities:
    """What a node creates while it is configured, and takes out of the graph afterwards."""

    def __init__(self, node: Node) -> None:
        """Create nothing yet."""
        self.node = node
        self._made: dict[Any, str] = {}

    def create(self, kind: str, *args: Any, **options: Any) -> Any:
        """Do as ``Node.create_<kind>``: a publisher, subscription, timer, ..."""
        made = getattr(self.node, f'create_{kind}')(*args, **options)
        self._made[made] = kind
        return made

    def drop(self, made: Any) -> None:
        """Take one of them out of the graph."""
        getattr(self.node, f'destroy_{self._made.pop(made)}')(made)

    def destroy(self) -> None:
        """Take all of them out of the graph, the newest first."""
        while self._made:
            self.drop(next(reversed(self._made)))


class Watcher:
    """A node in a ROS context of its own; what it hears is up to those derived from it."""

    def __init__(self, name: str, domain_id: int | None, namespace: str = '') -> None:
        """Join the graph of a domain, None for that of the environment, under a name."""
        self._context = rclpy.Context()
        start_ros(context=self._context, domain_id=domain_id)
        self._node = rclpy.create_node(name, namespace=namespace, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)

    def listen(self, timeout: float) -> None:
        """Listen for at most a while [s]."""
        with interrupts_wait():
            self._executor.spin_once(timeout_sec=timeout)

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)
