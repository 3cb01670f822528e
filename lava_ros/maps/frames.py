# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The maps in a recorded bag, frame by frame, in physical units. ROS is not required."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
import math
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros.bag import BagReader
from lava_ros.bag.decoding import (
    cloud_columns,
    Decoder,
    image_array,
    Moment,
    places_in,
    read_grid,
    stamp_of,
)
from lava_ros.bag.georeference import georeferenced, MESSAGE, recorded_georeference, TOPIC
from lava_ros.bag.reader import BagMessage
from lava_ros.bag.recorded_node import find_node
from lava_ros.errors import LavaError
from lava_ros.files.resources import share_path
from lava_ros.files.yaml import parse_yaml
from lava_ros.maps.layer_files import layers_from_dict, load_layers
from lava_ros.maps.layers import ARRIVAL, ARRIVED, IMAGE, INUNDATED, Layer
from lava_ros.scene import MAX_COORDINATE, Scene, scene_to_dict, Terrain
from lava_ros.simulation.accuracy import COVERED
from lava_ros.simulation.output.inundation import (
    area_of,
    footprint_cells,
    reached_cells,
    standing_cells,
    standing_part,
)

#: Called with the name of the activity and its completed fraction, 0 to 1.
Progress = Callable[[str, float], None]

# Resolution and origin (x, y) of a grid [m].
_Place = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class LayerFrame:
    """One layer at one moment.

    Attributes:
        layer: Its definition.
        values: Thickness [m], temperature [Celsius] or hazard 0..100, float32, shape
            [rows, columns]; NaN without lava and outside the terrain.
        is_saturated: True if a cell has the maximum value of the grid.
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
        layers: The newest layer of each source: thickness, temperature, hazard. If a grid and an
            image have the same time, the image, which is not rounded.
        vents: Map positions [m] of the vents with a discharge, shape [vents, 2].
        time: Simulated time [s]; None if the bag does not contain it.
        scene: The scene in the bag, in the form of ``scene_to_dict``.
        arrived: First arrival time [s], float32, shape [rows, columns], NaN in cells without
            arrival; None if the bag does not contain it.
        inundated: Fraction of each cell that lava has covered so far, float32, same shape, NaN
            without data; 1 in cells with arrival if the bag does not contain it, None without
            either.
        threshold: Minimum thickness of lava that counts as inundation [m].
        fissures: Ends of vents that are lines [m], shape [count, 2, 2].
    """

    elevation: np.ndarray
    resolution: float
    origin: tuple[float, float]
    layers: Mapping[str, LayerFrame]
    vents: np.ndarray
    time: float | None
    scene: Mapping[str, Any]
    arrived: np.ndarray | None = None
    inundated: np.ndarray | None = None
    threshold: float = COVERED
    fissures: Any = ()

    @property
    def terrain(self) -> Terrain:
        """The ground in the coordinate system of the scene.

        Raises:
            LavaError: If the scene, which may be that of another program, is not valid.
        """
        known = self.scene.get('terrain') or {}
        return Terrain(
            self.elevation, self.resolution, self.origin, known.get('epsg'),
            known.get('offset', (0.0, 0.0)), wkt=known.get('wkt'),
            sea_level=known.get('sea_level'),
        )

    @property
    def standing(self) -> np.ndarray:
        """Cells with lava now, bool; without a thickness, those with lava in any layer."""
        thickness = self.layers.get('thickness')
        if thickness is not None:
            return standing_cells(thickness.values, self.threshold)
        wet = [np.isfinite(item.values) for item in self.layers.values()]
        return np.logical_or.reduce([np.zeros(self.elevation.shape, dtype=bool), *wet])

    @property
    def standing_area(self) -> float:
        """Area on which lava stands now [m2], within the inundated area."""
        return self.area(standing_part(self.standing, self.inundated))

    @property
    def reached(self) -> np.ndarray | None:
        """Cells that lava has touched so far, bool; None without arrival times."""
        return None if self.arrived is None else reached_cells(self.arrived)

    @property
    def footprint(self) -> np.ndarray | None:
        """Cells of which lava has covered at least half so far, bool; None if unknown."""
        return None if self.inundated is None else footprint_cells(self.inundated)

    @property
    def lava(self) -> np.ndarray:
        """Cells with lava now, and cells that lava has reached if those are known, bool."""
        return self.standing if self.reached is None else self.standing | self.reached

    def area(self, cells: np.ndarray) -> float:
        """Return the area of a mask or of fractions of cells [m2]."""
        return area_of(cells, self.resolution)

    def with_cover(
        self, arrived: np.ndarray | None, inundated: np.ndarray | None, threshold: float
    ) -> 'Frame':
        """Return the frame with arrival times, inundated fractions, and their threshold [m].

        A bag without fractions counts whole cells. Lava without any arrival time is that of a
        simulation that did not record them.
        """
        frame = replace(self, arrived=arrived, threshold=threshold)
        if frame.reached is None or (frame.standing.any() and not frame.reached.any()):
            return replace(frame, arrived=None)
        if inundated is None or not np.isfinite(inundated).any():
            inundated = frame.reached.astype(np.float32)
        is_known = np.isfinite(self.elevation)
        inundated = np.where(is_known, np.nan_to_num(inundated), np.float32(np.nan))
        return replace(frame, inundated=inundated)

    @property
    def thickest(self) -> float:
        """Maximum thickness [m]; NaN without lava or without a thickness layer."""
        thickness = self.layers.get('thickness')
        return math.nan if thickness is None else float(np.fmax.reduce(thickness.values, None))


