# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Execution of callbacks, so that a failed one does not end the node, and ROS entities."""

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

#: Pause after a failed callback, so that one that always fails does not occupy the CPU [s].
PAUSE = 0.01


def now_ns(node: Node) -> int:
    """Return the time of a node's clock [ns]."""
    return int(node.get_clock().now().nanoseconds)


def spin(
    executor: Executor, *, until: Callable[[], bool], on_error: Callable[[Exception], None]
) -> None:
    """Run callbacks until ``until``, called at least ten times a second, returns True.

    Errors go to ``on_error``, and the node continues. They include errors of the middleware
    itself, for example for a time on /clock that no clock can represent.
    """
    while not until():
        try:
            executor.spin_once(timeout_sec=0.1)
        except Exception as error:
            on_error(error)
            time.sleep(PAUSE)


@contextmanager
def interrupts_wait() -> Iterator[None]:
    """Delay Ctrl+C until the end of the ``with`` block.

    A KeyboardInterrupt while rclpy converts a message is lost: rclpy raises a RuntimeError about a
    call argument instead. In threads other than the main one, which receive no signals, this does
    nothing.
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
    """The ROS entities that a node creates when configured and destroys at cleanup."""

    def __init__(self, node: Node) -> None:
        """Initialize without entities."""
        self.node = node
        self._made: dict[Any, str] = {}

    def create(self, kind: str, *args: Any, **options: Any) -> Any:
        """Call ``Node.create_<kind>``, for example for a publisher, subscription or timer."""
        made = getattr(self.node, f'create_{kind}')(*args, **options)
        self._made[made] = kind
        return made

    def drop(self, made: Any) -> None:
        """Destroy one entity."""
        getattr(self.node, f'destroy_{self._made.pop(made)}')(made)

    def destroy(self) -> None:
        """Destroy all entities, newest first."""
        while self._made:
            self.drop(next(reversed(self._made)))


class Watcher:
    """A node in its own ROS context; subclasses create its subscriptions."""

    def __init__(self, name: str, domain_id: int | None, namespace: str = '') -> None:
        """Join the graph of a domain as node ``name``; None: the domain of the environment."""
        self._context = rclpy.Context()
        start_ros(context=self._context, domain_id=domain_id)
        self._node = rclpy.create_node(name, namespace=namespace, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)

    def listen(self, timeout: float) -> None:
        """Process callbacks for at most ``timeout`` [s]."""
        with interrupts_wait():
            self._executor.spin_once(timeout_sec=timeout)

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)
