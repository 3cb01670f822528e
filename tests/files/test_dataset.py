# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Rasters by the functions of GDAL in C: they equal those which rasterio reads."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from rasterio.enums import ColorInterp

from files.test_rasters import GROUND
from lava_ros.errors import LavaError
from lava_ros.files.raster_formats import PICTURES
from lava_ros.files.rasters import RasterContent, read_raster
from lava_ros.files.reader.dataset import NUMBERS, TYPES

#: Properties of rasterio by those of ``RasterContent``.
PROPERTIES = {
    'place': 'transform', 'crs': 'crs', 'shape': 'shape', 'count': 'count', 'dtypes': 'dtypes',
    'scales': 'scales', 'offsets': 'offsets', 'units': 'units', 'descriptions': 'descriptions',
}

PICTURE = np.stack([GROUND - 1000.0, GROUND / 9.0, GROUND / 8.0, 255.0 * (GROUND > 1080.0)])

#: Cells and profile of a file, and properties that are set after it was created.
FILES: dict[str, tuple[np.ndarray, dict[str, Any], dict[str, Any]]] = {
    **{name: (GROUND / 9.0, {'dtype': name}, {}) for name in NUMBERS if name != 'float16'},
    'missing data': (np.where(GROUND < 1020.0, -9999.0, GROUND), {'nodata': -9999.0}, {}),
    'missing data as nan': (np.where(GROUND < 1020.0, np.nan, GROUND), {'nodata': np.nan}, {}),
    'value beyond float32': (GROUND, {'nodata': -1.7e308, 'dtype': 'float64'}, {}),
    'no missing data': (GROUND, {'nodata': -9999.0}, {}),
    'nan': (np.where(GROUND < 1020.0, np.nan, GROUND), {}, {}),
    'no system': (GROUND, {'crs': None}, {}),
    'system with heights': (GROUND, {'crs': 'EPSG:32633+5773'}, {}),
    'degrees': (GROUND, {'crs': 'EPSG:4326'}, {}),
    'not placed': (GROUND, {'transform': None}, {}),
    'rotated': (GROUND, {'transform': rasterio.Affine(9.0, 1.0, 5e5, 2.0, -9.0, 4e6)}, {}),
    'properties': (np.stack([GROUND, GROUND]), {}, {
        'scales': (0.1, 2.0), 'offsets': (5.0, -1.0), 'units': ('ft', 'm'),
        'descriptions': ('Höhe', None),
    }),
    'tiles': (GROUND, {'tiled': True, 'blockxsize': 16, 'blockysize': 16, 'compress': 'lzw'}, {}),
    'picture': (PICTURE[:3], {'dtype': 'uint8', 'photometric': 'rgb'}, {}),
    'alpha': (PICTURE, {'dtype': 'uint8', 'photometric': 'rgb', 'interleave': 'pixel'}, {
        'colorinterp': tuple(map(ColorInterp, (3, 4, 5, 6))),
    }),
}


def write(path: Path, name: str) -> Path:
    """Write a file of ``FILES``."""
    values, options, properties = FILES[name]
    bands = np.atleast_3d(values.T).T if values.ndim == 2 else values
    profile = {
        'driver': 'GTiff', 'dtype': 'float32', 'crs': 'EPSG:32633', 'count': len(bands),
        'width': bands.shape[2], 'height': bands.shape[1],
        'transform': rasterio.Affine(10.0, 0.0, 5e5, 0.0, -10.0, 4.18e6), **options,
    }
    with rasterio.open(path, 'w', **profile) as target:
        target.write(bands.astype(profile['dtype']))
        for key, value in properties.items():
            setattr(target, key, value)
        target.update_tags(AREA='a = b', lava='ä')
    return path


def assert_equal(found: RasterContent, path: Path, **options: Any) -> None:
    """Compare a raster with the values and properties that rasterio reads."""
    with rasterio.open(path) as source:
        expected = source.read(masked=True, **options)
        for own, theirs in PROPERTIES.items():
            assert_same(getattr(found, own), getattr(source, theirs))
        assert [*found.colours] == [item.name for item in source.colorinterp]
        assert found.tags == source.tags()
    assert found.values.dtype == expected.dtype
    np.testing.assert_array_equal(found.values.data, expected.data)
    np.testing.assert_array_equal(
        np.ma.getmaskarray(found.values), np.ma.getmaskarray(expected)
    )