def frame_of(scene: Scene) -> Frame:
    """Return the terrain and the vents of a scene as a frame without layers."""
    terrain = scene.terrain
    fissures = [(vent.position, vent.end) for vent in scene.vents if vent.end is not None]
    return Frame(
        elevation=terrain.elevation,
        resolution=terrain.resolution,
        origin=terrain.origin,
        layers={},
        vents=np.array([vent.position for vent in scene.vents]).reshape(-1, 2),
        time=None,
        scene=scene_to_dict(scene),
        fissures=np.array(fissures).reshape(-1, 2, 2),
    )


def threshold_at(moment: Moment | None) -> float:
    """Return the minimum thickness of lava that counts as inundation [m], from diagnostics."""
    known = math.nan if moment is None else moment.number('inundation_threshold_m')
    return known if known > 0.0 else COVERED


def silent(activity: str, fraction: float) -> None:
    """Report no progress."""


class Recording:
    """A bag with the maps of a simulation.

    Attributes:
        bag: The bag.
        decoder: Decoder of its messages.
        node: The node whose maps these are.
        timeline: Simulated times of its messages.
        layers: Layers with maps in the bag, by topic name.
        terrain, terrain_info, vents: Topic names of the ground, its metadata and the vents;
            ``vents`` is None if the bag has none.
        georeference: Topic name of the georeference of the ground, None if the bag has none.
        scene: The scene in the bag, in the form of ``scene_to_dict``, with the newest
            georeference if the bag has no description.
    """

    def __init__(
        self, path: str | Path, *, node: str | None = None, more: Sequence[Layer] = ()
    ) -> None:
        """Open a bag and find the layers of a node: those that it describes, and ``more``.

        ``node`` is the full name or the namespace of the node; None for the only one. A topic of a
        layer with messages of another type is reported as damage of the bag.

        Raises:
            LavaError: If the bag cannot be read, has several nodes and none is named, or has no
                maps or no terrain.
        """
        self.bag = bag = BagReader(path)
        self.decoder = Decoder(bag)
        self._left_out: set[str] = set()
        described = _yaml(bag, 'msg_config')
        # the layers at the time of recording, or defaults for bags of other programs
        if described is None:
            layers = load_layers(share_path('msg_configs/default.yaml'))
        else:
            layers = layers_from_dict(described)
        # masks and margins hide quantities
        maps = [
            item for item in layers
            if item.message == IMAGE or (item.range is not None and item.margin == 0.0)
        ]
        self.node, self.timeline = find_node(
            bag, self.decoder, _namespaces(bag, [*maps, *more]), node=node
        )
        self.layers: dict[str, Layer] = {}
        for layer in (*maps, *more):
            name = self.node.topic(layer.topic)
            kind = _type(bag, name)
            if kind == layer.message:
                self.layers[name] = layer
            elif kind and layer in maps:
                self._leave_out(name, f'the bag has {kind}, the layer is a {layer.message}')
        if not self.layers:
            raise LavaError('bag', str(path), 'a bag with the layers of a simulation')
        self.terrain = self._required('terrain', IMAGE)
        self.terrain_info = self._required('terrain_info', 'nav_msgs/msg/MapMetaData')
        self.vents = self._topic('vents', 'sensor_msgs/msg/PointCloud2')
        scene = _yaml(bag, 'scene')
        self.scene: Mapping[str, Any] = scene if isinstance(scene, Mapping) else {}
        if not isinstance(self.scene.get('terrain', {}), Mapping):
            field = f'custom_data scene.terrain of {path}'
            raise LavaError(field, self.scene['terrain'], 'a mapping')
        self.georeference = self._topic(TOPIC, MESSAGE)
        # other recorders store no scene
        if self.georeference is not None and not self.scene:
            for item in bag.newest([self.georeference], (bag.end_ns or 0) + 1):
                if stated := recorded_georeference(bag, self.decoder, item):
                    self.scene = georeferenced(self.scene, stated.georeference)

    @property
    def inundation_threshold(self) -> float:
        """Minimum thickness of lava that counts as inundation [m]."""
        return threshold_at(self.timeline.moments[-1] if self.timeline.moments else None)

    @property
    def topics(self) -> set[str]:
        """Names of the topics of a frame."""
        ground = self.terrain, self.terrain_info, self.georeference
        names = {*ground, self.vents, *self.layers}
        return {name for name in names if name is not None}

    @property
    def places(self) -> dict[str, tuple[float, float]]:
        """Map positions [m] of the places whose arrivals the bag has, by name."""
        topic = self._topic('place_arrivals', 'diagnostic_msgs/msg/DiagnosticArray')
        found = self.bag.newest([topic], (self.bag.end_ns or 0) + 1) if topic else ()
        return next((self.decoder.decode(item, places_in) for item in found), {})

    def frame_at(self, time: float | None = None) -> Frame:
        """Read the newest maps up to a simulated time [s]; None for the last ones.

        Raises:
            LavaError: If the bag is damaged, or has no terrain or no map at that time.
        """
        end = self.timeline.log_time_at(time)
        if time is not None and (end is None or time > self.timeline.last_time):
            raise LavaError('time', time, self.timeline.span)
        return self.frame_logged((self.bag.end_ns or 0) if end is None else end, time)

    def log_times(self) -> list[int]:
        """Return the log time of the last map of each frame [ns], also without simulated times.

        Raises:
            LavaError: If the bag is damaged.
        """
        found: dict[int, int] = {}
        for message in self.bag.messages({*self.layers}):
            found[self.time_of(message)] = message.stamp_ns
        return sorted(found.values())

    def frame_logged(self, end: int, time: float | None = None) -> Frame:
        """Read the newest maps up to a log time [ns]; errors name the simulated ``time`` [s].

        Raises:
            LavaError: If the bag is damaged, or has no terrain or no map at that time.
        """
        assembly = _Assembly(self)
        assembly.newest = {item.topic: item for item in self.bag.newest(self.topics, end + 1)}
        if what := assembly.missing_input():
            raise self.missing_error(time, what)
        return assembly.frame()

    def frames(self) -> Iterator[Frame]:
        """Yield the frames of the last run, oldest first, with one in memory at a time.

        A run ends where the simulation was reset to an earlier time. There is one frame for each
        time at which a layer was published; the other layers keep their previous map. Frames
        without a simulated time are left out, unless no frame has one.

        Raises:
            LavaError: If the bag is damaged.
        """
        run = self.timeline.last_run
        start = run[0].stamp_ns if run else 0
        assembly = _Assembly(self)
        seen: dict[str, BagMessage] = {}
        stamp, is_due = 0, False
        for message in self.bag.messages(self.topics):
            # each file of a bag begins with a copy of the latched messages
            if _is_copy(message, seen.get(message.topic)):
                continue
            seen[message.topic] = message
            when, is_layer = self.time_of(message), message.topic in self.layers
            if is_due and when != stamp:
                yield from self._due(assembly)
                is_due = False
            if not is_layer or when >= start:
                assembly.newest[message.topic] = message
                stamp, is_due = when, is_due or is_layer
        if is_due:
            yield from self._due(assembly)

    def time_of(self, message: BagMessage) -> int:
        """Return the ROS time of a message [ns], as in the timeline."""
        return self.timeline.ros_time(stamp_of(message), message.stamp_ns)

    def missing_error(self, time: float | None, what: str) -> LavaError:
        """Return the error for input missing up to a simulated time [s], None for the end."""
        if time is None:
            return LavaError('bag', str(self.bag.path), f'a bag that contains a {what}')
        return LavaError('time', time, f'a time at or after the first {what} of the bag')

    def progress_at(self, frame: Frame) -> float:
        """Return the fraction of the last run up to a frame; 0 if times are unknown."""
        run = self.timeline.last_run
        if frame.time is None or not run or run[-1].time <= run[0].time:
            return 0.0
        return (frame.time - run[0].time) / (run[-1].time - run[0].time)

    def _topic(self, name: str, message_type: str) -> str | None:
        """Return the full name of a topic of the node, None without messages of that type."""
        topic = self.node.topic(name)
        return topic if _type(self.bag, topic) == message_type else None

    def _required(self, name: str, message_type: str) -> str:
        topic = self._topic(name, message_type)
        if topic is None:
            expected = f'a bag with messages on the topic {self.node.topic(name)} ({message_type})'
            raise LavaError('bag', str(self.bag.path), expected)
        return topic

    @cached_property
    def _grounds(self) -> tuple[set[tuple[int, ...]], set[_Place]]:
        """Shapes and positions of all terrains in the bag."""
        shapes, places = set(), set()
        for message in self.bag.messages((self.terrain, self.terrain_info)):
            if message.topic == self.terrain:
                shapes.add(_image(self.decoder, message).shape)
            else:
                places.add(_place(self.decoder, message))
        return shapes, places

    def _check_ground(self, name: str, shape: tuple[int, ...], place: _Place | None) -> None:
        """Report a map that is not on the present terrain, unless it is on another of the bag."""
        shapes, places = self._grounds
        if shape not in shapes:
            rows, columns = shape
            self._leave_out(name, f'a map of {columns} x {rows} cells is on no terrain of the bag')
        elif place is not None and place not in places:
            self._leave_out(
                name, f'a map at ({place[1]:g}, {place[2]:g}) in cells of {place[0]:g} m is on no '
                'terrain of the bag',
            )

    def _leave_out(self, topic: str, reason: str) -> None:
        """Report the first map of a topic that is left out."""
        if topic not in self._left_out:
            self._left_out.add(topic)
            self.bag.report_damage(f'maps on {topic} are left out: {reason}')

    def _due(self, assembly: '_Assembly') -> Iterator[Frame]:
        if not assembly.missing_input():
            frame = assembly.frame()
            if frame.time is not None or not self.timeline.moments:
                yield frame


