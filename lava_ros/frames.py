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

"""A recorded bag -> the maps it holds, moment by moment, in physical units. Needs no ROS."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros.bag import BagReader
from lava_ros.bag.decoding import Decoder
from lava_ros.bag.grids import read_grid
from lava_ros.bag.reader import BagMessage
from lava_ros.errors import LavaError
from lava_ros.layer_files import layers_from_dict, load_layers
from lava_ros.layers import IMAGE, Layer
from lava_ros.share import share_path
from lava_ros.timeline import Timeline
from lava_ros.yaml_files import parse_yaml

# Resolution and origin (x, y) of a grid [m].
_Place = tuple[float, float, float]


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
        layers: The newest of each source, by source: thickness, temperature, hazard. Where a grid
            and an image are of the same time, the image, which is not rounded.
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
    recording = Recording(path)
    stamp = recording.timeline.stamp_at(time)
    if stamp is None:
        if time is not None:
            raise LavaError('time', time, recording.timeline.span)
        stamp = recording.bag.end_ns or 0
    assembly = _Assembly(recording)
    for message in recording.bag.newest(recording.topics, stamp + 1):
        assembly.take(message)
    if not assembly.has_ground:
        raise LavaError('time', time, 'a time from the first terrain of the bag on')
    if not assembly.has_layers:
        raise LavaError('time', time, 'a time from the first map of the bag on')
    return assembly.frame()


class Recording:
    """A bag with the maps of a simulation: what it holds, its times and its frames.

    Attributes:
        bag: The bag.
        decoder: Decodes its messages.
        timeline: Which simulated time was shown when.
        layers: The layers whose maps it has, by topic name.
        scene: What it says about its scene, as ``scene_to_dict`` gives it.
    """

    def __init__(self, path: str | Path) -> None:
        """Find out what the bag holds.

        Args:
            path: The bag's directory, or an .mcap file.

        Raises:
            LavaError: The bag cannot be read, or has no maps or no terrain.
        """
        self.bag = bag = BagReader(path)
        self.decoder = Decoder(bag)
        named = {_topic(bag, item.topic, item.message): item for item in _layers(bag)}
        self.layers = {name: item for name, item in named.items() if name and _is_map(item)}
        if not self.layers:
            raise LavaError('bag', str(path), 'a bag with the layers of a simulation')
        self.timeline = Timeline(bag, self.decoder)
        self._terrain = _required(bag, 'terrain', IMAGE)
        self._terrain_info = _required(bag, 'terrain_info', 'nav_msgs/msg/MapMetaData')
        self._vents = _topic(bag, 'vents', 'sensor_msgs/msg/PointCloud2')
        scene = _yaml(bag, 'scene')
        self.scene: Mapping[str, Any] = scene if isinstance(scene, Mapping) else {}

    @property
    def topics(self) -> set[str]:
        """Names of the topics that make a frame."""
        names = {self._terrain, self._terrain_info, self._vents, *self.layers}
        return {name for name in names if name is not None}

    def role(self, topic: str) -> str:
        """What a topic is for: ``terrain``, ``terrain_info``, ``vents`` or ``layer``."""
        roles = {self._terrain: 'terrain', self._terrain_info: 'terrain_info'}
        return (roles | {self._vents: 'vents'}).get(topic, 'layer')

    def frames(self) -> Iterator[Frame]:
        """Yield the frames of the last run, oldest first; memory holds one at a time.

        A run ends where the simulation was set back to an earlier time. A frame is there for each
        time a layer was published; layers that were not have their newest map before. Frames that
        the bag knows no simulated time of are left out, unless it knows none at all.

        Raises:
            LavaError: The bag is damaged.
        """
        run = self.timeline.last_run
        start = run[0].stamp_ns if run else 0
        assembly = _Assembly(self)
        seen: dict[str, int] = {}
        stamp, is_due = 0, False
        for message in self.bag.messages(self.topics):
            # Each file of a bag begins with what was latched when it did.
            if seen.get(message.topic) == message.publish_ns:
                continue
            seen[message.topic] = message.publish_ns
            if is_due and message.publish_ns != stamp:
                yield from self._due(assembly)
                is_due = False
            is_layer = message.topic in self.layers
            if not is_layer or message.publish_ns >= start:
                assembly.take(message)
                stamp, is_due = message.publish_ns, is_due or is_layer
        if is_due:
            yield from self._due(assembly)

    def share_at(self, frame: Frame) -> float:
        """Share of the last run that has passed with a frame; 0 where times are unknown."""
        run = self.timeline.last_run
        if frame.time is None or not run or run[-1].time <= run[0].time:
            return 0.0
        return (frame.time - run[0].time) / (run[-1].time - run[0].time)

    def _due(self, assembly: '_Assembly') -> Iterator[Frame]:
        if assembly.has_ground and assembly.has_layers:
            frame = assembly.frame()
            if frame.time is not None or not self.timeline.moments:
                yield frame


class _Assembly:
    """The newest message of each topic, and the frame they make."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._newest: dict[str, BagMessage] = {}
        self._decoded: dict[str, tuple[BagMessage, Any]] = {}

    def take(self, message: BagMessage) -> None:
        """Let a message replace the one before on its topic."""
        self._newest[message.topic] = message

    @property
    def has_ground(self) -> bool:
        """Whether terrain and its description are there."""
        roles = {self._recording.role(name) for name in self._newest}
        return {'terrain', 'terrain_info'} <= roles

    @property
    def has_layers(self) -> bool:
        """Whether there is a map."""
        return bool(self._layer_names())

    def frame(self) -> Frame:
        """Make the frame; maps of another terrain than the newest are left out."""
        by_role = {self._recording.role(name): name for name in self._newest}
        info = self._get(by_role['terrain_info'], _decoded)
        elevation = self._get(by_role['terrain'], _elevation)
        place = _place(info)
        layers: dict[str, LayerFrame] = {}
        for name in sorted(self._layer_names(), key=self._rank):
            layer = self._recording.layers[name]
            # A grid and an image of the same source show the same thing: the first will do.
            if layer.source not in layers:
                shown, where = self._get(name, partial(_map, layer))
                if shown.values.shape == elevation.shape and where in (place, None):
                    layers[layer.source] = shown
        vents = by_role.get('vents')
        stamp = max(self._newest[name].publish_ns for name in self._layer_names())
        return Frame(
            elevation=elevation,
            resolution=float(np.float64(str(np.float32(info.resolution)))),
            origin=(info.origin.position.x, info.origin.position.y),
            layers=layers,
            vents=self._get(vents, _vents) if vents else np.empty((0, 2)),
            time=self._recording.timeline.time_at(stamp),
            scene=self._recording.scene,
        )

    def _layer_names(self) -> list[str]:
        return [name for name in self._recording.layers if name in self._newest]

    def _rank(self, name: str) -> tuple[int, bool]:
        """Newer maps come first, and of the same time what is not rounded."""
        is_rounded = self._recording.layers[name].message != IMAGE
        return (-self._newest[name].publish_ns, is_rounded)

    def _get(self, name: str, convert: Callable[[Decoder, BagMessage], Any]) -> Any:
        """What a topic's newest message says; each is decoded once."""
        message = self._newest[name]
        known = self._decoded.get(name)
        if known is None or known[0] is not message:
            known = (message, convert(self._recording.decoder, message))
            self._decoded[name] = known
        return known[1]


