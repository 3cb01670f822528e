# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A recorded bag -> the maps it holds, moment by moment, in physical units. Needs no ROS."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
import math
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros.bag import BagReader
from lava_ros.bag.decoding import (
    cloud_columns,
    Decoder,
    image_array,
    places_in,
    read_grid,
    Timeline,
)
from lava_ros.bag.reader import BagMessage
from lava_ros.errors import LavaError
from lava_ros.files.resources import share_path
from lava_ros.files.yaml import parse_yaml
from lava_ros.maps.layer_files import layers_from_dict, load_layers
from lava_ros.maps.layers import ARRIVAL, ARRIVED, IMAGE, Layer
from lava_ros.scene import MAX_COORDINATE, Terrain
from lava_ros.simulation.inundation import inundated_cells, standing_cells

#: Called with the name of the activity and the share of it that is done, 0 to 1.
Progress = Callable[[str, float], None]

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
        arrived: Simulated time [s] of the step in which lava reached a cell, float32, shape [rows,
            columns], NaN where it has not; None when the bag does not say.
    """

    elevation: np.ndarray
    resolution: float
    origin: tuple[float, float]
    layers: Mapping[str, LayerFrame]
    vents: np.ndarray
    time: float | None
    scene: Mapping[str, Any]
    arrived: np.ndarray | None = None

    @property
    def standing(self) -> np.ndarray:
        """Cells with lava now, bool; where no thickness is known, those that any layer shows."""
        thickness = self.layers.get('thickness')
        if thickness is not None:
            return standing_cells(thickness.values)
        wet = [np.isfinite(item.values) for item in self.layers.values()]
        return np.logical_or.reduce([np.zeros(self.elevation.shape, dtype=bool), *wet])

    @property
    def inundated(self) -> np.ndarray | None:
        """Cells that lava has reached so far, bool; None when the bag does not say."""
        return None if self.arrived is None else inundated_cells(self.arrived)

    @property
    def lava(self) -> np.ndarray:
        """Cells that have lava now or have had it, as far as the frame says, bool."""
        return self.standing if self.inundated is None else self.standing | self.inundated

    def area(self, cells: np.ndarray) -> float:
        """Area of some of the cells [m2]."""
        return float(cells.sum()) * self.resolution**2

    @property
    def thickest(self) -> float:
        """Largest thickness [m]; NaN without lava, or where the bag does not say."""
        thickness = self.layers.get('thickness')
        if thickness is None or not np.isfinite(thickness.values).any():
            return math.nan
        return float(np.nanmax(thickness.values))


def silent(what: str, share: float) -> None:
    """Show no progress."""


class Recording:
    """A bag with the maps of a simulation: what it holds, its times and its frames.

    Attributes:
        bag: The bag.
        decoder: Decodes its messages.
        timeline: Which simulated time was shown when.
        layers: The layers whose maps it has, by topic name.
        terrain, terrain_info, vents: Topic names of the ground, its description and the vents;
            None for vents that the bag has not.
        scene: What it says about its scene, as ``scene_to_dict`` gives it.
    """

    def __init__(self, path: str | Path, *, more: Sequence[Layer] = ()) -> None:
        """Open a bag and find its layers, and ``more`` in addition to those that it describes.

        LavaError where the bag cannot be read, or has no maps or no terrain.
        """
        self.bag = bag = BagReader(path)
        self.decoder = Decoder(bag)
        described = _yaml(bag, 'msg_config')
        # as they were when the bag was recorded; the default ones for a foreign bag
        if described is None:
            layers = load_layers(share_path('msg_configs/default.yaml'))
        else:
            layers = layers_from_dict(described)
        shown = [*filter(_is_map, layers), *more]
        named = {_topic(bag, item.topic, item.message): item for item in shown}
        self.layers = {name: item for name, item in named.items() if name}
        if not self.layers:
            raise LavaError('bag', str(path), 'a bag with the layers of a simulation')
        self.timeline = Timeline(bag, self.decoder)
        self.terrain = _required(bag, 'terrain', IMAGE)
        self.terrain_info = _required(bag, 'terrain_info', 'nav_msgs/msg/MapMetaData')
        self.vents = _topic(bag, 'vents', 'sensor_msgs/msg/PointCloud2')
        scene = _yaml(bag, 'scene')
        self.scene: Mapping[str, Any] = scene if isinstance(scene, Mapping) else {}
        if not isinstance(self.scene.get('terrain', {}), Mapping):
            field = f'custom_data scene.terrain of {path}'
            raise LavaError(field, self.scene['terrain'], 'a mapping')

    @property
    def topics(self) -> set[str]:
        """Names of the topics that make a frame."""
        names = {self.terrain, self.terrain_info, self.vents, *self.layers}
        return {name for name in names if name is not None}

    @property
    def places(self) -> dict[str, tuple[float, float]]:
        """Map positions [m] of the places whose arrivals the bag has, by name."""
        topic = _topic(self.bag, 'place_arrivals', 'diagnostic_msgs/msg/DiagnosticArray')
        found = self.bag.newest([topic], (self.bag.end_ns or 0) + 1) if topic else ()
        return next((self.decoder.decode(item, places_in) for item in found), {})

    def frame_at(self, time: float | None = None) -> Frame:
        """Read the newest maps up to a simulated time [s]; None for the last ones.

        LavaError where the bag is damaged, or has no terrain or no map at that time.
        """
        stamp = self.timeline.stamp_at(time)
        last = max((item.time for item in self.timeline.moments), default=math.inf)
        if time is not None and (stamp is None or time > last):
            raise LavaError('time', time, self.timeline.span)
        assembly = _Assembly(self)
        end = (self.bag.end_ns or 0) if stamp is None else stamp
        assembly.newest = {item.topic: item for item in self.bag.newest(self.topics, end + 1)}
        if what := assembly.lacks():
            raise self.lack(time, what)
        return assembly.frame()

    def frames(self) -> Iterator[Frame]:
        """Yield the frames of the last run, oldest first; memory holds one at a time.

        A run ends where the simulation was set back to an earlier time. A frame is there for each
        time a layer was published; layers that were not have their newest map before. Frames that
        the bag knows no simulated time of are left out, unless it knows none at all. LavaError
        where the bag is damaged.
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
                assembly.newest[message.topic] = message
                stamp, is_due = message.publish_ns, is_due or is_layer
        if is_due:
            yield from self._due(assembly)

    def lack(self, time: float | None, what: str) -> LavaError:
        """The error of what is not there up to a simulated time [s], None for all of the bag."""
        if time is None:
            return LavaError('bag', str(self.bag.path), f'a bag that contains a {what}')
        return LavaError('time', time, f'a time at or after the first {what} of the bag')

    def share_at(self, frame: Frame) -> float:
        """Share of the last run that has passed with a frame; 0 where times are unknown."""
        run = self.timeline.last_run
        if frame.time is None or not run or run[-1].time <= run[0].time:
            return 0.0
        return (frame.time - run[0].time) / (run[-1].time - run[0].time)

    def _due(self, assembly: '_Assembly') -> Iterator[Frame]:
        if not assembly.lacks():
            frame = assembly.frame()
            if frame.time is not None or not self.timeline.moments:
                yield frame