class _Assembly:
    """The newest message of each topic, from which frames are assembled."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self.newest: dict[str, BagMessage] = {}
        self._decoded: dict[str, tuple[BagMessage, Any]] = {}
        # the newest metadata and elevations, and the terrain built from them
        self._ground: tuple[_Place, np.ndarray, Terrain] | None = None

    def missing_input(self) -> str:
        """Return the name of the first missing input of a frame, or an empty text."""
        if not {self._recording.terrain, self._recording.terrain_info} <= set(self.newest):
            return 'terrain'
        return '' if self._layer_names() else 'map'

    def frame(self) -> Frame:
        """Return the frame; maps of earlier terrains are left out."""
        recording = self._recording
        place = self._get(recording.terrain_info, _place)
        elevation = self._get(recording.terrain, _image)
        if self._ground is None or self._ground[0] != place or self._ground[1] is not elevation:
            # the shortest decimal for the float32: 0.1, not 0.10000000149
            resolution = float(str(np.float32(place[0])))
            self._ground = place, elevation, Terrain(elevation, resolution, place[1:])
        terrain = self._ground[2]
        layers: dict[str, LayerFrame] = {}
        # newer maps first, and images before grids of the same time
        for name in sorted(self._layer_names(), key=lambda name: (
            -recording.time_of(self.newest[name]), recording.layers[name].message != IMAGE
        )):
            layer = recording.layers[name]
            # a grid and an image of one source have the same content
            if layer.source not in layers:
                shown, where = self._get(name, partial(_map, layer))
                if layer.min_cells and shown is not None:
                    shown, where = _without_border(shown, where, terrain, place)
                if shown is None:
                    recording._leave_out(name, 'a map has infinite values')
                elif shown.values.shape == terrain.shape and where in (place, None):
                    layers[layer.source] = shown
                else:
                    recording._check_ground(name, shown.values.shape, where)
        arrived, inundated = (layers.pop(source, None) for source in (ARRIVED, INUNDATED))
        has_vents = recording.vents in self.newest
        stamp = max(recording.time_of(self.newest[name]) for name in self._layer_names())
        frame = Frame(
            elevation=terrain.elevation,
            resolution=terrain.resolution,
            origin=terrain.origin,
            layers=layers,
            vents=self._get(recording.vents, _vents) if has_vents else np.empty((0, 2)),
            time=recording.timeline.time_at(stamp),
            scene=self._scene(),
        )
        return frame.with_cover(
            None if arrived is None else arrived.values,
            None if inundated is None else inundated.values,
            recording.inundation_threshold,
        )

    def _scene(self) -> Mapping[str, Any]:
        """Return the scene with the georeference of the ground, if the bag has it."""
        recording, name = self._recording, self._recording.georeference
        if name is None or name not in self.newest:
            return recording.scene
        stated = self._get(name, partial(recorded_georeference, recording.bag))
        ground = recording.terrain, recording.terrain_info
        stamps = [stamp_of(self.newest[topic]) for topic in ground]
        if stated is None or not stated.belongs_to(stamps):
            return recording.scene
        return georeferenced(recording.scene, stated.georeference)

    def _layer_names(self) -> list[str]:
        return [name for name in self._recording.layers if name in self.newest]

    def _get(self, name: Any, convert: Callable[[Decoder, BagMessage], Any]) -> Any:
        """Return the content of a topic's newest message; each is decoded once."""
        message = self.newest[name]
        known = self._decoded.get(name)
        if known is None or known[0] is not message:
            known = (message, convert(self._recording.decoder, message))
            self._decoded[name] = known
        return known[1]


