# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Monitors of the demonstrations: diagnostics, maps and forecasts of a node."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import OccupancyGrid
import numpy as np
from sensor_msgs.msg import PointCloud2

from lava_ros.clients.watcher import Watcher
from lava_ros.live.worker_status import WorkerState
from lava_ros.ros import codec, outputs, qos
from lava_ros.ros.executor import now_ns
from lava_ros.scene import Terrain, Vent

_FRAME = 'map'


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


@dataclass(frozen=True, eq=False)
class ReceivedGrid:
    """A grid with its stamp [ns], received at the monotonic wall time ``received`` [s].

    ``cells`` are int8, shape [rows, columns].
    """

    stamp_ns: int
    received: float
    cells: np.ndarray


class ForecastWatch(DiagnosticsWatch):
    """Opens vents, publishes an outline, and receives forecasts.

    ``arrivals`` and ``probabilities`` list all received maps of ``arrival`` and
    ``inundation_probability``.
    """

    def __init__(self, domain_id: int) -> None:
        """Join the graph of a domain."""
        super().__init__('lava_forecast_watch', domain_id)
        self.arrivals: list[ReceivedGrid] = []
        self.probabilities: list[ReceivedGrid] = []
        latched, commands = qos.ros_profile(qos.LATCHED), qos.ros_profile(qos.COMMANDS)
        self._vents = self._node.create_publisher(PointCloud2, 'vents', commands)
        self._outline = self._node.create_publisher(OccupancyGrid, 'observed_outline', commands)
        received = {'arrival': self.arrivals, 'inundation_probability': self.probabilities}
        for topic, grids in received.items():
            take = partial(self._on_grid, grids)
            self._node.create_subscription(OccupancyGrid, topic, take, latched)

    @property
    def has_subscribers(self) -> bool:
        """True if both topics have a subscriber."""
        publishers = self._vents, self._outline
        return all(publisher.get_subscription_count() for publisher in publishers)

    def open_vents(self, vents: Sequence[Vent], terrain: Terrain) -> float:
        """Publish vents, and return the monotonic time [s]."""
        rows, header = outputs.vent_rows(vents, 0.0), codec.header(_FRAME, now_ns(self._node))
        self._vents.publish(outputs.vents_message(rows, terrain, header))
        return time.monotonic()

    def show_outline(self, lava: np.ndarray, terrain: Terrain, stamp_ns: int) -> float:
        """Publish an outline observed at a ROS time [ns], and return the monotonic time [s].

        ``lava`` is bool, shape [rows, columns]; every cell counts as observed.
        """
        header = codec.header(_FRAME, stamp_ns)
        info, cells = codec.map_metadata(terrain, header.stamp), np.where(lava, 100, 0)
        self._outline.publish(codec.occupancy_grid(cells.astype(np.int8), info, header))
        return time.monotonic()

    @staticmethod
    def _on_grid(grids: list[ReceivedGrid], grid: OccupancyGrid) -> None:
        cells = np.asarray(grid.data, dtype=np.int8).reshape(grid.info.height, grid.info.width)
        stamp_ns = codec.nanoseconds(grid.header.stamp)
        grids.append(ReceivedGrid(stamp_ns, time.monotonic(), cells))
