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

"""A channel with walls: what lateral stress does to the mean velocity."""

import pytest

from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification.cases.confined import channel_velocity


@pytest.mark.parametrize(('width', 'spacing'), [(1.0, 0.05), (2.5, 0.125), (5.0, 0.125)])
def test_helmholtz_solve_in_a_channel(device, width, spacing):
    """The solve is within 1 % for channels from one to five thicknesses wide."""
    accuracy = Accuracy(spacing=spacing, ratio=3.0)
    _, mean = channel_velocity(width, effect='helmholtz', accuracy=accuracy, device=device)
    assert mean.error < 0.01


def test_green_function_in_a_channel(device):
    """With a support of 6 / k the Green's function is within 1 %, six thicknesses wide."""
    accuracy = Accuracy(spacing=0.3, ratio=11.5)
    _, mean = channel_velocity(6.0, effect='green', accuracy=accuracy, device=device)
    assert mean.error < 0.01


def test_a_short_support_loses_the_walls(device):
    """Cut off at 1.7 thicknesses the Green's function sees half of the walls: it is no bargain."""
    accuracy = Accuracy(spacing=0.3, ratio=5.5)
    _, mean = channel_velocity(6.0, effect='green', accuracy=accuracy, device=device)
    assert mean.measured > 1.03 * mean.exact
