# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Speeds of scattered particles on a plane, and of the device functions."""

import numpy as np
import pytest
import warp as wp

from lava_ros.effects.column import column_type
from lava_ros.effects.laws import law_of, law_type, speed_function
from lava_ros.scene import Lava
from lava_ros.simulation import Particles
from solver import incline, only, simulated

#: Weight of lava of the default density [N/m3].
WEIGHT = 2500.0 * 9.81

#: No effects.
BARE = only()

precisions, viscosity_precisions = (
    pytest.mark.parametrize(('precision', 'within'), [('float32', 1e-4), ('float64', double)])
    for double in (1e-9, 1e-12)
)


def scattered(effects, *, slope=0.1, precision='float64', device='cpu', longest_step=60.0, **lava):
    """Return 500 random particles on a plane with the slope towards +x."""
    rng = np.random.default_rng(7)
    places, volumes = rng.uniform(0, 200, (500, 2)), rng.uniform(50, 150, 500)
    return simulated(
        incline(slope, 40, 40, 10.0, origin=(-100.0, -100.0)),
        Lava.paper(**{'viscosity': 1e4, 'arrhenius': 0.0, **lava}),
        Particles(places, volumes, rng.uniform(1100, 1400, 500)), effects=effects, device=device,
        precision=precision, longest_step=longest_step, deterministic=True, spacing=9.0,
        thickness=1.0,
    )


def responses(effects, lava, slopes, thickness, device):
    """Return mobility and its bound [m/s] from the device function, shape [slopes, 2]."""
    speed, column_struct = speed_function(wp, wp.float64, effects), column_type(wp.float64)

    @wp.kernel(module='unique', enable_backward=False)
    def evaluate(
        law: law_type(wp.float64), depth: wp.float64, slope: wp.array(dtype=wp.float64),
        found: wp.array(dtype=wp.vec2d),
    ):
        i = wp.tid()
        column = column_struct()
        column.normal_thickness = depth
        column.slope = slope[i]
        column.temperature = wp.float64(1400.0)
        found[i] = speed(law, wp.float64(WEIGHT), column)

    found = wp.zeros(len(slopes), dtype=wp.vec2d, device=device)
    wp.launch(
        evaluate,
        dim=len(slopes),
        inputs=[
            law_of(lava, wp.float64), thickness, wp.array(slopes, dtype=wp.float64, device=device)
        ],
        outputs=[found],
        device=device,
    )
    return found.numpy()
