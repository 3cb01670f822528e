# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Features on a terrain; barriers, low-pass filter and refinement."""

from dataclasses import replace
import json
from typing import Any

import numpy as np
import pytest
from rasterio.warp import transform

from geodata import feature, write_features
from lava_ros.errors import LavaError
from lava_ros.forecast.observations import observed_in_file
from lava_ros.products.gis import Provenance, write_grid
from lava_ros.scene import Scene, scene_to_dict, Terrain
from lava_ros.scene.features import load_features, read_features
from lava_ros.scene.reshaping import Barrier, finer, low_pass, with_barriers
from lava_ros.scene.terrain_files import barrier_tags, load_terrain
from lava_ros.simulation.particles.terrain import ringed_heights

#: A square kilometre on the central meridian of UTM zone 33.
TERRAIN = Terrain(np.zeros((50, 50)), 20.0, epsg=32633, offset=(500_000.0, 4_180_000.0))

#: A place on it in degrees and in metres.
DEGREES = (15.001, 37.769)
(_X,), (_Y,) = transform('EPSG:4326', 'EPSG:32633', [DEGREES[0]], [DEGREES[1]])
METRES = [[_X, _Y]]


def test_warns_of_features_without_a_geometry(tmp_path, caplog):
    path = tmp_path / 'a.geojson'
    gone = feature('Point', (), name='gone') | {'geometry': None}
    path.write_text(json.dumps({'type': 'FeatureCollection', 'features': [gone]}))
    with pytest.raises(LavaError, match='at least one point'):
        read_features('--places', path, TERRAIN)
    assert 'feature 0 (gone) has no geometry and is left out' in caplog.text
    for place in ((*DEGREES, 1200.0), DEGREES):
        here = feature('Point', place, name='here')
        path.write_text(json.dumps({'type': 'FeatureCollection', 'features': [gone, here]}))
        (found,) = load_features('--places', path)
        np.testing.assert_allclose(found.on(TERRAIN).rings[0], METRES, atol=1e-3)
    assert (found.name, found.system) == ('here', 'EPSG:4326')
    with pytest.raises(LavaError, match=r'feature 1 \(here\) is .*no coordinate system'):
        found.on(Terrain(np.zeros((5, 5)), 10.0))


def test_polygon_marks_cells_by_their_centre_except_in_holes(tmp_path):
    square = [[[x, y] for x, y in ((0, 0), (100, 0), (100, 100), (0, 100), (0, 0))]]
    hole = [[x, y] for x, y in ((40, 40), (60, 40), (60, 60), (40, 60), (40, 40))]
    rings = [[[500_000 + x, 4_180_000 + y] for x, y in ring] for ring in (*square, hole)]
    path = write_features(tmp_path / 'a.geojson', feature('Polygon', rings))
    lava, known = observed_in_file(path, TERRAIN)
    assert lava.sum() == 24 and lava[:5, :5].sum() == 24 and not lava[2, 2]
    assert known.all()


@pytest.mark.parametrize(('name', 'text', 'words'), [
    ('a.doc', '', 'ends with .geojson'),
    ('a.shp', '', 'a file of Shapefile'),
    ('a.csv', 'here,there\n1,2\n', "first line is 'here,there', expected the columns x,y"),
    ('a.csv', 'x,y\n', 'is 1, expected a first line'),
    ('a.csv', 'name,x,y\nhut,1,nan\n', r"line 2 \(hut\), y is 'nan', expected a finite"),
    ('a.csv', 'x,y\n1,1e30\n', 'coordinates of at most 1e'),
    ('a.csv', 'lon,lat,x,y\n2,4,5,6\n', 'the columns x,y or lon,lat or wkt'),
    ('a.csv', 'X,Easting,y\n2,4,5\n', "is 'X and Easting', expected one column for x"),
    ('a.csv', 'x (furlong),y\n2,4\n', "x .furlong. of .* is 'furlong', expected a unit such"),
    ('a.csv', 'wkt\nPNT\n', "line 2, wkt is 'PNT', expected well-known text"),
    ('a.geojson', '{"features": []}', 'GeoJSON that GDAL can read'),
    ('a.geojson', '{"type": "FeatureCollection", "features": []}', 'at least one point'),
    ('a.geojson', '{"type": "Feature", "geometry": {"type": "Circle"}}', 'at least one point'),
    ('a.geojson', '{"type": "Point", "coordinates": [[1], 2]}', "invalid 'x' coordinate"),
    ('a.geojson', '{"type": "Point", "coordinates": [500, 95]}', 'that GDAL knows'),
    ('a.geojson', '{"type": "Point", "coordinates": [1, 2], "crs": {"type": "name", '
     '"properties": {"name": "EPSG:0"}}}', 'that GDAL knows'),
    ('a.gpkg', 'SQLite it is not', 'a file of GeoPackage'),
    ('a.kml', '<!DOCTYPE x [<!ENTITY a "b">]><kml/>', 'a file of KML'),
    ('a.kmz', 'PK', 'a readable file'),
])
def test_rejects_invalid_files(tmp_path, name, text, words):
    (tmp_path / name).write_text(text)
    with pytest.raises(LavaError, match=words):
        read_features('--places', tmp_path / name, TERRAIN)