def _is_map(layer: Layer) -> bool:
    """Whether quantities can be read from a layer: a mask or a margin around lava hides them."""
    return layer.message == IMAGE or (layer.range is not None and layer.margin == 0.0)


def _layers(bag: BagReader) -> tuple[Layer, ...]:
    """The layers as they were when the bag was recorded; the default ones for a foreign bag."""
    data = _yaml(bag, 'msg_config')
    if data is not None:
        return layers_from_dict(data)
    return load_layers(share_path('msg_configs/default.yaml'))


def _yaml(bag: BagReader, name: str) -> Any:
    """What a text of the bag's custom data says, None without one."""
    return parse_yaml(f'custom_data {name} of {bag.path}', bag.custom_data.get(name, ''))


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


def _decoded(decoder: Decoder, message: BagMessage) -> Any:
    return decoder.decode(message)


def _elevation(decoder: Decoder, message: BagMessage) -> np.ndarray:
    return _image(decoder.decode(message))


def _image(message: Any) -> np.ndarray:
    """Pixels of a 32FC1 image, float32, shape [rows, columns]."""
    dtype = np.dtype('>f4' if message.is_bigendian else '<f4')
    shape, strides = (message.height, message.width), (message.step, dtype.itemsize)
    data = bytes(message.data)
    try:
        return np.ndarray(shape, dtype, data, strides=strides).astype(np.float32)
    except (TypeError, ValueError) as error:
        size = f'{len(data)} bytes for {shape[0]} rows and {shape[1]} columns'
        raise LavaError('image', size, f'as many as the pixels take ({error})') from error


def _place(info: Any) -> _Place:
    origin = info.origin.position
    return (info.resolution, origin.x, origin.y)


def _map(layer: Layer, decoder: Decoder, message: BagMessage) -> tuple[LayerFrame, _Place | None]:
    """A map, and the place it is at, None where it does not say."""
    if layer.message == IMAGE:
        values = _image(decoder.decode(message))
        has_lava = (values > 0.0) & np.isfinite(values)
        return LayerFrame(layer, np.where(has_lava, values, np.nan), False), None
    assert layer.range is not None
    low, high = layer.range
    first, last = layer.scale
    grid = read_grid(message)
    gain = np.float32((high - low) / (last - first))
    values = np.float32(low) + (grid.cells.astype(np.float32) - np.float32(first)) * gain
    values = np.where(grid.cells > 0, values, np.nan)
    place = (grid.resolution, *grid.origin)
    return LayerFrame(layer, values, bool((grid.cells == last).any())), place


def _vents(decoder: Decoder, item: BagMessage) -> np.ndarray:
    """Map positions of the vents that emit, float64, shape [vents, 2]."""
    message = decoder.decode(item)
    offsets = {field.name: field.offset for field in message.fields}
    points = np.frombuffer(bytes(message.data), np.uint8).reshape(-1, message.point_step)
    x, y, discharge = (
        np.ascontiguousarray(points[:, offsets[name] : offsets[name] + 4]).view('<f4')[:, 0]
        for name in ('x', 'y', 'discharge')
    )
    return np.stack([x, y], axis=-1)[discharge > 0.0].astype(np.float64)
