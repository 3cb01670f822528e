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

"""The surroundings of cells, against every pair of cells."""

import numpy as np
import pytest

from lava_ros.margin import within


@pytest.mark.parametrize('distance', [0.0, 0.9, 1.0, 1.5, 2.0, 3.7, 40.0])
@pytest.mark.parametrize('share', [0.0, 0.01, 0.2, 1.0])
def test_within_is_what_every_pair_says(distance, share):
    """A cell is near exactly when the distance to some marked cell says so."""
    marked = np.random.default_rng(1).random((17, 23)) < share
    rows, columns = np.indices(marked.shape)
    expected = marked.copy()
    for row, column in np.argwhere(marked):
        expected |= np.hypot(rows - row, columns - column) <= distance
    before = marked.copy()
    np.testing.assert_array_equal(within(marked, distance), expected)
    np.testing.assert_array_equal(marked, before)


def test_marks_at_the_border_stay_inside():
    """Marks in the corners do not come round at the other side."""
    marked = np.zeros((6, 8), dtype=bool)
    marked[0, 0] = marked[5, 7] = True
    near = within(marked, 1.0)
    assert near.sum() == 6
    assert near[0, 1] and near[1, 0] and near[4, 7] and near[5, 6]
