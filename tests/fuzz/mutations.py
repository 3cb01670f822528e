# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Valid files in which one part is changed: a key, a column, an attribute, a row or bytes.

A document is a tree of mappings and lists, with functions that write and read its file. All
documents get the same kinds of changes.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
import copy
from functools import reduce
import json
import math
from operator import getitem
from pathlib import Path
import random
from typing import Any, NamedTuple

import numpy as np
from rasterio.crs import CRS
import yaml

from eruption import LAVA, write_case
from files.test_rasters import FILES, write_format
from fuzz.bags import FLOATS, INTEGERS, TEXTS
from lava_ros.files.columns import COLUMNS
from lava_ros.files.yaml import dump_yaml
from lava_ros.hindcast.case import load_case
from lava_ros.layers.layer_files import load_layers
from lava_ros.scene import scene_from_yaml
from lava_ros.scene.effusion_rates import read_effusion_rates
from lava_ros.scene.given_vents import GivenVents
from lava_ros.scene.reshaping import read_barriers
from lava_ros.scene.scene import scene_to_dict
from lava_ros.scene.terrain_files import load_terrain, NPZ_KEYS
from scene.test_vent_files import DRIVERS, FISSURE, POINTS, TERRAIN
from scene.test_vent_files import write as write_vector

#: Heights [m] with a cell without data, row 0 in the north.
GROUND = np.add.outer(3.0 * np.arange(6.0), np.arange(7.0)).astype(np.float32)
GROUND[2, 3] = -9999.0


class Document(NamedTuple):
    """A valid file.

    Attributes:
        kind: Row in the table of a night.
        tree: Its parts, none if only its bytes are changed.
        write: Writes a tree into a folder; returns the path of the file.
        read: Reads a file; equal results have equal representations.
        needed: Paths of the parts that are required.
        depth: Levels of the tree that have names.
        is_table: True if the values are columns of a table.
        is_header: True for the lines of a header: their order may matter, and most are numbers.
    """

    kind: str
    tree: dict[str, Any]
    write: Callable[[Path, Any], Path]
    read: Callable[[Path], Any]
    needed: tuple[tuple[Any, ...], ...] = ()
    depth: int = 1
    is_table: bool = False
    is_header: bool = False


def _ground(path: Path) -> Any:
    found = load_terrain(path)
    known = (found.resolution, found.origin, found.epsg, found.wkt, found.offset, found.source)
    return *known, found.elevation.tolist()


def _npz(folder: Path, tree: Any) -> Path:
    path = folder / 'ground.npz'
    np.savez(path, **{name or 'empty': np.asarray(value) for name, value in tree.items()})
    return path


def _header(folder: Path, tree: Any, suffix: str) -> Path:
    lines = ''.join(f'{name} {value}\n' for name, value in tree.items())
    path = folder / f'ground{suffix}'
    if suffix == '.asc':
        heights = '\n'.join(' '.join(f'{value:g}' for value in row) for row in GROUND)
        path.write_text(f'{lines}{heights}\n', encoding='utf-8')
    else:
        path.with_suffix('.hdr').write_text(lines, encoding='utf-8')
        path.write_bytes(GROUND.tobytes())
    path.with_suffix('.prj').write_text(CRS.from_epsg(32633).to_wkt(version='WKT1_ESRI'))
    return path


def _vector(ending: str) -> Callable[[Path, Any], Path]:
    return lambda folder, tree: write_vector(folder / f'a.{ending}', 'MultiPoint', POINTS, tree)


def _json(folder: Path, tree: Any) -> Path:
    path = folder / 'a.geojson'
    path.write_text(json.dumps(tree), encoding='utf-8')
    return path


def _table(separator: str) -> Callable[[Path, Any], Path]:
    def write(folder: Path, tree: Any) -> Path:
        rows = [tree.keys(), *zip(*tree.values(), strict=True)]
        lines = (separator.join(map(str, row)) for row in rows)
        path = folder / 'table.csv'
        path.write_text('\n'.join(lines) + '\n', encoding='utf-8')
        return path

    return write


