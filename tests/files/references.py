# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Files that refer to addresses and to files elsewhere, in every form that GDAL follows.

Each form writes a file into a folder, with a reference to ``other``, and returns its path.
"""

from collections.abc import Callable
import json
from pathlib import Path
import shutil
import sqlite3
from typing import Any
import zipfile

import numpy as np
import rasterio
from rasterio.shutil import copy

from files.test_rasters import GROUND, virtual_raster, WMS, write_format, write_ground
from geodata import feature, write_features, write_raster
from scene.test_vent_files import POINTS
from scene.test_vent_files import write as write_vector

#: Writes a file with a reference into a folder.
Form = Callable[[Path, str], Path]

#: References by kind; ``port`` is that of a server, ``other`` a folder with files to open.
TARGETS = {
    'address': '/vsicurl/http://127.0.0.1:{port}/a.tif',
    'plain address': 'http://127.0.0.1:{port}/a.tif',
    'file': '{other}/tile.tif',
    'archive': '/vsizip/{other}/tile.zip/tile.tif',
    'text': virtual_raster('{other}/tile.tif', attributes='relativeToVRT="0"'),
    'service': WMS,
}


def _written(path: Path, text: str) -> Path:
    path.write_text(text, encoding='utf-8')
    return path


def _escaped(text: str) -> str:
    return text.replace('&', '&amp;').replace('<', '&lt;')


def _metadata(text: str, domain: str = 'OVERVIEWS', key: str = 'OVERVIEW_FILE') -> str:
    item = f'<MDI key="{key}">{_escaped(text)}</MDI>'
    return f'<Metadata domain="{domain}">{item}</Metadata>'


def _auxiliary(name: str, more: Callable[[str], str] = _metadata) -> Form:
    """Return a form with the reference in the auxiliary file of a format."""

    def write(folder: Path, target: str) -> Path:
        path = write_format(folder, name)
        _written(Path(f'{path}.aux.xml'), f'<PAMDataset>{more(target)}</PAMDataset>')
        return path

    return write


def _tags(folder: Path, target: str) -> Path:
    path = write_format(folder, 'GeoTIFF')
    with rasterio.open(path, 'r+') as file:
        file.update_tags(ns='OVERVIEWS', OVERVIEW_FILE=target)
    return path


def _tags_of_database(folder: Path, target: str) -> Path:
    source = _tags(folder, target).rename(folder / 'source.tif')
    copy(source, folder / 'ground.gpkg', driver='GPKG')
    source.unlink()
    return folder / 'ground.gpkg'


def _virtual(text: str) -> Form:
    """Return a form of a virtual raster in whose text ``TARGET`` stands for the reference."""

    def write(folder: Path, target: str) -> Path:
        write_ground(folder / 'tile.tif')
        return _written(folder / 'a.vrt', text.replace('TARGET', _escaped(target)))

    return write


def _beside(name: str) -> Form:
    """Return a form of a GeoTIFF with a virtual raster beside it, such as its mask."""

    def write(folder: Path, target: str) -> Path:
        path = write_format(folder, 'GeoTIFF')
        source = virtual_raster(_escaped(target), attributes='relativeToVRT="0"')
        _written(folder / name, source)
        return path

    return write


def _picture(folder: Path, target: str) -> Path:
    path = folder / 'ground.png'
    write_raster(path, np.ones((3, 4, 5), np.uint8), driver='PNG')
    _written(Path(f'{path}.aux.xml'), f'<PAMDataset>{_metadata(target)}</PAMDataset>')
    return path


def _projection(folder: Path, target: str) -> Path:
    path = write_format(folder, 'ESRI ASCII grid')
    Path(f'{path}.aux.xml').unlink()
    _written(path.with_suffix('.prj'), target)
    return path


def _shifted(target: str) -> str:
    """Return the definition of a system whose datum is shifted by a grid."""
    return (
        'PROJCS["a",GEOGCS["b",DATUM["c",SPHEROID["d",6378137,298.257],EXTENSION["PROJ4_GRIDS","'
        f'{target}"]],PRIMEM["e",0],UNIT["f",0.0174532925199433]],PROJECTION["Transverse_Mercator"'
        '],PARAMETER["central_meridian",15],UNIT["metre",1]]'
    )


def _arrays(path: Path, **more: str) -> Path:
    np.savez(path, elevation=GROUND, resolution=10.0, **more)
    return path


def _named(name: str, text: str = 'TARGET') -> Form:
    """Return a form of a file with a text, in which ``TARGET`` stands for the reference."""
    return lambda folder, target: _written(folder / name, text.replace('TARGET', target))


def _geojson(**members: Any) -> Form:
    """Return a form of GeoJSON with more members, in which ``TARGET`` stands for the reference."""

    def write(folder: Path, target: str) -> Path:
        data = {'type': 'FeatureCollection', 'features': [feature('Point', POINTS[0])], **members}
        text = json.dumps(data).replace('TARGET', json.dumps(target)[1:-1])
        return _written(folder / 'a.geojson', text)

    return write


def _database(*statements: str) -> Form:
    """Return a form of a GeoPackage after statements with the reference as argument."""

    def write(folder: Path, target: str) -> Path:
        path = write_vector(folder / 'a.gpkg', 'Point', POINTS[0], {'name': 'a'})
        with sqlite3.connect(path) as database:
            for statement in statements:
                database.execute(statement, (target,) * statement.count('?'))
        database.close()
        return path

    return write


def _shape(ending: str) -> Form:
    """Return a form of a Shapefile with a part that is the reference."""

    def write(folder: Path, target: str) -> Path:
        path = write_vector(folder / 'a.shp', 'Point', POINTS[0], {'name': 'a'})
        _written(path.with_suffix(ending), target)
        return path

    return write


def _kml(body: str) -> Form:
    """Return a form of KML with more elements."""
    text = (
        '<kml xmlns="http://www.opengis.net/kml/2.2"><Document>' + body + '<Placemark>'
        '<name>a</name><styleUrl>TARGET</styleUrl><Point><coordinates>15,37.7</coordinates>'
        '</Point></Placemark></Document></kml>'
    )
    return lambda folder, target: _written(
        folder / 'a.kml', text.replace('TARGET', _escaped(target))
    )


def _zipped(form: Form, suffix: str, rename: str = '{}') -> Form:
    """Return a form of an archive of another form."""

    def write(folder: Path, target: str) -> Path:
        inner = folder / 'inner'
        inner.mkdir()
        form(inner, target)
        path = folder / f'a{suffix}'
        with zipfile.ZipFile(path, 'w') as archive:
            for item in sorted(inner.iterdir()):
                archive.write(item, rename.format(item.name))
        shutil.rmtree(inner)
        return path

    return write


_MEMBER = virtual_raster('tile.tif')

#: Forms of rasters that take any reference.
RASTERS: dict[str, Form] = {
    'metadata of a GeoTIFF': _tags,
    'auxiliary file of a GeoTIFF': _auxiliary('GeoTIFF'),
    'metadata of a virtual raster': _virtual(
        _MEMBER.replace('<GeoT', _metadata('TARGET') + '<GeoT')
    ),
    'source of a virtual raster': _virtual(virtual_raster('TARGET')),
}

#: Further forms, each with one kind of reference.
MORE_RASTERS: dict[str, tuple[str, Form]] = {
    **{
        f'auxiliary file of {name}': ('address', _auxiliary(name))
        for name in ('Erdas Imagine', 'NetCDF classic', 'NetCDF-4', 'GeoPackage', 'SRTM',
                     'Surfer 6 text grid', 'Surfer 7 binary grid', 'ESRI binary grid',
                     'ESRI ASCII grid', 'GDAL virtual raster')
    },
    'metadata of a GeoPackage': ('address', _tags_of_database),
    'auxiliary file of a picture': ('address', _picture),
    'places of the cells': ('file', _auxiliary(
        'GeoTIFF', lambda target: _metadata(target, 'GEOLOCATION', 'X_DATASET')
    )),
    'system in an auxiliary file': ('plain address', _auxiliary(
        'Surfer 6 text grid', lambda target: f'<SRS>{target}</SRS>'
    )),
    'system in a projection file': ('plain address', _projection),
    'grid of datum shifts in a projection file': (
        'file', lambda folder, target: _projection(folder, _shifted(target)),
    ),
    'grid of datum shifts of an npz file': (
        'file', lambda folder, target: _arrays(folder / 'ground.npz', wkt=_shifted(target)),
    ),
    'link as the system of an npz file': (
        'plain address', lambda folder, target: _arrays(folder / 'ground.npz', wkt=target),
    ),
    'system of a virtual raster': ('plain address', _virtual(
        _MEMBER.replace('EPSG:32633', 'TARGET')
    )),
    'overview of a virtual raster': ('address', _virtual(_MEMBER.replace(
        '<SimpleS', '<Overview><SourceFilename>TARGET</SourceFilename></Overview><SimpleS'
    ))),
    'raw band of a virtual raster': ('file', _virtual(
        virtual_raster('TARGET', attributes='relativetoVRT="0"').replace(
            'band="1"', 'band="1" subClass="VRTRawRasterBand"'
        ))),
    'code of a virtual raster': ('file', _virtual(_MEMBER.replace(
        '<SimpleS', '<PixelFunctionType>TARGET.f</PixelFunctionType><PixelFunctionLanguage>Python'
        '</PixelFunctionLanguage><SimpleS'
    ).replace('band="1"', 'band="1" subClass="VRTDerivedRasterBand"'))),
    'mask of a GeoTIFF': ('address', _beside('ground.tif.msk')),
    'overviews of a GeoTIFF': ('address', _beside('ground.tif.ovr')),
    'service as a GeoTIFF': ('service', _named('a.tif')),
    'service as a text grid': ('service', _named('a.asc')),
    'tile index': ('file', _named('a.vrt', '<GDALTileIndexDataset><IndexDataset>TARGET'
                                  '</IndexDataset></GDALTileIndexDataset>')),
}

_ENTITY = '<!DOCTYPE kml [<!ENTITY b SYSTEM "TARGET">]>'

#: Forms of vector files, each with one kind of reference.
VECTORS: dict[str, tuple[str, Form]] = {
    **{
        f'link to a system, {kind}': ('plain address', _geojson(
            crs={'type': 'link', 'properties': {'href': 'TARGET', 'type': kind}}
        ))
        for kind in ('proj4', 'ogcwkt', 'esriwkt')
    },
    'address as a system': ('plain address', _geojson(
        crs={'type': 'name', 'properties': {'name': 'TARGET'}}
    )),
    'file as a system': ('file', _geojson(
        crs={'type': 'name', 'properties': {'name': 'TARGET'}}
    )),
    'grid in a system': ('file', _geojson(crs={
        'type': 'name', 'properties': {'name': '+proj=longlat +nadgrids=TARGET +type=crs'},
    })),
    'next page': ('plain address', _geojson(
        links=[{'rel': 'next', 'type': 'application/geo+json', 'href': 'TARGET'}]
    )),
    'transfer limit': ('plain address', _named(
        'a.json', '{"exceededTransferLimit": true, "objectIdFieldName": "TARGET", "features": []}'
    )),
    'address as GeoJSON': ('plain address', _named('a.geojson')),
    'virtual layer as GeoJSON': ('file', _named(
        'a.geojson', '<OGRVRTDataSource><OGRVRTLayer name="a"><SrcDataSource>TARGET'
        '</SrcDataSource></OGRVRTLayer></OGRVRTDataSource>'
    )),
    'virtual layer as KML': ('file', _named(
        'a.kml', '<OGRVRTDataSource>TARGET</OGRVRTDataSource>'
    )),
    'system of a GeoPackage': ('plain address', _database(
        'UPDATE gpkg_spatial_ref_sys SET definition = ?'
    )),
    'view of a GeoPackage': ('file', _database(
        'CREATE VIEW w AS SELECT * FROM a',
        "INSERT INTO gpkg_contents SELECT 'w', data_type, ?, description, last_change, min_x, "
        "min_y, max_x, max_y, srs_id FROM gpkg_contents WHERE table_name = 'a'",
        "INSERT INTO gpkg_geometry_columns VALUES ('w', 'geom', 'POINT', 4326, 0, 0)",
    )),
    'style of a GeoPackage': ('address', _database(
        'CREATE TABLE layer_styles (f_table_name TEXT, styleQML TEXT)',
        "INSERT INTO layer_styles VALUES ('a', ?)",
    )),
    'projection file of a Shapefile': ('plain address', _shape('.prj')),
    'code page of a Shapefile': ('file', _shape('.cpg')),
    'index of a Shapefile': ('file', _shape('.qix')),
    'style of a Shapefile': ('plain address', _shape('.qml')),
    'style of KML': ('plain address', _kml('<Style><IconStyle><Icon><href>TARGET</href></Icon>'
                                           '</IconStyle></Style>')),
    'link of KML': ('plain address', _kml('<NetworkLink><Link><href>TARGET</href></Link>'
                                          '</NetworkLink>')),
    'picture of KML': ('plain address', _kml('<GroundOverlay><Icon><href>TARGET</href></Icon>'
                                             '</GroundOverlay>')),
    'schema of KML': ('plain address', _kml('<Schema name="TARGET" id="a"/>')),
    'entity of KML': ('file', lambda folder, target: _written(
        folder / 'a.kml', f'<?xml version="1.0"?>{_ENTITY.replace("TARGET", target)}'
        '<kml xmlns="http://www.opengis.net/kml/2.2"><Document>&b;</Document></kml>'
    )),
    'style in an archive': ('plain address', _zipped(
        _kml('<Style><IconStyle><Icon><href>TARGET</href></Icon></IconStyle></Style>'), '.kmz'
    )),
    'link in an archive': ('file', _zipped(
        _kml('<NetworkLink><Link><href>TARGET</href></Link></NetworkLink>'), '.kmz'
    )),
    'link to a system in an archive': ('plain address', _zipped(_geojson(
        crs={'type': 'link', 'properties': {'href': 'TARGET', 'type': 'proj4'}}
    ), '.zip')),
    'path out of an archive': ('file', _zipped(_geojson(), '.zip', '../../other/{}')),
    'archive in an archive': ('file', _zipped(_zipped(_geojson(), '.zip'), '.zip')),
    'virtual layer in an archive': ('file', _zipped(
        _named('a.kml', '<OGRVRTDataSource>TARGET</OGRVRTDataSource>'), '.zip'
    )),
    'well-known text of a table': ('plain address', _named(
        'a.csv', 'name,wkt\na,"TARGET"\nb,POINT (500100 4180100)\n'
    )),
}

#: All forms by name: the reference and the writer.
FORMS: dict[str, tuple[str, Form]] = {
    **{
        f'{name}, {kind}': (TARGETS[kind], form)
        for name, form in RASTERS.items() for kind in TARGETS
    },
    **{
        name: (TARGETS[kind], form) for name, (kind, form) in (MORE_RASTERS | VECTORS).items()
    },
}


def write_other(folder: Path) -> None:
    """Write the files to which the references lead."""
    folder.mkdir()
    write_ground(folder / 'tile.tif')
    with zipfile.ZipFile(folder / 'tile.zip', 'w') as archive:
        archive.write(folder / 'tile.tif', 'tile.tif')
    write_features(folder / 'a.geojson', feature('Point', POINTS[0]))