class _Assembly:
    """The newest message of each topic, and the frame they make."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self.newest: dict[str, BagMessage] = {}
        self._decoded: dict[str, tuple[BagMessage, Any]] = {}
        # the newest description and elevations, and what they make
        self._ground: tuple[_Place, np.ndarray, Terrain] | None = None

    def lacks(self) -> str:
        """What is not there for a frame, or an empty text."""
        if not {self._recording.terrain, self._recording.terrain_info} <= set(self.newest):
            return 'terrain'
        return '' if self._layer_names() else 'map'

    def frame(self) -> Frame:
        """Make the frame; maps of another terrain than the newest are left out."""
        recording = self._recording
        place = self._get(recording.terrain_info, _place)
        elevation = self._get(recording.terrain, _image)
        if self._ground is None or self._ground[0] != place or self._ground[1] is not elevation:
            # The shortest decimal number the float32 stands for: 0.1, not 0.10000000149.
            resolution = float(str(np.float32(place[0])))
            self._ground = place, elevation, Terrain(elevation, resolution, place[1:])
        terrain = self._ground[2]
        layers: dict[str, LayerFrame] = {}
        for name in sorted(self._layer_names(), key=self._rank):
            layer = recording.layers[name]
            # A grid and an image of the same source show the same thing: the first will do.
            if layer.source not in layers:
                shown, where = self._get(name, partial(_map, layer))
                if shown.values.shape == terrain.shape and where in (place, None):
                    layers[layer.source] = shown
        arrived = layers.pop(ARRIVED, None)
        has_vents = recording.vents in self.newest
        stamp = max(self.newest[name].publish_ns for name in self._layer_names())
        frame = Frame(
            elevation=terrain.elevation,
            resolution=terrain.resolution,
            origin=terrain.origin,
            layers=layers,
            vents=self._get(recording.vents, _vents) if has_vents else np.empty((0, 2)),
            time=recording.timeline.time_at(stamp),
            scene=recording.scene,
            arrived=None if arrived is None else arrived.values,
        )
        # a layer without any time beside lava says nothing
        is_said = frame.inundated is None or frame.inundated.any() or not frame.standing.any()
        return frame if is_said else replace(frame, arrived=None)

    def _layer_names(self) -> list[str]:
        return [name for name in self._recording.layers if name in self.newest]

    def _rank(self, name: str) -> tuple[int, bool]:
        """Newer maps come first, and of the same time what is not rounded."""
        is_rounded = self._recording.layers[name].message != IMAGE
        return (-self.newest[name].publish_ns, is_rounded)

    def _get(self, name: Any, convert: Callable[[Decoder, BagMessage], Any]) -> Any:
        """What a topic's newest message says; each is decoded once."""
        message = self.newest[name]
        known = self._decoded.get(name)
        if known is None or known[0] is not message:
            known = (message, convert(self._recording.decoder, message))
            self._decoded[name] = known
        return known[1]


