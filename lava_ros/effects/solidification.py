# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Solidification (equations: simulation/step/effects/solidification.py)."""

from lava_ros.effects.effect import Array, Effect

EFFECT = Effect(
    rank=170,
    title='columns that freeze become ground',
    symbol='fraction of the way to the solidus',
    number=lambda scales: scales.freezing,
    threshold=0.9,
    fraction=1.0,
    admits='nothing freezes',
    source='column at rest',
    exists=lambda lava: lava.solidus > 0.0,
    arrays={
        # 1 if a particle became colder than the solidus in this step
        'cold': Array('int32', (1,)),
    },
    freezes=True,
    removes_particles=True,
    benchmark={'solidus': 1100.0},
)
