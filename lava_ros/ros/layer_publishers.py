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

"""Publishes the layers of snapshots, and records the same bytes."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from nav_msgs.msg import OccupancyGrid
from rclpy.publisher import Publisher

from lava_ros.errors import LavaError
from lava_ros.maps.forecast import EnsembleForecast, Forecast
from lava_ros.maps.layer_files import load_layers, switched
from lava_ros.maps.layers import Layer, OCCUPANCY_GRID
from lava_ros.ros import codec, outputs, qos
from lava_ros.ros.entities import Entities
from lava_ros.ros.parameters import Settings
from lava_ros.ros.recorder import Recorder
from lava_ros.simulation.snapshot import Snapshot

#: What layers show.
Shown = TypeVar('Shown', Snapshot, Forecast, EnsembleForecast)


def published_layers(
    config: Path, forecast: Path | None = None, *, settings: Settings
) -> list[Layer]:
    """The enabled layers; layers of ensembles only if there are ensembles.

    ``forecast`` is the file of the layers of forecasts, None without forecasts.

    Raises:
        LavaError: A file or the name of a layer is wrong, two layers share a topic, or the package
            of a message is missing.
    """
    known = _layers_of(config, is_forecast=False)
    if forecast is not None:
        known += _layers_of(forecast, is_forecast=True)
    topics = [layer.topic for layer in known]
    for layer in known:
        if topics.count(layer.topic) > 1:
            right = 'a topic that msg_config and forecast_config do not share'
            raise LavaError(f'layers.{layer.name}.topic', layer.topic, right)
    layers = switched(known, on=settings.layers_on, off=settings.layers_off)
    has_ensembles = settings.ensemble_members > 0
    enabled = [
        layer for layer in layers if layer.enabled and (has_ensembles or not layer.is_ensemble)
    ]
    for layer in enabled:
        outputs.message_class(layer)
    return enabled


def _layers_of(config: Path, *, is_forecast: bool) -> tuple[Layer, ...]:
    layers = load_layers(config)
    for layer in layers:
        if layer.is_forecast is not is_forecast:
            right = 'one of a forecast' if is_forecast else 'one of now; those of a forecast have'
            right += '' if is_forecast else ' a file of their own, forecast_config'
            raise LavaError(f'layers.{layer.name}.source', layer.source, right)
    return layers


@dataclass(eq=False)
class _Output(Generic[Shown]):
    """A layer, its publisher and what was sent last."""

    layer: Layer
    publisher: Publisher
    is_due: bool = True
    published: Shown | None = None
    cells: object = None


class LayerPublishers(Generic[Shown]):
    """The publishers of layers.

    Attributes:
        shown: What was published last, None before the first.
        shown_stamp_ns: Its stamp [ns].
        rates: The rates the layers ask for [Hz], each once.
    """

    def __init__(
        self, entities: Entities, layers: Sequence[Layer], recorder: Recorder, *, frame_id: str
    ) -> None:
        """Create a publisher for every layer."""
        self._recorder = recorder
        self._frame_id = frame_id
        self._outputs: list[_Output[Shown]] = []
        for layer in layers:
            kind, profile = outputs.message_class(layer), qos.ros_profile(layer.qos)
            publisher = entities.create('publisher', kind, layer.topic, profile)
            self._outputs.append(_Output(layer, publisher))
        self.rates: list[float] = sorted({output.layer.rate for output in self._outputs})
        self.shown: Shown | None = None
        self.shown_stamp_ns = 0

    @property
    def grid_topics(self) -> list[str]:
        """Topics of the layers that are occupancy grids."""
        layers = [output.layer for output in self._outputs]
        return [layer.topic for layer in layers if layer.message == OCCUPANCY_GRID]

    def newest(self, topic: str) -> OccupancyGrid | None:
        """The grid of a topic for the snapshot that was shown last, None before the first."""
        if self.shown is None:
            return None
        return self._message(*(o.layer for o in self._outputs if o.layer.topic == topic))

    def make_due(self, rate: float) -> None:
        """Let the layers of a rate be published with the next new snapshot."""
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
        """Publish ``snapshot`` on the layers that are due and have not published it yet.

        ``also_not_due`` includes layers that are not due, ``repeat`` those that have published it.
        ``stamp_ns`` is the ROS time of the messages [ns], ``recorded_ns`` that in the bag [ns], by
        default the same.
        """
        for output in self._outputs:
            is_new = snapshot is not output.published and (output.is_due or also_not_due)
            if is_new or repeat:
                self.shown, self.shown_stamp_ns = snapshot, stamp_ns
                self._publish(output, snapshot, recorded_ns or stamp_ns, repeat)

    def _publish(
        self, output: _Output[Shown], snapshot: Shown, recorded_ns: int, repeat: bool
    ) -> None:
        layer, before = output.layer, output.published
        output.is_due, output.published = False, snapshot
        is_recorded = layer.record and self._recorder.is_recording
        is_latched = layer.qos.durability == 'transient_local'
        # A latched topic has readers that are not here yet.
        if not (is_recorded or is_latched or output.publisher.get_subscription_count()):
            return
        message = self._message(layer)
        if layer.is_mask and is_latched:
            # Nav2 works its costmaps out anew, and warns, for each mask it gets.
            known, output.cells = output.cells, message.data
            is_same_ground = before is not None and before.terrain is snapshot.terrain
            if is_same_ground and known == output.cells and not repeat:
                return
        data = codec.serialise(message)
        output.publisher.publish(data)
        if is_recorded:
            topic = output.publisher.topic_name
            self._recorder.write(topic, layer.message, data, recorded_ns, qos=layer.qos)

    def _message(self, layer: Layer) -> Any:
        """The message of a layer for what is shown."""
        assert self.shown is not None
        return outputs.layer_message(
            layer, self.shown, frame_id=self._frame_id, stamp_ns=self.shown_stamp_ns
        )
