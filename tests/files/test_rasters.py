# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Raster formats: complete, truncated and rejected files, written by GDAL."""

from pathlib import Path
import socket
from typing import Any

import numpy as np
import pytest
from rasterio.shutil import copy

from geodata import write_raster
from lava_ros.errors import LavaError
from lava_ros.files.raster_formats import FORMATS
from lava_ros.files.rasters import read_raster
from lava_ros.scene.terrain_files import load_terrain

#: Rows from the north; the elevations distinguish mirrored and shifted grids.
GROUND = (1000.0 + np.add.outer(3.0 * np.arange(40.0), np.arange(30.0))).astype(np.float32)

#: Side of an SRTM tile of 3 arc seconds [cells], and its elevations.
TILE = 1201
HEIGHTS = (1000.0 + np.add.outer(np.arange(TILE), np.arange(TILE)) / 4.0).astype(np.int16)

#: Suffix and creation options of the file of each format, by the name of the format.
FILES: dict[str, tuple[str, dict[str, Any]]] = {
    'GDAL virtual raster': ('.vrt', {}),
    'GeoTIFF': ('.tif', {}),
    'Erdas Imagine': ('.img', {'COMPRESS': 'YES'}),
    'NetCDF classic': ('.nc', {'FORMAT': 'NC'}),
    'NetCDF-4': ('.grd', {'FORMAT': 'NC4', 'COMPRESS': 'DEFLATE'}),
    'GeoPackage': ('.gpkg', {}),
    'Surfer 6 text grid': ('.grd', {}),
    'Surfer 6 binary grid': ('.grd', {}),
    'Surfer 7 binary grid': ('.grd', {}),
    'SRTM': ('.hgt', {}),
    'ESRI binary grid': ('.flt', {}),
    'ESRI ASCII grid': ('.asc', {}),
}


def write_ground(path: Path) -> Path:
    return write_raster(path, GROUND)


def write_format(folder: Path, name: str) -> Path:
    """Write a file of a format with GDAL."""
    suffix, options = FILES[name]
    (driver,) = (item.driver for item in FORMATS if item.name == name)
    if driver == 'SRTMHGT':
        path = folder / 'N37E015.hgt'
        step = 1.0 / (TILE - 1)
        return write_raster(
            path, HEIGHTS, driver=driver, crs='EPSG:4326', cell=step,
            north_west=(15.0 - step / 2, 38.0 + step / 2),
        )
    source = write_ground(folder / 'source.tif')
    path = folder / f'ground{suffix}'
    if driver == 'GTiff':
        return source.rename(path)
    copy(source, path, driver=driver, **options)
    return path


def test_each_format_has_a_file():
    assert list(FILES) == [item.name for item in FORMATS]


@pytest.mark.parametrize('name', FILES)
def test_reads_format(tmp_path, name):
    path = write_format(tmp_path, name)
    cells = read_raster('terrain file', path).values[0]
    expected = HEIGHTS if name == 'SRTM' else GROUND
    np.testing.assert_allclose(cells, expected, rtol=1e-7)
    terrain = load_terrain(path)
    assert terrain.epsg == 32633
    if name != 'SRTM':
        np.testing.assert_allclose(terrain.elevation, GROUND[::-1], rtol=1e-7)
        assert (terrain.resolution, terrain.offset) == (10.0, (500_000.0, 4_179_600.0))


@pytest.mark.parametrize('fraction', [0.3, 0.99])
@pytest.mark.parametrize('name', FILES)
def test_rejects_truncated_file(tmp_path, name, fraction):
    path = write_format(tmp_path, name)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(fraction * len(whole))])
    try:
        terrain = load_terrain(path)
    except LavaError:
        return
    # the last bytes of a file may be unused
    assert fraction > 0.9
    np.testing.assert_array_equal(terrain.elevation, GROUND[::-1])


@pytest.mark.parametrize(
    ('driver', 'name'), [('PNG', 'a.png'), ('ENVI', 'a.dat'), ('USGSDEM', 'a.dem')]
)
def test_rejects_other_formats_with_advice(tmp_path, driver, name):
    data = np.ones((TILE, TILE), np.uint8 if driver == 'PNG' else np.int16)
    write_raster(
        tmp_path / name, data, driver=driver, crs='EPSG:4326', cell=1.0 / (TILE - 1),
        north_west=(15.0, 38.0),
    )
    with pytest.raises(LavaError, match='gdal_translate turns other formats into GeoTIFF'):
        load_terrain(tmp_path / name)