def _vents(path: Path) -> Any:
    return GivenVents((), path, None, {}, str).rows(TERRAIN)


def _barriers(path: Path) -> Any:
    usual = {'height': None, 'width': 10.0, 'slope': 1.0}
    return read_barriers('--lines', path, TERRAIN, usual)


def _scene(folder: Path, tree: Any) -> Path:
    _npz(folder, {'elevation': np.maximum(GROUND, 0.0), 'resolution': 10.0})
    return _yaml(folder / 'scene.yaml', tree)


def _yaml(path: Path, tree: Any) -> Path:
    path.write_text(dump_yaml(tree, allow_unicode=True), encoding='utf-8')
    return path


def _known_case(path: Path) -> Any:
    case = load_case(path.parent)
    known = (case.title, case.source, case.start, case.end, case.volume, case.low_pass)
    return *known, [event.text for event in case.scene.events], _of_scene(case.scene)


def _of_scene(scene: Any) -> Any:
    # the ground may have cells without data
    return scene_to_dict(scene), np.nan_to_num(scene.terrain.elevation, nan=-1.0).tolist()


_FACTOR = {'distribution': 'lognormal', 'median': 1.0, 'factor': 1.5}

_ATTRIBUTES = {
    'name': 'Fessura', 'effusion_rate': 30.0, 'temperature': 1350.0, 'radius': 25.0,
    'start': 60.0, 'end': 7200.0,
}

_PLACES = {'x': ['500100', '500300', '500700'], 'y': ['4180100', '4180500', '4180900']}

