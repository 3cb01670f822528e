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


"""Points, lines and areas of others come to the terrain's coordinates."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rasterio.warp import transform

from lava_ros.errors import LavaError
from lava_ros.forecast.rasters import seen_in_file
from lava_ros.scene import Terrain
from lava_ros.scene.features import read_features

#: A square kilometre on the central meridian of UTM zone 33.
TERRAIN = Terrain(np.zeros((50, 50)), 20.0, epsg=32633, offset=(500_000.0, 4_180_000.0))

#: A place on it [degrees], and the same in metres.
DEGREES = (15.001, 37.769)
(_X,), (_Y,) = transform('EPSG:4326', 'EPSG:32633', [DEGREES[0]], [DEGREES[1]])
METRES = [[_X, _Y]]


def features(path: Path, **members: Any) -> Path:
    """A GeoJSON file with a geometry for each name."""
    items = [
        {'type': 'Feature', 'properties': {'name': name}, 'geometry': geometry}
        for name, geometry in members.pop('of').items()
    ]
    path.write_text(json.dumps({'type': 'FeatureCollection', 'features': items, **members}))
    return path


@pytest.mark.parametrize(
    ('header', 'row'),
    [
        ('x,y,name', f'{_X},{_Y},gauge'),
        ('name,easting,northing', f'gauge,{_X},{_Y}'),
        ('lon,lat,name,kind', '15.001,37.769,gauge,seismic'),
        ('longitude,latitude,name', '15.001,37.769,gauge'),
    ],
)
def test_a_table(tmp_path: Path, header: str, row: str) -> None:
    """Its header says what its coordinates are; other columns are kept."""
    (tmp_path / 'a.csv').write_text(f'{header}\n{row}\n')
    (found,) = read_features('--overlay', tmp_path / 'a.csv', TERRAIN)
    np.testing.assert_allclose(found.rings[0], METRES, atol=1e-3)
    assert (found.kind, found.name) == ('Point', 'gauge')


def test_a_table_of_lines(tmp_path: Path) -> None:
    """A row with a second place is a line, one without it a point."""
    (tmp_path / 'a.csv').write_text('x,y,x_end,y_end\n1,2,3,4\n5,6,,\n')
    line, point = read_features('--vents', tmp_path / 'a.csv', TERRAIN)
    assert line.rings[0].tolist() == [[1.0, 2.0], [3.0, 4.0]]
    assert (line.kind, point.kind) == ('LineString', 'Point')


def test_geojson(tmp_path: Path) -> None:
    """Degrees become metres; an old file that names its system is believed."""
    point = {'type': 'Point', 'coordinates': [*DEGREES, 1200.0]}
    path = features(tmp_path / 'a.geojson', of={'a': point})
    (found,) = read_features('--overlay', path, TERRAIN)
    np.testing.assert_allclose(found.rings[0], METRES, atol=1e-3)
    crs = {'type': 'name', 'properties': {'name': 'urn:ogc:def:crs:EPSG::32633'}}
    lines = {'type': 'MultiLineString', 'coordinates': [[[1, 2], [3, 4]], [[5, 6], [7, 8]]]}
    path = features(tmp_path / 'b.json', of={'b': lines}, crs=crs)
    first, second = read_features('--overlay', path, TERRAIN)
    np.testing.assert_allclose(first.rings[0], [[1, 2], [3, 4]], atol=1e-6)
    np.testing.assert_allclose(second.rings[0], [[5, 6], [7, 8]], atol=1e-6)


def test_a_geopackage(tmp_path: Path) -> None:
    """Its layers are in their own systems."""
    fiona = pytest.importorskip('fiona')
    schema = {'geometry': 'Point', 'properties': {'name': 'str'}}
    with fiona.open(
        tmp_path / 'a.gpkg', 'w', driver='GPKG', schema=schema, crs='EPSG:4326', layer='stations'
    ) as file:
        geometry = {'type': 'Point', 'coordinates': DEGREES}
        file.write({'geometry': geometry, 'properties': {'name': 'gauge'}})
    (found,) = read_features('--overlay', tmp_path / 'a.gpkg', TERRAIN)
    np.testing.assert_allclose(found.rings[0], METRES, atol=1e-3)
    assert found.name == 'gauge'


def test_areas_become_cells(tmp_path: Path) -> None:
    """A cell is in an area whose middle is; a hole stays one."""
    square = [[[x, y] for x, y in ((0, 0), (100, 0), (100, 100), (0, 100), (0, 0))]]
    hole = [[x, y] for x, y in ((40, 40), (60, 40), (60, 60), (40, 60), (40, 40))]
    rings = [[[500_000 + x, 4_180_000 + y] for x, y in ring] for ring in (*square, hole)]
    crs = {'type': 'name', 'properties': {'name': 'EPSG:32633'}}
    area = {'type': 'Polygon', 'coordinates': rings}
    lava, known = seen_in_file(features(tmp_path / 'a.geojson', of={'a': area}, crs=crs), TERRAIN)
    assert lava.sum() == 24 and lava[:5, :5].sum() == 24 and not lava[2, 2]
    assert known.all()


@pytest.mark.parametrize(
    ('name', 'text', 'words'),
    [
        ('a.shp', '', 'ends with .geojson'),
        ('a.csv', 'east,north\n1,2\n', "first line is 'east,north', expected the columns x,y"),
        ('a.csv', 'x,y\n', '1 lines'),
        ('a.csv', 'x,y\n1,here\n', 'line 2 is .*a geometry of numbers'),
        ('a.csv', 'x,y\n1,nan\n', 'two coordinates'),
        ('a.geojson', '[1]', 'a FeatureCollection'),
        ('a.geojson', '{"features": []}', 'at least one point'),
        ('a.geojson', '{"features": [{"geometry": {"type": "Circle"}}]}', 'feature 0 is .Circle'),
        ('a.geojson', '{"features": [{"geometry": 5}]}', 'with a geometry'),
        ('a.geojson', '{"type": "Point", "coordinates": [[1], 2]}', 'a geometry of numbers'),
        ('a.geojson', '{"type": "Point", "coordinates": [500, 95]}', 'that GDAL knows'),
        ('a.geojson', '{"type": "Point", "coordinates": [1, 2], "crs": {"properties": '
         '{"name": "EPSG:0"}}}', 'that GDAL knows'),
        ('a.gpkg', 'SQLite it is not', 'GeoPackage'),
    ],
)
def test_what_cannot_be_read(tmp_path: Path, name: str, text: str, words: str) -> None:
    """The error names the file or the row, and what would be right."""
    (tmp_path / name).write_text(text)
    with pytest.raises(LavaError, match=words):
        read_features('--overlay', tmp_path / name, TERRAIN)


def test_degrees_on_a_terrain_that_is_nowhere(tmp_path: Path) -> None:
    """Nobody knows where they are."""
    (tmp_path / 'a.csv').write_text('lon,lat\n15,37\n')
    with pytest.raises(LavaError, match='which has no coordinate system'):
        read_features('--vents', tmp_path / 'a.csv', Terrain(np.zeros((5, 5)), 10.0))
