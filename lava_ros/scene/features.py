# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Points, lines and polygons from files, in the coordinates of a terrain."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
import logging
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.files import vectors
from lava_ros.files.columns import understood
from lava_ros.files.csv import read_table
from lava_ros.scene.projection import DEGREES, in_degrees, on_terrain
from lava_ros.scene.terrain import MAX_COORDINATE, Terrain
from lava_ros.scene.typed_places import likely_place

_LOG = logging.getLogger(__name__)

#: Suffixes of tables, and of all files that can be read.
TABLES = ('.csv', '.tsv', '.txt')
ENDINGS = (*vectors.ENDINGS, *TABLES)

#: Columns of a table with coordinates, in the terrain's system and in degrees.
PLACES = (('x', 'y'), ('lon', 'lat'))


@dataclass(frozen=True, eq=False)
class Feature:
    """A ``Point``, ``LineString`` or ``Polygon``.

    ``rings`` are coordinates in ``system``, shape [places, 2]: one array, or the outer ring and
    the holes of a polygon. If ``system`` is None, they are eastings and northings [m] of the
    terrain, or degrees if ``in_degrees`` is True and the feature is then on the terrain. ``where``
    is the name in errors; the parts of one feature have the same. ``given`` are the coordinates of
    the first ring as in the file, for errors.
    """

    where: str
    kind: str
    rings: tuple[np.ndarray, ...]
    properties: Mapping[str, Any]
    system: str | None = None
    given: Sequence[Sequence[float]] = ()

    @property
    def name(self) -> str:
        """Name of the feature; may be empty."""
        return _name(self.properties)

    def on(self, terrain: Terrain) -> 'Feature':
        """Return the feature in the system of a terrain; raise LavaError if not possible."""
        places = np.concatenate(self.rings)
        if self.system is None and not in_degrees(terrain, *places):
            return self
        system = self.system or DEGREES
        try:
            places = on_terrain(terrain, places, system, self.where, f'places of {system}')
        except LavaError as error:
            x, y = self.given[0][:2]
            expected = f'{error.expected}{likely_place(terrain, x, y, self.system)}'
            raise LavaError(self.where, error.value, expected) from None
        if self.system is None and not terrain.covered(places - terrain.offset).any():
            return self
        ends = np.cumsum([len(ring) for ring in self.rings])[:-1]
        return replace(self, rings=tuple(np.split(places, ends)), system=None)


def _name(properties: Mapping[str, Any]) -> str:
    # the first of several columns with a name counts
    known = (header for header in properties if understood('', [header], ['name'])[0])
    return next((str(properties[header]) for header in known if properties[header]), '')


def _label(where: str, properties: Mapping[str, Any]) -> str:
    """Return the position of a feature in its file, and its name if any, for errors."""
    return f'{where} ({name})' if (name := _name(properties)) else where


def read_features(field: str, path: str | Path, terrain: Terrain) -> list[Feature]:
    """Read the features of a file in the system of a terrain.

    Raises:
        LavaError: As in ``load_features``, and if a coordinate system is unknown.
    """
    return [feature.on(terrain) for feature in load_features(field, path)]