DOCUMENTS = (
    Document(
        'rasters', {
            'elevation': np.maximum(GROUND, 5.0), 'resolution': 10.0, 'epsg': 32633,
            'origin': (20.0, 30.0), 'offset': (500_000.0, 4_180_000.0), 'source': 'a survey',
        },
        _npz, _ground, (('elevation',), ('resolution',)),
    ),
    Document(
        'rasters', {
            'ncols': 7, 'nrows': 6, 'xllcorner': 500_000.0, 'yllcorner': 4_180_000.0,
            'cellsize': 10.0, 'NODATA_value': -9999,
        },
        lambda folder, tree: _header(folder, tree, '.asc'), _ground,
        (('ncols',), ('nrows',), ('xllcorner',), ('yllcorner',), ('cellsize',)), is_header=True,
    ),
    Document(
        'rasters', {
            'NROWS': 6, 'NCOLS': 7, 'NBANDS': 1, 'NBITS': 32, 'PIXELTYPE': 'FLOAT',
            'BYTEORDER': 'I', 'LAYOUT': 'BIL', 'ULXMAP': 500_005.0, 'ULYMAP': 4_180_055.0,
            'XDIM': 10.0, 'YDIM': 10.0, 'NODATA': -9999,
        },
        lambda folder, tree: _header(folder, tree, '.flt'), _ground,
        (('NROWS',), ('NCOLS',), ('ULXMAP',), ('ULYMAP',), ('XDIM',), ('YDIM',)), is_header=True,
    ),
    *(
        Document('rasters', {}, lambda folder, _, name=name: write_format(folder, name), _ground)
        for name in FILES if name != 'SRTM'
    ),
    *(Document('vectors', _ATTRIBUTES, _vector(ending), _vents) for ending in DRIVERS),
    Document(
        'vectors', {'name': 'dam', 'height': 12.0, 'width': 15.0, 'slope': 1.5},
        lambda folder, tree: write_vector(folder / 'a.gpkg', 'MultiLineString', FISSURE, tree),
        _barriers, (('height',),),
    ),
    Document(
        'vectors', {
            'type': 'FeatureCollection', 'name': 'fissures',
            'crs': {'type': 'name', 'properties': {'name': 'urn:ogc:def:crs:EPSG::32633'}},
            'features': [{
                'type': 'Feature', 'id': 7, 'properties': _ATTRIBUTES,
                'geometry': {'type': 'LineString', 'coordinates': POINTS},
            }],
        },
        _json, _vents, (('type',), ('features',), ('features', 0, 'type'),
                        ('features', 0, 'geometry'), ('features', 0, 'geometry', 'type')),
        depth=5,
    ),
    Document(
        'tables', {
            **_PLACES, 'name': ['a', 'b', 'c'], 'effusion_rate': ['5', '6.5', '8'],
            'temperature': ['1350', '1360', '1370'], 'radius': ['10', '20', '30'],
            'start': ['0', '60', '120'], 'end': ['900', '1800', '3600'],
        },
        _table(','), _vents, (('x',), ('y',)), is_table=True,
    ),
    Document(
        'tables', {
            'start': ['0', '600', '1200'], 'end': ['600', '1200', '1800'],
            'effusion_rate': ['5', '6.5', '3'], 'error': ['1', '2', '0.5'],
        },
        _table(';'), lambda path: read_effusion_rates('--effusion-rate', path),
        (('start',), ('end',), ('effusion_rate',)), is_table=True,
    ),
    Document(
        'tables', {
            'date': ['2021-09-19', '2021-09-20', '2021-09-22T12:00:00Z'],
            'cumulative_volume': ['0', '1e6', '1.5e6'],
        },
        _table(' '), lambda path: read_effusion_rates('--effusion-rate', path),
        (('date',), ('cumulative_volume',)), is_table=True,
    ),
    Document(
        'YAML', {
            'terrain': {
                'file': 'ground.npz', 'epsg': 32633, 'offset': [100.0, 200.0], 'nodata': 9.0,
                'resolution': 5.0, 'window': [0.0, 0.0, 70.0, 50.0],
            },
            'vents': [{
                'name': 'a', 'position': [-65.0, -165.0], 'radius': 12.0, 'temperature': 1400.0,
                'effusion_rate': [[0.0, 3.0], [60.0, 0.0]],
            }],
            'lava': {'material': 'etna_basalt', 'density': 2610.0, 'viscosity': 2e4},
            'gravity': 9.7, 'ambient_temperature': 290.0,
            'uncertainty': {'effusion_rate': _FACTOR, 'position': {'radius': 5.0}},
        },
        _scene, lambda path: _of_scene(scene_from_yaml(path)),
        (('terrain',), ('terrain', 'file')), depth=4,
    ),
    Document(
        'YAML', {
            'title': 'a case', 'source': 'a survey', 'epsg': 32633, 'start': 60.0, 'end': 1700.0,
            'lava': {**yaml.safe_load(LAVA)['lava'], 'material': 'etna_basalt'},
            'low_pass': 25.0, 'vent_temperature': 1380.0, 'vent_radius': 45.0,
            'uncertainty': {'effusion_rate': _FACTOR}, 'effusion_rate': {'porosity': 0.2},
            'events': [{'time': 900.0, 'barrier': {
                'line': [[500_300.0, 4_180_500.0], [500_500.0, 4_180_500.0]], 'height': 5.0,
                'width': 10.0,
            }}],
        },
        lambda folder, tree: _yaml(write_case(folder / 'case', hours=0.5) / 'case.yaml', tree),
        _known_case, depth=4,
    ),
    Document(
        'YAML', {'layers': {
            'height': {
                'topic': 'thick', 'source': 'thickness', 'message': 'nav_msgs/OccupancyGrid',
                'range': [0.0, 12.0], 'threshold': 0.2, 'outside': 5, 'rate': 2.0,
                'enabled': False, 'record': False, 'min_cells': 20, 'heartbeat': 9.0,
                'qos': {'reliability': 'best_effort', 'durability': 'volatile', 'depth': 3},
            },
            'danger': {
                'source': 'hazard', 'message': 'nav_msgs/OccupancyGrid', 'margin': 15.0,
                'hazard': {'lethal_thickness': 0.7, 'safe_temperature': 60.0,
                           'lethal_temperature': 320.0},
            },
        }},
        lambda folder, tree: _yaml(folder / 'layers.yaml', tree),
        lambda path: sorted(map(repr, load_layers(path))), (('layers',),), depth=4,
    ),
)

