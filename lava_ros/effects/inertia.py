# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Inertia (equations: simulation/step/effects/inertia.py)."""

import numpy as np

from lava_ros.effects.effect import Array, Effect
from lava_ros.effects.scales import Scales


def _relaxation(scales: Scales) -> 'np.ndarray':
    """Return the relaxation time rho h^2 / (3 mu) over the time to cover h / slope at speed u."""
    columns = scales.columns
    momentum = scales.lava.density * columns.speed * columns.thickness
    return momentum * columns.slope / (3.0 * scales.viscosity)


EFFECT = Effect(
    rank=70,
    title='inertia',
    symbol='relaxation over run-out time',
    number=_relaxation,
    needs_extent=True,
    threshold=0.1,
    admits='2 % of the front: a fifth of the number',
    extent_error=0.02,
    source='point source on a slope with and without',
    needs_velocity=True,
    needs_particles=True,
    # acceleration x and y [m/s2] of each ordered particle
    arrays={'kick': Array('vec2')},
)
