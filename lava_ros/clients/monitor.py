# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Monitors of the diagnostics and maps of a node, for demonstrations."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import OccupancyGrid

from lava_ros.clients.watcher import Watcher
from lava_ros.live.worker_status import WorkerState
from lava_ros.ros import codec, qos


class DiagnosticsWatch(Watcher):
    """Stores the newest diagnostic status of each name, with its stamp [ns]."""

    def __init__(self, name: str, domain_id: int) -> None:
        """Join the ROS graph of a domain as the node ``name``."""
        super().__init__(name, domain_id)
        self._statuses: dict[str, tuple[int, DiagnosticStatus]] = {}
        self._node.create_subscription(
            DiagnosticArray, '/diagnostics', self._on_diagnostics, qos.ros_profile(qos.DIAGNOSTICS)
        )

    def values(self, task: str) -> dict[str, str]:
        """Return a status by key: its values, ``message``, ``stamp_ns`` and ``error``."""
        stamp_ns, status = self._statuses.get(f'lava: {task}', (0, DiagnosticStatus()))
        known = {item.key: item.value for item in status.values}
        is_error = 'yes' if status.level == DiagnosticStatus.ERROR else ''
        return known | {'message': status.message, 'stamp_ns': str(stamp_ns), 'error': is_error}

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        stamp_ns = codec.nanoseconds(message.header.stamp)
        self._statuses |= {status.name: (stamp_ns, status) for status in message.status}


class Monitor(DiagnosticsWatch):
    """Follows a flow; ``frames`` and ``frame_stamp_ns`` are the number and last stamp of maps."""

    def __init__(self, domain_id: int) -> None:
        """Join the graph of a domain."""
        super().__init__('lava_monitor', domain_id)
        self.frames = self.frame_stamp_ns = 0
        self._node.create_subscription(
            OccupancyGrid, 'height', self._on_height, qos.ros_profile(qos.LATCHED)
        )

    @property
    def error(self) -> str:
        """Reason why the simulation, the recording or an input has failed, empty without one."""
        recorder, inputs, simulation = map(self.values, ('recorder', 'inputs', 'simulation'))
        has_failed = simulation.get('state') == WorkerState.FAILED.value
        for values, is_error in (
            (recorder, recorder['error']), (inputs, inputs['error']), (simulation, has_failed)
        ):
            if is_error:
                return values['message']
        return ''

    @property
    def is_finished(self) -> bool:
        """True if the simulation is finished and its last height map has been received."""
        values = self.values('simulation')
        last = int(values.get('frame_stamp_ns', -1))
        return values.get('state') == WorkerState.FINISHED.value and self.frame_stamp_ns >= last

    def _on_height(self, grid: OccupancyGrid) -> None:
        self.frames += 1
        self.frame_stamp_ns = codec.nanoseconds(grid.header.stamp)
