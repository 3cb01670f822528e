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
