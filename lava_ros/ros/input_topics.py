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

"""The topics that inputs come in by: checked, turned into commands, never fatal."""

from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
import time
import traceback
from typing import Any
from weakref import WeakValueDictionary

from geometry_msgs.msg import PointStamped
from nav_msgs.msg import MapMetaData, OccupancyGrid
from rclpy.clock import Clock
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Image, PointCloud2

from lava_ros.errors import LavaError
from lava_ros.forecast.assimilation import Mask
from lava_ros.maps.layers import GRID_MAP, OCCUPANCY_GRID
from lava_ros.ros import codec, inputs, qos
from lava_ros.ros.codec import decode
from lava_ros.ros.diagnostics import InputLog
from lava_ros.ros.entities import Entities
from lava_ros.ros.parameters import Settings
from lava_ros.ros.recorder import Recorder
from lava_ros.ros.worker import SimulationWorker
from lava_ros.scene import Terrain

#: How often an image that waits for its description is looked at [s].
PAIRING_PERIOD = 0.1

#: Clocks of two machines may differ by this [s].
CLOCK_TOLERANCE = 1.0

_OUTLINE = 'observed_outline'


class InputTopics:
    """Subscribes to the inputs; what is refused is logged and counted, and changes nothing.

    Attributes:
        log: What has been taken and refused.
        wanted: What is said while there is no terrain.
    """

    def __init__(
        self,
        entities: Entities,
        worker: SimulationWorker,
        *,
        settings: Callable[[], Settings],
        steady: Clock,
        observe: Callable[[Mask, float], 'Future[None]'] | None = None,
        recorder: Recorder | None = None,
        is_own: Callable[[str, bytes], bool] = lambda topic, data: False,
    ) -> None:
        """Subscribe to the input topics.

        ``settings`` returns the settings in use; ``steady`` is a clock that advances independently
        of ``/clock``. ``observe`` takes a mask of where lava was observed and its ROS time [s];
        without it there is no subscription to outlines. ``recorder`` records the outlines.
        ``is_own`` says whether a serialised message on a topic comes from this node.
        """
        self.log = InputLog()
        self._node = entities.node
        self._logger = entities.node.get_logger()
        self._observe = observe
        self._recorder = recorder
        self._is_own = is_own
        self._heard: WeakValueDictionary[int, Terrain] = WeakValueDictionary()
        self._worker = worker
        self._settings = settings
        self._pairing = inputs.TerrainPairing()
        self._clicks = 0
        terrain_qos = qos.terrain_profile(
            transient_local=settings().terrain_subscribe_transient_local
        )
        command_qos = qos.ros_profile(qos.COMMANDS)
        topics: list[tuple[Any, str, Callable[[Any], None], QoSProfile]] = [
            (Image, 'terrain', self._on_terrain, terrain_qos),
            (MapMetaData, 'terrain_info', self._on_terrain_info, terrain_qos),
            (PointCloud2, 'terrain_cloud', self._on_terrain_cloud, terrain_qos),
            (PointCloud2, 'vents', self._on_vents, command_qos),
            (PointStamped, 'clicked_point', self._on_clicked_point, command_qos),
        ]
        if observe is not None:
            topics.append((OccupancyGrid, _OUTLINE, self._on_outline, command_qos))
        # without grid_map_msgs there is no such topic
        with suppress(LavaError):
            kind = codec.message_class(GRID_MAP)
            topics.append((kind, 'terrain_grid', self._on_terrain_grid, terrain_qos))
        by = ', '.join(topic for _, topic, _, profile in topics if profile is terrain_qos)
        self.wanted = f'waiting for terrain on {by}'
        for message_class, topic, callback, profile in topics:
            take = self._guarded(topic, message_class, callback)
            entities.create('subscription', message_class, topic, take, profile, raw=True)
        entities.create('timer', PAIRING_PERIOD, self._poll_pairing, clock=steady)

    def command(self, topic: str, future: 'Future[None]') -> None:
        """Report how a command for the worker ends; that is in the worker's thread."""
        number = self.log.arrive()

        def report(done: 'Future[None]') -> None:
            error = None if done.cancelled() else done.exception()
            if isinstance(error, LavaError):
                self.reject(topic, error, number)
            elif done.cancelled():
                self.log.supersede(topic, number)
            elif error is None:
                self.log.accept(topic, number)

        future.add_done_callback(report)

    def has_heard(self, terrain: Terrain) -> bool:
        """Whether a terrain came by ``terrain`` and ``terrain_info``."""
        return id(terrain) in self._heard

    def reject(self, topic: str, error: LavaError, number: int | None = None) -> None:
        """Report an input that is refused; the newest of its topic, or that of a number."""
        if self.log.reject(topic, error, number):
            self._logger.error(f'{topic} refused: {error}')

    def report_callback(self, error: Exception) -> None:
        """Report what a callback of the middleware itself raised."""
        reason = f'{type(error).__name__}: {error}'
        self.reject('message', LavaError('message', reason, 'one that ROS can take'))
        self.log.forgive('message')

    def _guarded(
        self, topic: str, message_class: Any, callback: Callable[[Any], None]
    ) -> Callable[[bytes], None]:
        def take(data: bytes) -> None:
            if self._is_own(topic, data):
                return
            try:
                most = self._settings().max_input_bytes
                callback(decode(data, message_class, topic, max_bytes=most))
            except LavaError as error:
                self.reject(topic, error)
            except Exception as error:
                self._logger.error(traceback.format_exc())
                reason = f'{type(error).__name__}: {error}'
                self.reject(topic, LavaError(topic, reason, 'a message that can be read'))

        return take

    def _on_terrain(self, image: Image) -> None:
        inputs.check_image(image, self._settings())
        self._pairing.add(image, time.monotonic())
        self._poll_pairing()

    def _on_terrain_info(self, info: MapMetaData) -> None:
        inputs.check_info(info, self._settings())
        self.log.accept('terrain_info')
        self._pairing.add(info, time.monotonic())
        self._poll_pairing()

    def _poll_pairing(self) -> None:
        if not self._pairing.is_waiting:
            return
        try:
            pair = self._pairing.poll(time.monotonic())
            if pair is not None:
                terrain = inputs.terrain_from_image(*pair, self._settings())
                self._heard[id(terrain)] = terrain
                self.command('terrain', self._worker.set_terrain(terrain))
        except LavaError as error:
            self.reject('terrain', error)

    def _on_terrain_cloud(self, cloud: PointCloud2) -> None:
        terrain = inputs.terrain_from_cloud(cloud, self._settings())
        self.command('terrain_cloud', self._worker.set_terrain(terrain))

    def _on_terrain_grid(self, message: Any) -> None:
        terrain = inputs.terrain_from_grid(message, self._settings())
        self.command('terrain_grid', self._worker.set_terrain(terrain))

    def _on_vents(self, cloud: PointCloud2) -> None:
        vents = inputs.vents_from_cloud(cloud, self._settings())
        self.command('vents', self._worker.set_vents(vents))

    def _on_clicked_point(self, point: PointStamped) -> None:
        settings, scene = self._settings(), self._worker.eruption.scene
        if scene is not None and len(scene.vents) >= settings.max_vents:
            right = f'at most {settings.max_vents} (max_vents)'
            raise LavaError('clicked_point', 'one more vent', right)
        self._clicks += 1
        vent = inputs.vent_from_point(point, settings, name=f'click {self._clicks}')
        self.command('clicked_point', self._worker.add_vent(vent))

    def _on_outline(self, grid: OccupancyGrid) -> None:
        mask = inputs.mask_from_grid(grid, self._settings(), name=_OUTLINE)
        stamp_ns = codec.nanoseconds(grid.header.stamp)
        now_ns = int(self._node.get_clock().now().nanoseconds)
        if not 0 < stamp_ns <= now_ns + CLOCK_TOLERANCE * 1e9:
            right = f'the time at which it was seen, not after now, {1e-9 * now_ns:.3f} s'
            raise LavaError(f'{_OUTLINE}.header.stamp', f'{1e-9 * stamp_ns:.3f} s', right)
        assert self._observe is not None
        self.command(_OUTLINE, self._observe(mask, 1e-9 * stamp_ns))
        if self._recorder is not None and self._recorder.is_recording:
            topic, data = self._node.resolve_topic_name(_OUTLINE), codec.serialise(grid)
            self._recorder.write(topic, OCCUPANCY_GRID, data, now_ns, qos=qos.COMMANDS)
