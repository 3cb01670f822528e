# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lateral stress by the Green's function (equations: simulation/step/effects/green.py)."""

import math

from lava_ros.effects.effect import Array, Effect

EFFECT = Effect(
    rank=80,
    title='lateral viscous stress, as a sum',
    symbol='h / half-width',
    number=lambda scales: scales.lateral,
    needs_extent=True,
    threshold=math.inf,
    admits='nothing: helmholtz is the better form',
    source='docs/benchmarks/choice_lateral.csv',
    excludes={'inertia': 'the lateral stress is part of the local balance'},
    is_lateral=True,
    needs_particles=True,
    arrays={
        # x, y [m], and volume times local velocity, x and y [m4/s], of each ordered particle
        'source': Array('vec4'),
        # V / h [m2] of each ordered particle
        'area': Array('real'),
    },
)