def assert_same(found: Any, expected: Any) -> None:
    """Compare properties, of which a sequence may be a list or a tuple."""
    if isinstance(expected, tuple) and isinstance(found, list):
        expected = list(expected)
    assert found == expected


@pytest.mark.filterwarnings('ignore::rasterio.errors.NotGeoreferencedWarning')
@pytest.mark.parametrize('name', FILES)
def test_reads_the_same_as_rasterio(tmp_path, name):
    path = write(tmp_path / 'a.tif', name)
    assert_equal(read_raster('a', path, PICTURES, max_bands=9), path)
    assert_equal(
        read_raster('a', path, PICTURES, max_bands=9, max_side=30, kind=np.float64), path,
        out_dtype=np.float64, out_shape=(read_raster('a', path).count, 20, 15),
    )


def test_reads_a_palette(tmp_path):
    colours = {number: (number, 255 - number, 7, 255) for number in range(256)}
    with rasterio.open(tmp_path / 'a.png', 'w', driver='PNG', dtype='uint8', count=1, width=30,
                       height=40, transform=rasterio.Affine(1, 0, 9, 0, -1, 9)) as target:
        target.write((GROUND - 1000.0).astype(np.uint8), 1)
        target.write_colormap(1, colours)
    found = read_raster('a', tmp_path / 'a.png', PICTURES)
    assert {number: tuple(colour) for number, colour in found.palette.items()} == colours


def test_reads_a_mask_in_the_file_and_beside_it(tmp_path):
    for name, is_inside in (('a.tif', True), ('b.tif', False)):
        path = write(tmp_path / name, 'uint8')
        with (
            rasterio.Env(GDAL_TIFF_INTERNAL_MASK=is_inside), rasterio.open(path, 'r+') as target,
        ):
            target.write_mask(GROUND > 1080.0)
        assert path.with_name(f'{name}.msk').exists() != is_inside
        found = read_raster('a', path)
        np.testing.assert_array_equal(~found.values.mask[0], GROUND > 1080.0)
        assert_equal(found, path)


def test_refuses_bands_of_several_types(tmp_path):
    for name in ('a.tif', 'b.tif'):
        write(tmp_path / name, 'uint8' if name < 'b' else 'int16')
    bands = ''.join(
        f'<VRTRasterBand dataType="{kind}" band="{band}"><SimpleSource><SourceFilename '
        f'relativeToVRT="1">{name}</SourceFilename></SimpleSource></VRTRasterBand>'
        for band, (kind, name) in enumerate([('Byte', 'a.tif'), ('Int16', 'b.tif')], 1)
    )
    path = tmp_path / 'c.vrt'
    path.write_text(f'<VRTDataset rasterXSize="30" rasterYSize="40">{bands}</VRTDataset>')
    with pytest.raises(LavaError, match='bands of several types: int16, uint8'):
        read_raster('a', path, max_bands=2)


@pytest.mark.parametrize('kind', ['complex64', 'complex_int16'])
def test_complex_numbers_have_no_cells(tmp_path, kind):
    with rasterio.open(tmp_path / 'a.tif', 'w', driver='GTiff', dtype=kind, count=1, width=3,
                       height=2, transform=rasterio.Affine(1, 0, 9, 0, -1, 9)):
        pass
    found = read_raster('a', tmp_path / 'a.tif')
    assert found.dtypes == ['complex64'] and not found.values.size


def test_warnings_of_gdal_name_the_file(tmp_path, caplog):
    path = write(tmp_path / 'a.tif', 'float32')
    data = bytearray(path.read_bytes())
    # two tags in the wrong order
    first = int.from_bytes(data[4:8], 'little') + 2
    data[first : first + 24] = data[first + 12 : first + 24] + data[first : first + 12]
    path.write_bytes(data)
    assert read_raster('a', path).shape == GROUND.shape
    assert 'a.tif: TIFFReadDirectoryCheckOrder:Invalid TIFF directory' in caplog.text


def test_types_of_gdal_have_the_size_of_those_of_numpy():
    assert {name: size for name, size in TYPES.values() if name in NUMBERS} == {
        name: np.dtype(name).itemsize for name in NUMBERS
    }
