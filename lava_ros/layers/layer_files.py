# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Layer configurations: the files of msg_configs/."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
import re
from typing import Any

from lava_ros.bag.qos import LATCHED
from lava_ros.errors import LavaError
from lava_ros.files.resources import find_file
from lava_ros.files.yaml import read_yaml
from lava_ros.layers.layer import (
    ARRIVAL,
    ARRIVED,
    ENSEMBLE_SOURCES,
    FORECAST_SOURCES,
    GRID_MAP,
    HazardLimits,
    IMAGE,
    INUNDATED,
    LAVA,
    Layer,
    OCCUPANCY_GRID,
    plain_source,
    POINT_CLOUD,
    PROBABILITY,
    SOURCES,
    ZERO_CELSIUS,
)
from lava_ros.scene import MAX_SIDE_CELLS
from lava_ros.validation import choice, conflict, flag, items, keys, number, surplus, whole

#: Full names of message types, by the names in a file.
MESSAGES = {
    name: full
    for full in (OCCUPANCY_GRID, IMAGE, POINT_CLOUD, GRID_MAP)
    for name in (full.replace('/msg/', '/'), full)
}

_UNITS = {
    'thickness': 'm',
    'temperature': 'Celsius',
    'hazard': 'hazard',
    ARRIVAL: 's',
    ARRIVED: 's',
    INUNDATED: '1',
    PROBABILITY: '%',
}

#: Maximum absolute value of the end of a range, in its unit.
MAX_RANGE_END = 1e12

#: Maximum margin around lava [m].
MAX_MARGIN = 1000.0

#: Minimum and maximum heartbeat of a layer [s].
MIN_HEARTBEAT, MAX_HEARTBEAT = 0.1, 3600.0

#: Maximum number of classes of a layer.
MAX_CLASSES = 20

TOPIC = re.compile(r'[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*')


#: Checks of the keys of a layer, its ``qos`` and its ``hazard`` that depend on no other key.
CHECKS: Mapping[str, Callable[[str, object], Any]] = {
    'message': partial(choice, allowed=tuple(MESSAGES)),
    'source': partial(
        choice, allowed=(
            *SOURCES, *FORECAST_SOURCES, *ENSEMBLE_SOURCES, ARRIVED, INUNDATED, LAVA,
        )
    ),
    'threshold': partial(number, at_least=0.0, unit='m'),
    'enabled': flag,
    'rate': partial(number, at_least=0.001, at_most=50.0, unit='Hz'),
    'record': flag,
    'margin': partial(number, at_least=0.0, at_most=MAX_MARGIN, unit='m'),
    'outside': partial(whole, at_least=-1, at_most=100),
    'min_cells': partial(whole, at_least=0, at_most=MAX_SIDE_CELLS),
    'reliability': partial(choice, allowed=('reliable', 'best_effort')),
    'durability': partial(choice, allowed=('transient_local', 'volatile')),
    'depth': partial(whole, at_least=1, at_most=1000),
    'safe_temperature': partial(number, at_least=-ZERO_CELSIUS, unit='Celsius'),
    'lethal_temperature': partial(number, above=-ZERO_CELSIUS, unit='Celsius'),
    'lethal_thickness': partial(number, above=0.0, unit='m'),
}

#: Keys of ``qos``.
QOS_KEYS = ('reliability', 'durability', 'depth')

#: Checks of the end of a range, and of the grid value at it.
RANGE_CHECK = partial(number, at_least=-MAX_RANGE_END, at_most=MAX_RANGE_END)
SCALE_CHECK = partial(whole, at_least=0, at_most=100)


def find_config(name: str, *, field: str) -> Path:
    """Find a layer configuration by its path, or by its name in msg_configs/.

    Raises:
        LavaError: If there is no such file; the error names ``field``.
    """
    return find_file(name, 'msg_configs', field=field, expected='a readable YAML file')


def load_layers(path: str | Path) -> tuple[Layer, ...]:
    """Read a layer configuration.

    Raises:
        LavaError: If the file is not valid; the error names the key.
    """
    return layers_from_dict(read_yaml('msg_config', path))


def layers_from_dict(data: object) -> tuple[Layer, ...]:
    """Build layers from the plain data of a layer configuration.

    Raises:
        LavaError: If the data are not valid; the error names the key.
    """
    top = keys('msg_config', data, allowed=['layers'], required=['layers'])
    entries = top['layers']
    if not isinstance(entries, Mapping) or not entries:
        raise LavaError('layers', entries, 'a mapping of layer names to layers')
    layers = tuple(_layer(str(name), entry) for name, entry in entries.items())
    topics: dict[str, str] = {}
    for layer in layers:
        if layer.topic in topics:
            expected = f'a different topic: layer {topics[layer.topic]} has this one'
            raise LavaError(f'layers.{layer.name}.topic', layer.topic, expected)
        topics[layer.topic] = layer.name
    return layers


def switched(layers: Sequence[Layer], *, on: Sequence[str], off: Sequence[str]) -> list[Layer]:
    """Enable the layers named in ``on`` and disable the layers named in ``off``.

    Raises:
        LavaError: If a name does not belong to a layer, or is in both lists.
    """
    known = [layer.name for layer in layers]
    for field_name, names in (('layers_on', on), ('layers_off', off)):
        for name in names:
            choice(field_name, name, known)
    for name in off:
        if name in on:
            raise conflict(f'{name} in layers_on', f'{name} in layers_off')
    return [
        replace(layer, enabled=layer.name in on or (layer.enabled and layer.name not in off))
        for layer in layers
    ]


