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

"""Viscosity by the law of Vogel, Fulcher and Tammann."""

import numpy as np
import pytest

from lava_ros.scene import Lava
from solver import only


@pytest.mark.parametrize('precision', ['float32', 'float64'])
def test_viscosity_is_the_printed_law(viscosities, device, precision):
    """log10 mu = A + B / (T - C), whatever the constant viscosity says."""
    temperatures = np.linspace(1000.0, 1600.0, 13)
    lava = Lava(viscosity=7.0, vft_a=-4.55, vft_b=5700.0, vft_c=600.0)
    found = viscosities(
        temperatures, only('vft'), lava=lava, precision=precision, device=device
    )
    right = 10.0 ** (-4.55 + 5700.0 / (temperatures - 600.0))
    assert found == pytest.approx(right, rel={'float32': 1e-4, 'float64': 1e-12}[precision])


def test_viscosity_stays_finite_at_and_below_c(viscosities, device):
    """Cold lava has 1e15 Pa s, at and below C as well, and hardly moves."""
    temperatures = [300.0, 599.0, 600.0, 600.5, 900.0]
    lava = Lava(vft_a=-4.55, vft_b=5700.0, vft_c=600.0)
    found = viscosities(
        temperatures, only('vft'), lava=lava, precision='float32', device=device
    )
    assert found[:4] == pytest.approx(1e15, rel=1e-3)
    assert found[4] == pytest.approx(10.0 ** (-4.55 + 5700.0 / 300.0), rel=1e-3)


def test_a_wide_law_ends_a_kelvin_above_c(viscosities):
    """With a B so small that 1e15 Pa s is not reached, nothing is colder than C + 1 K."""
    lava = Lava(vft_a=1.0, vft_b=3.0, vft_c=900.0)
    found = viscosities(
        [900.0, 901.0, 903.0],
        only('vft'),
        lava=lava,
        precision='float64',
        device='cpu',
    )
    assert found == pytest.approx([1e4, 1e4, 1e2], rel=1e-9)