def _is_map(layer: Layer) -> bool:
    """Whether quantities can be read from a layer: a mask or a margin around lava hides them."""
    return layer.message == IMAGE or (layer.range is not None and layer.margin == 0.0)


def _yaml(bag: BagReader, name: str) -> Any:
    return parse_yaml(f'custom_data {name} of {bag.path}', bag.custom_data.get(name, ''))


def _topic(bag: BagReader, name: str, message_type: str) -> str | None:
    """Full name of a topic with messages by its relative name, whatever the namespace."""
    # rosbag2 lists what it subscribed to, also where nothing came
    shown = [item for item in bag.topics.values() if item.count != 0]
    names = (item.name for item in shown if item.message_type == message_type)
    return next((item for item in names if item.endswith(f'/{name}')), None)


def _required(bag: BagReader, name: str, message_type: str) -> str:
    topic = _topic(bag, name, message_type)
    if topic is None:
        right = f'a bag with messages on the topic {name} ({message_type})'
        raise LavaError('bag', str(bag.path), right)
    return topic


def _image(decoder: Decoder, item: BagMessage) -> np.ndarray:
    """Pixels of an image, float32, shape [rows, columns]."""
    return decoder.decode(item, lambda image: image_array(image, item.topic).astype(np.float32))


def _place(decoder: Decoder, item: BagMessage) -> _Place:
    def take(info: Any) -> _Place:
        origin = info.origin.position
        return (float(info.resolution), float(origin.x), float(origin.y))

    return decoder.decode(item, take)


def _map(layer: Layer, decoder: Decoder, message: BagMessage) -> tuple[LayerFrame, _Place | None]:
    """A map, and the place it is at, None where it does not say."""
    if layer.message == IMAGE:
        return image_frame(layer, _image(decoder, message)), None
    grid = read_grid(message)
    return grid_frame(layer, grid.cells), (grid.resolution, *grid.origin)


def image_frame(layer: Layer, pixels: np.ndarray) -> LayerFrame:
    """A layer from the pixels of its image; an arrival of 0 is there already, not nowhere."""
    values = pixels.astype(np.float32)
    is_there = values >= 0.0 if layer.source in (ARRIVAL, ARRIVED) else values > 0.0
    return LayerFrame(layer, np.where(is_there & np.isfinite(values), values, np.nan), False)


def grid_frame(layer: Layer, cells: np.ndarray) -> LayerFrame:
    """A layer from the cells of its occupancy grid, int8; without a range as they are."""
    first, last = layer.scale
    low, high = layer.range or (first, last)
    gain = np.float32((high - low) / (last - first))
    values = np.float32(low) + (cells.astype(np.float32) - np.float32(first)) * gain
    return LayerFrame(layer, np.where(cells > 0, values, np.nan), bool((cells == last).any()))


def _vents(decoder: Decoder, item: BagMessage) -> np.ndarray:
    """Map positions of the vents that emit, float64, shape [vents, 2]."""
    names = ('x', 'y', 'discharge')
    columns = decoder.decode(item, lambda cloud: cloud_columns(cloud, item.topic, names))
    points = np.stack([columns[name] for name in names], axis=-1)
    # NaN is neither 0 nor within
    points = points[~(points[:, 2] <= 0.0)]
    beyond = points[~(np.abs(points) <= MAX_COORDINATE)]
    if beyond.size:
        right = f'coordinates and discharges, at most {MAX_COORDINATE:g} from 0'
        raise LavaError(f'{item.topic}.data', float(beyond[0]), right)
    return points[:, :2]
