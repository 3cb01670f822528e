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

"""Solidification: what it is on the host. See ``device.py``."""

from lava_ros.effects.effect import Array, Effect
from lava_ros.effects.scales import FREEZES

EFFECT = Effect(
    rank=170,
    title='columns that freeze become ground',
    symbol='share of the way to the solidus',
    number=lambda scales: scales.freezing,
    threshold=FREEZES,
    fraction=1.0,
    admits='nothing freezes',
    source='column at rest',
    exists=lambda lava: lava.solidus > 0.0,
    arrays={
        # 1 when a particle got colder than the solidus in this step
        'cold': Array('int32', 1),
        # volume that has frozen [m3]
        'frozen': Array('float64', 1, is_total=True),
    },
    leaves_empty=True,
    benchmark={'solidus': 1100.0},
)
