# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Frames of maps from the messages of a bag."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property, partial
import logging
import math
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros.bag import BagReader
from lava_ros.bag.decoding import Decoder, places_in, stamp_of
from lava_ros.bag.georeference import georeferenced, MESSAGE, recorded_georeference, TOPIC
from lava_ros.bag.reader import BagMessage
from lava_ros.bag.recorded_node import find_node
from lava_ros.errors import LavaError, RefusalError
from lava_ros.files.resources import share_path
from lava_ros.files.yaml import parse_yaml
from lava_ros.layers.decoded import (
    GridPlace,
    image_of,
    map_of,
    place_of,
    vent_points,
    without_border,
)
from lava_ros.layers.frame import Frame, LayerFrame, threshold_at
from lava_ros.layers.layer import ARRIVED, IMAGE, INUNDATED, Layer
from lava_ros.layers.layer_files import layers_from_dict, load_layers
from lava_ros.layers.numbers import duration
from lava_ros.scene import Terrain

_LOG = logging.getLogger(__name__)

#: Name of the times of the maps that a run was asked for [s] in the description of its bag.
MAP_TIMES = 'map_times_s'

#: Called with the name of the activity and its completed fraction, 0 to 1.
Progress = Callable[[str, float], None]


def silent(activity: str, fraction: float) -> None:
    """Ignore progress."""


class Recording:
    """A bag with the maps of a simulation.

    Attributes:
        bag: The bag.
        decoder: Decoder of its messages.
        node: The node that published the maps.
        timeline: Simulated times of its messages.
        layers: Layers with maps in the bag, by topic name.
        terrain, terrain_info, vents: Topic names of the ground, its metadata and the vents;
            ``vents`` is None if the bag has none.
        georeference: Topic name of the georeference of the ground, None if the bag has none.
        scene: The scene in the bag, in the form of ``scene_to_dict``, with the newest
            georeference if the bag has no description.
    """

    def __init__(
        self, path: str | Path, *, node: str | None = None, more: Sequence[Layer] = (),
        may_continue: bool = False,
    ) -> None:
        """Open a bag and find the layers of a node: those that it describes, and ``more``.

        ``node`` is the full name or the namespace of the node; None for the only one. A topic of a
        layer with messages of another type is reported as damage of the bag, and a recording that
        was cut off is reported unless it ``may_continue``.

        Raises:
            LavaError: If the bag cannot be read, has several nodes and none is named, or has no
                maps or no terrain.
        """
        self.bag = bag = BagReader(path)
        if not may_continue:
            bag.warn_if_cut_off()
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
        if not self.layers and 'ensemble' in bag.custom_data:
            remedy = 'lava map draws pages of the folder of the ensemble, which has GeoTIFF files'
            problem = f'{path} has the probabilities of an ensemble, not the maps of one flow'
            raise RefusalError('bag', problem, remedy)
        if not self.layers and 'scene' in bag.custom_data:
            remedy = 'The command of a run that was interrupted before its first map continues it'
            raise RefusalError('bag', f'{path} has no map', remedy)
        if not self.layers:
            raise LavaError('bag', str(path), 'a bag with the layers of a simulation')
        self.terrain = self._required('terrain', IMAGE)
        self.terrain_info = self._required('terrain_info', 'nav_msgs/msg/MapMetaData')
        self.vents = self._topic('vents', 'sensor_msgs/msg/PointCloud2')
        times = _yaml(bag, MAP_TIMES)
        is_valid = isinstance(times, list) and all(isinstance(item, float) for item in times)
        self._map_times: list[float] = times if is_valid else []
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
        if self.unfinished:
            _LOG.warning(f'{path}: {self.unfinished}')

    @property
    def inundation_threshold(self) -> float:
        """Minimum thickness of lava that counts as inundation [m]."""
        return threshold_at(self.timeline.moments[-1] if self.timeline.moments else None)

    @property
    def unfinished(self) -> str:
        """Warning about a run that has not reached its end; empty for other bags."""
        if not self._map_times or self.timeline.last_time >= self._map_times[-1]:
            return ''
        end = duration(self._map_times[-1])
        return f'the run has not reached its end, {end}: the command that began it continues it'

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
        end = self.timeline.log_time_at(self.shown_time(time))
        return self.frame_logged((self.bag.end_ns or 0) if end is None else end, time)

    def shown_time(self, time: float | None) -> float | None:
        """Return the simulated time of the newest maps to read up to a time [s]; None for the end.

        A run makes the map of a time at the first end of a step at or after it.

        Raises:
            LavaError: If the last run has no maps of that time.
        """
        if time is None:
            return None
        run = self.timeline.last_run
        due = max((item for item in self._map_times if item <= time), default=math.inf)
        made = (item.time for item in run if item.time >= due)
        shown = max(time, min(made, default=time))
        if not run or not run[0].time <= shown <= run[-1].time:
            raise LavaError('time', time, self.timeline.span)
        return shown

    def log_times(self) -> list[int]:
        """Return the log time of the last map of each frame [ns], even without simulated times.

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
        """Return the error for input missing up to a simulated time [s]; None for the end."""
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
    def _grounds(self) -> tuple[set[tuple[int, ...]], set[GridPlace]]:
        """Shapes and positions of all terrains in the bag."""
        shapes, places = set(), set()
        for message in self.bag.messages((self.terrain, self.terrain_info)):
            if message.topic == self.terrain:
                shapes.add(image_of(self.decoder, message).shape)
            else:
                places.add(place_of(self.decoder, message))
        return shapes, places

    def _check_ground(self, name: str, shape: tuple[int, ...], place: GridPlace | None) -> None:
        """Report a map that fits neither the current terrain nor another one in the bag."""
        shapes, places = self._grounds
        if shape not in shapes:
            rows, columns = shape
            self._leave_out(name, f'a map of {columns} x {rows} cells fits no terrain in the bag')
        elif place is not None and place not in places:
            self._leave_out(
                name, f'a map at ({place[1]:g}, {place[2]:g}) in cells of {place[0]:g} m fits no '
                'terrain in the bag',
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
        self._ground: tuple[GridPlace, np.ndarray, Terrain] | None = None

    def missing_input(self) -> str:
        """Return the name of the first missing input of a frame, or an empty text."""
        if not {self._recording.terrain, self._recording.terrain_info} <= set(self.newest):
            return 'terrain'
        return '' if self._layer_names() else 'map'

    def frame(self) -> Frame:
        """Return the frame; maps of earlier terrains are left out."""
        recording = self._recording
        place = self._get(recording.terrain_info, place_of)
        elevation = self._get(recording.terrain, image_of)
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
                shown, where = self._get(name, partial(map_of, layer))
                if layer.min_cells and shown is not None:
                    shown, where = without_border(shown, where, terrain, place)
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
            vents=self._get(recording.vents, vent_points) if has_vents else np.empty((0, 2)),
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
    """Return True if a message repeats the previous one of its topic; a clock may loop."""
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