KINDS = tuple(dict.fromkeys(item.kind for item in DOCUMENTS))

#: New values. The usual ones may equal the default.
_USUAL = (None, '', ' ', True, False, 0, -1, [], {})
_VALUES = (
    'text', '12', '1,5', '1e3', '2021-09-19', '017', '1:30', math.nan, math.inf, -math.inf, 1e300,
    -1e300, 12, 1.5, [1.0], [1.0, 'a'], {'a': 1}, [[0.0, 1.0]] * 3, 'ä' * 300, '\x07',
)

#: Units that no column has.
_UNITS = ('furlong', 'stone', '?')

#: Parts to add, by kind; ``remark`` is unknown in all of them.
_MORE = {
    'rasters': (*NPZ_KEYS[:-1], 'remark', 'CELLSIZE', 'cellsize', 'dx', 'XLLCENTER', 'nodata'),
    'vectors': (*COLUMNS, 'remark'), 'tables': (*COLUMNS, 'remark'),
    'YAML': ('remark', 'discharge', 'projected', 'end', 'material', 'step', 'classes', 'scale',
             'terrain', 'barrier', 'solidus', 'file', 'nodata'),
}


class Change(NamedTuple):
    """A changed document, and the expectation of its result.

    Attributes:
        tree: The changed parts.
        action: The change, in words.
        without: The parts without the changed or added one, None for other changes.
        named: Texts, one of which a warning must contain if the change has no effect.
        same: True if the result equals that of the valid file, False if not, None if either.
        is_refused: True if every result is wrong.
    """

    tree: Any
    action: str
    without: Any = None
    named: tuple[str, ...] = ()
    same: bool | None = None
    is_refused: bool = False


def _paths(tree: Any, depth: int, above: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    if depth and isinstance(tree, dict | list):
        for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree):
            if isinstance(tree, dict):
                yield *above, key
            yield from _paths(value, depth - 1, (*above, key))


def _with(tree: Any, path: tuple[Any, ...], edit: Callable[[Any, Any], Any]) -> Any:
    """Return a copy of a tree in which ``edit`` changed the container of a path's last key."""
    if len(path) == 1:
        return edit(copy.deepcopy(tree), path[0])
    result = copy.copy(tree)
    result[path[0]] = _with(tree[path[0]], path[1:], edit)
    return result


def _without(part: Any, key: Any) -> Any:
    return {name: value for name, value in part.items() if name != key}


def _misspelt(chance: random.Random, name: str) -> str:
    place = chance.randrange(len(name))
    return chance.choice((
        name[:place] + name[place + 1 :], name[:place] + name[place] + name[place:],
        name.upper(), name.title(), name.replace('_', ''), name.replace('_', ' '), f'{name}_2',
        f'{name}s', f'my_{name}', f' {name}', name[::-1], f'{name}\u00e9', name.swapcase(),
    ))