def load_features(field: str, path: str | Path) -> list[Feature]:
    """Read the features of a file; a multipart feature becomes several features.

    The file is one of ``vectors.FORMATS``, or a table with the columns ``x,y`` (or their synonyms
    in ``columns.COLUMNS``) in the terrain's system, ``lon,lat`` in degrees, or well-known text. A
    row with ``x_end,y_end`` or ``lon_end,lat_end`` is a line. Features without a coordinate system
    are in that of the terrain.

    Raises:
        LavaError: If the file cannot be read or has no features. Errors name ``field`` or a
            feature.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in ENDINGS:
        raise LavaError(field, str(path), f'a file whose name ends with {" or ".join(ENDINGS)}')
    is_table = suffix in TABLES
    found = list(_from_table(field, path) if is_table else vectors.read_vectors(field, path))
    if not is_table and any(system is None for _, _, system, _ in found):
        _LOG.warning(f'{path} names no coordinate system: it is taken to be that of the terrain')
    features = []
    for where, geometry, system, properties in found:
        where = _label(where, properties)
        if geometry is None:
            _LOG.warning(f'{where} has no geometry and is left out')
            continue
        for kind, part in _parts(where, geometry):
            given = part if kind == 'Polygon' else [part]
            rings = tuple(np.array(ring, dtype=float) for ring in given)
            # NaN compares as False
            if not (np.abs(np.concatenate(rings)) <= MAX_COORDINATE).all():
                raise LavaError(where, part, f'coordinates of at most {MAX_COORDINATE:g}')
            features.append(Feature(where, kind, rings, properties, system, given[0]))
    if not features:
        raise LavaError(field, str(path), 'a file with at least one point, line or area')
    return features


def load_files(field: str, paths: Sequence[str | Path]) -> dict[str, list[Feature]]:
    """Read the features of files, as ``load_features``, by a unique name of each file.

    The name is that of the file without its suffix, with folders where two files would have the
    same, and then with the suffix.
    """
    names: dict[str, str | Path] = {}
    for path in dict.fromkeys(paths):
        parts = Path(path).resolve().with_suffix('').parts
        tails = ('/'.join(parts[-count:]) for count in range(1, len(parts)))
        names[next((name for name in tails if name not in names), str(path))] = path
    return {name: load_features(field, path) for name, path in names.items()}


def _parts(where: str, geometry: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the kind and coordinates of each part of a geometry; a point is a list of one."""
    kind = str(geometry['type'])
    if kind == 'GeometryCollection':
        for item in geometry['geometries']:
            yield from _parts(where, item)
        return
    single, places = kind.removeprefix('Multi'), geometry.get('coordinates')
    if single not in ('Point', 'LineString', 'Polygon') or not places:
        shown = kind if places else f'an empty {kind}'
        raise LavaError(where, shown, 'a point, a line or an area')
    for part in places if single != kind else [places]:
        yield single, [part] if single == 'Point' else part


def _from_table(field: str, path: Path) -> Iterator[vectors.Item]:
    """Yield the rows of a table as features."""
    rows = read_table(field, path)
    header = list(rows[0][1])
    wanted = [f'{name}{end}' for pair in PLACES for name in pair for end in ('', '_end')]
    columns, _ = understood(str(path), header, wanted)
    pairs = [pair for pair in PLACES if set(pair) <= set(columns)]
    known = ('wkt', 'geometry', 'geom', 'the_geom', 'shape')
    wkt = next((name for name in header if name.lower() in known), None)
    if len(pairs) + (wkt is not None) != 1:
        expected = ' or '.join(','.join(pair) for pair in PLACES)
        raise LavaError(f'{path}, first line', ','.join(header), f'the columns {expected} or wkt')
    if wkt is not None:
        found = vectors.geometries_of_wkt(field, [row[wkt] for _, row in rows])
        for (where, row), geometry in zip(rows, found, strict=True):
            text = row.pop(wkt)
            if geometry is None and text:
                raise LavaError(f'{where}, {wkt}', text, 'well-known text: POINT (500300 4179200)')
            yield where, geometry, None, _non_empty_cells(row)
        return
    (pair,) = pairs

    def place(where: str, row: dict[str, str], end: str) -> list[float] | None:
        known = [columns[name + end] for name in pair if name + end in columns]
        cells = [row.pop(column.header) for column in known]
        if end and not any(cells):
            return None
        if len(cells) < 2 or not all(cells):
            shown = ' and '.join(column.header for column in known)
            raise LavaError(f'{where}, {shown}', tuple(cells), 'both or neither')
        return [column.number(where, cell) for column, cell in zip(known, cells, strict=True)]

    for where, row in rows:
        label = _label(where, row)
        places = [place(label, row, ''), place(label, row, '_end')]
        geometry = {'type': 'LineString', 'coordinates': places}
        if places[1] is None:
            geometry = {'type': 'Point', 'coordinates': places[0]}
        yield where, geometry, None if pair == ('x', 'y') else DEGREES, _non_empty_cells(row)


def _non_empty_cells(row: Mapping[str, str]) -> dict[str, str]:
    return {name: text for name, text in row.items() if text}
