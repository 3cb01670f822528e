# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Lateral viscous stress by the Green's function: what it is on the host. See ``device.py``."""

import math

from lava_ros.effects.effect import Array, Effect

EFFECT = Effect(
    rank=80,
    title='lateral viscous stress, as a sum',
    symbol='h / l',
    number=lambda scales: scales.lateral,
    needs_extent=True,
    threshold=math.inf,
    admits='nothing: helmholtz is the better form',
    source='docs/benchmarks/choice_lateral.csv',
    excludes={'inertia': 'the lateral stress is part of the local balance'},
    arrays={
        # x, y [m], and volume times local velocity, x and y [m4/s], of each ordered particle
        'source': Array('vec4'),
        # V / h [m2] of each ordered particle
        'area': Array('real'),
    },
)
