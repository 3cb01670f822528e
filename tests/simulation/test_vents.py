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


"""The tables of vents on a device."""

import numpy as np

from lava_ros.scene import Vent
from lava_ros.simulation.vents import VentSet


def test_a_long_discharge_series_becomes_a_table() -> None:
    """Of 300,000 points: to integrate up to each one from the first would take hours."""
    count = 300_000
    vent = Vent((0.0, 0.0), 1.0)
    # what is validated point by point takes seconds
    series = tuple((float(time), float(time % 7)) for time in range(count))
    object.__setattr__(vent, 'discharge', series)
    vents = VentSet(
        [vent],
        since=10.0,
        carried=[4.0],
        centre=np.zeros(2),
        particle_volume=1.0,
        least_radius=1.0,
        downhill=[0.0],
        symmetric=False,
        device='cpu',
    )
    volumes = vents.outlets.volumes.numpy()
    assert volumes.shape == (count,)
    assert volumes[:14].tolist() == 11 * [4.0] + [7.0, 11.0, 16.0]
    assert volumes[-1] == 4.0 + vents.emitted(count - 1.0)
