# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The speed of a Bingham fluid, which flows only where the stress at its base exceeds a strength.

The stress at the base of a layer of thickness d is tau_b = rho g d s, s its slope, and falls
linearly to 0 at the surface. Above d_s = d (1 - B), B = tau_y / tau_b, it is below the strength
tau_y: a plug rides on a sheared layer. With mu du/dz = tau - tau_y there and no slip below, the
depth average is

    u = (rho g d^2 s / 3 mu) (1 - 3 B / 2 + B^3 / 2),   exactly 0 for B >= 1,

and the derivative of the flux, d(d u)/ds = (rho g d^3 / 3 mu) (1 - B^3), is the diffusivity along
the slope: between u d / s, that across it, and that of lava without strength.
"""

from functools import lru_cache
from typing import Any


@lru_cache
def speed(
    wp: Any, real: Any, law_type: Any, column_type: Any, viscosity: Any, strength: Any
) -> Any:
    """Return the device function for u / s and the largest derivative du/ds [m/s]."""
    vec2 = wp.types.vector(2, real)

    @wp.func
    def bingham(law: law_type, weight: real, column: column_type) -> vec2:
        thickness = column.normal_thickness
        # no branch, which would keep a CPU from vectorising a loop over columns
        stress = wp.max(weight * thickness * column.slope, real(1e-30))
        resisted = strength(law, column)
        b = wp.min(resisted / stress, real(1.0))
        # 1 - b without the cancellation of the quotient
        free = wp.max(stress - resisted, real(0.0)) / stress
        newtonian = weight * thickness * thickness
        newtonian /= real(3.0) * viscosity(law, column.temperature)
        return newtonian * free * vec2(free * (real(1.0) + real(0.5) * b), real(1.0) + b + b * b)

    return bingham
