# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Detection of undeclared cells without data."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio

from geodata import write_raster
from lava_ros.cli.parser import parse_command_line
from lava_ros.cli.scenes import scene_from_arguments
from lava_ros.errors import LavaError
from lava_ros.scene import scene_from_yaml
from lava_ros.scene.terrain_files import load_terrain

#: A mountain of 300 to 1500 m on cells of 10 m.
MOUNTAIN = (
    300.0 + 1200.0 * np.exp(-np.add.outer(
        (np.arange(60) - 30.0) ** 2, (np.arange(60) - 25.0) ** 2
    ) / 400.0)
).astype(np.float32)

MARKS = (
    -32768.0, -9999.0, -999.0, -99.0, -1.0, 0.0, 9999.0, 32767.0, 99999.0, 1.70141e38, -3.4e38,
)


def write(path: Path, data: np.ndarray, **options: Any) -> Path:
    if path.suffix == '.npz':
        np.savez(path, elevation=data, resolution=10.0)
        return path
    driver = {'.tif': 'GTiff', '.img': 'HFA', '.flt': 'EHdr'}[path.suffix]
    return write_raster(path, data, driver=driver, **options)


def holed(value: float, where: Any = np.s_[:, 45:]) -> np.ndarray:
    """Return the mountain with a value in some cells."""
    data = MOUNTAIN.copy()
    data[where] = value
    return data


@pytest.mark.parametrize(('value', 'suffix'), [
    *((value, '.tif') for value in MARKS), (-9999.0, '.img'), (0.0, '.flt'), (-999.0, '.npz'),
])
def test_rejects_a_block_of_an_undeclared_value(tmp_path, value, suffix):
    """The error has the option that declares it, with which the cells have no data."""
    path = write(tmp_path / f'a{suffix}', holed(value))
    typed = f'{np.float32(value):g}'
    with pytest.raises(LavaError) as caught:
        load_terrain(path)
    assert caught.value.value == f'{typed} in 900 cells'
    assert f'--nodata {typed}' in str(caught.value)
    terrain = load_terrain(path, nodata=value)
    expected = MOUNTAIN if suffix == '.npz' else MOUNTAIN[::-1]
    assert not terrain.has_data[:, 45:].any()
    np.testing.assert_array_equal(terrain.elevation[:, :45], expected[:, :45])


@pytest.mark.parametrize('crs', ['EPSG:32633', None], ids=['Earth', 'anywhere'])
@pytest.mark.parametrize('value', [-32768.0, -9999.0, -999.0, 9999.0, 32767.0, 1.70141e38, 7000.0])
def test_rejects_a_spike_of_one_cell(tmp_path, value, crs):
    path = write(tmp_path / 'a.tif', holed(value, np.s_[20, 20]), crs=crs)
    with pytest.raises(LavaError, match='in 1 cell.*--nodata'):
        load_terrain(path)


@pytest.mark.filterwarnings('error::RuntimeWarning')
@pytest.mark.parametrize(('ground', 'cells', 'message'), [
    # the difference of the values overflows
    (holed(-3.4e38), [(np.s_[:, :5], 1.70141e38)], 'elevation'),
    # interpolation has smeared the missing values: the extreme one is shown
    (MOUNTAIN, [((10, 10), -6000.0), ((40, 40), -6500.0)], '-6500 in 2 cells'),
    # a mountain by the sea
    (np.maximum(MOUNTAIN - 400.0, 0.0), [(np.s_[28:32, 23:27], 0.0)], '0 in 16 cells'),
])
def test_rejects_values_among_others(ground, cells, message, tmp_path):
    data = ground.copy()
    for where, value in cells:
        data[where] = value
    with pytest.raises(LavaError, match=message):
        load_terrain(write(tmp_path / 'a.tif', data))


def test_compares_stored_values_without_unit_and_scale(tmp_path):
    stored = np.rint(10.0 * holed(-99.9)).astype(np.int16)
    path = write(tmp_path / 'a.tif', stored)
    with rasterio.open(path, 'r+') as file:
        file.scales, file.offsets = [0.1], [500.0]
    with pytest.raises(LavaError, match='-999 in 900 cells'):
        load_terrain(path)
    corner = load_terrain(path, nodata=-999).elevation[0, 0]
    assert corner == pytest.approx(500.0 + MOUNTAIN[-1, 0], abs=0.1)
    path = write(tmp_path / 'b.tif', holed(-999.0))
    with rasterio.open(path, 'r+') as file:
        file.units = ['ft']
    with pytest.raises(LavaError, match='-999 in 900 cells'):
        load_terrain(path)


@pytest.mark.parametrize(
    'ground',
    [
        np.maximum(MOUNTAIN - 400.0, 0.0),
        np.maximum(MOUNTAIN - 400.0, -1.0),
        np.minimum(MOUNTAIN, 999.0),
        # a bathymetry that passes -999 m, and a pit in it
        np.rint(MOUNTAIN - 1999.0),
        # a wall, a house and a plane with poles
        np.where(np.arange(60) == 20, 40.0, 0.0) + np.zeros((60, 1)),
        np.where(np.add.outer(np.arange(60) % 20, np.arange(60) % 20) == 0, 300.0, 0.0),
        np.zeros((60, 60)),
        4.0 * MOUNTAIN,
    ],
    ids=['sea', 'low sea', 'plateau', 'bathymetry', 'wall', 'poles', 'plane', 'high'],
)
def test_accepts_seas_plateaus_walls_and_planes(tmp_path, ground):
    terrain = load_terrain(write(tmp_path / 'a.tif', ground.astype(np.float32)))
    np.testing.assert_array_equal(terrain.elevation, ground.astype(np.float32)[::-1])


def test_command_line_and_scene_file_declare_a_value_or_none(tmp_path):
    path = write(tmp_path / 'a.tif', holed(-99.0))
    words = ['plan', '--within', '9s', '--terrain', str(path)]
    scene = scene_from_arguments(parse_command_line([*words, '--nodata', '-99']))
    assert np.isnan(scene.terrain.elevation[:, -1]).all()
    words += ['--epsg', '32634']
    kept = scene_from_arguments(parse_command_line([*words, '--nodata', 'none']))
    assert kept.terrain.elevation.min() == -99.0 and kept.terrain.epsg == 32634
    text = 'terrain: {file: a.tif, nodata: VALUE}\nvents: [{position: [200, 300], discharge: 5}]\n'
    for value, expected in (('-99', np.nan), ('none', -99.0)):
        (tmp_path / 'a.yaml').write_text(text.replace('VALUE', value))
        scene = scene_from_yaml(tmp_path / 'a.yaml')
        np.testing.assert_array_equal(scene.terrain.elevation[0, -1], np.float32(expected))
    for name, value in (('--nodata', '-99'), ('--epsg', '32633')):
        with pytest.raises(LavaError, match=f'{name} has no effect without --terrain'):
            scene_from_arguments(parse_command_line(['plan', '--within', '9s', name, value]))
    with pytest.raises(LavaError, match="--nodata is 'sea', expected a number, or none"):
        scene_from_arguments(parse_command_line([*words, '--nodata', 'sea']))
    with pytest.raises(LavaError, match=r'terrain\.nodata'):
        load_terrain(path, nodata='sea')


def test_warns_of_a_declared_value_without_cells(tmp_path, caplog):
    np.savez(tmp_path / 'a.npz', elevation=MOUNTAIN, resolution=10.0)
    load_terrain(tmp_path / 'a.npz', nodata=-99.0)
    assert 'no cell has the value -99 that nodata declares' in caplog.text
