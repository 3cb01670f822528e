# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Viscosity of lava with crystals."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from effects.columns import viscosities
from effects.rheology import viscosity_precisions
from lava_ros.effects.crystals import MIN_FREE_FRACTION
from lava_ros.effects.laws import speed_function
from lava_ros.scene import Lava
from solver import only

CRYSTALS = Lava.paper(
    viscosity=50.0, arrhenius=0.01, reference_temperature=1400.0, liquidus=1450.0, solidus=1250.0,
    crystal_law='maron-pierce', crystals=0.5,
)


@viscosity_precisions
@pytest.mark.parametrize(('law', 'exponent'), [('einstein-roscoe', 2.5), ('maron-pierce', 2.0)])
@pytest.mark.parametrize('arrhenius', [False, True])
def test_viscosity_with_crystals_is_as_published(
    device, precision, within, law, exponent, arrhenius
):
    """The viscosity is mu_melt (1 - phi / phi_m)^-e; phi is linear from liquidus to solidus."""
    temperatures = np.linspace(1200.0, 1500.0, 13)
    effects = only('crystals', *['arrhenius'] * arrhenius)
    lava = replace(CRYSTALS, crystal_law=law)
    found = viscosities(temperatures, effects, lava=lava, precision=precision, device=device)
    phi = np.clip(0.5 * (1450.0 - temperatures) / 200.0, 0.0, 0.5)
    melt = 50.0 * np.exp(0.01 * (1400.0 - temperatures)) if arrhenius else 50.0
    assert found == pytest.approx(melt * (1.0 - phi / 0.6) ** -exponent, rel=within)


def test_viscosity_is_finite_at_maximum_packing(device):
    lava, temperatures = replace(CRYSTALS, crystals=0.9), [1260.0, 1300.0, 1450.0]
    found = viscosities(
        temperatures, only('crystals'), lava=lava, precision='float32', device=device
    )
    assert found[0] == pytest.approx(50.0 * MIN_FREE_FRACTION**-2.0, rel=1e-3)
    assert found[1] == pytest.approx(found[0])
    assert found[2] == pytest.approx(50.0, rel=1e-4)


def test_newtonian_lava_compiles_no_speed_function():
    assert speed_function(wp, wp.float32, only('crystals')) is None
