# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Subscriptions to the input topics."""

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import chain
import math
import time
import traceback
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PointStamped, TransformStamped
from nav_msgs.msg import MapMetaData, OccupancyGrid
from rclpy.clock import Clock
from sensor_msgs.msg import Image, PointCloud2

from lava_ros.bag import QosProfile
from lava_ros.bag.georeference import TOPIC
from lava_ros.errors import LavaError, RefusalError
from lava_ros.forecast.assimilation import Mask
from lava_ros.layers.layer import GRID_MAP, OCCUPANCY_GRID
from lava_ros.live.worker import SimulationWorker, STOPPED
from lava_ros.ros import codec, inputs, qos
from lava_ros.ros.codec import decode
from lava_ros.ros.executor import now_ns
from lava_ros.ros.georeference import TerrainGeoreferences
from lava_ros.ros.input_log import InputLog
from lava_ros.ros.node_graph import NodeGraph
from lava_ros.ros.parameters import Settings
from lava_ros.scene import Terrain

#: Interval between checks for a complete pair of ``terrain`` and ``terrain_info`` [s].
PAIRING_PERIOD = 0.1

#: Maximum difference between the clocks of two machines [s].
CLOCK_TOLERANCE = 1.0

#: Minimum wall time between two searches of the graph for other publishers [s].
RIVALS_PERIOD = 1.0

#: Wall time without vents after which the log warns [s]: discovery of a publisher takes a second.
VENT_PATIENCE = 3.0

#: Number of publications that the subscriptions of a topic remember.
MAX_PUBLICATIONS = 64

_OUTLINE = 'observed_outline'


class RepeatFilter:
    """Recognises a publication that two subscriptions to a topic deliver.

    A publication has a source timestamp and a sequence number, which are the same at each
    subscription. rclpy does not give its publisher. Each subscription delivers the publications of
    a publisher in order, but one may begin earlier, skip some, or be late.
    """

    def __init__(self, taken: Iterable[tuple[int, int]] = ()) -> None:
        """Initialize with the publications that a killed process has taken.

        Each is its source timestamp and sequence number.
        """
        self._taken = deque(taken, maxlen=MAX_PUBLICATIONS)
        self._durability = ''

    @property
    def taken(self) -> tuple[tuple[int, int], ...]:
        """The newest publications taken, in order."""
        return tuple(self._taken)

    def is_repeat(self, durability: str, info: Mapping[str, Any]) -> bool:
        """Return True if a message, received with ``info``, was taken before.

        ``durability`` identifies the subscription. A known publication counts as
        new if the same subscription has since delivered an older one, which replaced it: the
        other subscription began after the older one.
        """
        publication = info['source_timestamp'], info['publication_sequence_number']
        is_other = durability != self._durability
        if publication in self._taken and (is_other or publication == self._taken[-1]):
            return True
        self._taken.append(publication)
        self._durability = durability
        return False


