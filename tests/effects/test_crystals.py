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

"""Viscosity of lava that carries crystals."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.effects.crystals import LEAST_ROOM
from lava_ros.scene import Lava
from solver import only

LAVA = Lava(
    viscosity=50.0,
    arrhenius=0.01,
    reference_temperature=1400.0,
    liquidus=1450.0,
    solidus=1250.0,
    crystal_law='maron-pierce',
    crystals=0.5,
)


@pytest.mark.parametrize('precision', ['float32', 'float64'])
@pytest.mark.parametrize('law', ['einstein-roscoe', 'maron-pierce'])
@pytest.mark.parametrize('arrhenius', [False, True])
def test_viscosity_is_the_printed_law(viscosities, device, precision, law, arrhenius):
    """(1 - phi / phi_m)^-e times the melt's viscosity; phi is linear from liquidus to solidus."""
    temperatures = np.linspace(1200.0, 1500.0, 13)
    found = viscosities(
        temperatures,
        only('crystals', *['arrhenius'] * arrhenius),
        lava=replace(LAVA, crystal_law=law),
        precision=precision,
        device=device,
    )
    phi = np.clip(0.5 * (1450.0 - temperatures) / 200.0, 0.0, 0.5)
    melt = 50.0 * np.exp(0.01 * (1400.0 - temperatures)) if arrhenius else 50.0
    exponent = {'einstein-roscoe': 2.5, 'maron-pierce': 2.0}[law]
    right = melt * (1.0 - phi / 0.6) ** -exponent
    assert found == pytest.approx(right, rel={'float32': 1e-4, 'float64': 1e-12}[precision])


def test_jammed_crystals_leave_a_finite_viscosity(viscosities, device):
    """Where crystals are packed as densely as they can, or would be more, mu stops rising."""
    found = viscosities(
        [1260.0, 1300.0, 1450.0],
        only('crystals'),
        lava=replace(LAVA, crystals=0.9),
        precision='float32',
        device=device,
    )
    assert found[0] == pytest.approx(50.0 * LEAST_ROOM**-2.0, rel=1e-3)
    assert found[1] == pytest.approx(found[0])
    assert found[2] == pytest.approx(50.0, rel=1e-4)
