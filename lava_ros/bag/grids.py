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

"""An occupancy grid as a bag holds it -> an array: decoders make a Python number of each cell."""

from dataclasses import dataclass
import struct

import numpy as np

from lava_ros.bag.reader import BagMessage
from lava_ros.errors import LavaError

#: Bytes before what CDR aligns.
_CDR_HEADER = 4


@dataclass(frozen=True, eq=False)
class Grid:
    """A nav_msgs/OccupancyGrid.

    Attributes:
        resolution: Side of a cell [m].
        origin: Position (x, y) [m] of the lower-left corner of cell [0, 0].
        cells: Values, int8, shape [rows, columns].
    """

    resolution: float
    origin: tuple[float, float]
    cells: np.ndarray


def read_grid(message: BagMessage) -> Grid:
    """Read the grid that a message carries.

    Raises:
        LavaError: The message is cut off or is not such a grid.
    """
    body = memoryview(message.data)[_CDR_HEADER:]
    try:
        order = '<' if message.data[1] & 1 else '>'
        # The header: a stamp of 8 bytes, the length of the frame's name and the name.
        (length,) = struct.unpack_from(f'{order}I', body, 8)
        start = _aligned(12 + length, 4)
        # Its load time, 8 bytes, comes before the rest of the description.
        resolution, columns, rows = struct.unpack_from(f'{order}f2I', body, start + 8)
        pose = _aligned(start + 20, 8)
        x, y = struct.unpack_from(f'{order}2d', body, pose)
        (count,) = struct.unpack_from(f'{order}I', body, pose + 56)
        cells = np.frombuffer(body, np.int8, count, pose + 60)
        return Grid(resolution, (x, y), cells.reshape(rows, columns))
    except (IndexError, struct.error, ValueError) as error:
        raise LavaError(
            f'message on {message.topic}', f'{len(message.data)} bytes', f'a grid ({error})'
        ) from error


def _aligned(position: int, size: int) -> int:
    return -(-position // size) * size
