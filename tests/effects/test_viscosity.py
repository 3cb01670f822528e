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

"""Viscosity by the law of Vogel, Fulcher and Tammann, and of lava that carries crystals."""

from dataclasses import replace

import numpy as np
import pytest

from effects.columns import viscosities
from lava_ros.effects.crystals import LEAST_ROOM
from lava_ros.scene import Lava
from solver import only

MELT = Lava(viscosity=7.0, vft_a=-4.55, vft_b=5700.0, vft_c=600.0)

CRYSTALS = Lava(
    viscosity=50.0, arrhenius=0.01, reference_temperature=1400.0, liquidus=1450.0, solidus=1250.0,
    crystal_law='maron-pierce', crystals=0.5,
)

within = pytest.mark.parametrize(('precision', 'within'), [('float32', 1e-4), ('float64', 1e-12)])


@within
def test_the_law_of_the_melt_is_the_printed_one(device, precision, within):
    """log10 mu = A + B / (T - C), whatever the constant viscosity says."""
    temperatures = np.linspace(1000.0, 1600.0, 13)
    found = viscosities(temperatures, only('vft'), lava=MELT, precision=precision, device=device)
    right = 10.0 ** (-4.55 + 5700.0 / (temperatures - 600.0))
    assert found == pytest.approx(right, rel=within)


def test_viscosity_stays_finite_at_and_below_c(device):
    """Cold lava has 1e15 Pa s, at and below C as well, and hardly moves."""
    temperatures = [300.0, 599.0, 600.0, 600.5, 900.0]
    found = viscosities(temperatures, only('vft'), lava=MELT, precision='float32', device=device)
    assert found[:4] == pytest.approx(1e15, rel=1e-3)
    assert found[4] == pytest.approx(10.0 ** (-4.55 + 5700.0 / 300.0), rel=1e-3)


def test_a_wide_law_ends_a_kelvin_above_c():
    """With a B so small that 1e15 Pa s is not reached, nothing is colder than C + 1 K."""
    lava = Lava(vft_a=1.0, vft_b=3.0, vft_c=900.0)
    temperatures = [900.0, 901.0, 903.0]
    found = viscosities(temperatures, only('vft'), lava=lava, precision='float64', device='cpu')
    assert found == pytest.approx([1e4, 1e4, 1e2], rel=1e-9)


@within
@pytest.mark.parametrize(('law', 'exponent'), [('einstein-roscoe', 2.5), ('maron-pierce', 2.0)])
@pytest.mark.parametrize('arrhenius', [False, True])
def test_the_law_of_crystals_is_the_printed_one(
    device, precision, within, law, exponent, arrhenius
):
    """(1 - phi / phi_m)^-e times the melt's viscosity; phi is linear from liquidus to solidus."""
    temperatures = np.linspace(1200.0, 1500.0, 13)
    effects = only('crystals', *['arrhenius'] * arrhenius)
    lava = replace(CRYSTALS, crystal_law=law)
    found = viscosities(temperatures, effects, lava=lava, precision=precision, device=device)
    phi = np.clip(0.5 * (1450.0 - temperatures) / 200.0, 0.0, 0.5)
    melt = 50.0 * np.exp(0.01 * (1400.0 - temperatures)) if arrhenius else 50.0
    assert found == pytest.approx(melt * (1.0 - phi / 0.6) ** -exponent, rel=within)


def test_jammed_crystals_leave_a_finite_viscosity(device):
    """Where crystals are packed as densely as they can, or would be more, mu stops rising."""
    lava, temperatures = replace(CRYSTALS, crystals=0.9), [1260.0, 1300.0, 1450.0]
    found = viscosities(
        temperatures, only('crystals'), lava=lava, precision='float32', device=device
    )
    assert found[0] == pytest.approx(50.0 * LEAST_ROOM**-2.0, rel=1e-3)
    assert found[1] == pytest.approx(found[0])
    assert found[2] == pytest.approx(50.0, rel=1e-4)
