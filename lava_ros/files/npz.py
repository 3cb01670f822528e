# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Reader of untrusted npz files into arrays of bounded size."""

import math
from pathlib import Path
from zipfile import ZipFile

import numpy as np
from numpy.lib import format as npy

from lava_ros.errors import refusing
from lava_ros.files import MAX_CELLS, open_input

#: Maximum size of all arrays together [bytes]: a grid in double precision, and a margin.
MAX_BYTES = 9 * MAX_CELLS

_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def read_arrays(field: str, path: str | Path) -> dict[str, np.ndarray]:
    """Read the arrays of an .npz file by name, without unpickling.

    Raises:
        LavaError: If the file cannot be read, or its arrays are larger than allowed or than the
            data in the file. The error names ``field``.
    """
    with (
        refusing(field, str(path), 'a readable .npz file'),
        open_input(path) as file,
        ZipFile(file) as archive,
    ):
        size = sum(item.file_size for item in archive.infolist())
        if size > MAX_BYTES:
            raise ValueError(f'{size} bytes of arrays, more than {MAX_BYTES}')
        for item in archive.infolist():
            # numpy allocates the size in the header before it reads the data
            with archive.open(item) as member:
                shape, _, dtype = _HEADERS[npy.read_magic(member)](member)
            # numpy also creates items of size 0 one by one
            asked = math.prod(shape, start=max(dtype.itemsize, 1))
            if min(shape, default=0) < 0 or asked > item.file_size:
                raise ValueError(f'{item.filename} of shape {shape} in {item.file_size} bytes')
        file.seek(0)
        with np.load(file, allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files}
