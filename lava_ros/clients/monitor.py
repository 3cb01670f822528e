# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Monitors of the demonstrations: diagnostics, maps and forecasts of a node."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
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


@dataclass(frozen=True)
class Observation:
    """Newest diagnostics, and the height maps so far.

    Attributes:
        state: State of the simulation (``WorkerState``), empty before the first diagnostics.
        message: Message of the status ``simulation``.
        values: Values of the status ``simulation``, by key.
        refused: Newest refused input, empty if all inputs are accepted.
        recorder_error: Error of the recording, empty without one.
        frames: Number of height maps received.
        frame_stamp_ns: Stamp of the newest height map [ns].
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
        """True if the simulation has failed."""
        return self.state == WorkerState.FAILED.value

    @property
    def is_finished(self) -> bool:
        """True if the simulation is finished and its last height map has been received."""
        last = int(self.values.get('frame_stamp_ns', -1))
        return self.state == WorkerState.FINISHED.value and self.frame_stamp_ns >= last


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
    """Subscribes to ``/diagnostics`` and ``height``."""

    def __init__(self, domain_id: int) -> None:
        """Join the graph of a domain."""
        super().__init__('lava_monitor', domain_id)
        self._stamps_ns: list[int] = []
        self._node.create_subscription(
            OccupancyGrid,
            'height',
            lambda grid: self._stamps_ns.append(codec.nanoseconds(grid.header.stamp)),
            qos.ros_profile(qos.LATCHED),
        )

    def observe(self, timeout: float) -> Observation:
        """Receive messages for up to ``timeout`` [s], and return the observation."""
        self.listen(timeout)
        values, inputs, recorder = map(self.values, ('simulation', 'inputs', 'recorder'))
        return Observation(
            state=values.get('state', ''),
            message=values['message'],
            values=values,
            refused=inputs['message'] if inputs['error'] else '',
            recorder_error=recorder['message'] if recorder['error'] else '',
            frames=len(self._stamps_ns),
            frame_stamp_ns=self._stamps_ns[-1] if self._stamps_ns else 0,
        )


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
        rows, stamp_ns = outputs.vent_rows(vents, 0.0), now_ns(self._node)
        self._vents.publish(
            outputs.vents_message(rows, terrain, frame_id=_FRAME, stamp_ns=stamp_ns)
        )
        return time.monotonic()

    def show_outline(self, lava: np.ndarray, terrain: Terrain, stamp_ns: int) -> float:
        """Publish an outline observed at a ROS time [ns], and return the monotonic time [s].

        ``lava`` is bool, shape [rows, columns]; every cell counts as observed.
        """
        info = codec.map_metadata(terrain, stamp_ns)
        cells = np.where(lava, 100, 0).astype(np.int8)
        self._outline.publish(codec.occupancy_grid(cells, info, codec.header(_FRAME, stamp_ns)))
        return time.monotonic()

    @staticmethod
    def _on_grid(grids: list[ReceivedGrid], grid: OccupancyGrid) -> None:
        cells = np.asarray(grid.data, dtype=np.int8).reshape(grid.info.height, grid.info.width)
        stamp_ns = codec.nanoseconds(grid.header.stamp)
        grids.append(ReceivedGrid(stamp_ns, time.monotonic(), cells))
