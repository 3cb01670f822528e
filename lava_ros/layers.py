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

"""The layers of a simulation that are published, as a file in msg_configs/ describes them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
import re
from typing import Any, TYPE_CHECKING

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.forecast.forecast import Forecast, UNKNOWN
from lava_ros.hazard import hazard, LETHAL_TEMPERATURE, LETHAL_THICKNESS, SAFE_TEMPERATURE
from lava_ros.margin import within

if TYPE_CHECKING:
    # The solver's package loads Warp, which files and messages do not need.
    from lava_ros.simulation.snapshot import Snapshot

    #: What a layer shows: the flow of now, or the largest of what comes.
    Shown = Snapshot | Forecast

#: 0 C in kelvin.
ZERO_CELSIUS = 273.15

OCCUPANCY_GRID = 'nav_msgs/msg/OccupancyGrid'
IMAGE = 'sensor_msgs/msg/Image'
POINT_CLOUD = 'sensor_msgs/msg/PointCloud2'
GRID_MAP = 'grid_map_msgs/msg/GridMap'

#: What a file may call a message type, and its full name.
MESSAGES = {
    'nav_msgs/OccupancyGrid': OCCUPANCY_GRID,
    OCCUPANCY_GRID: OCCUPANCY_GRID,
    'sensor_msgs/Image': IMAGE,
    IMAGE: IMAGE,
    'sensor_msgs/PointCloud2': POINT_CLOUD,
    POINT_CLOUD: POINT_CLOUD,
    'grid_map_msgs/GridMap': GRID_MAP,
    GRID_MAP: GRID_MAP,
}

#: Quantities that a message may show alone.
SOURCES = ('thickness', 'temperature', 'hazard')

#: The source that says when lava comes.
ARRIVAL = 'arrival'

#: What stands before a source of ``SOURCES`` for the worst of it within a forecast's horizon.
PEAK = 'peak_'

#: Quantities of a forecast, each shown alone.
FORECAST_SOURCES = (ARRIVAL, *(PEAK + source for source in SOURCES))

#: The source of messages that show several quantities side by side.
LAVA = 'lava'
RELIABILITIES = ('reliable', 'best_effort')
DURABILITIES = ('transient_local', 'volatile')

#: Widest margin around lava [m].
MOST_MARGIN = 1000.0

_UNITS = {'thickness': 'm', 'temperature': 'Celsius', 'hazard': 'hazard', ARRIVAL: 's'}

_TOPIC = re.compile(r'[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*')


@dataclass(frozen=True)
class Qos:
    """How a layer's messages are delivered.

    Attributes:
        reliability: ``reliable`` or ``best_effort``.
        durability: ``transient_local`` (a late subscriber gets the last message) or ``volatile``.
        depth: Messages kept for slow or late subscribers.
    """

    reliability: str = 'reliable'
    durability: str = 'transient_local'
    depth: int = 1


@dataclass(frozen=True)
class HazardLimits:
    """Where burial and heat become dangerous.

    Attributes:
        lethal_thickness: Thickness at which burial alone is lethal [m].
        safe_temperature: Temperature up to which heat does no harm [K].
        lethal_temperature: Temperature from which heat alone is lethal [K].
    """

    lethal_thickness: float = LETHAL_THICKNESS
    safe_temperature: float = SAFE_TEMPERATURE
    lethal_temperature: float = LETHAL_TEMPERATURE


@dataclass(frozen=True)
class Layer:
    """One output of the node: what is shown and how it becomes a message.

    Attributes:
        name: The layer's key in its file.
        topic: Relative topic name.
        source: ``thickness``, ``temperature`` or ``hazard``; in point clouds and grid maps
            ``lava``, which is all of them. Of a forecast ``arrival`` or ``peak_thickness``,
            ``peak_temperature``, ``peak_hazard``.
        message: Full name of the message type.
        range: Values that map to the two ends of ``scale`` [m, Celsius, hazard, or s]; None for
            what is not scaled and for masks with a step, and for the arrival, whose range is that
            of its forecast.
        scale: Grid values at the ends of ``range``; the second may be the smaller.
        step: Value from which on a cell is 100, and 0 below it: a mask; for the arrival up to
            which, and 0 beyond it; None for a scale.
        margin: Distance from lava [m] up to which a cell without lava counts as the mildest lava,
            or, with a step, as one beyond it.
        threshold: Thickness below which a cell counts as dry [m].
        outside: Grid value outside the terrain.
        enabled: Whether the layer is published at all.
        rate: Messages per second [Hz], at most.
        record: Whether the messages go into a bag that is being recorded.
        qos: Delivery of the messages.
        hazard: Limits of the hazard, where it is shown.
    """

    name: str
    topic: str
    source: str
    message: str
    range: tuple[float, float] | None = None
    scale: tuple[int, int] = (0, 100)
    step: float | None = None
    margin: float = 0.0
    threshold: float = 0.1
    outside: int = -1
    enabled: bool = True
    rate: float = 1.0
    record: bool = True
    qos: Qos = field(default_factory=Qos)
    hazard: HazardLimits = field(default_factory=HazardLimits)

    @property
    def is_forecast(self) -> bool:
        """Whether it shows a forecast in place of a snapshot."""
        return self.source in FORECAST_SOURCES

    def raw_values(self, snapshot: 'Shown') -> np.ndarray:
        """Return the layer's quantity on the terrain's cells.

        Returns:
            float32, shape [rows, columns]: thickness [m], temperature [Celsius], hazard 0..100 or
            arrival [s]. Dry cells are 0, or NaN for temperature and arrival; cells of which
            nothing is known, as outside the terrain, are NaN, and for the arrival ``UNKNOWN``.

        Raises:
            LavaError: The layer shows several quantities.
        """
        if self.source not in (*SOURCES, *FORECAST_SOURCES):
            right = f'one of {", ".join(SOURCES)}; maps and points have them all'
            raise LavaError(f'layers.{self.name}.source', self.source, right)
        return self._raw(self.source.removeprefix(PEAK), snapshot)

    def maps(self, snapshot: 'Shown') -> dict[str, np.ndarray]:
        """Return the ground's elevation [m] and each of ``SOURCES`` as ``raw_values`` does."""
        elevation = np.asarray(snapshot.terrain.elevation, dtype=np.float32)
        return {'elevation': elevation} | {name: self._raw(name, snapshot) for name in SOURCES}

    def points(self, snapshot: 'Shown') -> dict[str, np.ndarray]:
        """Return a point on the lava's surface for each wet cell, row by row.

        Returns:
            Columns ``x``, ``y``, ``z`` [m], ``thickness`` [m] and ``temperature`` [Celsius, NaN
            where it is unknown], float32, one value a point.
        """
        rows, columns = np.nonzero(self.wet(snapshot))
        terrain, thickness = snapshot.terrain, snapshot.thickness[rows, columns]
        temperature = snapshot.temperature[rows, columns]
        values = {
            'x': terrain.origin[0] + (columns + 0.5) * terrain.resolution,
            'y': terrain.origin[1] + (rows + 0.5) * terrain.resolution,
            'z': terrain.elevation[rows, columns] + thickness,
            'thickness': thickness,
            'temperature': self._quantity('temperature', thickness, temperature),
        }
        return {name: np.asarray(column, dtype=np.float32) for name, column in values.items()}

    def grid_values(self, snapshot: 'Shown') -> np.ndarray:
        """Return the layer's quantity on the scale of an occupancy grid.

        Returns:
            int8, shape [rows, columns]: 0 without lava, 1 to 100 with lava, ``outside`` outside
            the terrain. With a step 100 from it on and 0 below. A wet cell whose quantity is
            unknown is as one at the range's high end, or beyond the step.

        Raises:
            LavaError: The layer has neither a range nor a step.
        """
        wet = self.wet(snapshot)
        if isinstance(snapshot, Forecast) and self.source == ARRIVAL:
            quantity, default = snapshot.arrival[wet], (0.0, snapshot.horizon)
        else:
            source, default = self.source.removeprefix(PEAK), None
            quantity = self._quantity(
                source, snapshot.thickness[wet], snapshot.temperature[wet]
            )
        distance = self.margin / snapshot.terrain.resolution
        values = np.zeros(snapshot.thickness.shape, dtype=np.int8)
        if self.step is not None:
            reached = wet.copy()
            # The comparison is false for what is unknown.
            is_below = quantity < np.float32(self.step)
            reached[wet] = quantity <= np.float32(self.step) if default else ~is_below
            values[within(reached, distance)] = 100
        else:
            values[within(wet, distance)] = max(1, self.scale[0])
            values[wet] = self._scaled(quantity, self.range or default)
        values[np.isnan(snapshot.thickness)] = self.outside
        return values

    def values(self, snapshot: 'Shown') -> np.ndarray:
        """Return what a grid or an image carries: grid values or raw values by message type."""
        if self.message == OCCUPANCY_GRID:
            return self.grid_values(snapshot)
        return self.raw_values(snapshot)

    def wet(self, snapshot: 'Shown') -> np.ndarray:
        """Where this layer sees lava, bool, shape [rows, columns]."""
        if isinstance(snapshot, Forecast) and self.source == ARRIVAL:
            return np.isfinite(snapshot.arrival)
        return (snapshot.thickness > 0.0) & (snapshot.thickness >= self.threshold)

    def _scaled(self, quantity: np.ndarray, ends: tuple[float, float] | None) -> np.ndarray:
        """Grid values of the quantity in wet cells, never 0."""
        if ends is None:
            raise LavaError(f'layers.{self.name}.range', None, 'two numbers [low, high]')
        low, high = ends
        first, last = self.scale
        gain = np.float32((last - first) / (high - low))
        scaled = np.rint(np.float32(first) + (quantity - np.float32(low)) * gain)
        least, most = sorted(self.scale)
        return np.clip(np.where(np.isnan(scaled), last, scaled), max(1, least), most)

    def _raw(self, source: str, snapshot: 'Shown') -> np.ndarray:
        if isinstance(snapshot, Forecast) and source == ARRIVAL:
            unknown = np.isnan(snapshot.thickness)
            return np.where(unknown, np.float32(UNKNOWN), snapshot.arrival)
        wet = self.wet(snapshot)
        dry_value = np.nan if source == 'temperature' else 0.0
        values = np.full(snapshot.thickness.shape, dry_value, dtype=np.float32)
        values[wet] = self._quantity(source, snapshot.thickness[wet], snapshot.temperature[wet])
        values[np.isnan(snapshot.thickness)] = np.nan
        return values

    def _quantity(
        self, source: str, thickness: np.ndarray, temperature: np.ndarray
    ) -> np.ndarray:
        """A quantity in wet cells alone: they are few."""
        if source == 'thickness':
            return thickness
        if source == 'temperature':
            return temperature - np.float32(ZERO_CELSIUS)
        return hazard(
            thickness,
            temperature,
            lethal_thickness=self.hazard.lethal_thickness,
            safe_temperature=self.hazard.safe_temperature,
            lethal_temperature=self.hazard.lethal_temperature,
        )


