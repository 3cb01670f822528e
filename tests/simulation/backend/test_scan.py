# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Cumulative sums on a device."""

import numpy as np
import pytest
import warp as wp

from lava_ros.simulation.backend.graph import Launches
from lava_ros.simulation.backend.scan import Scan


@pytest.mark.parametrize('length', [4, 4100, 600_000, 3_000_000])
def test_scan_sums_the_preceding_items(device, length):
    rng = np.random.default_rng(length)
    starts = wp.full(length, -1, dtype=wp.int32, device=device)
    scan, launches = Scan(length, wp.get_device(device)), Launches(wp.get_device(device))
    for most in (1, 700):
        sizes = rng.integers(0, most + 1, length)
        for _ in range(3):
            scan(launches, wp.array(sizes, dtype=wp.int32, device=device), starts)
            assert (starts.numpy() == np.cumsum(sizes) - sizes).all()
