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

"""Steep slopes: thickness and speed are vertical and horizontal, the physics is along the slope.

On a slope b a layer of vertical thickness h is h cos b thick across the flow. Its speed along the
slope is rho g (h cos b)^2 sin b / (3 mu), and the horizontal part of that is
rho g h^2 tan b cos^4 b / (3 mu): cos^4 b of what a map shows.
"""

from functools import lru_cache
from typing import Any

import warp as wp


@lru_cache
def factor(real: Any) -> Any:
    """Return the device function cos^4 b of the ground's gradient."""
    vec2 = wp.types.vector(2, real)

    @wp.func
    def steep(ground: vec2) -> real:
        square = real(1.0) / (real(1.0) + wp.dot(ground, ground))
        return square * square

    return steep


@lru_cache
def along(real: Any) -> Any:
    """Return the device function that gives a thickness and a slope whose laws hold on the level.

    Let the surface's gradient be (s, r), down the ground's slope and across it. In a layer
    h cos b thick the stress at the base is rho g (h cos^2 b) (s, r cos b), that of a layer
    h cos^2 b thick on the slope sqrt(s^2 + r^2 cos^2 b): rho g (h cos b) sin b in a sheet, where
    s = tan b and r = 0. The velocity is along it; on the map its part down the slope is cos b
    times as long, which leaves it along (s, r), with the mobility of that layer on that slope.
    With the ground's gradient G the slope is cos b (|grad S|^2 + (grad S . G)^2)^(1/2).
    """
    vec2 = wp.types.vector(2, real)

    @wp.func
    def layer(height: real, surface: vec2, ground: vec2) -> vec2:
        square = real(1.0) / (real(1.0) + wp.dot(ground, ground))
        down = wp.dot(surface, ground)
        return vec2(
            height * square, wp.sqrt(square * (wp.dot(surface, surface) + down * down))
        )

    return layer
