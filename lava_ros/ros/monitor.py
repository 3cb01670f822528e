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

"""Watches a lava node from outside, through what it publishes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import OccupancyGrid
import numpy as np
from sensor_msgs.msg import PointCloud2

from lava_ros.ros import codec, outputs, qos
from lava_ros.ros.spinning import Watcher
from lava_ros.ros.worker_status import WorkerState
from lava_ros.scene import Terrain, Vent


@dataclass(frozen=True)
class Observation:
    """What was heard last.

    Attributes:
        state: Words for what the simulation does, empty before anything was heard.
        message: What the diagnostics say about the simulation.
        values: Their values, by key.
        refused: The newest input that was refused, empty when all are taken.
        recorder_error: What is wrong with the recording, empty when nothing is.
        frames: Height maps heard.
        frame_stamp_ns: Stamp of the newest of them [ns].
    """

    state: str = ''
    message: str = ''
    values: Mapping[str, str] = field(default_factory=dict)
    refused: str = ''
    recorder_error: str = ''
    frames: int = 0
    frame_stamp_ns: int = 0

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self.values.get('simulated_time_s', 0.0))

    @property
    def has_failed(self) -> bool:
        """Whether the simulation has given up."""
        return self.state == WorkerState.FAILED.value

    @property
    def is_finished(self) -> bool:
        """Whether the simulation is at its end and its last height map was heard."""
        last = int(self.values.get('frame_stamp_ns', -1))
        return self.state == WorkerState.FINISHED.value and self.frame_stamp_ns >= last


class DiagnosticsWatch(Watcher):
    """Keeps the newest diagnostic status of each name, with its stamp [ns]."""

    def __init__(self, name: str, domain_id: int) -> None:
        """Join the ROS graph of a domain as the node ``name``."""
        super().__init__(name, domain_id)
        self._statuses: dict[str, tuple[int, DiagnosticStatus]] = {}
        self._node.create_subscription(
            DiagnosticArray, '/diagnostics', self._on_diagnostics, qos.ros_profile(qos.DIAGNOSTICS)
        )

    def values(self, task: str) -> dict[str, str]:
        """The newest values of a status, with its message and the time of both, by key."""
        stamp_ns, status = self._statuses.get(f'lava: {task}', (0, DiagnosticStatus()))
        known = {item.key: item.value for item in status.values}
        is_error = 'yes' if status.level == DiagnosticStatus.ERROR else ''
        return known | {'message': status.message, 'stamp_ns': str(stamp_ns), 'error': is_error}

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        stamp_ns = codec.nanoseconds(message.header.stamp)
        self._statuses |= {status.name: (stamp_ns, status) for status in message.status}


class Monitor(DiagnosticsWatch):
    """Listens to ``/diagnostics`` and ``height``."""

    def __init__(self, domain_id: int) -> None:
        """Join the graph of a domain."""
        super().__init__('lava_monitor', domain_id)
        self._frames = 0
        self._frame_stamp_ns = 0
        self._node.create_subscription(
            OccupancyGrid, 'height', self._on_height, qos.ros_profile(qos.LATCHED)
        )

    def observe(self, timeout: float) -> Observation:
        """Listen for at most a while [s] and say what is known."""
        self.listen(timeout)
        values = self.values('simulation')
        return Observation(
            state=values.get('state', ''),
            message=values['message'],
            values=values,
            refused=self._complaint('inputs'),
            recorder_error=self._complaint('recorder'),
            frames=self._frames,
            frame_stamp_ns=self._frame_stamp_ns,
        )

    def _complaint(self, task: str) -> str:
        said = self.values(task)
        return said['message'] if said['error'] else ''

    def _on_height(self, grid: OccupancyGrid) -> None:
        self._frames += 1
        self._frame_stamp_ns = codec.nanoseconds(grid.header.stamp)


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


class ForecastWatch(DiagnosticsWatch):
    """Opens vents, publishes an outline, and receives forecasts.

    Attributes:
        arrivals: Every ``arrival`` map, in order.
        probabilities: Every ``inundation_probability`` map, in order.
    """

    def __init__(self, domain_id: int) -> None:
        """Join the graph of a domain."""
        super().__init__('lava_forecast_watch', domain_id)
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

    @property
    def is_heard(self) -> bool:
        """Whether a node hears what is published here."""
        publishers = self._vents, self._outline
        return all(publisher.get_subscription_count() for publisher in publishers)

    def open_vents(self, vents: Sequence[Vent], terrain: Terrain) -> float:
        """Publish vents, and return when that was on the monotonic clock [s]."""
        rows = outputs.vent_rows(vents, 0.0)
        message = outputs.vents_message(
            rows, terrain, frame_id=_FRAME, stamp_ns=self._now_ns()
        )
        self._vents.publish(message)
        return time.monotonic()

    def show_outline(self, lava: np.ndarray, terrain: Terrain, stamp_ns: int) -> float:
        """Publish where lava was observed at a ROS time [ns], and return the monotonic time [s].

        ``lava`` is bool, shape [rows, columns]; every cell counts as observed.
        """
        info = codec.map_metadata(terrain, stamp_ns)
        cells = np.where(lava, 100, 0).astype(np.int8)
        self._outline.publish(codec.occupancy_grid(cells, info, codec.header(_FRAME, stamp_ns)))
        return time.monotonic()

    def _now_ns(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)


def _heard(grid: OccupancyGrid) -> HeardGrid:
    cells = np.asarray(grid.data, dtype=np.int8).reshape(grid.info.height, grid.info.width)
    return HeardGrid(codec.nanoseconds(grid.header.stamp), time.monotonic(), cells)
