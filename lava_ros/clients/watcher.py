# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Nodes in their own ROS context, which process messages only when asked."""

from collections.abc import Iterator
from contextlib import contextmanager
import signal
import threading

import rclpy
from rclpy.executors import SingleThreadedExecutor

from lava_ros.ros.executor import start_ros


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
