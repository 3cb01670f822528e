# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Elevation files: terrain, or one clear error."""

from pathlib import Path
import sys
from typing import Any
import zipfile

import numpy as np
import pytest
import rasterio
from rasterio.enums import ColorInterp
from rasterio.transform import Affine, from_origin
from rasterio.warp import transform as transform_points

from geodata import write_raster
from lava_ros.errors import LavaError
from lava_ros.scene import Terrain
from lava_ros.scene.projection import projected
from lava_ros.scene.terrain_files import demo_terrain, load_terrain

#: Rows from the north, as in raster files.
NORTH_FIRST = np.array([[7.0, 8.0, 9.0], [4.0, 5.0, 6.0], [1.0, 2.0, 3.0], [0.5, 0.6, 0.7]])
FLOATS = NORTH_FIRST.astype(np.float32)


def write_asc(
    path: Path, cell: str = 'cellsize 25', *, hole: object = -9999, nodata: object = -9999
) -> Path:
    """Write an ESRI ASCII grid with a hole in its north-east corner."""
    rows = [[7, 8, hole], [4, 5, 6], [1, 2, 3]]
    text = f'ncols 3\nnrows 3\nxllcorner 1000\nyllcorner 2000\n{cell}\nNODATA_value {nodata}\n'
    path.write_text(text + '\n'.join(' '.join(map(str, row)) for row in rows) + '\n')
    return path


