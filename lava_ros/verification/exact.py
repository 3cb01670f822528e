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

"""Exact solutions of shallow viscous flow.

All follow from h_t = div[(g / 3 nu) h^3 grad(h + z)] with kinematic viscosity nu = mu / rho.
"""

import math

import numpy as np


def sheet_velocity(
    thickness: float, slope: float, *, density: float, viscosity: float, gravity: float
) -> float:
    """Depth-averaged speed along the slope of a uniform sheet, rho g h^2 sin(b) / (3 mu) [m/s].

    From the balance of weight and drag, mu d2u/dz2 = -rho g sin(b), no slip below and no stress
    on top.

    Args:
        thickness: Thickness normal to the slope [m].
        slope: Angle of the slope [rad].
        density: Density [kg/m3].
        viscosity: Dynamic viscosity [Pa s].
        gravity: Acceleration of gravity [m/s2].
    """
    return density * gravity * thickness**2 * math.sin(slope) / (3.0 * viscosity)


def green_response(wave_number: float, thickness: float) -> float:
    """Velocity over local velocity for a driving term sin(q x), 1 / (1 + q^2 / k^2).

    From lap u' - k^2 u' = b with k = sqrt(3) / h (see ``simulation.viscosity``).

    Args:
        wave_number: q [1/m].
        thickness: Thickness of the uniform layer [m].
    """
    return 1.0 / (1.0 + wave_number**2 * thickness**2 / 3.0)


class FixedVolumeSpread:
    """A fixed volume that spreads on a plane (Huppert 1982, J. Fluid Mech. 121, axisymmetric).

    The similarity variable r / R(t) turns the equation into
    h = h0 (1 - r^2/R^2)^(1/3), R = 0.89391 (g V^3 t / 3 nu)^(1/8),
    h0 = 0.53113 (3 nu V / (g t))^(1/4). The two coefficients are
    (2^10 / (3^4 pi^3))^(1/8) and 4 / (3 pi 0.89391^2): from V = (3 pi / 4) h0 R^2 and from
    dR/dt = (2 g h0^3 / 9 nu) / R, the front's speed.
    """

    RADIUS = (2.0**10 / (3.0**4 * math.pi**3)) ** 0.125
    HEIGHT = 4.0 / (3.0 * math.pi * RADIUS**2)

    def __init__(self, volume: float, kinematic_viscosity: float, gravity: float) -> None:
        """Set the case.

        Args:
            volume: V [m3].
            kinematic_viscosity: nu [m2/s].
            gravity: g [m/s2].
        """
        self.volume = volume
        self.nu = kinematic_viscosity
        self.gravity = gravity

    def radius(self, time: float) -> float:
        """R [m] at a time [s] after the release from a point."""
        scale = self.gravity * self.volume**3 * time / (3.0 * self.nu)
        return self.RADIUS * scale**0.125

    def time_of_radius(self, radius: float) -> float:
        """Time [s] at which the radius [m] is reached."""
        scale = 3.0 * self.nu / (self.gravity * self.volume**3)
        return (radius / self.RADIUS) ** 8 * scale

    def thickness(self, distance: np.ndarray, time: float) -> np.ndarray:
        """Thickness [m] at distances from the centre [m]."""
        ratio = np.asarray(distance) / self.radius(time)
        centre = self.HEIGHT * (3.0 * self.nu * self.volume / (self.gravity * time)) ** 0.25
        return centre * np.cbrt(np.clip(1.0 - ratio**2, 0.0, None))

    def rms_radius(self, time: float) -> float:
        """Root of the volume-weighted mean of r^2, R sqrt(3 / 7) [m]."""
        return self.radius(time) * math.sqrt(3.0 / 7.0)

    def particles(self, count: int, time: float) -> np.ndarray:
        """Positions [m], shape [count, 2], of equal volumes that have the profile at a time.

        The radius that holds a share s of the volume is R sqrt(1 - (1 - s)^(3/4)); the angles
        follow the golden angle.
        """
        share = (np.arange(count) + 0.5) / count
        distance = self.radius(time) * np.sqrt(1.0 - (1.0 - share) ** 0.75)
        angle = np.arange(count) * math.pi * (3.0 - math.sqrt(5.0))
        return np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=1)
