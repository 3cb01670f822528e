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

"""Sums over an array in one launch."""

import numpy as np
import pytest
import warp as wp

from lava_ros.simulation.backend.graph import Launches
from lava_ros.simulation.backend.scan import Scan


@pytest.mark.parametrize('length', [4, 4096, 4100, 100_000, 600_000, 3_000_000])
def test_what_is_before_each_item(device: str, length: int) -> None:
    """Of one tile and of many, and again with the same words."""
    rng = np.random.default_rng(length)
    starts = wp.full(length, -1, dtype=wp.int32, device=device)
    scan, launches = Scan(length, wp.get_device(device)), Launches(wp.get_device(device))
    for most in (1, 700):
        sizes = rng.integers(0, most + 1, length)
        for _ in range(3):
            scan(launches, wp.array(sizes, dtype=wp.int32, device=device), starts)
            assert (starts.numpy() == np.cumsum(sizes) - sizes).all()
