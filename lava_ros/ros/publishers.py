# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Publication of layers and of the scene; the recorder gets the same bytes."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any, Generic, TypeVar

from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import MapMetaData, OccupancyGrid
from nav_msgs.srv import GetMap
from rclpy.clock import Clock, ClockType
from rclpy.publisher import Publisher
from rclpy.timer import Timer
from sensor_msgs.msg import Image, PointCloud2
from visualization_msgs.msg import MarkerArray

from lava_ros.bag.georeference import TOPIC
from lava_ros.errors import LavaError
from lava_ros.layers.forecast import EnsembleForecast, Forecast
from lava_ros.layers.layer import Layer, OCCUPANCY_GRID
from lava_ros.layers.layer_files import load_layers, switched
from lava_ros.live.worker import SimulationWorker
from lava_ros.ros import codec, outputs, qos
from lava_ros.ros.georeference import static_transform, TF_LISTENER, TF_STATIC
from lava_ros.ros.node_graph import NodeGraph
from lava_ros.ros.parameters import Settings
from lava_ros.scene import Scene
from lava_ros.simulation.output.snapshot import ParticleSample, Snapshot

#: A snapshot, forecast or ensemble that layers show.
Shown = TypeVar('Shown', Snapshot, Forecast, EnsembleForecast)


def published_layers(
    config: Path, forecast: Path | None = None, *, settings: Settings
) -> list[Layer]:
    """Return the enabled layers, including ensemble layers only if there are ensembles.

    ``config`` is the file of the layers of the current state, ``forecast`` that of the layers of
    forecasts, None without forecasts.

    Raises:
        LavaError: If a file or the name of a layer is not valid, the package of a message is
            missing, or there is a ``mask_margin`` but no mask.
    """
    known: list[Layer] = []
    for path, is_forecast, expected in (
        (config, False, 'a source of the current state; forecasts are in forecast_config'),
        (forecast, True, 'a source of a forecast'),
    ):
        for layer in load_layers(path) if path is not None else ():
            if layer.is_forecast is not is_forecast:
                raise LavaError(f'layers.{layer.name}.source', layer.source, expected)
            known.append(layer)
    layers = switched(known, on=settings.layers_on, off=settings.layers_off)
    has_ensembles = settings.ensemble_members > 0
    enabled = [
        layer for layer in layers if layer.enabled and (has_ensembles or not layer.is_ensemble)
    ]
    for layer in enabled:
        outputs.message_class(layer)
    margin = settings.mask_margin
    if margin is None:
        return enabled
    if not any(layer.is_keepout for layer in enabled):
        expected = '-1 unless msg_config has a keepout mask (a layer with step)'
        raise LavaError('mask_margin', margin, expected)
    return [replace(layer, margin=margin) if layer.is_keepout else layer for layer in enabled]


@dataclass(eq=False)
class _Output(Generic[Shown]):
    """A layer, its publisher and its last message.

    ``published`` is the newest state that the layer shows, with the stamp ``stamp_ns`` [ns], and
    ``message`` its message, None if nothing needs it. The last message that was sent has the
    stamp ``sent_ns`` [ns]. ``heartbeat`` is the timer of a layer with a heartbeat.
    """

    layer: Layer
    publisher: Publisher
    is_due: bool = True
    published: Shown | None = None
    stamp_ns: int = 0
    message: Any = None
    sent_ns: int = 0
    heartbeat: Timer | None = None