def change(chance: random.Random, document: Document) -> Change:
    """Change one part of a document."""
    tree = document.tree
    path = chance.choice(list(_paths(tree, document.depth)))
    name, shown = path[-1], '.'.join(map(str, path))
    without = _with(tree, path, _without)
    kinds = [*['rename', 'set'] * 3, 'drop', 'order', 'add']
    action = chance.choice(kinds + ['unit', 'row', 'cut'] * document.is_table)
    if action == 'drop':
        return Change(without, f'{shown} is dropped', is_refused=path in document.needed)
    if action == 'add':
        new = chance.choice(_MORE[document.kind])
        value: Any = ['7'] * len(tree[name]) if document.is_table else 7
        # the current GeoJSON has no such objects
        if new in reduce(getitem, path[:-1], tree) or 'crs' in path[:-1]:
            return Change(without, f'{shown} is dropped', is_refused=path in document.needed)
        changed = _with(tree, path, lambda part, _: {**part, new: value})
        return Change(changed, f'{new} is added next to {shown}', tree, (new, new[:10]))
    if action == 'order':
        return Change(_with(tree, path, lambda part, _: dict(reversed(part.items()))),
                      f'the order at {shown}', same=None if document.is_header else True)
    if action == 'rename':
        new = _misspelt(chance, name)
        changed = _with(tree, path, lambda part, key: {
            new if item == key else item: value for item, value in part.items()
        })
        # a Shapefile cuts names to ten letters
        return Change(changed, f'{shown} becomes {new!r}', without, (new.strip(), new[:10]))
    if action == 'unit':
        units = COLUMNS['time' if name == 'date' else name][1]
        unit = chance.choice((*units, *_UNITS)) if units else 'm'
        new = f'{name} ({unit})'
        changed = {new if item == name else item: value for item, value in tree.items()}
        # Celsius has no factor, and dates have no unit
        same = units[unit] == 1.0 if units and unit in units else None
        if name in ('date', 'temperature', 'error', 'start', 'end') or not units:
            same = None
        return Change(changed, f'{shown} becomes {new!r}', named=(new,), same=same,
                      is_refused=bool(units) and unit in _UNITS)
    if action in ('row', 'cut'):
        row = chance.randrange(len(tree[name]))
        if action == 'cut':
            cut = {item: cells[:row] for item, cells in tree.items()}
            return Change(cut, f'rows at and after {row} are missing', same=False)
        more = {item: [*cells, cells[row]] for item, cells in tree.items()}
        # any warning
        return Change(more, f'row {row} is repeated', more, ('',))
    value = chance.choice((*_USUAL, *_VALUES))
    named = (str(name), str(value)) if value in _VALUES else None
    if document.is_table:
        row = chance.randrange(len(tree[name]))
        value = '' if value is None else str(value)
        value = [value if index == row else cell for index, cell in enumerate(tree[name])]
    elif document.kind == 'vectors' and document.depth == 1:
        # some formats lack lists, dates and infinite numbers; in KML names are text
        is_text = value in _VALUES and (name == 'name' or not _is_number(value))
        value = f'text: {value}' if is_text else value
        value = json.dumps(value) if isinstance(value, list | dict) else value
    changed = _with(tree, path, lambda part, key: {**part, key: value})
    is_refused = document.is_header and not _is_number(value) and not name.startswith('NODATA')
    return Change(changed, f'{shown} becomes {value!r}', without if named else None, named or (),
                  is_refused=is_refused)


def _is_number(value: Any) -> bool:
    with suppress(ValueError):
        return math.isfinite(float(str(value)))
    return False


def insane(chance: random.Random, document: Document) -> Any:
    """Return the parts of a document with an extreme value in place of one."""
    path = chance.choice([*_paths(document.tree, document.depth)])
    value: Any = chance.choice((*INTEGERS, *FLOATS, *TEXTS, [1.0, {'time': []}], {'line': 1}))
    if document.is_table:
        value = [str(value), *document.tree[path[-1]][1:]]
    return _with(document.tree, path, lambda part, key: {**part, key: value})


def damaged(chance: random.Random, content: bytes) -> bytes:
    """Change, remove or repeat some bytes."""
    data = bytearray(content)
    for _ in range(chance.choice((1, 1, 2, 8))):
        place = chance.randrange(len(data))
        action = chance.random()
        if action < 0.6:
            flipped = data[place] ^ 1 << chance.randrange(8)
            data[place] = chance.choice((0, 255, 10, 44, 48, flipped))
        elif action < 0.8:
            del data[place : place + chance.choice((1, 2, 16, len(data)))]
        else:
            data[place:place] = data[place : place + chance.randrange(40)]
        data = data or bytearray(b' ')
    return bytes(data)
