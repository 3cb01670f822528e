# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""npz files from anywhere -> arrays of bounded size. All npz of this package is read here."""

from pathlib import Path
from zipfile import ZipFile

import numpy as np
from numpy.lib import format as npy

from lava_ros.errors import LavaError
from lava_ros.files import MOST_CELLS, open_input

#: Most bytes of all arrays together: those of that grid in double precision, and some more.
MOST_BYTES = 9 * MOST_CELLS

_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def read_arrays(field: str, path: str | Path) -> dict[str, np.ndarray]:
    """Read the arrays of an .npz file by name, without executing anything in it.

    LavaError, which names ``field``, where the file cannot be read, or its arrays are larger than
    allowed or than the data that the file has for them.
    """
    try:
        with open_input(path) as file, ZipFile(file) as archive:
            size = sum(item.file_size for item in archive.infolist())
            if size > MOST_BYTES:
                raise ValueError(f'{size} bytes of arrays, more than {MOST_BYTES}')
            for item in archive.infolist():
                # numpy takes the memory that a header asks for before it reads on
                with archive.open(item) as member:
                    shape, _, dtype = _HEADERS[npy.read_magic(member)](member)
                # items without bytes are made all the same, each of them
                asked = max(dtype.itemsize, 1)
                for side in shape:
                    asked *= side
                if min(shape, default=0) < 0 or asked > item.file_size:
                    raise ValueError(f'{item.filename} of shape {shape} in {item.file_size} bytes')
            file.seek(0)
            with np.load(file, allow_pickle=False) as stored:
                return {name: stored[name] for name in stored.files}
    # zip, compression and header are parsed by libraries, which may raise anything for them
    except Exception as error:
        right = f'a readable .npz file ({type(error).__name__}: {error})'
        raise LavaError(field, str(path), right) from error
