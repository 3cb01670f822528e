# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Inclines with and without walls, and a vent on them: scenes of several tests."""

import math

import numpy as np

from lava_ros.scene import Lava, Scene, Terrain, Vent

LAVA = Lava(density=2600.0, viscosity=1e4, arrhenius=0.0, emissivity=0.0, convection=0.0)
SLOPE = math.tan(math.radians(5.0))
HOUR = 3600.0

#: rho g tan(b) cos^4(b) / (3 mu) on that slope [1/(m s)].
MOBILITY = 2600.0 * 9.81 * SLOPE / (1.0 + SLOPE**2) ** 2 / 3e4


def ground(cell: float, wall: float = 0.0) -> Terrain:
    """Return an incline of 5 degrees, 2 km by 600 m, with side walls of a slope ``wall``."""
    x = (np.arange(round(2000.0 / cell)) + 0.5) * cell
    y = (np.arange(round(600.0 / cell)) + 0.5) * cell - 300.0
    return Terrain(1000.0 - SLOPE * x + wall * np.abs(y)[:, None], cell)


def scene(terrain: Terrain, discharge: float = 10.0) -> Scene:
    """Return a scene with a vent near the upper end, in the middle."""
    return Scene(terrain, (Vent((100.0, 300.0), discharge),), LAVA)
