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

"""Maps of an ensemble -> messages, and a message of where lava was seen -> a mask."""

from typing import Any

from nav_msgs.msg import OccupancyGrid
import numpy as np

from lava_ros.errors import LavaError
from lava_ros.forecast.assimilation import Mask
from lava_ros.forecast.probability import HazardMaps, occupancy
from lava_ros.layers import IMAGE, OCCUPANCY_GRID
from lava_ros.ros import codec
from lava_ros.ros.inputs import check_info, InputRules
from lava_ros.scene import Terrain

#: Value of a mask's cell from which on there is lava; negative ones are unknown.
LEAST_LAVA = 50

#: Largest value of a cell of an occupancy grid.
MOST_CELL = 100

#: Arrival where nothing is known.
UNKNOWN = -1.0


def probability_messages(
    maps: HazardMaps, terrain: Terrain, *, frame_id: str, stamp_ns: int
) -> dict[str, tuple[str, Any]]:
    """Make the messages of an ensemble.

    Args:
        maps: The maps.
        terrain: The ground they belong to.
        frame_id: Frame of the messages.
        stamp_ns: Time from which on the maps look ahead [ns].

    Returns:
        Type and message by relative topic: ``inundation_probability`` as an occupancy grid, and as
        32FC1 images ``expected_thickness`` [m] and ``arrival_time_p10``, ``_p50``, ``_p90``: the
        time [s] by which so many per cent of the members had lava, NaN where fewer had any and -1
        where nothing is known, as in ``arrival_time``.
    """
    header, info = codec.header(frame_id, stamp_ns), codec.map_metadata(terrain, stamp_ns)
    grid = codec.occupancy_grid(occupancy(maps.probability), info, header)
    messages: dict[str, tuple[str, Any]] = {
        'inundation_probability': (OCCUPANCY_GRID, grid),
        'expected_thickness': (IMAGE, codec.float_image(maps.thickness, header)),
    }
    for share, values in maps.arrival.items():
        name = f'arrival_time_p{round(100 * share)}'
        times = np.where(terrain.has_data, values, np.float32(UNKNOWN))
        messages[name] = (IMAGE, codec.float_image(times, header))
    return messages


def mask_from_grid(grid: OccupancyGrid, rules: InputRules, *, name: str = 'observed') -> Mask:
    """Read where lava was seen: 50 to 100 lava, 0 to 49 none, negative where nobody looked.

    Args:
        grid: The message.
        rules: What is asked of it.
        name: What it is called in errors.

    Raises:
        LavaError: Frame, size, resolution, origin or data are not usable.
    """
    if grid.header.frame_id != rules.frame_id:
        right = f'{rules.frame_id!r}: nothing is transformed here'
        raise LavaError(f'{name}.header.frame_id', grid.header.frame_id, right)
    info = grid.info
    check_info(info, rules, name=f'{name}.info')
    if len(grid.data) != info.width * info.height:
        right = f'width x height = {info.width * info.height} cells'
        raise LavaError(f'{name}.data', f'{len(grid.data)} cells', right)
    cells = np.asarray(grid.data, dtype=np.int8).reshape(info.height, info.width)
    if cells.max() > MOST_CELL:
        raise LavaError(f'{name}.data', int(cells.max()), f'cells from -1 to {MOST_CELL}')
    return Mask(
        lava=cells >= LEAST_LAVA,
        known=cells >= 0,
        # The shortest decimal number the float32 stands for: 0.1, not 0.10000000149.
        resolution=float(str(np.float32(info.resolution))),
        origin=(info.origin.position.x, info.origin.position.y),
    )