def _layer(name: str, value: object) -> Layer:
    where = f'layers.{name}'
    allowed = [item.name for item in fields(Layer) if item.name != 'name']
    data = keys(where, value, allowed=allowed, required=['source', 'message'])
    result = {'topic': name, **data, **_checked(where, data), 'name': name}
    message = result['message'] = MESSAGES[result['message']]
    known = (*SOURCES, *FORECAST_SOURCES, *ENSEMBLE_SOURCES)
    known += (ARRIVED, INUNDATED) if message == IMAGE else ()
    known = (LAVA,) if message in (POINT_CLOUD, GRID_MAP) else known
    source = choice(f'{where}.source', data['source'], known)
    topic = result['topic']
    if not isinstance(topic, str) or not TOPIC.fullmatch(topic):
        expected = 'a relative topic name: letters, digits, _ and / between'
        raise LavaError(f'{where}.topic', topic, expected)
    if 'heartbeat' in data:
        result['heartbeat'] = _heartbeat(f'{where}.heartbeat', data['heartbeat'])
    if 'qos' in data:
        qos = keys(f'{where}.qos', data['qos'], allowed=QOS_KEYS)
        result['qos'] = replace(LATCHED, **_checked(f'{where}.qos', qos))
    if source in (*FORECAST_SOURCES, *ENSEMBLE_SOURCES):
        _refuse(where, data, ['heartbeat'], 'to forecasts, which are withdrawn, never repeated')
    if message == OCCUPANCY_GRID:
        result |= _scaling(where, data, plain_source(source))
    else:
        scaling = ('range', 'scale', 'step', 'classes', 'margin', 'outside', 'min_cells')
        _refuse(where, data, scaling, 'because only a grid scales the values')
    if source.endswith('hazard') or message == GRID_MAP:
        result['hazard'] = _hazard_limits(f'{where}.hazard', data.get('hazard', {}))
    else:
        reason = 'unless source is hazard or the message a GridMap'
        _refuse(where, data, ['hazard'], reason)
    return Layer(**result)


def _checked(where: str, data: Mapping[str, object]) -> dict[str, Any]:
    """Return the values that ``CHECKS`` checks."""
    return {key: CHECKS[key](f'{where}.{key}', data[key]) for key in data if key in CHECKS}


def _refuse(where: str, data: Mapping[str, object], names: Iterable[str], reason: str) -> None:
    for key in names:
        if key in data:
            raise surplus(f'{where}.{key}', reason)


def _scaling(where: str, data: Mapping[str, object], quantity: str) -> dict[str, Any]:
    """Return the fields of a layer for the values of an occupancy grid."""
    unit = _UNITS[quantity]
    if 'step' in data:
        _refuse(where, data, ('range', 'scale', 'classes'), 'if step is set')
        return {'step': number(f'{where}.step', data['step'], unit=unit)}
    if 'classes' in data:
        _refuse(where, data, ('range', 'scale', 'margin'), 'if classes is set')
        return {'classes': _classes(f'{where}.classes', data['classes'], unit)}
    if quantity in (ARRIVAL, PROBABILITY) and data.get('margin'):
        _refuse(where, data, ['margin'], 'unless step is set')
    if quantity == PROBABILITY:
        _refuse(where, data, ('range', 'scale'), 'to a probability, which is always 0 to 100')
        return {}
    ends = data.get('scale', (100, 0) if quantity == ARRIVAL else (0, 100))
    expected = 'two whole numbers, the grid values at the ends of range'
    two = partial(items, least=2, most=2)
    scale = tuple(SCALE_CHECK(*item) for item in two(f'{where}.scale', ends, expected))
    if max(scale) == 0:
        raise LavaError(f'{where}.scale', ends, 'a value above 0 at one end: 0 means no lava')
    if 'range' not in data and quantity in (ARRIVAL, 'hazard'):
        return {'scale': scale, 'range': None if quantity == ARRIVAL else (0.0, 100.0)}
    expected = f'two numbers [low, high] {unit}'
    first, second = two(f'{where}.range', data.get('range'), expected)
    low = RANGE_CHECK(*first, unit=unit)
    high = RANGE_CHECK(*second, at_least=None, above=low, unit=unit)
    return {'scale': scale, 'range': (low, high)}


def _classes(where: str, value: object, unit: str) -> tuple[float, ...]:
    expected = f'1 to {MAX_CLASSES - 1} numbers {unit}, each larger than the previous'
    bounds: list[float] = []
    for field, item in items(where, value, expected, least=1, most=MAX_CLASSES - 1):
        bounds.append(number(field, item, above=bounds[-1] if bounds else 0.0, unit=unit))
    return tuple(bounds)


def _heartbeat(where: str, value: object) -> float:
    heartbeat = number(where, value, at_least=0.0, unit='s')
    if heartbeat and not MIN_HEARTBEAT <= heartbeat <= MAX_HEARTBEAT:
        expected = f'0 s for none, or {MIN_HEARTBEAT:g} to {MAX_HEARTBEAT:g} s'
        raise LavaError(where, value, expected)
    return heartbeat


def _hazard_limits(where: str, value: object) -> HazardLimits:
    usual, zero = HazardLimits(), ZERO_CELSIUS
    data = keys(where, value, allowed=[item.name for item in fields(HazardLimits)])
    known = _checked(where, data)
    safe = known.get('safe_temperature', usual.safe_temperature - zero)
    lethal = known.get('lethal_temperature', usual.lethal_temperature - zero)
    lethal = number(f'{where}.lethal_temperature', lethal, above=safe, unit='Celsius')
    thickness = known.get('lethal_thickness', usual.lethal_thickness)
    return HazardLimits(thickness, safe + zero, lethal + zero)
