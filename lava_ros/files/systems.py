# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Definitions of coordinate systems in files: by a code, an OGC name or well-known text."""

import re

from lava_ros.errors import LavaError

#: A code such as EPSG:32633, an OGC name with such a code, and the start of well-known text.
_CODE = re.compile(r'\s*((?:EPSG|OGC|ESRI|IGNF|IAU_\d+):\w+)\s*', re.IGNORECASE)
_NAME = re.compile(
    r'\s*(?:urn:(?:x-)?ogc:def:crs:|https?://(?:www\.)?opengis\.net/def/crs/)'
    r'(\w+)[:/][\w.]*[:/](\w+)\s*', re.IGNORECASE,
)
_TEXT = re.compile(r'\s*[A-Za-z_]+\s*\[')

#: Parts of well-known text that name a file, such as a grid of datum shifts.
_FILES = re.compile(
    r'PARAMETERFILE\s*\[[^\]]*|PROJ4_GRIDS"\s*,\s*"(?!@null")[^"]*|'
    r'\w*(?:grids|geoid|file|model|init)=(?!@null\b)[^\s"]*',
    re.IGNORECASE,
)


def plain_system(field: str, text: str) -> str:
    """Return the definition of a coordinate system in a file, an OGC name as a code.

    Raises:
        LavaError: If it is a link or another definition, for which GDAL or PROJ would open files
            and addresses, or if it names a file.
    """
    if name := _NAME.fullmatch(text):
        return f'{name[1]}:{name[2]}'
    if code := _CODE.fullmatch(text):
        return code[1]
    if not _TEXT.match(text):
        expected = 'an EPSG code, an OGC name or well-known text'
        raise LavaError(field, text, expected)
    if named := _FILES.search(text):
        raise LavaError(field, named[0], 'a coordinate system without references to files')
    return text
