# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Frames of a running node, from the maps that it publishes."""

from collections.abc import Mapping
from functools import partial
from itertools import product
import math
import os
import time
from typing import Any
import zlib

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
from nav_msgs.msg import MapMetaData
import numpy as np
from rclpy.exceptions import InvalidNamespaceException
from rclpy.validate_namespace import validate_namespace
from sensor_msgs.msg import Image, PointCloud2
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import MarkerArray

from lava_ros.bag.decoding import cloud_columns, image_array, Moment, moment_of, places_in
from lava_ros.clients.watcher import Watcher
from lava_ros.errors import LavaError
from lava_ros.layers.frame import Frame, grid_frame, image_frame, LayerFrame, threshold_at
from lava_ros.layers.layer import ARRIVED, IMAGE, INUNDATED, Layer
from lava_ros.layers.messages import BARRIERS, LABELS, PLACES
from lava_ros.products.run_warnings import method_of
from lava_ros.ros import qos
from lava_ros.ros.codec import message_class, nanoseconds
from lava_ros.watch.frames import (
    Frames,
    Level,
    NO_PARTICLES,
    Status,
    watched_layers,
    WatchedParticles,
)

#: Time without diagnostics after which the node counts as silent [s]; the normal period is 1 s.
PATIENCE = 5.0

#: Maximum number of frames. Beyond it, every second one is deleted.
MAX_FRAMES = 600

#: Maximum number of stamps whose maps wait for the diagnostics with their simulated time.
_MAX_PENDING = 20

#: Maximum number of messages that one poll receives.
_MAX_MESSAGES = 50


class _Packed:
    def __init__(self, shown: LayerFrame) -> None:
        self._layer, self._is_saturated = shown.layer, shown.is_saturated
        self.shape = shown.values.shape
        is_known = np.isfinite(shown.values)
        # most of a large map is empty
        ends = [np.flatnonzero(is_known.any(axis=axis))[[0, -1]] if is_known.any() else (0, -1)
                for axis in (1, 0)]
        self._part = tuple(slice(first, last + 1) for first, last in ends)
        self._data = zlib.compress(shown.values[self._part].astype(np.float32).tobytes(), 1)

    def unpacked(self) -> LayerFrame:
        values = np.full(self.shape, np.nan, dtype=np.float32)
        part = values[self._part]
        part[:] = np.frombuffer(zlib.decompress(self._data), np.float32).reshape(part.shape)
        return LayerFrame(self._layer, values, self._is_saturated)