def _is_copy(message: BagMessage, before: BagMessage | None) -> bool:
    """Return True if a message of a topic is the previous one again; a clock may loop."""
    return (
        before is not None
        and before.publish_ns == message.publish_ns
        and before.data == message.data
    )


def _yaml(bag: BagReader, name: str) -> Any:
    return parse_yaml(f'custom_data {name} of {bag.path}', bag.custom_data.get(name, ''))


def _type(bag: BagReader, name: str) -> str:
    """Return the type of a topic, empty without messages."""
    topic = bag.topics.get(name)
    # rosbag2 also lists topics without messages
    return topic.message_type if topic is not None and topic.count else ''


def _namespaces(bag: BagReader, layers: Sequence[Layer]) -> list[str]:
    """Return the namespaces with a layer and a terrain; without a terrain, those with a layer."""
    found = {
        name.removesuffix(f'/{layer.topic}') or '/'
        for name in bag.topics
        for layer in layers
        if name.endswith(f'/{layer.topic}') and _type(bag, name) == layer.message
    }
    with_ground = {
        name for name in found if _type(bag, f'{name.rstrip("/")}/terrain') == IMAGE
    }
    return sorted(with_ground or found)


def _image(decoder: Decoder, item: BagMessage) -> np.ndarray:
    """Return the pixels of an image, float32, shape [rows, columns]."""
    return decoder.decode(item, lambda image: image_array(image, item.topic).astype(np.float32))