def load_layers(path: str | Path) -> tuple[Layer, ...]:
    """Read a file of msg_configs/.

    Raises:
        LavaError: The file cannot be read, or a key or value in it is wrong.
    """
    import yaml

    try:
        data = yaml.safe_load(Path(path).read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise LavaError('msg_config', str(path), f'a readable YAML file ({error})') from error
    return layers_from_dict(data)


def layers_from_dict(data: object) -> tuple[Layer, ...]:
    """Build the layers from the plain data of a YAML file.

    Raises:
        LavaError: A key or value is wrong; the message names it and what is allowed.
    """
    top = validation.keys('msg_config', data, allowed=['layers'], required=['layers'])
    entries = top['layers']
    if not isinstance(entries, Mapping) or not entries:
        raise LavaError('layers', entries, 'a mapping of layer names to layers')
    layers = tuple(_layer(str(name), entry) for name, entry in entries.items())
    topics: dict[str, str] = {}
    for layer in layers:
        if layer.topic in topics:
            raise LavaError(
                f'layers.{layer.name}.topic',
                layer.topic,
                f'a topic of its own: layer {topics[layer.topic]} has this one',
            )
        topics[layer.topic] = layer.name
    return layers


def switched(layers: Sequence[Layer], *, on: Sequence[str], off: Sequence[str]) -> list[Layer]:
    """Enable and disable layers by their names.

    Args:
        layers: The layers of a file.
        on: Names of those that are published whatever the file says.
        off: Names of those that are not.

    Raises:
        LavaError: A name is none of a layer, or stands in both lists.
    """
    known = [layer.name for layer in layers]
    for field_name, names in (('layers_on', on), ('layers_off', off)):
        for name in names:
            validation.choice(field_name, name, known)
    for name in off:
        if name in on:
            raise LavaError('layers_off', name, 'a layer that is not in layers_on as well')
    return [
        replace(layer, enabled=layer.name in on or (layer.enabled and layer.name not in off))
        for layer in layers
    ]


def _layer(name: str, entry: object) -> Layer:
    where = f'layers.{name}'
    allowed = [item.name for item in fields(Layer) if item.name != 'name']
    data = validation.keys(where, entry, allowed=allowed, required=['source', 'message'])
    message = MESSAGES[validation.choice(f'{where}.message', data['message'], MESSAGES)]
    sources = (LAVA,) if message in (POINT_CLOUD, GRID_MAP) else (*SOURCES, *FORECAST_SOURCES)
    source = validation.choice(f'{where}.source', data['source'], sources)
    topic = data.get('topic', name)
    if not isinstance(topic, str) or not _TOPIC.fullmatch(topic):
        raise LavaError(
            f'{where}.topic', topic, 'a relative topic name: letters, digits, _ and / between'
        )
    result: dict[str, Any] = {
        'name': name,
        'topic': topic,
        'source': source,
        'message': message,
        'threshold': validation.number(
            f'{where}.threshold', data.get('threshold', 0.1), at_least=0.0, unit='m'
        ),
        'enabled': _switch(f'{where}.enabled', data.get('enabled', True)),
        'rate': validation.number(
            f'{where}.rate', data.get('rate', 1.0), at_least=0.001, at_most=50.0, unit='Hz'
        ),
        'record': _switch(f'{where}.record', data.get('record', True)),
        'qos': _qos(f'{where}.qos', data.get('qos', {})),
    }
    if message == OCCUPANCY_GRID:
        if 'step' in data:
            result['step'] = _step(where, source, data)
        else:
            result['range'] = _range(where, source, data)
            usual = (100, 0) if source == ARRIVAL else (0, 100)
            result['scale'] = _scale(f'{where}.scale', data.get('scale', usual))
        result['margin'] = validation.number(
            f'{where}.margin', data.get('margin', 0.0), at_least=0.0, at_most=MOST_MARGIN, unit='m'
        )
        if source == ARRIVAL and result['margin'] and 'step' not in data:
            raise LavaError(f'{where}.margin', result['margin'], 'absent, or beside step')
        result['outside'] = _integer(
            f'{where}.outside', data.get('outside', -1), lowest=-1, highest=100
        )
    else:
        for key in ('range', 'scale', 'step', 'margin', 'outside'):
            if key in data:
                raise LavaError(
                    f'{where}.{key}', data[key], 'absent: only a grid scales the values'
                )
    if source.endswith('hazard') or message == GRID_MAP:
        result['hazard'] = _hazard_limits(f'{where}.hazard', data.get('hazard', {}))
    elif 'hazard' in data:
        right = 'absent unless source is hazard or the message a GridMap'
        raise LavaError(f'{where}.hazard', data['hazard'], right)
    return Layer(**result)


def _step(where: str, source: str, data: Mapping[str, object]) -> float:
    for key in ('range', 'scale'):
        if key in data:
            raise LavaError(f'{where}.{key}', data[key], 'absent beside step')
    return validation.number(f'{where}.step', data['step'], unit=_unit(source))


def _scale(where: str, value: object) -> tuple[int, int]:
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise LavaError(where, value, 'two whole numbers, the grid values at the ends of range')
    first, last = (
        _integer(f'{where}[{index}]', item, lowest=0, highest=100)
        for index, item in enumerate(value)
    )
    if max(first, last) == 0:
        raise LavaError(where, value, 'a value above 0 at one end: 0 says that there is no lava')
    return (first, last)


def _unit(source: str) -> str:
    return _UNITS[source.removeprefix(PEAK)]


def _range(where: str, source: str, data: Mapping[str, object]) -> tuple[float, float] | None:
    unit = _unit(source)
    if 'range' not in data and source == ARRIVAL:
        return None
    if 'range' not in data and source.endswith('hazard'):
        return (0.0, 100.0)
    value = data.get('range')
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise LavaError(f'{where}.range', value, f'two numbers [low, high] {unit}')
    low = validation.number(f'{where}.range[0]', value[0], unit=unit)
    high = validation.number(f'{where}.range[1]', value[1], above=low, unit=unit)
    return (low, high)


def _qos(where: str, value: object) -> Qos:
    data = validation.keys(where, value, allowed=[item.name for item in fields(Qos)])
    default = Qos()
    return Qos(
        reliability=validation.choice(
            f'{where}.reliability', data.get('reliability', default.reliability), RELIABILITIES
        ),
        durability=validation.choice(
            f'{where}.durability', data.get('durability', default.durability), DURABILITIES
        ),
        depth=_integer(f'{where}.depth', data.get('depth', default.depth), lowest=1, highest=1000),
    )


def _hazard_limits(where: str, value: object) -> HazardLimits:
    data = validation.keys(where, value, allowed=[item.name for item in fields(HazardLimits)])
    default = HazardLimits()
    safe = validation.number(
        f'{where}.safe_temperature',
        data.get('safe_temperature', default.safe_temperature - ZERO_CELSIUS),
        at_least=-ZERO_CELSIUS,
        unit='Celsius',
    )
    lethal = validation.number(
        f'{where}.lethal_temperature',
        data.get('lethal_temperature', default.lethal_temperature - ZERO_CELSIUS),
        above=safe,
        unit='Celsius',
    )
    return HazardLimits(
        lethal_thickness=validation.number(
            f'{where}.lethal_thickness',
            data.get('lethal_thickness', default.lethal_thickness),
            above=0.0,
            unit='m',
        ),
        safe_temperature=safe + ZERO_CELSIUS,
        lethal_temperature=lethal + ZERO_CELSIUS,
    )


def _switch(where: str, value: object) -> bool:
    if not isinstance(value, bool):
        raise LavaError(where, value, 'true or false')
    return value


def _integer(where: str, value: object, *, lowest: int, highest: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not lowest <= value <= highest:
        raise LavaError(where, value, f'a whole number from {lowest} to {highest}')
    return value