def plane(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return a slope [m], which interpolation must preserve."""
    return 1000.0 + 0.2 * (x - 500_000.0) - 0.1 * (y - 4_180_000.0)


def plane_rows(height: float = 10.0) -> np.ndarray:
    """Return the slope from (500,000, 4,180,000) to the south-east, rows from the north."""
    x = 500_000.0 + (np.arange(60) + 0.5) * 10.0
    y = 4_180_000.0 - (np.arange(round(600 / height)) + 0.5) * height
    return plane(*np.meshgrid(x, y)).astype(np.float32)


def centres(terrain: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return easting and northing of the cell centres [m], shape [rows, columns] each."""
    rows, columns = terrain.shape
    east = terrain.offset[0] + terrain.origin[0] + (np.arange(columns) + 0.5) * terrain.resolution
    north = terrain.offset[1] + terrain.origin[1] + (np.arange(rows) + 0.5) * terrain.resolution
    return np.meshgrid(east, north)


@pytest.mark.parametrize(
    ('hole', 'nodata'), [(-9999, -9999), ('nan', 'nan'), ('NaN', 'nan'), ('nan', 'NaN')]
)
def test_reads_esri_grid(tmp_path, hole, nodata):
    """Row 0 is in the south, and the map starts at the lower-left corner.

    The EPSG code of the caller does not change the cells.
    """
    path = write_asc(tmp_path / 'a.asc', hole=hole, nodata=nodata)
    for epsg in (None, 32633):
        terrain = load_terrain(path, epsg=epsg)
        np.testing.assert_array_equal(terrain.elevation, [[1, 2, 3], [4, 5, 6], [7, 8, np.nan]])
        assert (terrain.resolution, terrain.origin, terrain.offset) == (25.0, (0, 0), (1000, 2000))
        assert terrain.epsg == epsg


@pytest.mark.parametrize(('elevation', 'words'), [
    (np.full((4, 3), np.nan), 'is nan, expected at least one cell with data'),
    (np.where(FLOATS > 8.5, np.inf, FLOATS), 'is inf, expected at most 100000 m'),
    (FLOATS[:1], r"is 'array of shape \(1, 3\)', expected a 2-D array of 2"),
    (FLOATS[:1, :1], r"is 'array of shape \(1, 1\)', expected a 2-D array of 2"),
])
@pytest.mark.parametrize('suffix', ['tif', 'npz'])
def test_error_about_elevations_names_their_file(elevation, words, suffix, tmp_path):
    path = tmp_path / f'ground.{suffix}'
    if suffix == 'npz':
        np.savez(path, elevation=np.float32(elevation), resolution=10.0)
    else:
        write_raster(path, np.float32(elevation), cell=10.0)
    with pytest.raises(LavaError, match=rf'^elevation of ground\.{suffix} {words}'):
        load_terrain(path)


@pytest.mark.parametrize(('height', 'words'), [
    (10.0, '60 x 60 cells of 10 m, none'),
    (12.0, '60 x 60 cells of 10 m (in the file 10 by 12), none'),
    (30.0, '60 x 60 cells of 10 m (in the file 10 by 30), none'),
])
def test_log_names_cells_that_are_not_square(height, words, tmp_path, caplog):
    caplog.set_level('INFO')
    place = from_origin(500_000.0, 4_180_000.0, 10.0, height)
    rows = plane_rows(height)
    with rasterio.open(
        tmp_path / 'm.tif', 'w', driver='GTiff', height=len(rows), width=60, count=1,
        dtype='float32', crs='EPSG:32633', transform=place,
    ) as file:
        file.write(rows, 1)
    load_terrain(tmp_path / 'm.tif')
    assert f'm.tif: EPSG:32633, {words}' in caplog.text


def test_esri_grid_has_only_numbers_with_a_decimal_point(tmp_path):
    """GDAL reads text as 0 or in part, and as 0 for NODATA. A comma may separate thousands."""
    for number in ('-1', '+1.5', '.5', '2.', '1e2', '1.5E-3', '-9999.0'):
        terrain = load_terrain(write_asc(tmp_path / 'a.asc', hole=number))
        value = float(number)
        expected = np.nan if value == -9999.0 else np.float32(value)
        np.testing.assert_array_equal(terrain.elevation[2, 2], expected)
    for text in ('nan', 'NaN', 'N/A', '-', '1o1', '1D3', '0x1F', 'inf', '1.2.3', '1,5', '1,500.0'):
        with pytest.raises(LavaError) as caught:
            load_terrain(write_asc(tmp_path / 'a.asc', hole=text))
        assert caught.value.field == 'line 7, column 5 of a.asc'
        assert caught.value.value == text
    with pytest.raises(LavaError, match=r"NODATA_value of a\.asc is 'N/A', expected a number"):
        load_terrain(write_asc(tmp_path / 'a.asc', hole='N/A', nodata='N/A'))


def test_reads_geotiff_and_moves_the_map_origin(tmp_path):
    path = write_raster(tmp_path / 'a.tif', FLOATS)
    terrain = load_terrain(path)
    np.testing.assert_array_equal(terrain.elevation, FLOATS[::-1])
    assert terrain.epsg == 32633
    assert terrain.offset == (500_000.0, 4_180_000.0 - 40.0)
    assert terrain.resolution == 10.0
    terrain = load_terrain(path, offset=(499_000.0, 4_179_000.0))
    assert terrain.offset == (499_000.0, 4_179_000.0)
    assert terrain.origin == (1000.0, 960.0)
    # any elevation is valid off the Earth
    assert load_terrain(write_raster(path, FLOATS + 10_000.0, crs=None)).epsg is None


@pytest.mark.filterwarnings('error::RuntimeWarning')
def test_geotiff_with_scale_and_nodata(tmp_path):
    """Stored integers become metres, and a NODATA value, even beyond float32, becomes NaN."""
    stored = np.array([[0, 10], [20, 65535]], dtype=np.uint16)
    path = write_raster(tmp_path / 'a.tif', stored, nodata=65535, scale=(0.5, -100.0))
    np.testing.assert_allclose(load_terrain(path).elevation, [[-90.0, np.nan], [-100.0, -95.0]])
    for nodata in (1.7e308, -1.7e308, float('nan')):
        cells = np.array([[1.0, 2.0], [nodata, 4.0]])
        path = write_raster(tmp_path / 'a.tif', cells, nodata=nodata)
        np.testing.assert_array_equal(load_terrain(path).elevation, [[np.nan, 4.0], [1.0, 2.0]])


@pytest.mark.parametrize(('south', 'code'), [(37.64, 32633), (-37.76, 32733)])
def test_reprojects_degrees_to_utm(south, code, tmp_path):
    def hill_at(longitude, latitude):
        east, north = 88.4e3 * (longitude - 14.87), 111.0e3 * (latitude - south - 0.065)
        return 500.0 + 900.0 * np.exp(-np.hypot(east, north) ** 2 / (2.0 * 800.0**2))

    steps = (np.arange(144) + 0.5) / 1200.0
    longitude, latitude = np.meshgrid(14.8 + steps, south + 0.12 - steps)
    path = write_raster(
        tmp_path / 'a.tif', hill_at(longitude, latitude).astype(np.float32), crs='EPSG:4326',
        transform=from_origin(14.8, south + 0.12, 1.0 / 1200.0, 1.0 / 1200.0),
    )
    terrain = load_terrain(path)
    assert terrain.epsg == code
    assert 70.0 < terrain.resolution < 95.0
    places = (values.ravel() for values in centres(terrain))
    found = np.reshape(transform_points(f'EPSG:{code}', 'EPSG:4326', *places), (2, -1))
    exact = hill_at(*found.reshape(2, *terrain.shape))
    known = terrain.has_data
    assert known.mean() > 0.9
    assert np.abs(terrain.elevation - exact)[known].max() < 5.0


@pytest.mark.parametrize(
    ('height', 'resolution', 'cell'), [(20.0, None, 10.0), (10.0, 5.0, 5.0), (10.0, 30.0, 30.0)]
)
def test_resampling_preserves_a_plane(tmp_path, height, resolution, cell):
    transform = from_origin(500_000.0, 4_180_000.0, 10.0, height)
    path = write_raster(tmp_path / 'a.tif', plane_rows(height), transform=transform)
    terrain = load_terrain(path, resolution=resolution)
    assert terrain.resolution == cell
    assert terrain.shape == (600 // cell, 600 // cell)
    error = terrain.elevation - plane(*centres(terrain))
    assert np.abs(error[4:-4, 4:-4]).max() < 1e-2


def test_window_keeps_the_position_of_its_cells(tmp_path):
    path = write_raster(tmp_path / 'a.tif', plane_rows())
    part = load_terrain(path, window=(500_100.0, 4_179_505.0, 500_195.0, 4_179_600.0))
    assert part.shape == (10, 10)
    assert part.offset == (500_100.0, 4_179_500.0)
    np.testing.assert_allclose(part.elevation, plane(*centres(part)), rtol=1e-6)


def test_reads_npz_with_its_place(tmp_path):
    rows = NORTH_FIRST[::-1]
    np.savez(tmp_path / 'a.npz', elevation=rows, resolution=30.0)
    terrain = load_terrain(tmp_path / 'a.npz')
    np.testing.assert_array_equal(terrain.elevation, FLOATS[::-1])
    assert (terrain.origin, terrain.offset, terrain.epsg) == ((0.0, 0.0), (0.0, 0.0), None)
    place = {'origin': [-45.0, -60.0], 'offset': [500_000.0, 4_180_000.0], 'epsg': 32633}
    np.savez(tmp_path / 'a.npz', elevation=rows, resolution=30.0, **place)
    terrain = load_terrain(tmp_path / 'a.npz')
    assert (*terrain.origin, *terrain.offset) == (-45.0, -60.0, 500_000.0, 4_180_000.0)
    assert terrain.epsg == 32633


@pytest.mark.parametrize(('kind', 'shape'), [
    ('<f4', '(100000, 100000)'), ('<f4', '(4611686018427387904, 4)'), ('<f4', '(-1, -5)'),
    # items of size 0
    ('|V0', '(268435456, )'),
])
def test_rejects_npz_headers_larger_than_the_data(tmp_path, kind, shape):
    header = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".encode()
    data = b'\x93NUMPY\x01\x00' + len(header).to_bytes(2, 'little') + header + bytes(64)
    np.savez(tmp_path / 'a.npz', resolution=10.0)
    with zipfile.ZipFile(tmp_path / 'a.npz', 'a') as archive:
        archive.writestr('elevation.npy', data)
    with pytest.raises(LavaError, match='of shape'):
        load_terrain(tmp_path / 'a.npz')


def test_rejects_a_sparse_grid_with_too_many_cells(tmp_path):
    path = tmp_path / 'a.tif'
    with rasterio.open(
        path, 'w', driver='GTiff', height=32_000, width=32_000, count=1, dtype='float64',
        crs='EPSG:32633', transform=from_origin(0, 100, 10, 10), SPARSE_OK=True, tiled=True,
    ):
        pass
    with pytest.raises(LavaError, match='32000 x 32000 cells.*at most 100000000'):
        load_terrain(path)


def test_npz_files_need_no_gdal(tmp_path, monkeypatch):
    np.savez(tmp_path / 'a.npz', elevation=NORTH_FIRST, resolution=30.0, epsg=32633)
    monkeypatch.setitem(sys.modules, 'rasterio', None)
    assert load_terrain(tmp_path / 'a.npz').resolution == 30.0


@pytest.mark.parametrize(('bands', 'written', 'options', 'message'), [
    (np.zeros((3, 4, 4), np.uint8), {}, {}, 'one band of elevations, not 3'),
    (FLOATS.astype(np.uint8), {}, {}, 'uint8 is the type of a picture'),
    (FLOATS.astype(np.complex64), {}, {}, 'numbers, not complex64'),
    (FLOATS, {'crs': 'EPSG:2274'}, {}, 'in metres, such as UTM, not US survey foot'),
    (FLOATS, {'transform': Affine(8.0, 6.0, 5e5, 6.0, -8.0, 4.18e6)}, {}, 'north up'),
    (
        FLOATS,
        {'crs': 'EPSG:4326', 'transform': from_origin(10, 88, 0.01, 0.01)},
        {},
        'at most 84 degrees',
    ),
    # higher than any mountain
    (FLOATS + 10_000, {}, {}, r'at most 9000 m; multiply feet by 0\.3048'),
    (FLOATS, {}, {'epsg': 1}, 'an EPSG code'),
    (FLOATS, {}, {'resolution': -1.0}, 'terrain.resolution'),
    (FLOATS, {}, {'resolution': 1e6}, 'cells per side'),
    (FLOATS, {}, {'offset': (1.0,)}, 'terrain.offset'),
    (FLOATS, {}, {'window': (0, 0, 1, 1)}, 'the file, which covers x 500000 to 500030 m'),
    (FLOATS, {}, {'window': (0.0, 0.0)}, 'x0, y0, x1, y1'),
    (FLOATS, {}, {'window': 5.0}, 'x0, y0, x1, y1'),
    (FLOATS, {}, {'fill_holes': 'no'}, "terrain.fill_holes is 'no', expected true or false"),
])
def test_rejects_invalid_geotiff_or_option(tmp_path, bands, written, options, message):
    with pytest.raises(LavaError, match=message):
        load_terrain(write_raster(tmp_path / 'a.tif', bands, **written), **options)


@pytest.mark.parametrize(('data', 'message'), [
    ({'resolution': 30.0}, 'elevation'),
    ({'elevation': NORTH_FIRST}, 'resolution is missing'),
    ({'elevation': NORTH_FIRST, 'resolution': 1.0, 'height': 1.0}, 'unknown key'),
    ({'elevation': np.array([None, 1]), 'resolution': 1.0}, 'a readable .npz file'),
    ({'elevation': np.arange(4.0), 'resolution': 1.0}, 'numbers .m. of shape .rows, columns.'),
    # an EPSG code is not rounded
    ({'elevation': FLOATS, 'resolution': 1.0, 'epsg': 32633.7}, 'epsg is 32633.7'),
])
def test_rejects_invalid_npz(tmp_path, data, message):
    np.savez(tmp_path / 'a.npz', **data)
    with pytest.raises(LavaError, match=message):
        load_terrain(tmp_path / 'a.npz')


def test_rejects_missing_or_damaged_files(tmp_path):
    for path in (tmp_path / 'none.tif', tmp_path):
        with pytest.raises(LavaError, match='a file(; this is a folder| that exists)'):
            load_terrain(path)
    (tmp_path / 'a.tif').write_bytes(b'II*\0 this is not a raster')
    with pytest.raises(LavaError, match='that GDAL can read'):
        load_terrain(tmp_path / 'a.tif')
    for size, expected in (('0.000833', 'epsg 4326'), ('nan', ''), ('inf', ''), ('1e300', '')):
        with pytest.raises(LavaError, match=f'terrain file.*{expected}'):
            load_terrain(write_asc(tmp_path / 'a.asc', f'cellsize {size}'))
    np.savez(tmp_path / 'a.npz', elevation=NORTH_FIRST, resolution=30.0)
    whole = (tmp_path / 'a.npz').read_bytes()
    (tmp_path / 'a.npz').write_bytes(whole[:200])
    with pytest.raises(LavaError, match='a readable .npz file'):
        load_terrain(tmp_path / 'a.npz')
    # unknown versions, flags and compressions in the list of members
    for where in (6, 8, 10):
        data = bytearray(whole)
        data[data.index(b'PK\x01\x02') + where] |= 99
        (tmp_path / 'a.npz').write_bytes(data)
        with pytest.raises(LavaError, match='a readable .npz file'):
            load_terrain(tmp_path / 'a.npz')


def test_demo_terrain_is_mount_st_helens():
    """Its summit is at the published coordinates, and the crater is north of it."""
    terrain = demo_terrain()
    assert (terrain.epsg, terrain.resolution, terrain.origin) == (26710, 30.0, (0.0, 0.0))
    assert terrain.has_data.all()
    assert 900.0 < terrain.elevation.min() < 2500.0 < terrain.elevation.max() < 2550.0
    row, column = np.unravel_index(terrain.elevation.argmax(), terrain.shape)
    place = (np.array([column, row]) + 0.5) * 30.0 + terrain.offset
    longitude, latitude = transform_points('EPSG:26710', 'EPSG:4326', *place[:, None])
    assert (longitude[0], latitude[0]) == pytest.approx((-122.1945, 46.1912), abs=0.003)
    # 1.5 km north of the summit: western rim, floor, eastern rim
    west, floor, east = terrain.elevation[row + 50, column + np.array([-20, 20, 50])]
    assert floor < min(west, east) - 300.0


def hill(rows: int = 40, columns: int = 50) -> np.ndarray:
    """Return a smooth hill [m], rows from the north."""
    y, x = np.mgrid[0:rows, 0:columns]
    return (500.0 + 2.0 * x + 300.0 * np.exp(-((y - 20.0) ** 2) / 200.0)).astype(np.float32)


def test_logs_the_properties_of_a_file(tmp_path, caplog):
    caplog.set_level('INFO')
    cells = hill()
    cells[0, :3] = -1.0
    load_terrain(write_raster(tmp_path / 'a.tif', cells, nodata=-1.0))
    (record,) = caplog.records
    message = 'a.tif: EPSG:32633, 50 x 40 cells of 10 m, 3 without data, '
    message += 'elevations 546.601 to 898 m'
    assert (record.levelname, record.getMessage()) == ('INFO', message)
    load_terrain(write_raster(tmp_path / 'a.tif', 0.05 * hill()))
    assert 'they may be slopes in degrees instead of heights' in caplog.text


@pytest.mark.parametrize(('system', 'stretch'), [
    ('EPSG:3857', np.cos(np.radians(21.2))),
    ('EPSG:3395', np.cos(np.radians(21.2))),
    # true lengths along parallels, but meridians at an angle of 20 degrees to the north
    ('+proj=sinu +R=6371007.181 +type=crs', None),
])
def test_reprojects_mercator_and_sheared_systems_to_utm(tmp_path, system, stretch):
    """At 21 degrees south, lengths in Mercator are 7 % too long."""
    (x,), (y,) = transform_points('EPSG:4326', system, [55.7], [-21.2])
    path = write_raster(
        tmp_path / 'a.tif', hill(), crs=system, transform=from_origin(x, y, 10.0, 10.0)
    )
    terrain = load_terrain(path)
    assert terrain.epsg == 32740
    if stretch is not None:
        assert terrain.resolution == pytest.approx(10.0 * stretch, rel=5e-3)


def test_warns_of_enclosed_holes_and_pits_and_fills_them(tmp_path, caplog):
    cells, whole = hill(), hill()
    cells[10:13, 10:14] = -1.0
    cells[30, 30] -= 100.0
    cells[:, -2:] = -1.0
    path = write_raster(tmp_path / 'a.tif', cells, nodata=-1.0)
    holed = load_terrain(path)
    message = '13 cells inside have no data or lie deep below all their neighbours, the first at '
    assert message + '500305, 4179695: the simulation would lose or trap lava there' in caplog.text
    filled = load_terrain(path, fill_holes=True)
    assert 'they were filled from the cells around them' in caplog.text
    assert not holed.has_data[:, -2:].any() and not filled.has_data[:, -2:].any()
    np.testing.assert_allclose(filled.elevation[:, :-2], whole[::-1, :-2], atol=15.0)
    untouched = holed.has_data & (np.abs(holed.elevation - whole[::-1]) < 1.0)
    np.testing.assert_array_equal(filled.elevation[untouched], holed.elevation[untouched])


@pytest.mark.parametrize('place', [(15.0, 95.0), (1000.0, 10.0)])
def test_rejects_places_outside_the_domain_of_a_projection(place):
    with pytest.raises(LavaError, match='longitude, latitude is .* in the domain of EPSG:32633'):
        projected(Terrain(np.zeros((2, 2)), 10.0, epsg=32633), *place)


def test_an_alpha_band_is_refused_with_a_remedy(tmp_path):
    bands = np.stack((np.full((4, 5), 700.0), np.full((4, 5), 255.0))).astype(np.float32)
    path = write_raster(tmp_path / 'a.tif', bands)
    with rasterio.open(path, 'r+') as file:
        file.colorinterp = [ColorInterp.gray, ColorInterp.alpha]
    with pytest.raises(LavaError, match='-b 1 keeps the first one; band 2 only marks cells'):
        load_terrain(path)


def test_longitudes_beyond_180_degrees_are_those_of_the_western_hemisphere(tmp_path):
    elevation = 700.0 + np.add.outer(np.arange(60.0), np.arange(50.0))
    found = []
    for west in (-72.0, 288.0):
        place = {'crs': 'EPSG:4326', 'cell': 1e-3, 'north_west': (west, -39.0)}
        path = write_raster(tmp_path / 'a.tif', np.float32(elevation), **place)
        found.append(load_terrain(path))
    one, other = found
    assert one.epsg == other.epsg == 32719
    assert one.offset == pytest.approx(other.offset, abs=one.resolution)
    np.testing.assert_allclose(one.elevation, other.elevation, atol=2.0)
