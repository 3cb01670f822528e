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

"""Files of msg_configs/ -> layers."""

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
import re
from typing import Any

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.layers import (
    ARRIVAL,
    DURABILITIES,
    ENSEMBLE_SOURCES,
    FORECAST_SOURCES,
    GRID_MAP,
    HazardLimits,
    LAVA,
    Layer,
    MESSAGES,
    MOST_MARGIN,
    OCCUPANCY_GRID,
    plain_source,
    POINT_CLOUD,
    PROBABILITY,
    Qos,
    RELIABILITIES,
    SOURCES,
    ZERO_CELSIUS,
)

_UNITS = {
    'thickness': 'm',
    'temperature': 'Celsius',
    'hazard': 'hazard',
    ARRIVAL: 's',
    PROBABILITY: '%',
}

_TOPIC = re.compile(r'[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*')


def load_layers(path: str | Path) -> tuple[Layer, ...]:
    """Read a file of msg_configs/.

    Raises:
        LavaError: The file cannot be read, or a key or value in it is wrong.
    """
    from lava_ros.yaml_files import read_yaml

    return layers_from_dict(read_yaml('msg_config', path))


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
    alone = (*SOURCES, *FORECAST_SOURCES, *ENSEMBLE_SOURCES)
    sources = (LAVA,) if message in (POINT_CLOUD, GRID_MAP) else alone
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
        elif source == PROBABILITY:
            _refuse(where, data, ('range', 'scale'), 'absent: a probability is 0 to 100 as it is')
        else:
            result['range'] = _range(where, source, data)
            usual = (100, 0) if plain_source(source) == ARRIVAL else (0, 100)
            result['scale'] = _scale(f'{where}.scale', data.get('scale', usual))
        result['margin'] = validation.number(
            f'{where}.margin', data.get('margin', 0.0), at_least=0.0, at_most=MOST_MARGIN, unit='m'
        )
        is_exact = plain_source(source) in (ARRIVAL, PROBABILITY)
        if is_exact and result['margin'] and 'step' not in data:
            raise LavaError(f'{where}.margin', result['margin'], 'absent, or beside step')
        result['outside'] = _integer(
            f'{where}.outside', data.get('outside', -1), lowest=-1, highest=100
        )
    else:
        scaling = ('range', 'scale', 'step', 'margin', 'outside')
        _refuse(where, data, scaling, 'absent: only a grid scales the values')
    if source.endswith('hazard') or message == GRID_MAP:
        result['hazard'] = _hazard_limits(f'{where}.hazard', data.get('hazard', {}))
    elif 'hazard' in data:
        right = 'absent unless source is hazard or the message a GridMap'
        raise LavaError(f'{where}.hazard', data['hazard'], right)
    return Layer(**result)


def _step(where: str, source: str, data: Mapping[str, object]) -> float:
    _refuse(where, data, ('range', 'scale'), 'absent beside step')
    return validation.number(f'{where}.step', data['step'], unit=_unit(source))


def _refuse(where: str, data: Mapping[str, object], keys: Sequence[str], right: str) -> None:
    for key in keys:
        if key in data:
            raise LavaError(f'{where}.{key}', data[key], right)


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
    return _UNITS[plain_source(source)]


def _range(where: str, source: str, data: Mapping[str, object]) -> tuple[float, float] | None:
    unit = _unit(source)
    if 'range' not in data and plain_source(source) == ARRIVAL:
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
