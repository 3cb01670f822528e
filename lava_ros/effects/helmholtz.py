# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lateral stress by solving an equation (equations: simulation/step/effects/helmholtz.py)."""

from lava_ros.effects.effect import Array, Effect

EFFECT = Effect(
    rank=90,
    title='lateral viscous stress, solved',
    symbol='h / half-width',
    number=lambda scales: scales.lateral,
    # chords at the margins are shorter than the flow is wide
    fraction=0.5,
    needs_extent=True,
    threshold=0.22,
    admits='5 % of the speed of the shortest waves: (pi h / w)^2 / 2.5, w the width',
    speed_error=0.05,
    source='docs/accuracy, lateral stress; docs/benchmarks/choice_lateral.csv',
    excludes={
        'green': 'they are one effect',
        'inertia': 'the lateral stress is part of the local balance',
    },
    is_lateral=True,
    # finer particles need more sweeps
    work_power=1.5,
    arrays={
        # x, y from the centre [m], area V / h [m2] and thickness [m] of each ordered particle
        'layer': Array('vec4'),
        # velocities of two sweeps and their difference [m/s] of each ordered particle
        'solution': Array('vec2'),
        'next_solution': Array('vec2'),
        'correction': Array('vec2'),
    },
)
