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

"""Inertia: what it is on the host. See ``device.py``."""

from typing import TYPE_CHECKING

from lava_ros.effects.effect import Array, Effect

if TYPE_CHECKING:
    from lava_ros.effects.scales import Scales


def _relaxation(scales: 'Scales') -> float:
    """Relaxation time rho h^2 / (3 mu) of the speed over the time u covers the run-out h / s."""
    momentum = scales.lava.density * scales.speed * scales.thickness
    return momentum * scales.slope / (3.0 * scales.viscosity)


EFFECT = Effect(
    rank=70,
    title='inertia',
    symbol='relaxation over run-out time',
    number=_relaxation,
    threshold=0.1,
    admits='2 % of the front: a fifth of the number',
    source='point source on a slope with and without',
    arrays={
        # velocity of each particle in the middle of the latest step [m/s]
        'velocity': Array('vec2', is_carried=True),
        # acceleration x and y [m/s2] of each ordered particle
        'kick': Array('vec2'),
    },
)