@dataclass(eq=False)
class InputSubscribers:
    """Subscribes to the inputs; a refused message is logged and counted, and changes nothing.

    ``settings`` returns the current settings; ``steady`` is a clock that advances independently of
    ``/clock``. ``observe`` receives a mask of observed lava and its ROS time [s]; without it there
    is no subscription to outlines. ``is_echo`` returns True for a serialised message on a topic
    that comes from this node. ``vents_taken`` are the publications on ``vents`` that a resumed
    simulation includes: a latched one that comes again must not replace a vent opened since.
    ``log`` counts accepted and refused messages; ``wanted`` is the log text while there is no
    terrain.
    """

    graph: NodeGraph
    worker: SimulationWorker
    settings: Callable[[], Settings]
    steady: Clock
    observe: Callable[[Mask, float], 'Future[str]'] | None = None
    is_echo: Callable[[str, bytes], bool] = lambda topic, data: False
    vents_taken: tuple[tuple[int, int], ...] = ()

    def __post_init__(self) -> None:
        """Subscribe to the input topics."""
        self.log = InputLog()
        self._logger = self.graph.node.get_logger()
        self._georeferences = TerrainGeoreferences()
        self._set_terrain: Future[None] | None = None
        self._set_vents: Future[None] | None = None
        # wall time at which the newest terrain is used, even without its georeference [s]
        self._ground_due = math.inf
        self._pairing = inputs.TerrainPairing()
        self._clicks, self._begun_ns = 0, now_ns(self.graph.node)
        self._has_vents = self._is_told = False
        self._vents_due = math.inf
        terrains: dict[str, tuple[Any, Callable[[Any], None]]] = {
            'terrain': (Image, self._on_terrain),
            'terrain_info': (MapMetaData, self._on_terrain_info),
            'terrain_cloud': (
                PointCloud2, partial(self._on_ground, 'terrain_cloud', inputs.terrain_from_cloud)
            ),
        }
        # without grid_map_msgs there is no such topic
        with suppress(LavaError):
            take = partial(self._on_ground, 'terrain_grid', inputs.terrain_from_grid)
            terrains['terrain_grid'] = codec.message_class(GRID_MAP), take
        self.wanted = f'waiting for terrain on {", ".join(terrains)}'
        self._replaced = list(terrains), [TOPIC], ['vents']
        self._rivals, self._rivals_time = '', -math.inf
        self._ignored = ''
        self._subscribe(TOPIC, TransformStamped, self._on_georeference, qos.state_inputs(1))
        for topic, (kind, callback) in terrains.items():
            self._subscribe(topic, kind, callback, qos.state_inputs(1))
        commands = qos.state_inputs(qos.COMMANDS.depth)
        self._vent_repeats = RepeatFilter(self.vents_taken)
        self._subscribe('vents', PointCloud2, self._on_vents, commands, self._vent_repeats)
        if self.observe is not None:
            self._subscribe(_OUTLINE, OccupancyGrid, self._on_outline, commands)
        if self.settings().clicked_point_enabled:
            # a click is an event: one from before the start of the node must not open a vent
            click = self._on_clicked_point
            self._subscribe('clicked_point', PointStamped, click, (qos.COMMANDS,))
        self.graph.create('timer', PAIRING_PERIOD, self._poll_pairing, clock=self.steady)

    def _subscribe(
        self,
        topic: str,
        kind: Any,
        callback: Callable[[Any], None],
        profiles: Sequence[QosProfile],
        repeats: RepeatFilter | None = None,
    ) -> None:
        """Subscribe with each profile, and process each publication once."""
        repeats = repeats or RepeatFilter()
        for profile in profiles:
            is_repeat = partial(repeats.is_repeat, profile.durability)
            guarded = partial(self._take, topic, kind, callback, is_repeat)
            self.graph.create(
                'subscription', kind, topic, guarded, qos.ros_profile(profile), raw=True
            )

    @property
    def vents(self) -> tuple[tuple[int, int], ...]:
        """The newest publications on ``vents``, as in ``vents_taken``."""
        return self._vent_repeats.taken

    def status(self, warning: str = '') -> DiagnosticStatus:
        """Return the status of the inputs, with warnings about conflicting publishers.

        It also warns until the first vents, of a georeference that is not used, and with a
        ``warning``.
        """
        now = time.monotonic()
        if now - self._rivals_time >= RIVALS_PERIOD:
            known, scene = self._rivals, self.worker.view.scene
            found = [*map(self._find_rivals, self._replaced), self._find_imitators(), warning]
            if scene is not None:
                found.append(self._georeferences.warning(scene.terrain))
            self._rivals = '; '.join(filter(None, found))
            self._rivals_time = now
            if self._rivals not in ('', known):
                self._logger.warning(self._rivals)
        return self.log.status('; '.join(filter(None, (self._find_missing(), self._rivals))))

    def _find_missing(self) -> str:
        """Return a warning if there has been no vent and no message on ``vents`` so far."""
        scene, latest = self.worker.view.scene, self.worker.latest
        # without a scene the status of the simulation is 'waiting for terrain'
        if self._has_vents or scene is None:
            return ''
        has_lava = latest is not None and latest.budget.emitted > 0.0
        self._has_vents = bool(scene.vents) or has_lava or self.log.has_accepted('vents')
        # the first vents start the simulation again, which may compile kernels for a minute
        is_pending = self._set_vents is not None and not self._set_vents.done()
        if self._has_vents or is_pending:
            return ''
        now = time.monotonic()
        self._vents_due = min(self._vents_due, now + VENT_PATIENCE)
        if now >= self._vents_due and not self._is_told:
            self._is_told = True
            self._logger.warning('no vent yet: waiting for a message on vents')
        return 'no vent yet'

    def _find_rivals(self, topics: Sequence[str]) -> str:
        """Return a warning if ``topics`` whose messages replace each other have two sources."""
        sources = [self.graph.other_publishers(topic) for topic in topics]
        names = sorted({name for item in sources for name in item})
        if max(len(names), *map(len, sources)) < 2:
            return ''
        return (
            f'several publishers of {" and ".join(topics)} ({", ".join(names)}): each '
            'message replaces those of the others; one node has to publish all of them'
        )

    def _find_imitators(self) -> str:
        """Return a warning if other nodes publish the maps of this node, too."""
        received = {self.graph.node.resolve_topic_name(topic) for topic in chain(*self._replaced)}
        found = {
            topic: names
            for topic in self.graph.published.keys() - received
            if (names := self.graph.other_publishers(topic))
        }
        if not found:
            return ''
        own = self.graph.node.get_fully_qualified_name()
        killed = {own: f'{own} (a second node, or one that was killed up to 20 s ago)'}
        names = sorted({killed.get(name, name) for item in found.values() for name in item})
        return (
            f'{", ".join(names)} also publishes {", ".join(sorted(found))}: subscribers receive a '
            'mixture of its maps and those of this node; give it another namespace'
        )

    def command(self, topic: str, future: 'Future[Any]') -> None:
        """Report the result of a worker command, in the worker's thread."""
        number = self.log.arrive()

        def report(done: 'Future[Any]') -> None:
            error = None if done.cancelled() else done.exception()
            # an input that waits when the node ends is not wrong
            if isinstance(error, LavaError) and error is not STOPPED:
                self._reject(topic, error, number)
            elif done.cancelled():
                self.log.supersede(topic, number)
            elif error is None:
                self.log.accept(topic, number)
                if isinstance(done.result(), str):
                    self._logger.info(f'{topic}: {done.result()}')

        future.add_done_callback(report)

    def refuse(self, topic: str, error: LavaError) -> None:
        """Report a refused input as a warning, because no later input would clear an error."""
        self._reject(topic, error)
        self.log.downgrade(topic)

    def came_from_topic(self, terrain: Terrain) -> bool:
        """Return True if a terrain was received on ``terrain`` and ``terrain_info``."""
        return self._georeferences.topic_of(terrain) == 'terrain'

    def report_callback(self, error: Exception) -> None:
        """Report an error that the middleware itself raised in a callback."""
        reason = f'{type(error).__name__}: {error}'
        problem = f'A message could not be received: {reason}'
        self.refuse('message', RefusalError('message', problem, 'Check its publisher'))

    def _reject(self, topic: str, error: LavaError, number: int | None = None) -> None:
        if self.log.reject(topic, error, number):
            self._logger.error(f'{topic} refused: {error}')

    def _take(
        self,
        topic: str,
        kind: Any,
        callback: Callable[[Any], None],
        is_repeat: Callable[[Mapping[str, Any]], bool],
        data: bytes,
        info: Mapping[str, Any],
    ) -> None:
        """Deserialise a message and pass it to ``callback``; report all errors."""
        if is_repeat(info) or self.is_echo(topic, data):
            return
        try:
            callback(decode(data, kind, topic, max_bytes=self.settings().max_input_bytes))
        except LavaError as error:
            self._reject(topic, error)
        except Exception as error:
            self._logger.error(traceback.format_exc())
            reason = f'{type(error).__name__}: {error}'
            problem = f'The message could not be processed: {reason}'
            self._reject(topic, RefusalError(topic, problem, 'Check its publisher'))

    def _on_terrain(self, image: Image) -> None:
        self._add_half(inputs.check_image, image)

    def _on_terrain_info(self, info: MapMetaData) -> None:
        self._add_half(inputs.check_info, info)

    def _add_half(self, check: Callable[[Any, Settings], Any], half: Image | MapMetaData) -> None:
        try:
            check(half, self.settings())
        except LavaError:
            self._pairing.refuse(half, time.monotonic())
            raise
        if isinstance(half, MapMetaData):
            self.log.accept('terrain_info')
        self._pairing.add(half, time.monotonic())
        self._poll_pairing()

    def _poll_pairing(self) -> None:
        try:
            pair = self._pairing.poll(time.monotonic())
            if pair is not None:
                terrain = inputs.terrain_from_image(*pair, self.settings())
                self._put('terrain', terrain, pair[0].header.stamp, pair[1].map_load_time)
        except LavaError as error:
            self._reject('terrain', error)
        if time.monotonic() >= self._ground_due:
            self._put_ground(self._georeferences.topic)

    def _on_ground(self, topic: str, read: Callable[..., Terrain], message: Any) -> None:
        self._put(topic, read(message, self.settings()), message.header.stamp)

    def _put(self, topic: str, terrain: Terrain, *stamps: Time) -> None:
        """Take a terrain of a topic; its georeference may follow within ``inputs.SETTLE``."""
        has_georeference = self._georeferences.add_terrain(terrain, topic, *stamps)
        if has_georeference or not self.graph.other_publishers(TOPIC):
            self._put_ground(topic)
        else:
            self._ground_due = min(self._ground_due, time.monotonic() + inputs.SETTLE)

    def _put_ground(self, topic: str) -> None:
        """Replace the terrain by the newest one, for a message on a topic."""
        assert self._georeferences.ground is not None
        self._ground_due = math.inf
        self._set_terrain = self.worker.set_terrain(self._georeferences.ground)
        self.command(topic, self._set_terrain)

    def _on_georeference(self, message: TransformStamped) -> None:
        is_of_ground = self._georeferences.add_georeference(message, self.settings().frame_id)
        is_late, scene = self._ground_due == math.inf, self.worker.view.scene
        is_waiting = self._set_terrain is not None and not self._set_terrain.done()
        # a file or an event of the scene may have replaced the terrain of the topic
        is_used = scene is not None and self._georeferences.topic_of(scene.terrain) is not None
        if is_of_ground and is_late and (is_waiting or is_used):
            self._put_ground(TOPIC)
            return
        self.log.accept(TOPIC)
        if is_of_ground and not is_late:
            self._put_ground(self._georeferences.topic)

    def _on_vents(self, cloud: PointCloud2) -> None:
        vents = inputs.vents_from_cloud(cloud, self.settings())
        if (ignored := inputs.ignored_fields(cloud)) not in ('', self._ignored):
            self._ignored = ignored
            self._logger.warning(f'vents: {ignored}')
        self._set_vents = self.worker.set_vents(vents)
        self.command('vents', self._set_vents)

    def _on_clicked_point(self, point: PointStamped) -> None:
        settings, scene = self.settings(), self.worker.view.scene
        if scene is not None and len(scene.vents) >= settings.max_vents:
            problem = f'The scene already has {len(scene.vents)} vents'
            remedy = f'Remove one, or raise max_vents ({settings.max_vents})'
            raise RefusalError('clicked_point', problem, remedy)
        self._clicks += 1
        vent = inputs.vent_from_point(point, settings, name=f'click {self._clicks}')
        self.command('clicked_point', self.worker.add_vent(vent))

    def _on_outline(self, grid: OccupancyGrid) -> None:
        mask = inputs.mask_from_grid(grid, self.settings(), name=_OUTLINE)
        stamp_ns = codec.nanoseconds(grid.header.stamp)
        moment_ns = now_ns(self.graph.node)
        if not 0 < stamp_ns <= moment_ns + CLOCK_TOLERANCE * 1e9:
            expected = f'the time of the observation, at most now, {1e-9 * moment_ns:.3f} s'
            raise LavaError(f'{_OUTLINE}.header.stamp', f'{1e-9 * stamp_ns:.3f} s', expected)
        if stamp_ns < self._begun_ns <= moment_ns:
            # a latched outline from before all forecasts of this node
            expected = f'a time after the start of the node, {1e-9 * self._begun_ns:.3f} s'
            error = LavaError(f'{_OUTLINE}.header.stamp', f'{1e-9 * stamp_ns:.3f} s', expected)
            self.refuse(_OUTLINE, error)
            return
        assert self.observe is not None
        self.command(_OUTLINE, self.observe(mask, 1e-9 * stamp_ns))
        recorder = self.graph.recorder
        if recorder.is_recording:
            topic, data = self.graph.node.resolve_topic_name(_OUTLINE), codec.serialise(grid)
            recorder.write(topic, OCCUPANCY_GRID, data, moment_ns, qos=qos.COMMANDS)
