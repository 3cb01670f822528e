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

"""Grids are read from their bytes as decoders read them."""

from nav_msgs.msg import OccupancyGrid
import numpy as np
import pytest

from lava_ros.bag.decoding import read_grid
from lava_ros.bag.reader import BagMessage
from lava_ros.errors import LavaError
from lava_ros.ros import codec


def message(frame_id: str = 'map') -> BagMessage:
    """A grid of 3 rows and 5 columns as it is in a bag."""
    grid = OccupancyGrid()
    grid.header.frame_id = frame_id
    grid.info.resolution, grid.info.width, grid.info.height = 2.5, 5, 3
    grid.info.origin.position.x, grid.info.origin.position.y = -7.0, 1e6
    grid.data = list(range(-1, 14))
    return BagMessage('/height', 1, 1, codec.serialise(grid))


@pytest.mark.parametrize('frame_id', ['', 'm', 'ma', 'map', 'odom', 'a/long/frame'])
def test_a_grid(frame_id: str) -> None:
    """Whatever the length of the name before them, values and place are found."""
    grid = read_grid(message(frame_id))
    np.testing.assert_array_equal(grid.cells, np.arange(-1, 14).reshape(3, 5))
    assert grid.cells.dtype == np.int8
    assert (grid.resolution, grid.origin) == (2.5, (-7.0, 1e6))


def test_every_cut_is_refused() -> None:
    """A message that breaks off anywhere is an error, never a grid of something else."""
    whole = message()
    # Serialisation pads the end to four bytes.
    for length in range(len(whole.data) - 3):
        with pytest.raises(LavaError, match='message on /height'):
            read_grid(whole._replace(data=whole.data[:length]))


def test_a_size_that_is_not_that_of_the_cells() -> None:
    """Rows and columns that do not make the cells there are, are refused."""
    grid = OccupancyGrid()
    grid.info.width, grid.info.height, grid.data = 4, 4, [0] * 15
    with pytest.raises(LavaError, match='a grid'):
        read_grid(BagMessage('/height', 1, 1, codec.serialise(grid)))


def test_a_big_endian_grid() -> None:
    """The order of bytes that the message names is followed."""
    little = message().data
    body = bytearray(little)
    body[1] = 0

    def swap(start: int, size: int) -> None:
        at = 4 + start
        body[at : at + size] = body[at : at + size][::-1]

    # Stamp, length of the name, load time, resolution, width, height; pose; count of cells.
    for start in (0, 4, 8, 16, 20, 24, 28, 32):
        swap(start, 4)
    for start in range(40, 96, 8):
        swap(start, 8)
    swap(96, 4)
    grid = read_grid(BagMessage('/height', 1, 1, bytes(body)))
    np.testing.assert_array_equal(grid.cells, np.arange(-1, 14).reshape(3, 5))
    assert grid.origin == (-7.0, 1e6)
