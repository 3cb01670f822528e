# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Inclines with a vent: scenes of several tests."""

import math
from typing import Any

import numpy as np

from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.uncertainty import uncertainty_from_dict

LAVA = Lava.paper(density=2600.0, viscosity=1e4, arrhenius=0.0, emissivity=0.0, convection=0.0)
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


def uncertain_scene(discharge: Any, **lava: float) -> Scene:
    """Return a vent on a rough slope of 24 x 30 cells, of uncertain discharge and elevation."""
    y, x = np.mgrid[0:30, 0:24] * 20.0
    return Scene(
        Terrain(500.0 - 0.1 * y + 5.0 * np.sin(x / 60.0), 20.0),
        (Vent((240.0, 100.0), discharge, radius=30.0),), Lava.paper(viscosity=5e3, **lava),
        uncertainty=uncertainty_from_dict({
            'discharge': {'distribution': 'lognormal', 'median': 1.0, 'factor': 1.5},
            'terrain': {'deviation': 1.0, 'correlation': 60.0},
        }),
    )
