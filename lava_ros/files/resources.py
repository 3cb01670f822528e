# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Paths of the package's data files: msg_configs/, examples/, launch/."""

import os
from pathlib import Path
import sys

from lava_ros.errors import LavaError
from lava_ros.files import similar_file

PACKAGE = 'lava_ros'


def share_path(relative: str) -> Path:
    """Return the path of a data file or folder of this package.

    The search order is the checkout from which the package runs, each ament prefix
    (``AMENT_PREFIX_PATH``), and the data files of pip (``sys.prefix``).

    Raises:
        LavaError: If there is no such file. The error lists the places that were searched.
    """
    return _first(_own(relative), 'share path', relative, f'a file of {PACKAGE}')


def find_file(name: str | Path, folder: str, *, field: str, expected: str) -> Path:
    """Find a file by its path, otherwise by its name in a folder of this package.

    Args:
        name: Path or file name.
        folder: Folder of this package, such as ``msg_configs``.
        field: Name of the field in an error.
        expected: Description of a valid value in an error.

    Returns:
        Path of the file.

    Raises:
        LavaError: If there is no such file. The error lists the places that were searched.
    """
    path = Path(name)
    # only a bare name is searched in the folder: a path could lead out of it
    own = _own(f'{folder}/{name}') if path.name == str(name) else []
    return _first([path, *own], field, str(name), expected)


def _first(paths: list[Path], field: str, value: str, expected: str) -> Path:
    """Return the first path that exists."""
    for path in paths:
        if os.path.lexists(path):
            return path
    places = ', '.join(str(path.absolute()) for path in paths)
    raise LavaError(field, value, f'{expected}; looked for {places}{similar_file(paths[0])}')


def _own(relative: str) -> list[Path]:
    """Return the possible paths of a data file of this package."""
    checkout = Path(__file__).resolve().parents[2]
    manifest = checkout / 'package.xml'
    is_checkout = manifest.is_file() and f'<name>{PACKAGE}</name>' in manifest.read_text('utf-8')
    ament = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    prefixes = [*(Path(item) for item in ament if item), Path(sys.prefix)]
    roots = [checkout] * is_checkout + [prefix / 'share' / PACKAGE for prefix in prefixes]
    return [root / relative for root in roots]