class LayerPublishers(Generic[Shown]):
    """The publishers of layers, and the ``get_map`` services of layers that are grids.

    A layer with a heartbeat sends its newest map again when it has sent nothing for that time. The
    map keeps its stamp.

    ``shown`` is the state published last, stamped ``shown_stamp_ns`` [ns]; ``rates`` are the
    rates of the layers [Hz].
    """

    def __init__(
        self,
        graph: NodeGraph,
        layers: Sequence[Layer],
        heartbeat_time: Callable[[], int | None] = lambda: None,
    ) -> None:
        """Create a publisher for each layer, and a steady timer for each heartbeat.

        ``heartbeat_time`` returns the ROS time [ns] at which a heartbeat is recorded, None while
        the maps must not be repeated.
        """
        self._graph, self._heartbeat_time = graph, heartbeat_time
        self._outputs: list[_Output[Shown]] = []
        # the heartbeat must not stop with a simulated clock
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        for layer in layers:
            kind, profile = outputs.message_class(layer), qos.ros_profile(layer.offered_qos)
            field = f'layers.{layer.name}.topic'
            publisher = graph.create('publisher', kind, layer.topic, profile, field=field)
            output: _Output[Shown] = _Output(layer, publisher)
            if layer.heartbeat:
                repeat = partial(self._repeat, output)
                output.heartbeat = graph.create('timer', layer.heartbeat, repeat, clock=steady)
            self._outputs.append(output)
            if layer.message == OCCUPANCY_GRID:
                get = partial(self._get_map, layer)
                graph.create('service', GetMap, f'~/{layer.topic}/get_map', get)
        self.rates = {layer.rate for layer in layers}
        self.shown: Shown | None = None
        self.shown_stamp_ns = 0

    def mark_due(self, rate: float) -> None:
        """Mark the layers of a rate [Hz] as due with the next new snapshot."""
        for output in self._outputs:
            output.is_due |= output.layer.rate == rate

    def publish(
        self,
        snapshot: Shown,
        stamp_ns: int,
        *,
        also_not_due: bool,
        repeat: bool,
        recorded_ns: int | None = None,
    ) -> None:
        """Publish ``snapshot`` on the layers that are due and have not published it.

        ``also_not_due`` includes layers that are not due, ``repeat`` those that have published it.
        ``stamp_ns`` is the stamp of a snapshot that is published for the first time [ns],
        ``recorded_ns`` the ROS time of the messages in the bag [ns], by default ``stamp_ns``.
        """
        # the clock went back: no map may be from the future until the next one comes
        repeat |= also_not_due and 0 < stamp_ns < self.shown_stamp_ns
        for output in self._outputs:
            is_new = snapshot is not output.published and (output.is_due or also_not_due)
            if is_new or repeat:
                # a repeated state keeps its stamp, which shows its age, unless the clock went back
                if snapshot is not self.shown or not 0 < self.shown_stamp_ns <= stamp_ns:
                    self.shown, self.shown_stamp_ns = snapshot, stamp_ns
                self._publish(output, snapshot, recorded_ns or stamp_ns, repeat)

    def _repeat(self, output: _Output[Shown]) -> None:
        """Send the newest map again; record it if it is not in the bag yet."""
        recorded_ns = self._heartbeat_time()
        if output.published is None or self.shown is None or recorded_ns is None:
            return
        if 0 < recorded_ns < self.shown_stamp_ns:
            self.publish(self.shown, recorded_ns, also_not_due=True, repeat=False)
            return
        message = output.message
        if message is None:
            message = self._message(output.layer, output.published, output.stamp_ns)
        is_recorded = output.layer.record and output.stamp_ns != output.sent_ns
        self._send(output, message, recorded_ns if is_recorded else None)

    def _publish(
        self, output: _Output[Shown], snapshot: Shown, recorded_ns: int, repeat: bool
    ) -> None:
        layer, before = output.layer, output.published
        output.is_due, output.published, output.stamp_ns = False, snapshot, self.shown_stamp_ns
        is_recorded = layer.record and self._graph.recorder.is_recording
        is_latched = layer.qos.durability == 'transient_local'
        # A latched topic may get subscribers later.
        if not (is_recorded or is_latched or output.publisher.get_subscription_count()):
            output.message = None
            return
        message = self._message(layer, snapshot, output.stamp_ns)
        known = output.message
        if layer.is_mask or layer.heartbeat:
            output.message = message
        if layer.is_mask and is_latched:
            # Nav2 recomputes its costmaps, and warns, for each mask that it receives.
            is_same_ground = before is not None and before.terrain is snapshot.terrain
            if is_same_ground and known.data == message.data and not repeat:
                return
        self._send(output, message, recorded_ns if is_recorded else None)
        if output.heartbeat is not None:
            output.heartbeat.reset()

    def _send(self, output: _Output[Shown], message: Any, recorded_ns: int | None) -> None:
        """Publish a message, and record it at a ROS time [ns] unless that is None."""
        # layer.qos is without the deadline, which a replay cannot meet
        self._graph.send(output.publisher, message, recorded_ns, output.layer.qos)
        output.sent_ns = output.stamp_ns

    def _get_map(self, layer: Layer, _: Any, response: Any) -> Any:
        # Without a map the response is empty: GetMap has no field for an error.
        if self.shown is not None:
            response.map = self._message(layer, self.shown, self.shown_stamp_ns)
        return response

    def _message(self, layer: Layer, shown: Shown, stamp_ns: int) -> Any:
        return outputs.layer_message(layer, shown, self._graph.header(stamp_ns))


#: Messages of a terrain by topic.
_GROUND = {TOPIC: TransformStamped, 'terrain': Image, 'terrain_info': MapMetaData}


