# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lava from places to cells."""

import numpy as np
import pytest

from lava_ros.scene import Terrain
from lava_ros.simulation.cells.grid import deposit


@pytest.mark.parametrize(('place', 'rows', 'columns'), [
    # lava outside of the terrain goes to the cell of its place
    ((2.4, 2.4), [0.3, 0.7, 0.0, 0.0], [0.3, 0.7, 0.0, 0.0, 0.0]),
    ((0.4, 0.4), [1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0, 0.0]),
    ((9.6, 7.6), [0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 0.0, 1.0]),
    ((7.6, 5.6), [0.0, 0.0, 0.7, 0.3], [0.0, 0.0, 0.0, 0.7, 0.3]),
])
def test_lava_is_shared_out_by_the_overlap_of_its_square(place, rows, columns):
    found = deposit(
        Terrain(np.zeros((4, 5)), 2.0), np.array([place]), np.array([10.0]), np.array([2.0])
    )
    np.testing.assert_allclose(found, 10.0 * np.outer(rows, columns), atol=1e-12)
