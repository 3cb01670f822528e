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

from typing import Any

from rclpy.node import Node


class Entities:
    """Creates publishers, subscriptions, timers and others, and remembers them."""

    def __init__(self, node: Node) -> None:
        """Create nothing yet."""
        self.node = node
        self._made: list[tuple[str, Any]] = []

    def create(self, kind: str, *args: Any, **options: Any) -> Any:
        """Do as ``Node.create_<kind>``: a publisher, subscription, timer, ..."""
        made = getattr(self.node, f'create_{kind}')(*args, **options)
        self._made.append((kind, made))
        return made

    def drop(self, made: Any) -> None:
        """Take one of them out of the graph."""
        (entry,) = (item for item in self._made if item[1] is made)
        self._made.remove(entry)
        self._destroy(*entry)

    def destroy(self) -> None:
        """Take all of them out of the graph, the newest first."""
        while self._made:
            self._destroy(*self._made.pop())

    def _destroy(self, kind: str, made: Any) -> None:
        getattr(self.node, f'destroy_{kind}')(made)
