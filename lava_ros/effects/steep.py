# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Steep slopes: thickness and speed are vertical and horizontal, the physics is along the slope.

On a slope b a layer of vertical thickness h is h cos b thick across the flow. Its speed along the
slope is rho g (h cos b)^2 sin b / (3 mu), and the horizontal part of that is
rho g h^2 tan b cos^4 b / (3 mu): cos^4 b of the speed without this effect.

Heat leaves through the surface along the slope, so the heat balance has the thickness h cos b too
(``column.py``).

This applies to a layer on a slope. On a wall lava detaches and falls; as a layer it would have to
be h = d / cos b thick on the map to pass on the flux at the edge, a dam on top of a high cliff.
So b, wherever its cosine is used, is limited to ``STEEPEST``; the surface's slope is not.
"""

from functools import lru_cache
import math
from typing import Any

import numpy as np

from lava_ros.effects.effect import Effect

EFFECT = Effect(
    rank=10,
    title='thickness along steep slopes',
    symbol='slope',
    number=lambda scales: scales.columns.ground_slope,
    threshold=math.tan(math.radians(5.0)),
    admits='1.5 % of the speed: 1 - cos^4',
    speed_error=0.015,
    source='docs/MODEL.md, steep slopes; in a run the sides of frozen lava count',
    is_default=True,
)

#: Steepest ground on which lava forms a layer [deg]. The speed on the map is largest at 30 and a
#: third of that at 60: a layer is 1.44 times as thick there, and thinner again on steeper ground.
STEEPEST = 60.0

#: The square of the gradient of that ground.
_LARGEST = math.tan(math.radians(STEEPEST)) ** 2


def cosine(slope: np.ndarray) -> np.ndarray:
    """Return cos b for slopes of the ground, rise over run."""
    return 1.0 / np.sqrt(1.0 + np.minimum(np.square(slope), _LARGEST))


@lru_cache
def cosine_squared(real: Any) -> Any:
    """Return the device function cos^2 b of the ground's gradient."""
    import warp as wp

    vec2 = wp.types.vector(2, real)

    @wp.func
    def squared(ground: vec2) -> real:
        return real(1.0) / (real(1.0) + wp.min(wp.dot(ground, ground), real(_LARGEST)))

    return squared


@lru_cache
def factor(real: Any) -> Any:
    """Return the device function cos^4 b of the ground's gradient."""
    import warp as wp

    squared = cosine_squared(real)

    @wp.func
    def steep(ground: wp.types.vector(2, real)) -> real:
        square = squared(ground)
        return square * square

    return steep


@lru_cache
def along(real: Any, *, climbs: bool = False) -> Any:
    """Return the device function for a layer along the slope.

    It returns the thickness d = h cos b across the flow, the slope s' along the flow, and cos^2 b,
    the mobility u / |grad S| on the map over that along the flow, u' / s'.

    Let the surface's gradient be (s, r), down the ground's slope and across it. The stress at the
    base is rho g d (s cos b, r cos^2 b), so s' = cos b sqrt(s^2 + r^2 cos^2 b): rho g d sin b in a
    sheet, where s = tan b and r = 0. The velocity is parallel to it; on the map its part down the
    slope is cos b times as long, which leaves it parallel to (s, r). With the ground's gradient G,
    s' = cos^2 b (|grad S|^2 + (grad S . G)^2)^(1/2). Lava that ``climbs`` a slope is on it,
    however steep.
    """
    import warp as wp

    vec2, vec3 = wp.types.vector(2, real), wp.types.vector(3, real)
    largest = math.inf if climbs else _LARGEST

    @wp.func
    def layer(height: real, surface: vec2, ground: vec2) -> vec3:
        rise = wp.dot(ground, ground)
        down = wp.dot(surface, ground)
        down *= down
        if rise > real(largest):
            # G is that of the steepest layer
            down *= real(largest) / rise
            rise = real(largest)
        square = real(1.0) / (real(1.0) + rise)
        slope = square * wp.sqrt(wp.dot(surface, surface) + down)
        return vec3(height * wp.sqrt(square), slope, square)

    return layer
