# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Layer configurations: the files of msg_configs/."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
import re
from typing import Any

from lava_ros.bag.qos import LATCHED
from lava_ros.errors import LavaError
from lava_ros.files import keys
from lava_ros.files.keys import Key, Keys, list_of, schema_of
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
from lava_ros.validation import choice, conflict, flag, items, number, surplus, whole

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


#: Checks of the end of a range, and of the grid value at it.
RANGE_CHECK = partial(number, at_least=-MAX_RANGE_END, at_most=MAX_RANGE_END)
SCALE_CHECK = partial(whole, at_least=0, at_most=100)

QOS_KEYS = Keys({
    'reliability': Key(partial(choice, allowed=('reliable', 'best_effort'))),
    'durability': Key(partial(choice, allowed=('transient_local', 'volatile'))),
    'depth': Key(partial(whole, at_least=1, at_most=1000)),
})

HAZARD_KEYS = Keys({
    'lethal_thickness': Key(partial(number, above=0.0, unit='m')),
    'safe_temperature': Key(partial(number, at_least=-ZERO_CELSIUS, unit='Celsius')),
    'lethal_temperature': Key(partial(number, above=-ZERO_CELSIUS, unit='Celsius')),
})

_SOURCES = (*SOURCES, *FORECAST_SOURCES, *ENSEMBLE_SOURCES, ARRIVED, INUNDATED, LAVA)

#: Keys of a layer; msg_configs/default.yaml describes them in full. Checks of the others depend
#: on the source and the message.
LAYER_KEYS = Keys({
    'topic': Key(
        {'type': 'string', 'pattern': f'^{TOPIC.pattern}$'},
        'Relative topic name; the name of the layer if left out',
    ),
    'source': Key(partial(choice, allowed=_SOURCES), 'Quantity that the layer shows', True),
    'message': Key(partial(choice, allowed=tuple(MESSAGES)), 'Type of the messages', True),
    'range': Key(
        list_of(schema_of(RANGE_CHECK), 2, 2),
        'Values [low, high] that map to the ends of scale, in the unit of the source',
    ),
    'scale': Key(
        list_of(schema_of(SCALE_CHECK), 2, 2),
        'Grid values [first, last] at the ends of range; [0, 100] if left out',
    ),
    'step': Key(keys.number(), 'Value of the source at or above which a cell is 100; below it, 0'),
    'classes': Key(
        list_of(keys.number(above=0.0), 1, MAX_CLASSES - 1),
        'Values of the source at which one class ends and the next begins',
    ),
    'margin': Key(
        partial(number, at_least=0.0, at_most=MAX_MARGIN, unit='m'),
        'Clearance around cells with lava [m]; 0 if left out',
    ),
    'threshold': Key(
        partial(number, at_least=0.0, unit='m'),
        'Thickness below which a cell is dry [m]; 0.1 if left out',
    ),
    'outside': Key(
        partial(whole, at_least=-1, at_most=100),
        'Grid value of cells without terrain; -1 if left out',
    ),
    'min_cells': Key(
        partial(whole, at_least=0, at_most=MAX_SIDE_CELLS),
        'Minimum number of columns and of rows; 0 if left out',
    ),
    'heartbeat': Key(
        keys.any_of({'const': 0}, keys.number(at_least=MIN_HEARTBEAT, at_most=MAX_HEARTBEAT)),
        'Wall time after which an unchanged map is sent again [s]; 0: never',
    ),
    'enabled': Key(flag, 'Publish the layer; true if left out'),
    'rate': Key(
        partial(number, at_least=0.001, at_most=50.0, unit='Hz'),
        'Maximum rate of the messages [Hz]; 1 if left out',
    ),
    'record': Key(flag, 'Write the layer to the bag; true if left out'),
    'qos': Key(QOS_KEYS, 'Quality of service of the publisher'),
    'hazard': Key(
        HAZARD_KEYS.as_schema(),
        'Limits between which heat and burial grow from harmless to lethal',
    ),
})

#: Keys of a layer configuration.
FILE_KEYS = Keys({
    'layers': Key({
        'type': 'object', 'minProperties': 1, 'additionalProperties': LAYER_KEYS.as_schema(),
    }, is_required=True),
})


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
    entries = FILE_KEYS.names('msg_config', data)['layers']
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
    data = LAYER_KEYS(where, value)
    result: dict[str, Any] = {'topic': name, **data, 'name': name}
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
        result['qos'] = replace(LATCHED, **data['qos'])
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
    known = HAZARD_KEYS(where, value)
    safe = known.get('safe_temperature', usual.safe_temperature - zero)
    lethal = known.get('lethal_temperature', usual.lethal_temperature - zero)
    lethal = number(f'{where}.lethal_temperature', lethal, above=safe, unit='Celsius')
    thickness = known.get('lethal_thickness', usual.lethal_thickness)
    return HazardLimits(thickness, safe + zero, lethal + zero)
