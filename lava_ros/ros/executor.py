# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Execution of callbacks, so that a failed one does not end the node, and ROS entities."""

from collections.abc import Callable
import time
from typing import Any

from rclpy.executors import Executor
from rclpy.node import Node

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


class EntityRegistry:
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
