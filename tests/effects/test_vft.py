# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Viscosity of a melt by the law of Vogel, Fulcher and Tammann."""

import pytest

from effects.columns import viscosities
from lava_ros.scene import Lava
from solver import only

MELT = Lava.paper(viscosity=7.0, vft_a=-4.55, vft_b=5700.0, vft_c=600.0)


def test_viscosity_is_at_most_1e15_at_and_below_c(device):
    temperatures = [300.0, 599.0, 600.0, 600.5, 900.0]
    found = viscosities(temperatures, only('vft'), lava=MELT, precision='float32', device=device)
    assert found[:4] == pytest.approx(1e15, rel=1e-3)
    assert found[4] == pytest.approx(10.0 ** (-4.55 + 5700.0 / 300.0), rel=1e-3)


def test_viscosity_is_constant_below_c_plus_1_kelvin():
    lava = Lava.paper(vft_a=1.0, vft_b=3.0, vft_c=900.0)
    temperatures = [900.0, 901.0, 903.0]
    found = viscosities(temperatures, only('vft'), lava=lava, precision='float64', device='cpu')
    assert found == pytest.approx([1e4, 1e4, 1e2], rel=1e-9)
