# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Viscosity by the Arrhenius law of the paper."""

import numpy as np
import pytest

from effects.columns import viscosities
from effects.rheology import viscosity_precisions
from lava_ros.scene import Lava
from solver import only


@viscosity_precisions
def test_viscosity_is_as_published(device, precision, within):
    """The viscosity is mu exp(alpha (T0 - T)), both above and below T0."""
    temperatures = np.linspace(1200.0, 1500.0, 7)
    lava = Lava.paper(viscosity=50.0, arrhenius=0.01, reference_temperature=1400.0)
    found = viscosities(
        temperatures, only('arrhenius'), lava=lava, precision=precision, device=device
    )
    expected = 50.0 * np.exp(0.01 * (1400.0 - temperatures))
    assert found == pytest.approx(expected, rel=within)
    assert [lava.viscosity_at(value) for value in temperatures] == pytest.approx(expected)


def test_exponent_is_limited(device):
    lava = Lava.paper(viscosity=1e-3, arrhenius=1.0, reference_temperature=1400.0)
    found = viscosities(
        [1330.0, 1340.0], only('arrhenius'), lava=lava, precision='float64', device=device
    )
    assert found == pytest.approx([1e-3 * np.exp(60.0)] * 2, rel=1e-9)
