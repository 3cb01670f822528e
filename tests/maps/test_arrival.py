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

"""When lava came, from frames."""

from pathlib import Path

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.maps.arrival import Arrival
from lava_ros.maps.frames import Recording
from recording import GRIDS, growing, RAW_CONFIG, record


def arrival_of(bag: Path, threshold: float) -> Arrival:
    """The arrival over all frames of a bag."""
    result = Arrival(threshold)
    for frame in Recording(bag).frames():
        result.add(frame)
    return result


def test_first_times(tmp_path):
    """A cell has the time of the first frame with lava, also when the lava has left since."""

    def flow(time: float) -> np.ndarray:
        thickness = growing(time)
        if time > 500.0:
            thickness[:, 0] = 0.0
        return thickness

    found = arrival_of(record(tmp_path / 'bag', flow=flow), 0.1)
    assert found.times is not None
    expected = [200, 200, 400, 400, 600, 600, 800, 800, np.nan]
    np.testing.assert_array_equal(found.times[12, :9], expected)
    assert np.isnan(found.times[:10]).all()
    assert (found.longest_gap, found.frame_count) == (200.0, 4)


def test_the_threshold_decides(tmp_path):
    """Cells whose lava stays below it are never reached."""
    bag = record(tmp_path / 'bag', config=RAW_CONFIG)
    found = arrival_of(bag, 3.05)
    assert found.times is not None and found.peak is not None
    # 3.26 m less 5 cm a column: columns 0 to 4 are above 3.05 m.
    np.testing.assert_array_equal(np.isfinite(found.times[12]), np.arange(40) < 5)
    np.testing.assert_allclose(found.peak[12, :8], 3.26 - 0.05 * np.arange(8), rtol=1e-6)


@pytest.mark.parametrize('threshold', [0.05, 0.0, -1.0])
def test_a_threshold_that_the_layer_does_not_show(tmp_path, threshold):
    """A grid without lava thinner than 0.1 m cannot say when such lava came."""
    with pytest.raises(LavaError, match=r'threshold is .*at least 0\.1 m'):
        arrival_of(record(tmp_path / 'bag', config=GRIDS), threshold)


def test_a_step_of_the_grid_counts_as_what_it_stands_for(tmp_path):
    """Lava that the grid rounds to the threshold has arrived."""
    bag = record(tmp_path / 'bag', flow=lambda time: np.full_like(growing(time), 0.3))
    found = arrival_of(bag, 0.3)
    assert found.times is not None
    assert np.isfinite(found.times).sum() == 30 * 40 - 6


def test_times_are_those_that_the_simulation_noted(tmp_path):
    """Maps 200 s apart give them to the step, for this threshold alone, where maps have lava."""

    def noted(time: float) -> np.ndarray:
        times = np.where(growing(time) > 0.0, 100.0 * np.arange(40) + 37.5, np.nan)
        times[25] = 12.0
        return times

    bag = record(tmp_path / 'bag', arrived=noted)
    found = arrival_of(bag, 0.1)
    assert found.times is not None and found.is_noted
    np.testing.assert_array_equal(found.times[12, :8], 100.0 * np.arange(8) + 37.5)
    assert not np.isfinite(found.times[25]).any()
    other = arrival_of(bag, 0.5)
    assert other.times is not None and not other.is_noted
    assert other.times[12, 0] == 200.0
