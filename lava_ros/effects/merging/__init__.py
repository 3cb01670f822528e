# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Merging and splitting of particles: what it is on the host. See ``device.py``."""

from lava_ros.effects.effect import Array, Effect

EFFECT = Effect(
    rank=180,
    title='particles that have come together merge, stretched ones split',
    arrays={
        # who each particle merges with, whether it splits, and how many before it do
        'partner': Array('int32'),
        'births': Array('int32'),
        'slots': Array('int32'),
        # displacement since the last pass, and whether one is due
        'moved': Array('float64', 2, is_saved=True),
    },
    leaves_empty=True,
)