GROUND = Terrain(
    np.add.outer(np.arange(40.0), np.zeros(50)), 10.0, epsg=32633, offset=(500_000.0, 4_180_000.0)
)


def _place(x: float, y: float) -> tuple[float, float]:
    return (500_000.0 + x, 4_180_000.0 + y)


def _added(terrain: Terrain) -> np.ndarray:
    return terrain.elevation - GROUND.elevation


def test_barrier_has_its_height_width_and_sides():
    barrier = Barrier((_place(100, 205), _place(400, 205)), height=20.0, width=30.0)
    added = _added(with_barriers(GROUND, [barrier]))
    np.testing.assert_allclose(added[17:25, 25], [5, 15, 20, 20, 20, 15, 5, 0], atol=1e-4)
    assert added[20, 10:40].min() == pytest.approx(20.0)
    assert added[20, 3] == 0.0
    assert added[20, 47] == 0.0
    assert with_barriers(GROUND, [barrier]).epsg == 32633


def test_thin_barrier_has_no_gap():
    """A wall narrower than a cell blocks flow between neighbours, including diagonal ones."""
    barrier = Barrier((_place(5, 5), _place(395, 385)), height=5.0, width=0.5, slope=100.0)
    raised = _added(with_barriers(GROUND, [barrier])) > 4.0
    for row in range(1, 37):
        columns = np.flatnonzero(raised[row])
        following = np.flatnonzero(raised[row + 1])
        assert len(columns)
        # the parts of two rows overlap, so that there is no gap between them
        assert set(columns) & set(following)


@pytest.mark.parametrize('width', [8.0, 30.0])
def test_volume_of_a_barrier_is_that_of_its_cross_section(width, caplog):
    barrier = Barrier(((140.0, 500.0), (861.0, 500.0)), height=12.0, width=width)
    volumes = {}
    for cell in (1.0, 10.0):
        ground = Terrain(np.zeros((int(1000 / cell), int(1000 / cell))), cell)
        caplog.clear()
        added = with_barriers(ground, [barrier]).elevation
        volumes[cell] = float(added.sum(dtype=float)) * cell**2
        is_widened = bool(width < np.sqrt(2.0) * cell)
        assert is_widened is ('becomes 14.1 m wide on cells of 10 m' in caplog.text)
    assert barrier.volume == pytest.approx(volumes[1.0], rel=1e-3)
    assert (barrier.volume < 0.8 * volumes[10.0]) is (width < 10.0)


@pytest.mark.parametrize('ending', ['.tif', '.npz'])
def test_elevation_file_keeps_its_barriers(tmp_path, ending, caplog):
    """Damaged barriers, or those of another coordinate system, are only a warning."""
    line = (_place(100, 100), _place(300, 100), _place(300, 300))
    dam = with_barriers(GROUND, [Barrier(line, 8.0, 20.0)])
    dam = with_barriers(dam, [Barrier(line[:2], 9.0, 20.0)])
    path = tmp_path / f'dam{ending}'

    def write(tags: dict[str, str], epsg: int = 32633) -> Terrain:
        if ending == '.tif':
            origin = Provenance('dam', effects=(), preset='none')
            write_grid(path, 'elevation', dam.elevation, replace(dam, epsg=epsg), origin, tags)
        else:
            known = {name: getattr(dam, name) for name in ('elevation', 'resolution', 'offset')}
            np.savez(path, **known, **tags, epsg=epsg)
        return load_terrain(path)

    tags = barrier_tags(dam)
    assert write(tags).barriers == (line, line[:2]) == finer(dam, 2).barriers
    assert write(barrier_tags(GROUND)).barriers == ()
    for wrong, epsg in (
        (tags, 32634), (dict.fromkeys(tags, '{'), 32633), (dict.fromkeys(tags, '[1]'), 32633),
        (dict.fromkeys(tags, '{"epsg": 32633, "crests": [[[1, 2]]]}'), 32633),
    ):
        caplog.clear()
        assert write(wrong, epsg).barriers == ()
        assert 'maps will not show its barriers' in caplog.text
    stored = scene_to_dict(Scene(dam))['terrain']['barriers']
    assert stored == [[list(place) for place in crest] for crest in dam.barriers]


