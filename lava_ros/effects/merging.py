# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Merging and splitting of particles (equations: simulation/step/effects/merging.py)."""

from lava_ros.effects.effect import Array, Effect

EFFECT = Effect(
    rank=180,
    title='particles that have come together merge, stretched ones split',
    no_case='it changes particles, not lava',
    arrays={
        # merge partner of each particle, whether it splits, and number of splitting ones before it
        'partner': Array('int32'),
        'births': Array('int32'),
        'slots': Array('int32'),
        # displacement since the last pass, and whether one is due
        'moved': Array('float64', (2,), is_saved=True),
    },
    removes_particles=True,
    needs_particles=True,
)
