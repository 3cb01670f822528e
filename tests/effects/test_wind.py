# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Forced convection by wind."""

from dataclasses import replace

import numpy as np
import pytest

from effects.columns import AIR, CAPACITY, HOUR, still_columns
from lava_ros.effects.heat import heat_loss
from lava_ros.effects.wind import TRANSFER
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation.selection import effects_for
from lava_ros.verification.cases.case import plane
from solver import only

WINDY = Lava.paper(viscosity=1e15, emissivity=0.0, convection=5.0)


def test_wind_cools_a_column(device):
    """T - Ta falls as exp(-(lambda + CH rho c U) t / (rho c h))."""
    ends = {}
    for names, speed in ((('wind',), 20.0), (('wind',), 0.0), ((), 20.0)):
        found, thickness = still_columns(
            WINDY, only('cooling', *names), [1400.0], [HOUR], thickness=1.0, wind_speed=speed,
            device=device,
        )
        ends[names, speed] = found[0, 0]
    rate = (WINDY.convection + 20.0 * TRANSFER) / (CAPACITY * thickness)
    assert ends[('wind',), 20.0] == pytest.approx(AIR + 1100.0 * np.exp(-rate * HOUR), abs=0.01)
    assert ends[('wind',), 0.0] == ends[(), 20.0] > ends[('wind',), 20.0] + 30.0


def test_wind_is_on_above_a_speed():
    scene = Scene(Terrain(np.zeros((12, 12)), 2.0), (Vent((12.0, 12.0), 0.01),), Lava.paper())
    assert 'wind' not in effects_for(scene)
    assert 'wind' in effects_for(replace(scene, wind_speed=10.0))


def test_heat_loss_on_the_host_is_linear_in_the_speed():
    ground = plane((0.0, 0.0, 40.0, 40.0), 10.0, 0.0)
    windy, still = (heat_loss(Scene(ground, lava=WINDY, wind_speed=u))(1400.0) for u in (10, 0))
    assert windy - still == pytest.approx(10.0 * TRANSFER * 1100.0)
    # FLOWGO's coefficient for 5 m/s
    assert pytest.approx(8.73, abs=0.005) == 5.0 * TRANSFER
