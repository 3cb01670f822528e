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

from collections.abc import Mapping
from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import OccupancyGrid

from lava_ros.ros import qos
from lava_ros.ros.watcher import Watcher
from lava_ros.ros.worker_status import WorkerState


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


class Monitor(Watcher):
    """Listens to ``/diagnostics`` and ``height``, in a ROS context of its own."""

    def __init__(self, domain_id: int) -> None:
        """Join the graph of a domain."""
        super().__init__('lava_monitor', domain_id)
        self._statuses: dict[str, DiagnosticStatus] = {}
        self._frames = 0
        self._frame_stamp_ns = 0
        self._node.create_subscription(
            DiagnosticArray, '/diagnostics', self._on_diagnostics, qos.ros_profile(qos.DIAGNOSTICS)
        )
        self._node.create_subscription(
            OccupancyGrid, 'height', self._on_height, qos.ros_profile(qos.LATCHED)
        )

    def observe(self, timeout: float) -> Observation:
        """Listen for at most a while [s] and say what is known."""
        self.listen(timeout)
        simulation = self._statuses.get('lava: simulation', DiagnosticStatus())
        values = {item.key: item.value for item in simulation.values}
        return Observation(
            state=values.get('state', ''),
            message=simulation.message,
            values=values,
            refused=self._complaint('lava: inputs'),
            recorder_error=self._complaint('lava: recorder'),
            frames=self._frames,
            frame_stamp_ns=self._frame_stamp_ns,
        )

    def _complaint(self, name: str) -> str:
        status = self._statuses.get(name)
        return status.message if status is not None and status.level == status.ERROR else ''

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self._statuses |= {status.name: status for status in message.status}

    def _on_height(self, grid: OccupancyGrid) -> None:
        self._frames += 1
        stamp = grid.header.stamp
        self._frame_stamp_ns = stamp.sec * 1_000_000_000 + stamp.nanosec
