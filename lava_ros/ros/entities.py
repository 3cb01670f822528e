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

"""What a node creates for as long as it is configured, and takes out of the graph afterwards."""

from collections.abc import Callable
from typing import Any

from rclpy.node import Node


class Entities:
    """Creates publishers, subscriptions, timers and services, and remembers them."""

    def __init__(self, node: Node) -> None:
        """Create nothing yet.

        Args:
            node: The node that has them.
        """
        self.node = node
        self._made: list[tuple[Callable[[Any], object], Any]] = []

    def publisher(self, *args: Any, **options: Any) -> Any:
        """Do as ``Node.create_publisher``."""
        return self._keep(
            self.node.create_publisher(*args, **options), self.node.destroy_publisher
        )

    def subscription(self, *args: Any, **options: Any) -> Any:
        """Do as ``Node.create_subscription``."""
        return self._keep(
            self.node.create_subscription(*args, **options), self.node.destroy_subscription
        )

    def timer(self, *args: Any, **options: Any) -> Any:
        """Do as ``Node.create_timer``."""
        return self._keep(self.node.create_timer(*args, **options), self.node.destroy_timer)

    def service(self, *args: Any, **options: Any) -> Any:
        """Do as ``Node.create_service``."""
        return self._keep(self.node.create_service(*args, **options), self.node.destroy_service)

    def guard_condition(self, callback: Callable[[], None]) -> Any:
        """Do as ``Node.create_guard_condition``."""
        return self._keep(
            self.node.create_guard_condition(callback), self.node.destroy_guard_condition
        )

    def destroy(self) -> None:
        """Take all of them out of the graph, the newest first."""
        while self._made:
            destroy, made = self._made.pop()
            destroy(made)

    def _keep(self, made: Any, destroy: Callable[[Any], object]) -> Any:
        self._made.append((destroy, made))
        return made