def virtual_raster(name: str, *, attributes: str = 'relativeToVRT="1"', more: str = '') -> str:
    """Return the text of a virtual raster with one source."""
    return (
        '<VRTDataset rasterXSize="30" rasterYSize="40"><SRS>EPSG:32633</SRS>'
        '<GeoTransform>500000,10,0,4180000,0,-10</GeoTransform>'
        f'<VRTRasterBand dataType="Float32" band="1">{more}<SimpleSource>'
        f'<SourceFilename {attributes}>{name}</SourceFilename></SimpleSource></VRTRasterBand>'
        '</VRTDataset>'
    )


def test_virtual_raster_opens_files_of_its_folder(tmp_path):
    write_ground(tmp_path / 'tile')
    (tmp_path / 'a.vrt').write_text(virtual_raster('tile'))
    np.testing.assert_array_equal(load_terrain(tmp_path / 'a.vrt').elevation, GROUND[::-1])


WMS = (
    '<GDAL_WMS><Service name="WMS"><ServerUrl>http://127.0.0.1:{port}/x?</ServerUrl>'
    '<Layers>a</Layers></Service><DataWindow><UpperLeftX>0</UpperLeftX>'
    '<UpperLeftY>200</UpperLeftY><LowerRightX>200</LowerRightX><LowerRightY>0</LowerRightY>'
    '<SizeX>20</SizeX><SizeY>20</SizeY></DataWindow><BandsCount>1</BandsCount></GDAL_WMS>'
)

#: Files that refer to others than rasters of their folder, and a text file that they refer to;
#: ``other/tile.tif`` and ``tile.tif`` are rasters.
VIRTUAL = {
    'file in another folder': (virtual_raster('other/tile.tif'), {}),
    'absolute path': (virtual_raster('{folder}/tile.tif', attributes='relativeToVRT="0"'), {}),
    'virtual raster': (virtual_raster('b.vrt'), {'b.vrt': virtual_raster('tile.tif')}),
    'code': (
        virtual_raster('tile.tif', more='<PixelFunctionType>mul</PixelFunctionType>'), {},
    ),
    'system at an address': (
        virtual_raster('tile.tif').replace('EPSG:32633', 'http://127.0.0.1/a.wkt'), {},
    ),
    'service with the name of a tile': (virtual_raster('N37E015.hgt'), {'N37E015.hgt': WMS}),
    'address': (virtual_raster('/vsicurl/http://127.0.0.1:{port}/a.tif'), {}),
    'connection': (virtual_raster('NETCDF:a.nc:z'), {}),
    'missing file': (virtual_raster('none.tif'), {}),
    'no file': ('<VRTDataset rasterXSize="30" rasterYSize="40"/>', {}),
    'entities': ('<!DOCTYPE a [<!ENTITY b "c">]>' + virtual_raster('&b;'), {}),
    'cut off': (virtual_raster('tile.tif')[:-20], {}),
    'service': (WMS, {}),
}


@pytest.mark.parametrize('case', VIRTUAL)
def test_virtual_raster_opens_nothing_else(tmp_path, case):
    with socket.create_server(('127.0.0.1', 0)) as server:
        server.settimeout(0.0)
        text, beside = VIRTUAL[case]
        (tmp_path / 'other').mkdir()
        for name in ('tile.tif', 'other/tile.tif'):
            write_ground(tmp_path / name)
        port = str(server.getsockname()[1])
        names = ('a.vrt', 'a.asc') if case in ('address', 'service') else ('a.vrt',)
        for name, content in {**beside, **dict.fromkeys(names, text)}.items():
            content = content.replace('{port}', port).replace('{folder}', str(tmp_path))
            (tmp_path / name).write_text(content)
        for name in names:
            with pytest.raises(LavaError):
                load_terrain(tmp_path / name)
        with pytest.raises(BlockingIOError):
            server.accept()


def test_rejects_masks_other_than_geotiff(tmp_path):
    path, mask = write_format(tmp_path, 'GeoTIFF'), tmp_path / 'ground.tif.msk'
    mask.write_text(virtual_raster('/vsicurl/http://127.0.0.1:9/a.tif'))
    with pytest.raises(LavaError, match='a mask in a GeoTIFF'):
        load_terrain(path)
    write_ground(tmp_path / 'mask.tif').rename(mask)
    assert load_terrain(path).epsg == 32633


