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

"""A recorded bag -> the maps it holds at one moment, in physical units. Needs no ROS."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from lava_ros.bag import BagReader
from lava_ros.bag.reader import BagMessage
from lava_ros.errors import LavaError
from lava_ros.layers import IMAGE, Layer, layers_from_dict, load_layers
from lava_ros.share import share_path

DIAGNOSTICS = '/diagnostics'


@dataclass(frozen=True, eq=False)
class LayerFrame:
    """One layer at one moment.

    Attributes:
        layer: What the layer is.
        values: Thickness [m], temperature [Celsius] or hazard 0..100, float32, shape
            [rows, columns]; NaN where there is no lava and outside the terrain.
        is_saturated: Whether a cell has the largest value the grid can hold.
    """

    layer: Layer
    values: np.ndarray
    is_saturated: bool


@dataclass(frozen=True, eq=False)
class Frame:
    """The maps of a bag at one moment.

    Attributes:
        elevation: Ground elevation [m], float32, shape [rows, columns], NaN without data; row 0
            has the smallest y.
        resolution: Side of a cell [m].
        origin: Map position (x, y) [m] of the lower-left corner of cell [0, 0].
        layers: The newest of each source, by source: thickness, temperature, hazard.
        vents: Map positions [m] of the vents with a discharge, shape [vents, 2].
        time: Simulated time [s], None when the bag does not say.
        scene: What the bag says about its scene, as ``scene_to_dict`` gives it.
    """

    elevation: np.ndarray
    resolution: float
    origin: tuple[float, float]
    layers: Mapping[str, LayerFrame]
    vents: np.ndarray
    time: float | None
    scene: Mapping[str, Any]


def read_frame(path: str | Path, time: float | None = None) -> Frame:
    """Read the maps of a bag.

    Args:
        path: The bag's directory, or an .mcap file.
        time: Simulated time [s]: the newest maps up to then are read; None for the last ones.

    Raises:
        LavaError: The bag cannot be read or lacks what is asked for.
    """
    bag = BagReader(path)
    decoder = _Decoder(bag)
    clock = _Clock(bag, decoder)
    names = {layer: _topic(bag, layer.topic, layer.message) for layer in _layers(bag)}
    if not any(names.values()):
        raise LavaError('bag', str(path), 'a bag with the layers of a simulation')
    stamp = clock.stamp_at(time)
    if stamp is None:
        if time is not None:
            raise LavaError('time', time, clock.span)
        stamp = bag.end_ns or 0
    ground = [
        _required(bag, 'terrain', IMAGE),
        _required(bag, 'terrain_info', 'nav_msgs/msg/MapMetaData'),
    ]
    vents = _topic(bag, 'vents', 'sensor_msgs/msg/PointCloud2')
    wanted = {*ground, *(name for name in names.values() if name)} | ({vents} if vents else set())
    newest = {item.topic: item for item in bag.newest(wanted, stamp + 1)}
    if any(name not in newest for name in ground):
        raise LavaError('time', time, 'a time from the first terrain of the bag on')
    elevation = _image(decoder.decode(newest[ground[0]]))
    info = decoder.decode(newest[ground[1]])
    layers: dict[str, LayerFrame] = {}
    for layer, name in names.items():
        # A grid and an image of the same source show the same thing; the first one will do.
        if name in newest and layer.source not in layers:
            layers[layer.source] = _layer_frame(layer, decoder.decode(newest[name]))
    stamps = [newest[name].stamp_ns for name in names.values() if name in newest]
    if not stamps:
        raise LavaError('time', time, 'a time from the first map of the bag on')
    return Frame(
        elevation=elevation,
        resolution=float(np.float64(str(np.float32(info.resolution)))),
        origin=(info.origin.position.x, info.origin.position.y),
        layers=layers,
        vents=_vents(decoder.decode(newest[vents])) if vents in newest else np.empty((0, 2)),
        time=clock.time_at(max(stamps)),
        scene=yaml.safe_load(bag.custom_data.get('scene', '')) or {},
    )


class _Decoder:
    """Decodes messages by the definitions the bag itself holds."""

    def __init__(self, bag: BagReader) -> None:
        try:
            from mcap.records import Schema
            from mcap_ros2.decoder import DecoderFactory
        except ImportError as error:
            raise LavaError(
                'bag',
                str(bag.path),
                "mcap-ros2-support to decode it: pip install 'lava_ros[plot]'",
            ) from error
        self._factory = DecoderFactory()
        self._schemas = {
            name: Schema(
                id=index,
                name=topic.message_type,
                encoding='ros2msg',
                data=topic.schema.text.encode(),
            )
            for index, (name, topic) in enumerate(bag.topics.items(), start=1)
        }

    def decode(self, message: BagMessage) -> Any:
        """Decode a message."""
        decode = self._factory.decoder_for('cdr', self._schemas[message.topic])
        assert decode is not None
        return decode(message.data)


def _layers(bag: BagReader) -> tuple[Layer, ...]:
    """The layers as they were when the bag was recorded; the default ones for a foreign bag."""
    text = bag.custom_data.get('msg_config', '')
    if text:
        return layers_from_dict(yaml.safe_load(text))
    return load_layers(share_path('msg_configs/default.yaml'))


def _topic(bag: BagReader, name: str, message_type: str) -> str | None:
    """Full name of a topic by its relative name, whatever the namespace."""
    for topic in bag.topics.values():
        if topic.name.endswith(f'/{name}') and topic.message_type == message_type:
            return topic.name
    return None


def _required(bag: BagReader, name: str, message_type: str) -> str:
    topic = _topic(bag, name, message_type)
    if topic is None:
        raise LavaError('bag', str(bag.path), f'a bag with the topic {name} ({message_type})')
    return topic


class _Clock:
    """When which simulated time was shown, as the diagnostics of the bag say."""

    def __init__(self, bag: BagReader, decoder: _Decoder) -> None:
        known: dict[int, float] = {}
        for message in bag.messages([DIAGNOSTICS] if DIAGNOSTICS in bag.topics else []):
            for status in decoder.decode(message).status:
                values = {item.key: item.value for item in status.values}
                if 'simulated_time_s' in values and 'frame_stamp_ns' in values:
                    known[int(values['frame_stamp_ns'])] = float(values['simulated_time_s'])
        self._stamps = sorted(known)
        self._times = [known[stamp] for stamp in self._stamps]

    def stamp_at(self, time: float | None) -> int | None:
        """Stamp of the newest frame up to a simulated time [s], None for the newest of all."""
        for stamp, shown in zip(self._stamps[::-1], self._times[::-1], strict=True):
            if time is None or shown <= time:
                return stamp
        return None

    def time_at(self, stamp_ns: int) -> float | None:
        """Simulated time [s] at a stamp, None where nothing is known."""
        if not self._stamps or not self._stamps[0] <= stamp_ns <= self._stamps[-1]:
            return None
        # Nanoseconds since 1970 have more digits than a float64.
        since_first = [stamp - self._stamps[0] for stamp in self._stamps]
        return float(np.interp(stamp_ns - self._stamps[0], since_first, self._times))

    @property
    def span(self) -> str:
        """The simulated times there are, for errors."""
        if not self._times:
            return 'absent: the bag does not say its simulated time'
        return f'{min(self._times):g} to {max(self._times):g} s'


def _image(message: Any) -> np.ndarray:
    """Pixels of a 32FC1 image, float32, shape [rows, columns]."""
    dtype = np.dtype('>f4' if message.is_bigendian else '<f4')
    shape, strides = (message.height, message.width), (message.step, dtype.itemsize)
    return np.ndarray(shape, dtype, bytes(message.data), strides=strides).astype(np.float32)


def _layer_frame(layer: Layer, message: Any) -> LayerFrame:
    if layer.message == IMAGE:
        values = _image(message)
        return LayerFrame(layer, np.where(values > 0.0, values, np.nan), False)
    assert layer.range is not None
    low, high = layer.range
    cells = np.array(message.data, dtype=np.int8).reshape(message.info.height, message.info.width)
    values = low + cells.astype(np.float32) * np.float32((high - low) / 100.0)
    return LayerFrame(layer, np.where(cells > 0, values, np.nan), bool((cells == 100).any()))


def _vents(message: Any) -> np.ndarray:
    """Map positions of the vents that emit, float64, shape [vents, 2]."""
    offsets = {item.name: item.offset for item in message.fields}
    points = np.frombuffer(bytes(message.data), np.uint8).reshape(-1, message.point_step)
    x, y, discharge = (
        np.ascontiguousarray(points[:, offsets[name] : offsets[name] + 4]).view('<f4')[:, 0]
        for name in ('x', 'y', 'discharge')
    )
    return np.stack([x, y], axis=-1)[discharge > 0.0].astype(np.float64)
