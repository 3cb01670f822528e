# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Nodes around a lava node: what watches it from outside, and what stands for the sensors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import MapMetaData, OccupancyGrid
import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import Image, PointCloud2

from lava_ros.ros import codec, outputs, qos
from lava_ros.ros.spinning import now_ns, Watcher
from lava_ros.ros.worker_status import WorkerState
from lava_ros.scene import Scene, Terrain, Vent

_FRAME = 'map'


@dataclass(frozen=True)
class Observation:
    """What was heard last.

    Attributes:
        state: Words for what the simulation does, empty before anything was heard.
        message: What the diagnostics say about the simulation; with ``values``, by key.
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
        self._stamps_ns: list[int] = []
        self._node.create_subscription(
            OccupancyGrid,
            'height',
            lambda grid: self._stamps_ns.append(codec.nanoseconds(grid.header.stamp)),
            qos.ros_profile(qos.LATCHED),
        )

    def observe(self, timeout: float) -> Observation:
        """Listen for at most a while [s] and say what is known."""
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
class HeardGrid:
    """A grid with a stamp [ns] that was heard at a monotonic wall time [s].

    ``cells`` are int8, shape [rows, columns].
    """

    stamp_ns: int
    heard: float
    cells: np.ndarray


class ForecastWatch(DiagnosticsWatch):
    """Opens vents, publishes an outline, and receives forecasts.

    ``arrivals`` and ``probabilities`` are all maps of ``arrival`` and ``inundation_probability``.
    """

    def __init__(self, domain_id: int) -> None:
        """Join the graph of a domain."""
        super().__init__('lava_forecast_watch', domain_id)
        self.arrivals: list[HeardGrid] = []
        self.probabilities: list[HeardGrid] = []
        latched, commands = qos.ros_profile(qos.LATCHED), qos.ros_profile(qos.COMMANDS)
        self._vents = self._node.create_publisher(PointCloud2, 'vents', commands)
        self._outline = self._node.create_publisher(OccupancyGrid, 'observed_outline', commands)
        heard = {'arrival': self.arrivals, 'inundation_probability': self.probabilities}
        for topic, grids in heard.items():
            take = partial(self._on_grid, grids)
            self._node.create_subscription(OccupancyGrid, topic, take, latched)

    @property
    def is_heard(self) -> bool:
        """Whether a node hears what is published here."""
        publishers = self._vents, self._outline
        return all(publisher.get_subscription_count() for publisher in publishers)

    def open_vents(self, vents: Sequence[Vent], terrain: Terrain) -> float:
        """Publish vents, and return when that was on the monotonic clock [s]."""
        rows, stamp_ns = outputs.vent_rows(vents, 0.0), now_ns(self._node)
        self._vents.publish(
            outputs.vents_message(rows, terrain, frame_id=_FRAME, stamp_ns=stamp_ns)
        )
        return time.monotonic()

    def show_outline(self, lava: np.ndarray, terrain: Terrain, stamp_ns: int) -> float:
        """Publish where lava was observed at a ROS time [ns], and return the monotonic time [s].

        ``lava`` is bool, shape [rows, columns]; every cell counts as observed.
        """
        info = codec.map_metadata(terrain, stamp_ns)
        cells = np.where(lava, 100, 0).astype(np.int8)
        self._outline.publish(codec.occupancy_grid(cells, info, codec.header(_FRAME, stamp_ns)))
        return time.monotonic()

    @staticmethod
    def _on_grid(grids: list[HeardGrid], grid: OccupancyGrid) -> None:
        cells = np.asarray(grid.data, dtype=np.int8).reshape(grid.info.height, grid.info.width)
        stamp_ns = codec.nanoseconds(grid.header.stamp)
        grids.append(HeardGrid(stamp_ns, time.monotonic(), cells))


class SceneFeed(Node):
    """Publishes terrain once, latched, and the vents whenever they change or somebody joins.

    A discharge that changes with time follows the simulated time on ``/diagnostics``, which also
    say what the node has refused: whoever runs the feed does not see the node's log. The lava's
    constants are not sent; these are parameters of the simulation.
    """

    def __init__(self, scene: Scene, *, frame_id: str = _FRAME) -> None:
        """Create the publishers, and publish the terrain."""
        super().__init__('lava_feed')
        self._scene = scene
        self._frame_id = frame_id
        self._time = 0.0
        self._sent: list[tuple[float, ...]] | None = None
        self._readers = 0
        self._refusal = ''
        latched, commands = qos.ros_profile(qos.LATCHED), qos.ros_profile(qos.COMMANDS)
        # a latched publisher has to stay
        self._terrain = {
            'terrain': self.create_publisher(Image, 'terrain', latched),
            'terrain_info': self.create_publisher(MapMetaData, 'terrain_info', latched),
        }
        # who comes late gets them when published again: the node does not ask for old ones
        self._vents = self.create_publisher(PointCloud2, 'vents', commands)
        self.create_subscription(
            DiagnosticArray, '/diagnostics', self._on_diagnostics, qos.ros_profile(qos.DIAGNOSTICS)
        )
        messages = outputs.terrain_messages(
            scene.terrain, frame_id=frame_id, stamp_ns=now_ns(self)
        )
        for topic, message in messages.items():
            self._terrain[topic].publish(message)
        self.create_timer(0.2, self._publish_vents)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            # Other namespaces have eruptions of their own.
            node, _, task = status.name.rpartition(': ')
            if node.rpartition('/')[0] != self.get_namespace().strip('/'):
                continue
            if task == 'inputs':
                refusal = status.message if status.level == DiagnosticStatus.ERROR else ''
                if refusal and refusal != self._refusal:
                    self.get_logger().error(f'{status.name}: {refusal}')
                self._refusal = refusal
            for item in status.values:
                if item.key == 'simulated_time_s':
                    self._time = float(item.value)

    def _publish_vents(self) -> None:
        terrain, rows = self._scene.terrain, outputs.vent_rows(self._scene.vents, self._time)
        readers = self._vents.get_subscription_count()
        if rows != self._sent or readers > self._readers:
            self._vents.publish(
                outputs.vents_message(
                    rows, terrain, frame_id=self._frame_id, stamp_ns=now_ns(self)
                )
            )
            self._sent = rows
        self._readers = readers