def _place(decoder: Decoder, item: BagMessage) -> _Place:
    def read(info: Any) -> _Place:
        origin = info.origin.position
        return (float(info.resolution), float(origin.x), float(origin.y))

    return decoder.decode(item, read)


def _map(
    layer: Layer, decoder: Decoder, message: BagMessage
) -> tuple[LayerFrame | None, _Place | None]:
    """Return a map, None with infinite values, and the position of its grid, None for an image."""
    if layer.message == IMAGE:
        pixels = _image(decoder, message)
        return None if np.isinf(pixels).any() else image_frame(layer, pixels), None
    grid = read_grid(decoder, message)
    return grid_frame(layer, grid.cells), (grid.resolution, *grid.origin)


def _without_border(
    shown: LayerFrame, where: _Place | None, terrain: Terrain, place: _Place
) -> tuple[LayerFrame, _Place | None]:
    """Cut a map with further cells around it (``min_cells``) down to the terrain."""
    border = shown.layer.border(terrain.shape)
    (below, _), (left, _) = border
    whole = tuple(np.add(terrain.shape, np.sum(border, axis=1)))
    resolution, x, y = place
    corner = resolution, x - left * resolution, y - below * resolution
    # the node extends the grid with its resolution in float64
    if where is None or shown.values.shape != whole or not np.allclose(
        where, corner, rtol=0.0, atol=1e-3 * resolution
    ):
        return shown, where
    rows, columns = terrain.shape
    values = shown.values[below : below + rows, left : left + columns]
    return replace(shown, values=values), place