class ScenePublisher:
    """Publishes relief and vents, latched, and the node's own terrain on its input topics.

    It also publishes the static transform to the map frame, if ``publish_tf`` is true.
    """

    def __init__(self, graph: NodeGraph, *, publish_tf: bool) -> None:
        """Create the publishers."""
        self._graph = graph
        self._transform = static_transform(is_wanted=publish_tf)
        self._messages = outputs.SceneMessages(self._transform)
        self._sent: dict[str, bytes] = {}
        self._publishers = self._create(_GROUND)
        self._drawn = self._create({'relief': OccupancyGrid, 'vents_markers': MarkerArray})
        if self._transform is not None:
            kind = self._transform.message_class
            self._drawn |= self._create({TF_STATIC: kind})
            profile = qos.ros_profile(TF_LISTENER)
            graph.create('subscription', kind, TF_STATIC, self._on_transforms, profile)

    def publish(self, scene: Scene, time: float, stamp_ns: int, *, is_heard: bool) -> None:
        """Publish the vents and the terrain if they have changed.

        Once a terrain is received from another node (``is_heard``), the terrain published here is
        withdrawn. ``time`` is simulated [s], ``stamp_ns`` the ROS time [ns].
        """
        messages = self._messages.update(scene, time, self._graph.header(stamp_ns))
        for topic in self._drawn.keys() & messages.keys():
            self._drawn[topic].publish(codec.serialise(messages[topic]))
        changed = self._publishers.keys() & messages.keys()
        if not is_heard:
            for topic in changed:
                data = codec.serialise(messages[topic])
                self._sent[topic] = sha256(data).digest()
                self._publishers[topic].publish(data)
        elif changed and self._sent:
            # late subscribers to new latched publishers get only the newer terrain
            for publisher in self._publishers.values():
                self._graph.drop(publisher)
            self._sent = {}
            self._publishers = self._create(_GROUND)

    def is_echo(self, topic: str, data: bytes) -> bool:
        """Return True if a message is one that this node has published itself."""
        return topic in self._sent and sha256(data).digest() == self._sent[topic]

    def warning(self) -> str:
        """Return a warning about the static transform, empty without one."""
        return self._transform.warning() if self._transform is not None else ''

    def _on_transforms(self, message: Any) -> None:
        assert self._transform is not None
        self._transform.receive(message.transforms, self._graph.frame_id)

    def _create(self, kinds: Mapping[str, Any]) -> dict[str, Any]:
        latched = qos.ros_profile(qos.LATCHED)
        return {
            topic: self._graph.create('publisher', kind, topic, latched)
            for topic, kind in kinds.items()
        }


class ParticlePublisher:
    """Publishes a sample of the particles with each map, while the topic has a subscriber.

    The topic has no publisher while the lava is on cells.
    """

    def __init__(self, graph: NodeGraph, worker: SimulationWorker) -> None:
        """Create the publisher."""
        self._worker, self._graph = worker, graph
        self._publisher: Any = None
        # the name belongs to this publisher, even while there is none
        self._offer(True)
        self._read = graph.create('guard_condition', self._publish)
        self._wanted: tuple[Snapshot, int] | None = None
        self._asked: tuple[Snapshot, int, Future[ParticleSample]] | None = None

    def _offer(self, is_offered: bool) -> None:
        """Create the publisher, or drop it."""
        if is_offered and self._publisher is None:
            self._publisher = self._graph.create(
                'publisher', PointCloud2, 'lava_particles', qos.ros_profile(qos.NEWEST)
            )
        elif self._publisher is not None and not is_offered:
            self._graph.drop(self._publisher)
            self._publisher = None

    def request(self, snapshot: Snapshot, stamp_ns: int) -> None:
        """Read the particles and publish them with the stamp [ns] of the maps of a snapshot.

        While the particles of earlier maps are being read, only the newest request waits, so the
        last maps before a pause always have their particles.
        """
        accuracy = self._worker.view.accuracy
        if accuracy is not None:
            self._offer(accuracy.method == 'particles')
        if self._publisher is not None and self._publisher.get_subscription_count():
            self._wanted = snapshot, stamp_ns
            self._ask()

    def _ask(self) -> None:
        if self._wanted is None or self._asked is not None:
            return
        sample = self._worker.commands.submit(self._worker.session.sample, 'particles')
        self._asked, self._wanted = (*self._wanted, sample), None
        sample.add_done_callback(lambda _: self._read.trigger())

    def _publish(self) -> None:
        if self._asked is None:
            return
        (snapshot, stamp_ns, sample), self._asked = self._asked, None
        # a simulation that failed, ended or was replaced after the request may have no particles
        is_read = not sample.cancelled() and sample.exception() is None
        if is_read and self._publisher is not None:
            header = self._graph.header(stamp_ns)
            message = outputs.particle_message(sample.result(), snapshot, header)
            self._publisher.publish(codec.serialise(message))
        self._ask()
