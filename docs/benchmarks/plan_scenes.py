# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Held-out scenes for plans, which were not used to choose constants of the method."""

from dataclasses import replace
from functools import partial

from bench_scenes import BASALT, bench_scene, FLUID, ground, MELT, plane, valley, VENT
import numpy as np

from lava_ros.scene import Vent


def held_out(finer=1):
    """Build the scenes, with the ground sampled on cells smaller by a factor ``finer``."""
    on = partial(ground, finer=finer)
    return (
        # basalt down a slope of 11 degrees that ends on a terrace
        bench_scene(
            'terrace', 1200.0,
            on((-400.0, 200.0), (-200.0, 200.0), 4.0,
               lambda x, y: 0.2 * np.maximum(x, -40.0) + 0.01 * x + 0.0 * y),
            replace(BASALT, viscosity=3000.0), Vent((100.3, 0.2), 20.0),
        ),
        # stiff lava down the flank of a cone
        bench_scene(
            'cone', 1800.0,
            on((-300.0, 300.0), (-300.0, 300.0), 5.0,
               lambda x, y: -0.3 * np.hypot(np.hypot(x, y), 40.0)),
            replace(BASALT, viscosity=2e4), Vent((60.3, 20.2), 25.0),
        ),
        # fluid lava between two hills
        bench_scene(
            'saddle', 900.0, on((-400.0, 200.0), (-250.0, 250.0), 4.0, _saddle),
            FLUID, Vent(VENT, 20.0),
        ),
        # basalt over gullies across a slope
        bench_scene(
            'gullies', 1200.0,
            on((-500.0, 100.0), (-150.0, 150.0), 3.0,
               lambda x, y: 0.12 * x + 2.0 * np.sin(y / 12.0)
                   + 1.5 * np.sin((x + 0.5 * y) / 25.0)),
            replace(BASALT, viscosity=2000.0), Vent(VENT, 12.0),
        ),
        # lava with a strength of 3 kPa on a gentle slope
        bench_scene(
            'thick', 2400.0,
            on((-250.0, 100.0), (-150.0, 150.0), 4.0, plane(0.08)),
            replace(BASALT, viscosity=5e4, yield_strength=3000.0, yield_rate=0.01),
            Vent(VENT, 30.0),
        ),
        # lava that thins under shear down a valley
        bench_scene(
            'thinning', 1500.0,
            on((-600.0, 100.0), (-100.0, 100.0), 3.5, valley(0.1, 0.2)),
            replace(BASALT, viscosity=5000.0, flow_index=0.7), Vent(VENT, 15.0),
        ),
        # three vents among hills
        bench_scene(
            'hills', 1500.0,
            on((-300.0, 200.0), (-250.0, 250.0), 4.0,
               lambda x, y: 0.04 * x + 4.0 * np.sin(x / 18.0) * np.cos(y / 22.0)),
            replace(MELT, crystals=0.3),
            Vent((60.3, -60.2), 10.0), Vent((40.3, 90.2), 12.0), Vent((-50.3, 10.2), 6.0),
        ),
        # a discharge that dies down on a slope of 5 degrees
        bench_scene(
            'waning', 2000.0,
            on((-500.0, 100.0), (-200.0, 200.0), 4.0, plane(0.087)),
            replace(BASALT, viscosity=2000.0),
            Vent(VENT, ((0.0, 40.0), (400.0, 15.0), (1000.0, 5.0), (1600.0, 0.0))),
        ),
        # fluid lava down a slope of 20 degrees
        bench_scene(
            'steep', 500.0,
            on((-1200.0, 100.0), (-120.0, 120.0), 4.0, plane(0.36)),
            replace(FLUID, viscosity=3000.0), Vent(VENT, 30.0),
        ),
        # stiff lava in a hollow
        bench_scene(
            'pond', 1200.0,
            on((-150.0, 150.0), (-150.0, 150.0), 3.0,
               lambda x, y: 12.0 * np.minimum((x**2 + 2.0 * y**2) / 90.0**2, 1.0)
                   + 0.02 * x),
            replace(BASALT, viscosity=3e4), Vent((40.3, 20.2), 15.0, radius=6.0),
        ),
    )


def _saddle(x, y):
    """Return a slope of 3 degrees with a hill on either side of the flow."""
    left = 25.0 * np.exp(-((x + 120.0) ** 2 + (y - 70.0) ** 2) / 3600.0)
    right = 20.0 * np.exp(-((x + 140.0) ** 2 + (y + 60.0) ** 2) / 3600.0)
    return 0.06 * x + left + right