@pytest.mark.parametrize(('line', 'words'), [
    ((_place(10, 105), _place(490, 105)), ''),
    ((_place(10, 105), _place(-990, 105)), '99 % of the barrier is off the terrain, such as '),
    ((_place(10, 205), _place(490, 205)), '21 % of the barrier is off the terrain, such as '),
    ((_place(10, 105), _place(1e8, 105)), '1e+02 % of the barrier is off the terrain, such as '),
])
def test_part_of_a_barrier_off_the_terrain_is_a_warning(line, words, caplog):
    elevation = np.array(GROUND.elevation)
    elevation[20, 20:30] = np.nan
    with_barriers(replace(GROUND, elevation=elevation), [Barrier(line, 8.0, 20.0)])
    assert words in caplog.text and ('off the terrain' in caplog.text) is bool(words)


def test_barrier_and_filter_keep_cells_without_data():
    elevation = np.array(GROUND.elevation)
    elevation[20, 20:30] = np.nan
    holed = Terrain(elevation, 10.0)
    raised = with_barriers(holed, [Barrier(((100.0, 205.0), (400.0, 205.0)), 8.0, 20.0)])
    np.testing.assert_array_equal(raised.has_data, holed.has_data)
    smooth = low_pass(holed, 30.0)
    np.testing.assert_array_equal(smooth.has_data, holed.has_data)
    assert np.isfinite(smooth.elevation[19, 25])


@pytest.mark.parametrize(('change', 'word'), [
    ({'line': ((0.0, 0.0),)}, 'two or more places'),
    ({'line': ((0.0, 0.0), (0.0, 0.0))}, 'two or more different points'),
    ({'line': '0,0 1,1'}, 'two or more places'),
    ({'line': ((0.0, 0.0), (1.0, np.nan))}, r'barrier.line\[1\]'),
    ({'height': -5.0}, 'barrier.height'),
    ({'width': 0.0}, 'barrier.width'),
    # a barrier off the terrain
    ({}, 'a line on the terrain.*easting 500000 to 500500'),
])
def test_rejects_invalid_barriers(change, word):
    good: dict[str, Any] = {'line': ((0.0, 0.0), (100.0, 0.0)), 'height': 5.0, 'width': 5.0}
    with pytest.raises(LavaError, match=word):
        with_barriers(GROUND, [Barrier(**{**good, **change})])


def test_filter_removes_short_waves_and_keeps_planes():
    """A wave of 8 widths keeps 73 % of its height, one of 2 widths less than 1 %."""
    x = (np.arange(400) + 0.5) * 10.0
    for length, fraction in ((800.0, 0.7346), (400.0, 0.2912), (200.0, 0.0072)):
        waves = Terrain(1000.0 + np.tile(np.sin(2.0 * np.pi * x / length), (200, 1)), 10.0)
        left = low_pass(waves, 100.0).elevation[100, 60:340] - 1000.0
        assert np.abs(left).max() == pytest.approx(fraction, abs=2e-3)
    smooth = low_pass(GROUND, 30.0)
    np.testing.assert_allclose(smooth.elevation[13:27], GROUND.elevation[13:27], atol=1e-3)
    assert low_pass(GROUND, 0.0) is GROUND
    for width in (-1.0, np.nan, 1e4):
        with pytest.raises(LavaError, match='low_pass'):
            low_pass(GROUND, width)


def test_refined_terrain_is_the_surface_of_the_simulation():
    heights = np.random.default_rng(3).uniform(0.0, 30.0, (7, 9)).astype(np.float32)
    terrain = Terrain(heights, 30.0, origin=(5.0, -7.0))
    fine = finer(terrain, 3)
    assert fine.resolution == 10.0 and fine.shape == (21, 27) and fine.extent == terrain.extent
    ring = ringed_heights(terrain)
    ring = ring + float(heights[0, 0] - ring[1, 1])
    near, middle, far = 25 / 72, 46 / 72, 1 / 72
    weights = {-1: (near, middle, far), 0: (1 / 8, 3 / 4, 1 / 8), 1: (far, middle, near)}
    for row, column in ((0, 0), (3, 5), (6, 8)):
        patch = ring[row : row + 3, column : column + 3]
        for m, low in weights.items():
            for n, left in weights.items():
                expected = np.array(low) @ patch @ np.array(left)
                found = fine.elevation[3 * row + 1 + m, 3 * column + 1 + n]
                assert found == pytest.approx(expected, abs=1e-4)


def test_refinement_keeps_planes_and_cells_without_data():
    x, y = np.meshgrid(np.arange(8.0), np.arange(6.0))
    heights = 3.0 * x - 2.0 * y
    heights[2:4, 3] = np.nan
    terrain = Terrain(heights, 1.0)
    fine = finer(terrain, 4)
    x, y = np.meshgrid((np.arange(32) + 0.5) / 4 - 0.5, (np.arange(24) + 0.5) / 4 - 0.5)
    known = np.kron(terrain.has_data, np.ones((4, 4), dtype=bool))
    np.testing.assert_array_equal(fine.has_data, known)
    np.testing.assert_allclose(fine.elevation[known], (3.0 * x - 2.0 * y)[known], atol=1e-5)
    assert finer(terrain, 1) is terrain
