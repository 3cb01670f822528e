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

"""Lateral viscous stress, solved for: what it is on the host. See ``device.py``."""

from lava_ros.effects.effect import Array, Effect, footprint_change

EFFECT = Effect(
    rank=90,
    title='lateral viscous stress, solved',
    symbol='h / half-width',
    number=lambda scales: scales.lateral,
    needs_extent=True,
    threshold=0.22,
    admits='5 % of the speed of the shortest waves: (pi h / 2 l)^2 / 2.5',
    cost=footprint_change(0.05),
    source='docs/accuracy, lateral stress; docs/benchmarks/choice_lateral.csv',
    excludes={
        'green': 'they are one effect',
        'inertia': 'the lateral stress is part of the local balance',
    },
    arrays={
        # x, y from the centre [m], area V / h [m2] and thickness [m] of each ordered particle
        'layer': Array('vec4'),
        # velocities of two sweeps and their difference [m/s] of each ordered particle
        'solution': Array('vec2'),
        'next_solution': Array('vec2'),
        'correction': Array('vec2'),
    },
)
