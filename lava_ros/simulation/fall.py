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

"""Free fall: no lava is faster than what it has fallen by can have made it.

The local balance of weight and drag has no inertia, so nothing bounds its speed: at a wall, or
where lava is thin as water, it is that of lava which has fallen for ever. A particle on ground of
height H has fallen from the highest ground that lava came from, ``State.top``, and lies h deep:
u^2 <= 2 g (max(top - H, 0) + h). Lava with u^2 <= 2 g h never sees the bound. As u^2 / (g h) is
the number that calls for inertia above 0.1 (``selection.py``): all lava whose balance holds.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.simulation.motion_arguments import arguments_type
from lava_ros.simulation.terrain import terrain_functions


@lru_cache
def fall_function(real: Any) -> Any:
    """Return the device function that keeps a velocity at a place to that of free fall."""
    vec2 = wp.types.vector(2, real)
    height_at = terrain_functions(real).height_at

    @wp.func
    def fallen(velocity: vec2, thickness: real, place: vec2, m: arguments_type(real)) -> vec2:
        square = wp.dot(velocity, velocity)
        head = square / (real(2.0) * m.constants.gravity) - thickness
        kept = velocity
        # hardly any lava is that fast: the others need not know how high they are
        if head > real(0.0):
            fall = wp.max(m.top[0] - height_at(m.ground, place[0], place[1]), real(0.0))
            if head > fall:
                kept *= wp.sqrt((fall + thickness) / (head + thickness))
        return kept

    return fallen
