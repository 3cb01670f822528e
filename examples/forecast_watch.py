# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""ROS node that opens vents, publishes an outline, and receives forecasts of `lava_node`."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
import time

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import OccupancyGrid
import numpy as np
from sensor_msgs.msg import PointCloud2

from lava_ros.clients.monitor import DiagnosticsWatch
from lava_ros.layers.messages import vent_rows
from lava_ros.ros import codec, outputs, qos
from lava_ros.ros.executor import now_ns
from lava_ros.scene import Terrain, Vent

_FRAME = 'map'


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
        # simulated times [s] and their stamps [ns]
        self._moments: list[tuple[float, int]] = []
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
        rows, header = vent_rows(vents, 0.0), codec.header(_FRAME, now_ns(self._node))
        self._vents.publish(outputs.vents_message(rows, terrain, header))
        return time.monotonic()

    def stamp_at(self, time: float) -> int:
        """Return the ROS time [ns] at which the simulation reached a simulated time [s]."""
        times, stamps = zip(*self._moments, strict=True)
        # a simulation on a busy machine is slower than its clock, so its speed is not assumed
        return stamps[0] + round(np.interp(time, times, [item - stamps[0] for item in stamps]))

    def show_outline(self, lava: np.ndarray, terrain: Terrain, stamp_ns: int) -> float:
        """Publish an outline observed at a ROS time [ns], and return the monotonic time [s].

        ``lava`` is bool, shape [rows, columns]; every cell counts as observed.
        """
        header = codec.header(_FRAME, stamp_ns)
        self._outline.publish(codec.occupancy_grid(np.where(lava, 100, 0), terrain, header))
        return time.monotonic()

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        super()._on_diagnostics(message)
        status = self.values('simulation')
        if 'simulated_time_s' in status:
            moment = float(status['simulated_time_s']), int(status['stamp_ns'])
            if self._moments and moment[0] < self._moments[-1][0]:
                # the first vents start the simulation again
                self._moments.clear()
            self._moments.append(moment)

    @staticmethod
    def _on_grid(grids: list[ReceivedGrid], grid: OccupancyGrid) -> None:
        cells = np.asarray(grid.data, dtype=np.int8).reshape(grid.info.height, grid.info.width)
        stamp_ns = codec.nanoseconds(grid.header.stamp)
        grids.append(ReceivedGrid(stamp_ns, time.monotonic(), cells))