class LiveFrames(Watcher, Frames):
    """Frames received from the node in a namespace, at simulated ``times`` [s].

    ``version`` increases with every change of the frames.
    """

    def __init__(self, namespace: str = '', domain_id: int | None = None) -> None:
        """Subscribe in a ROS domain; None for the domain of the environment.

        Raises:
            LavaError: If ``namespace`` is not a ROS namespace, such as ``/etna``.
        """
        self._namespace = namespace.strip('/')
        try:
            validate_namespace(f'/{self._namespace}')
        except InvalidNamespaceException as error:
            expected = 'letters, digits and _ between slashes, such as /etna'
            raise LavaError('--namespace', namespace, expected) from error
        Watcher.__init__(self, 'lava_watch', domain_id, self._namespace)
        Frames.__init__(self)
        self._maps: list[dict[str, _Packed]] = []
        self._waiting: dict[int, dict[str, _Packed]] = {}
        self._forecasts: dict[str, _Packed] = {}
        self._info: MapMetaData | None = None
        self._elevation: np.ndarray | None = None
        self._frame_id = 'map'
        self._particles = NO_PARTICLES
        self._sampling: Any = None
        self._wanted_at = 0.0
        self._vents: list[dict[str, Any]] = []
        self._barriers: list[np.ndarray] = []
        self._statuses: dict[str, str] = {}
        self._senders: dict[str, Any] = {}
        self._lava = 'lava'
        self._moment: Moment | None = None
        self._received, self._received_at = 0, time.monotonic()
        self._reported = Status(Level.WARN, '')
        self._problems: dict[str, str] = {}
        self._others: set[str] = set()
        latched = qos.ros_profile(qos.LATCHED)
        subscribed: list[tuple[Any, str, Any]] = [
            (message_class(item.message), item.topic, partial(self._on_layer, item))
            for item in watched_layers()
        ]
        subscribed += [
            (MarkerArray, 'vents_markers', self._on_vents),
            (DiagnosticArray, 'place_arrivals', self._on_places),
        ]
        for kind, topic, read in subscribed:
            self._node.create_subscription(kind, topic, partial(self._read, topic, read), latched)
        inputs: list[tuple[Any, str, Any]] = [
            (Image, 'terrain', self._on_terrain),
            (MapMetaData, 'terrain_info', self._on_terrain_info),
        ]
        # with the profiles of the node's subscriptions; a message that arrives twice is the same
        # terrain
        for (kind, topic, read), profile in product(inputs, qos.state_inputs(1)):
            received = partial(self._read, topic, read)
            self._node.create_subscription(kind, topic, received, qos.ros_profile(profile))
        self._node.create_subscription(
            DiagnosticArray, '/diagnostics', self._on_diagnostics, qos.ros_profile(qos.DIAGNOSTICS)
        )

    def poll(self) -> None:
        """Process the messages that have arrived."""
        if self._sampling is not None and time.monotonic() - self._wanted_at > PATIENCE:
            # no page shows particles, and the node publishes them only if it has a subscriber
            self._node.destroy_subscription(self._sampling)
            self._sampling = None
        for _ in range(_MAX_MESSAGES):
            received = self._received
            self.listen(0.0)
            if self._received == received:
                return

    @property
    def status(self) -> Status:
        """Status that the node reports, or the reason why there is none."""
        silence = time.monotonic() - self._received_at
        if self._moment is None:
            domain = os.environ.get('ROS_DOMAIN_ID', '0')
            where = f'in namespace /{self._namespace} of ROS domain {domain}'
            if silence <= PATIENCE:
                return Status(Level.WARN, f'listening for a node {where}')
            others = f' (heard from {", ".join(sorted(self._others))})' if self._others else ''
            words = f"no node answers {where}{others}: start 'lava ros node', or give --namespace"
            return Status(Level.ERROR, f'{words} and ROS_DOMAIN_ID of the one that runs')
        if silence > PATIENCE:
            words = f'no message from the node for {silence:.0f} s: these are its last maps'
            return Status(Level.ERROR, words)
        if self._problems:
            return Status(Level.ERROR, next(iter(self._problems.values())))
        lacks_ground = self._info is None or self._elevation is None
        if self._maps and lacks_ground and self._reported.level is not Level.ERROR:
            return Status(Level.WARN, 'received maps, but no terrain with terrain_info')
        return self._reported

    def frame(self, index: int) -> Frame:
        """Return the frame at ``times[index]``, with the newest map of each layer at that time.

        Raises:
            LavaError: If there is no terrain, or its size differs from ``terrain_info``.
        """
        if self._info is None or self._elevation is None:
            raise LavaError('terrain', None, 'a message on terrain and one on terrain_info')
        if self._elevation.shape != (self._info.height, self._info.width):
            raise LavaError('terrain', self._elevation.shape, 'height and width of terrain_info')
        found: dict[str, _Packed] = {}
        for maps in self._maps[: index + 1]:
            shape = self._elevation.shape
            found |= {key: item for key, item in maps.items() if item.shape == shape}
        terrain: dict[str, Any] = {'offset': (0.0, 0.0)}
        if self._moment is not None and math.isfinite(epsg := self._moment.number('epsg')):
            offset = map(self._moment.number, ('offset_easting', 'offset_northing'))
            terrain = {'epsg': int(epsg), 'offset': tuple(offset)}
        terrain['barriers'] = [(crest + terrain['offset']).tolist() for crest in self._barriers]
        layers = {source: item.unpacked() for source, item in found.items()}
        arrived, inundated = (layers.pop(source, None) for source in (ARRIVED, INUNDATED))
        frame = Frame(
            elevation=self._elevation,
            resolution=float(str(np.float32(self._info.resolution))),
            origin=(self._info.origin.position.x, self._info.origin.position.y),
            layers=layers,
            vents=np.reshape([vent['position'] for vent in self._vents], (-1, 2)),
            time=self.times[index],
            scene={'terrain': terrain, 'vents': self._vents},
        )
        return frame.with_cover(
            None if arrived is None else arrived.values,
            None if inundated is None else inundated.values,
            threshold_at(self._moment),
        )

    def facts(self, index: int) -> Mapping[str, str]:
        """Return the newest sentence of each status of the node."""
        return self._statuses

    def particles(self, index: int) -> WatchedParticles:
        """Return the newest particles with the newest maps; the first call subscribes to them."""
        self._wanted_at = time.monotonic()
        if self._sampling is None:
            topic = 'lava_particles'
            read = partial(self._read, topic, self._on_particles)
            profile = qos.ros_profile(qos.NEWEST)
            self._sampling = self._node.create_subscription(PointCloud2, topic, read, profile)
        return self._particles if index == len(self.times) - 1 else NO_PARTICLES

    def command(self, name: str) -> None:
        """Call a service of the node; its answer follows in ``answer``."""
        switches = {'pause': True, 'resume': False}
        service, kind = ('pause', SetBool) if name in switches else (name, Trigger)
        if service not in self._senders:
            full = f'/{self._lava}/{service}'
            self._senders[service] = self._node.create_client(kind, full)
        client = self._senders[service]
        if not client.service_is_ready():
            self.answer = f'{name}: no node answers'
            return
        request = kind.Request()
        if name in switches:
            request.data = switches[name]
        self.answer = f'{name}: asked'
        client.call_async(request).add_done_callback(partial(self._on_answer, name))

    def open_vent(self, x: float, y: float) -> None:
        """Publish the place on ``clicked_point``; a refusal is in the statuses of the node."""
        if 'clicked_point' not in self._senders:
            profile = qos.ros_profile(qos.COMMANDS)
            self._senders['clicked_point'] = self._node.create_publisher(
                PointStamped, 'clicked_point', profile
            )
        message = PointStamped()
        message.header.frame_id = self._frame_id
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.point.x, message.point.y = x, y
        self._senders['clicked_point'].publish(message)
        self.answer = f'vent at {x:.0f} m, {y:.0f} m: sent'

    def _on_answer(self, name: str, future: Any) -> None:
        self.answer = f'{name}: {future.result().message}'

    def _read(self, topic: str, read: Any, message: Any) -> None:
        """Read a message; an invalid one is reported in ``status`` and otherwise ignored."""
        self._received += 1
        try:
            read(message)
            self._problems.pop(topic, None)
        except ValueError as error:
            self._problems[topic] = f'{topic}: {error}'

    def _on_layer(self, layer: Layer, message: Any) -> None:
        if layer.message == IMAGE:
            shown = image_frame(layer, image_array(message, layer.topic))
        else:
            cells = np.asarray(message.data, dtype=np.int8)
            shown = grid_frame(layer, cells.reshape(message.info.height, message.info.width))
        if layer.is_forecast:
            self._forecasts[layer.source] = _Packed(shown)
        else:
            stamp_ns = nanoseconds(message.header.stamp)
            self._waiting.setdefault(stamp_ns, {})[layer.source] = _Packed(shown)
            if len(self._waiting) > _MAX_PENDING:
                del self._waiting[min(self._waiting)]

    def _on_places(self, message: DiagnosticArray) -> None:
        self.places = places_in(message)
        self.version += 1

    def _on_particles(self, message: PointCloud2) -> None:
        columns = cloud_columns(message, 'lava_particles', ('x', 'y', 'temperature'))
        self._particles = WatchedParticles(np.column_stack(list(columns.values())))
        self.version += 1

    def _on_terrain(self, image: Image) -> None:
        self._frame_id = image.header.frame_id
        self._elevation = image_array(image, 'terrain').astype(np.float32)
        self.version += 1

    def _on_terrain_info(self, info: MapMetaData) -> None:
        self._info = info
        self.version += 1

    def _on_vents(self, message: MarkerArray) -> None:
        self._barriers = [
            np.array([(point.x, point.y) for point in item.points])
            for item in message.markers
            if item.ns == BARRIERS
        ]
        labels = {item.id: item.text for item in message.markers if item.ns == LABELS}
        self._vents = [
            {'name': labels.get(item.id, ''), 'position': [place.x, place.y]}
            for item in message.markers
            if item.ns == PLACES
            # a fissure is a line, a vent a disc
            for place in item.points or [item.pose.position]
        ]

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self._received += 1
        for status in message.status:
            node, _, task = status.name.partition(': ')
            if not task:
                continue
            if node.rpartition('/')[0] != self._namespace:
                self._others |= {node} if task == 'simulation' else set()
                continue
            self._statuses = {**self._statuses, task: status.message}
            if task != 'simulation':
                continue
            self._lava = node
            self._received_at = time.monotonic()
            levels = {status.OK: Level.OK, status.ERROR: Level.ERROR}
            level = levels.get(status.level, Level.WARN)
            self._reported = Status(level, f'{node}: {status.message}')
            moment = moment_of(status)
            if moment is not None:
                self._add_frames(moment)

    def _add_frames(self, moment: Moment) -> None:
        """Add frames of the pending maps, whose simulated time is interpolated."""
        before, self._moment = self._moment or moment, moment
        self.method = method_of(moment)
        if moment.time < before.time:
            self.times.clear()
            self._maps.clear()
            self._particles = NO_PARTICLES
            before = moment
        elif moment.stamp_ns < before.stamp_ns:
            # the clock went back: a map from before may have a stamp that it reaches again
            self._waiting = {
                stamp: maps for stamp, maps in self._waiting.items() if stamp <= moment.stamp_ns
            }
            before = moment
        for stamp in sorted(item for item in self._waiting if item <= moment.stamp_ns):
            maps = self._waiting.pop(stamp) | self._forecasts
            since, span = stamp - before.stamp_ns, moment.stamp_ns - before.stamp_ns
            if since < 0:
                continue
            fraction = since / span if span else 1.0
            now = before.time + fraction * (moment.time - before.time)
            if self.times and self.times[-1] == now:
                self._maps[-1] |= maps
            else:
                self.times.append(now)
                self._maps.append(maps)
            self.version += 1
        if len(self.times) > MAX_FRAMES:
            del self.times[1:-1:2], self._maps[1:-1:2]
