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

"""Messages and bags to test with, made without ROS."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import get_typestore, Stores

from lava_ros.bag import BagWriter, LATCHED, QosProfile

GRID = 'nav_msgs/msg/OccupancyGrid'
SECOND = 1_000_000_000

Messages = list[tuple[str, int, bytes]]


@pytest.fixture(scope='session')
def make_grid() -> Callable[[int], bytes]:
    """Serialises an OccupancyGrid of 40 x 60 cells with the given stamp [ns]."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    time = types['builtin_interfaces/msg/Time']
    pose = types['geometry_msgs/msg/Pose'](
        types['geometry_msgs/msg/Point'](-5.0, 7.0, 0.0),
        types['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0),
    )

    def make(stamp_ns: int) -> bytes:
        stamp = time(*divmod(stamp_ns, SECOND))
        cells = np.random.default_rng(stamp_ns).integers(-1, 101, 40 * 60).astype(np.int8)
        message = types[GRID](
            types['std_msgs/msg/Header'](stamp, 'map'),
            types['nav_msgs/msg/MapMetaData'](time(0, 0), 2.5, 60, 40, pose),
            cells,
        )
        return bytes(store.serialize_cdr(message, GRID))

    return make


@pytest.fixture
def bag(tmp_path: Path, make_grid: Callable[[int], bytes]) -> tuple[Path, Messages]:
    """A finished bag and what was written: /hazard latched each second, /points each half."""
    directory = tmp_path / 'eruption'
    messages: Messages = []
    with BagWriter(directory, custom_data={'scene': '{"gravity": 9.81}', 'note': 'a\nb'}) as out:
        for half in range(20):
            stamp = 100 * SECOND + half * SECOND // 2
            if half % 2 == 0:
                messages.append(('/hazard', stamp, make_grid(stamp)))
                out.write('/hazard', GRID, messages[-1][2], stamp, qos=LATCHED)
            messages.append(('/points', stamp, make_grid(stamp + 1)))
            out.write(
                '/points', GRID, messages[-1][2], stamp, qos=QosProfile(reliability='best_effort')
            )
            if half % 4 == 3:
                out.flush()
    return directory, messages
