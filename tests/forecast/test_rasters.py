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

"""Rasters of others land on the cells of the terrain they are on."""

import math
from pathlib import Path

import numpy as np
import pytest
import rasterio
from rasterio.transform import Affine, from_origin

from lava_ros.errors import LavaError
from lava_ros.forecast.rasters import raster_on, seen_in_file
from lava_ros.forecast.sampling import Susceptibility
from lava_ros.scene import Terrain

#: 6 x 8 cells of 20 m, in UTM zone 33.
TERRAIN = Terrain(np.zeros((6, 8)), 20.0, epsg=32633, offset=(500_000.0, 4_180_000.0))


def write(path: Path, values: np.ndarray, **options: object) -> Path:
    """A raster of the terrain's extent, row 0 in the north."""
    settings: dict[str, object] = {
        'crs': 'EPSG:32633', 'transform': from_origin(500_000.0, 4_180_120.0, 20.0, 20.0),
        'nodata': -1.0, 'count': 1, **options,
    }
    with rasterio.open(
        path, 'w', driver='GTiff', width=values.shape[1], height=values.shape[0],
        dtype='float32', **settings,
    ) as file:
        file.write(values.astype('float32'), 1)
    return path


def test_cells_are_where_they_were(tmp_path: Path) -> None:
    """South first; what has no data is NaN; a coarser raster fills all of its cells."""
    values = np.arange(48.0).reshape(6, 8)
    values[0, 0] = -1.0
    cells = raster_on(TERRAIN, write(tmp_path / 'a.tif', values), field='a')
    expected = np.flipud(np.where(values < 0.0, np.nan, values))
    np.testing.assert_array_equal(cells, expected)
    coarse = write(
        tmp_path / 'b.tif', np.array([[1.0, 2.0], [3.0, 4.0]]),
        transform=from_origin(500_000.0, 4_180_120.0, 80.0, 60.0),
    )
    cells = raster_on(TERRAIN, coarse, field='b')
    np.testing.assert_array_equal(cells, np.kron([[3.0, 4.0], [1.0, 2.0]], np.ones((3, 4))))


def test_other_coordinates_are_turned(tmp_path: Path) -> None:
    """A raster in degrees around the terrain's western half is there, and nowhere else."""
    degrees = write(
        tmp_path / 'a.tif', np.ones((1, 1)), crs='EPSG:4326',
        transform=from_origin(14.9, 38.0, 0.1 + 80.0 / 87_900.0, 1.0),
    )
    cells = raster_on(TERRAIN, degrees, field='a')
    assert (cells[:, :4] == 1.0).all() and np.isnan(cells[:, 4:]).all()


def test_an_outline_knows_where_nobody_looked(tmp_path: Path) -> None:
    """Above 0 is lava, 0 is none, no data is neither."""
    values = np.zeros((6, 8))
    values[0, :3], values[5] = 1.0, -1.0
    lava, known = seen_in_file(write(tmp_path / 'a.tif', values), TERRAIN)
    assert lava[5, :3].all() and lava.sum() == 3
    assert not known[0].any() and known[1:].all()


def test_a_susceptibility_is_read(tmp_path: Path) -> None:
    """The one cell with a likelihood gets every vent."""
    values = np.zeros((6, 8))
    values[1, 2] = 0.3
    path = write(tmp_path / 'a.tif', values)
    places = Susceptibility(TERRAIN, raster_on(TERRAIN, path, field='--susceptibility'))
    for share in (1e-9, 0.5, 1.0 - 1e-9):
        assert TERRAIN.cell_at(*places.place(share, share)) == (4, 2)


def test_rasters_of_nowhere_are_refused(tmp_path: Path) -> None:
    """Missing, no raster, two bands, elsewhere, or in coordinates that the terrain lacks."""
    (tmp_path / 'text.tif').write_text('no raster')
    ones = np.ones((6, 8))
    far = write(tmp_path / 'far.tif', ones, transform=from_origin(0.0, 1000.0, 20.0, 20.0))
    for path in (tmp_path / 'none.tif', tmp_path / 'text.tif', far):
        with pytest.raises(LavaError, match='--observed'):
            seen_in_file(path, TERRAIN)
    (tmp_path / 'other.tif').write_text('<VRTDataset rasterXSize="8" rasterYSize="6"/>')
    with pytest.raises(LavaError, match='a GeoTIFF or an ESRI ASCII grid'):
        seen_in_file(tmp_path / 'other.tif', TERRAIN)
    flat = write(tmp_path / 'flat.tif', ones, transform=Affine(0.0, 0.0, 5e5, 0.0, -20.0, 4.18e6))
    endless = write(tmp_path / 'nan.tif', ones, transform=Affine(20, 0, math.nan, 0, -20, 4.18e6))
    for path in (flat, endless):
        with pytest.raises(LavaError, match='a georeferenced raster'):
            seen_in_file(path, TERRAIN)
    here = write(tmp_path / 'here.tif', ones)
    with pytest.raises(LavaError, match='coordinate system'):
        raster_on(Terrain(np.zeros((6, 8)), 20.0), here, field='a')