@pytest.mark.parametrize('name', ['GeoPackage', 'NetCDF-4'])
def test_rejects_a_file_with_several_rasters(tmp_path, name):
    path = write_format(tmp_path, name)
    source = write_ground(tmp_path / 'source.tif')
    if name == 'GeoPackage':
        copy(source, path, driver='GPKG', RASTER_TABLE='other', APPEND_SUBDATASET='YES')
    else:
        write_raster(source, np.stack((GROUND, GROUND)))
        copy(source, path, driver='netCDF', FORMAT='NC4')
    with pytest.raises(LavaError, match=r'a file with one raster, not \w+, \w+'):
        load_terrain(path)


def _write_text(path: Path, body: str) -> Path:
    head = 'ncols 3\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 10\n'
    path.write_text(head + body)
    return path


@pytest.mark.parametrize(('body', 'message'), [
    ('1 2 3\n4 5 6\n7 8 9\n', 'number of values in a.asc is 9, expected 6'),
    ('1 2 3\n4 5 6 7\n', 'number of values in a.asc is 7, expected 6'),
    ('1 2 3\n4 5\n', 'number of values in a.asc is 5, expected 6'),
    ('1;2;3\n4;5;6\n', "line 6, column 1 of a.asc is '1;2;3'"),
    ('cellsize 20\n1 2 3\n4 5 6\n', "cellsize of a.asc is '20', expected only once"),
    ('dx 20\n1 2 3\n4 5 6\n', "of a.asc is 'cellsize and dx', expected a line of"),
    ('NODATA_value -9,5\n1 2 3\n4 5 6\n', "is '-9,5', expected a number or nan"),
])
def test_rejects_ambiguous_text_grid(tmp_path, body, message):
    with pytest.raises(LavaError, match=message):
        load_terrain(_write_text(tmp_path / 'a.asc', body))


@pytest.mark.parametrize('name', ['ESRI ASCII grid', 'ESRI binary grid'])
def test_rejects_a_header_without_position_or_cell_size(tmp_path, name):
    path = write_format(tmp_path, name)
    header = path if path.suffix == '.asc' else path.with_suffix('.hdr')
    whole = header.read_text()
    place = [line for line in whole.splitlines(keepends=True)
             if line.lower().startswith(('xll', 'yll', 'cellsize', 'ul', 'xdim', 'ydim'))]
    assert len(place) in (3, 4)
    for line in place:
        header.write_text(whole.replace(line, ''))
        with pytest.raises(LavaError, match='is missing, expected a line of the header'):
            load_terrain(path)


@pytest.mark.parametrize('order', [('xllcenter', 'yllcorner'), ('xllcorner', 'yllcenter')])
@pytest.mark.parametrize('name', ['ESRI ASCII grid', 'ESRI binary grid'])
def test_rejects_the_corner_of_one_axis_with_the_centre_of_the_other(tmp_path, name, order):
    path = write_format(tmp_path, name)
    header = path if path.suffix == '.asc' else path.with_suffix('.hdr')
    values = dict(line.split()[:2] for line in header.read_text().splitlines()[:12])
    west = values.get('xllcorner', values.get('ULXMAP'))
    south = values.get('yllcorner', values.get('ULYMAP'))
    lines = [f'{order[0]} {west}', f'{order[1]} {south}', *(
        line for line in header.read_text().splitlines()
        if not line.lower().startswith(('xll', 'yll', 'ul'))
    )]
    header.write_text('\n'.join(lines) + '\n')
    either = '|'.join(' and '.join(names) for names in (order, order[::-1]))
    with pytest.raises(LavaError, match=f'is .({either}).'):
        load_terrain(path)
    header.write_text(header.read_text().replace(order[1], f'y{order[0][1:]}'))
    assert load_terrain(path).shape == GROUND.shape


def test_rejects_a_damaged_coordinate_system(tmp_path):
    path = write_format(tmp_path, 'Erdas Imagine')
    data = bytearray(path.read_bytes())
    data[data.index(b'WGS 84') - 8] = 44
    path.write_bytes(data)
    with pytest.raises(LavaError, match='a raster that GDAL can read .The WKT could not'):
        load_terrain(path)
