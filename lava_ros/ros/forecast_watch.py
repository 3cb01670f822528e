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

"""Hears a node's forecasts, and tells it of vents and of where lava was seen."""

from collections.abc import Sequence
from dataclasses import dataclass
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import OccupancyGrid
import numpy as np
from sensor_msgs.msg import PointCloud2

from lava_ros.ros import codec, outputs, qos
from lava_ros.ros.watcher import Watcher
from lava_ros.scene import Terrain, Vent

_FRAME = 'map'


@dataclass(frozen=True, eq=False)
class HeardGrid:
    """A grid that was heard.

    Attributes:
        stamp_ns: Its stamp [ns].
        heard: Monotonic wall time at which it came [s].
        cells: Its cells, int8, shape [rows, columns].
    """

    stamp_ns: int
    heard: float
    cells: np.ndarray


class ForecastWatch(Watcher):
    """A node in a ROS context of its own.

    Attributes:
        arrivals: The newest ``arrival`` that said that lava comes, None before.
        probabilities: Every ``inundation_probability``, in order.
    """

    def __init__(self, domain_id: int) -> None:
        """Join the graph of a domain."""
        super().__init__('lava_forecast_watch', domain_id)
        self._statuses: dict[str, tuple[int, DiagnosticStatus]] = {}
        self.arrivals: list[HeardGrid] = []
        self.probabilities: list[HeardGrid] = []
        latched = qos.ros_profile(qos.LATCHED)
        commands = qos.ros_profile(qos.COMMANDS)
        self._vents = self._node.create_publisher(PointCloud2, 'vents', commands)
        self._outline = self._node.create_publisher(OccupancyGrid, 'observed_outline', commands)
        for topic, heard in (
            ('arrival', self.arrivals), ('inundation_probability', self.probabilities)
        ):
            self._node.create_subscription(
                OccupancyGrid,
                topic,
                lambda grid, heard=heard: heard.append(_heard(grid)),
                latched,
            )
        self._node.create_subscription(
            DiagnosticArray, '/diagnostics', self._on_diagnostics, qos.ros_profile(qos.DIAGNOSTICS)
        )

    @property
    def is_heard(self) -> bool:
        """Whether a node hears what is published here."""
        publishers = self._vents, self._outline
        return all(publisher.get_subscription_count() for publisher in publishers)

    def values(self, task: str) -> dict[str, str]:
        """The newest values of a status, with its message and the time of both, by key."""
        stamp_ns, status = self._statuses.get(f'lava: {task}', (0, DiagnosticStatus()))
        known = {item.key: item.value for item in status.values}
        is_error = 'yes' if status.level == DiagnosticStatus.ERROR else ''
        return known | {'message': status.message, 'stamp_ns': str(stamp_ns), 'error': is_error}

    def open_vents(self, vents: Sequence[Vent], terrain: Terrain) -> float:
        """Publish vents, and return when that was on the monotonic clock [s]."""
        rows = outputs.vent_rows(vents, 0.0)
        message = outputs.vents_message(
            rows, terrain, frame_id=_FRAME, stamp_ns=self._now_ns()
        )
        self._vents.publish(message)
        return time.monotonic()

    def show_outline(self, lava: np.ndarray, terrain: Terrain, stamp_ns: int) -> float:
        """Publish where lava was seen at a ROS time [ns], and return when that was published [s].

        Args:
            lava: Where there was lava, bool, shape [rows, columns]; somebody looked everywhere.
            terrain: The ground.
            stamp_ns: When it was seen [ns].
        """
        info = codec.map_metadata(terrain, stamp_ns)
        cells = np.where(lava, 100, 0).astype(np.int8)
        self._outline.publish(codec.occupancy_grid(cells, info, codec.header(_FRAME, stamp_ns)))
        return time.monotonic()

    def _now_ns(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        stamp_ns = _nanoseconds(message.header.stamp)
        self._statuses |= {status.name: (stamp_ns, status) for status in message.status}


def _heard(grid: OccupancyGrid) -> HeardGrid:
    cells = np.asarray(grid.data, dtype=np.int8).reshape(grid.info.height, grid.info.width)
    return HeardGrid(_nanoseconds(grid.header.stamp), time.monotonic(), cells)


def _nanoseconds(stamp: object) -> int:
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)  # type: ignore[attr-defined]