def image_frame(layer: Layer, pixels: np.ndarray) -> LayerFrame:
    """Return a layer from the pixels of its image; 0 is an arrival time, but not a thickness."""
    values = pixels.astype(np.float32)
    is_there = values >= 0.0 if layer.source in (ARRIVAL, ARRIVED) else values > 0.0
    return LayerFrame(layer, np.where(is_there & np.isfinite(values), values, np.nan), False)


def grid_frame(layer: Layer, cells: np.ndarray) -> LayerFrame:
    """Return a layer from the cells of its occupancy grid, int8, unscaled without a range."""
    first, last = layer.scale
    low, high = layer.range or (first, last)
    gain = np.float32((high - low) / (last - first))
    values = np.float32(low) + (cells.astype(np.float32) - np.float32(first)) * gain
    return LayerFrame(layer, np.where(cells > 0, values, np.nan), bool((cells == last).any()))


def _vents(decoder: Decoder, item: BagMessage) -> np.ndarray:
    """Return the map positions of the active vents and ends of fissures, float64, [count, 2]."""
    names, ends = ('x', 'y', 'discharge'), ('x_end', 'y_end')
    columns = decoder.decode(item, lambda cloud: cloud_columns(cloud, item.topic, names, ends))
    points = np.stack([columns[name] for name in names], axis=-1)
    if all(name in columns for name in ends):
        others = np.stack([columns[name] for name in (*ends, 'discharge')], axis=-1)
        points = np.concatenate([points, others[~np.isnan(others[:, :2]).all(axis=1)]])
    # keeps NaN, which the next check rejects
    points = points[~(points[:, 2] <= 0.0)]
    beyond = points[~(np.abs(points) <= MAX_COORDINATE)]
    if beyond.size:
        expected = f'coordinates and discharges, at most {MAX_COORDINATE:g} from 0'
        raise LavaError(f'{item.topic}.data', float(beyond[0]), expected)
    return points[:, :2]
