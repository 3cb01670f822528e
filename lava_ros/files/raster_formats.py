# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Raster formats that can be read, recognised by the first bytes of a file."""

import re
from typing import NamedTuple


class RasterFormat(NamedTuple):
    """A raster format that can be read.

    Attributes:
        name: Name of the format, for people.
        driver: Name of the GDAL driver.
        suffixes: Usual suffixes of file names.
        head: Pattern of the first bytes of such files.
        needs_suffix: True if the first bytes of such files do not identify them.
        notes: Conditions and limits, for people.
        written: Outputs in this format, for people; empty if it is only read.
    """

    name: str
    driver: str
    suffixes: tuple[str, ...]
    head: re.Pattern[bytes]
    needs_suffix: bool = False
    notes: str = ''
    written: str = ''


#: A line of an ESRI ASCII grid's header.
HEADER = re.compile(
    rb'\s*(ncols|nrows|[xy]ll(?:corner|center)|cellsize|d[xy]|nodata_value|byteorder)\s+(\S+)',
    re.IGNORECASE,
)

NUMBER = rb'[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?'

#: Pattern and description of the value of each line in the header of an ESRI grid.
EXPECTED_LINES = {
    name: (re.compile(pattern, re.IGNORECASE), words)
    for names, pattern, words in (
        ('nrows ncols nbands nbits skipbytes bandrowbytes totalrowbytes bandgapbytes', rb'\d+',
         'a whole number'),
        ('ulxmap ulymap xllcorner yllcorner xllcenter yllcenter cellsize xdim ydim dx dy '
         'min_value max_value', NUMBER, 'a number'),
        ('nodata nodata_value', NUMBER + rb'|nan|null', 'a number or nan'),
        ('byteorder', rb'[im]|[lm]sbfirst', 'I or M'),
        ('layout', rb'bi[lp]|bsq', 'BIL, BIP or BSQ'),
        ('pixeltype', rb'(un)?signedint|float', 'SIGNEDINT, UNSIGNEDINT or FLOAT'),
    )
    for name in names.split()
}

#: Groups of lines of which exactly one is required, by their meaning: without them GDAL assumes a
#: corner at 0 and cells of side 1, and it accepts a corner for one axis with a centre for the
#: other.
POSITION_LINES = (
    (('ulxmap', 'ulymap'), ('xllcorner', 'yllcorner'), ('xllcenter', 'yllcenter')),
    (('xdim', 'ydim'), ('cellsize',), ('dx', 'dy')),
)

#: Raster formats in the order of detection.
FORMATS = (
    RasterFormat(
        'GDAL virtual raster', 'VRT', ('.vrt',), re.compile(rb'[^\0]*<VRTDataset'),
        notes='mosaic of GeoTIFF, Erdas Imagine or SRTM files of the same folder',
    ),
    RasterFormat(
        'GeoTIFF', 'GTiff', ('.tif', '.tiff'), re.compile(rb'II\*\0|MM\0\*|II\+\0|MM\0\+'),
        notes='also BigTIFF and cloud-optimised (COG)',
        written='maps of `lava export`, `ensemble`, `hindcast` and `barrier`, as COG',
    ),
    RasterFormat('Erdas Imagine', 'HFA', ('.img',), re.compile(rb'EHFA_HEADER_TAG')),
    RasterFormat(
        'NetCDF classic', 'netCDF', ('.nc', '.grd'), re.compile(rb'CDF[\1\2\5]'),
        notes='a single gridded variable', written='`--formats nc`: all maps, CF conventions',
    ),
    RasterFormat(
        'NetCDF-4', 'netCDF', ('.nc', '.grd'), re.compile(rb'\x89HDF\r\n\x1a\n'),
        notes='a single gridded variable, as GMT writes it',
    ),
    RasterFormat(
        'GeoPackage', 'GPKG', ('.gpkg',), re.compile(rb'SQLite format 3\0'),
        notes='a single raster table',
    ),
    RasterFormat('Surfer 6 text grid', 'GSAG', ('.grd',), re.compile(rb'DSAA')),
    RasterFormat('Surfer 6 binary grid', 'GSBG', ('.grd',), re.compile(rb'DSBB')),
    RasterFormat('Surfer 7 binary grid', 'GS7BG', ('.grd',), re.compile(rb'DSRB')),
    RasterFormat(
        # the first byte of an elevation below 9216 m, which text of another format does not have
        'SRTM', 'SRTMHGT', ('.hgt',), re.compile(rb'[\0-\x23\x80\xfe\xff]'), needs_suffix=True,
        notes='named after its south-west corner, such as `N37E015.hgt`',
    ),
    RasterFormat(
        'ESRI binary grid', 'EHdr', ('.flt', '.bil'), re.compile(b''), needs_suffix=True,
        notes='with its `.hdr` file',
    ),
    RasterFormat(
        'ESRI ASCII grid', 'AAIGrid', ('.asc', '.txt'), HEADER,
        notes='decimal points only; with a `.prj` file or an EPSG code',
    ),
)

#: Formats of pictures, which need not be georeferenced.
PICTURES = (
    *(item for item in FORMATS if item.driver == 'GTiff'),
    RasterFormat('PNG', 'PNG', ('.png',), re.compile(rb'\x89PNG')),
    RasterFormat('JPEG', 'JPEG', ('.jpg', '.jpeg'), re.compile(rb'\xff\xd8\xff')),
)

#: Drivers of the source files of a virtual raster.
TILE_DRIVERS = ('GTiff', 'HFA', 'SRTMHGT')
