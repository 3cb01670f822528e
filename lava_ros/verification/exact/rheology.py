# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Exact solutions of lava with a yield strength, or whose stress is a power of the strain rate.

The stress at the base of a layer is rho g d sin b on a slope and rho g h |grad h| on a plane, and
falls linearly to 0 at the surface; where it is below the strength tau_y nothing is sheared.
"""

import math

import numpy as np

from lava_ros.verification.exact.spreading import spiral


def herschel_bulkley_velocity(
    thickness: float, slope: float, *, density: float, consistency: float, strength: float,
    index: float, gravity: float,
) -> float:
    """Return the depth-averaged speed along the slope of a uniform sheet [m/s].

    K (du/dz)^n = rho g s (Y - z) below Y = h - tau_y / (rho g s), s = sin b, and 0 above. Twice
    integrated from no slip, the flux is
    q = n / ((n + 1)(2 n + 1)) (rho g s / K)^(1/n) Y^(1 + 1/n) ((1 + 2 n) h - n Y), and the speed
    q / h. With tau_y = 0 and n = 1 it is rho g s h^2 / (3 K). h is normal to the slope [m], b in
    rad, K (``consistency``) in Pa s^n and tau_y (``strength``) in Pa.
    """
    weight, n = density * gravity * math.sin(slope), index
    sheared = thickness - strength / weight
    if sheared <= 0.0:
        return 0.0
    rate = (weight / consistency) ** (1.0 / n) * sheared ** (1.0 + 1.0 / n)
    profile = (1.0 + 2.0 * n) * thickness - n * sheared
    return n / ((n + 1.0) * (2.0 * n + 1.0)) * rate * profile / thickness


def critical_thickness(strength: float, slope: float, *, density: float, gravity: float) -> float:
    """Return the maximum thickness of a sheet at rest, tau_y / (rho g sin b) [m].

    It is normal to the slope b [rad]; tau_y is ``strength`` [Pa], rho ``density`` [kg/m3] and g
    ``gravity`` [m/s2].
    """
    return strength / (density * gravity * math.sin(slope))


def vft_viscosity(temperature: float, a: float, b: float, c: float) -> float:
    """Return 10^(A + B / (T - C)) [Pa s] (Giordano, Russell & Dingwell 2008)."""
    return math.pow(10.0, a + b / (temperature - c))


def crystal_factor(fraction: float, packing: float, exponent: float) -> float:
    """Return the viscosity factor of a volume fraction of crystals, (1 - phi / phi_m)^-e."""
    return math.pow(1.0 - fraction / packing, -exponent)


class BinghamDome:
    """The final dome of a volume that has spread on a plane.

    It rests where rho g h |dh/dr| = tau_y everywhere: h^2 = k^2 (R - r), k^2 = 2 tau_y / (rho g),
    and the volume is 2 pi k times the integral of r (R - r)^(1/2), 8 pi k R^(5/2) / 15.

    Attributes:
        radius: R [m].
        rms_radius: Root mean square of r over the volume, R (8 / 21)^(1/2) by Beta functions [m].
    """

    def __init__(self, volume: float, strength: float, density: float, gravity: float) -> None:
        """Set volume [m3], tau_y [Pa], rho [kg/m3] and g [m/s2]."""
        self._k = math.sqrt(2.0 * strength / (density * gravity))
        self.radius = (15.0 * volume / (8.0 * math.pi * self._k)) ** 0.4
        self.rms_radius = self.radius * math.sqrt(8.0 / 21.0)

    def thickness(self, distance: np.ndarray) -> np.ndarray:
        """Return the thickness [m] at distances from the middle [m]."""
        return self._k * np.sqrt(np.maximum(self.radius - distance, 0.0))

    def radius_of_thickness(self, thickness: float) -> float:
        """Return the distance from the middle [m] at which the dome has a thickness [m]."""
        return self.radius - (thickness / self._k) ** 2

    def particles(self, count: int, radius: float) -> np.ndarray:
        """Return positions of equal volumes in a dome of this shape [m], shape [count, 2].

        The fraction of the volume beyond r is u^(3/2) (5 - 3 u) / 2 with u = 1 - r / R. Azimuths
        follow the golden angle. ``radius`` is R [m], which may differ from that of this dome.
        """
        u = np.linspace(0.0, 1.0, 20001)
        beyond = 0.5 * u**1.5 * (5.0 - 3.0 * u)
        outside = 1.0 - (np.arange(count) + 0.5) / count
        return spiral(radius * (1.0 - np.interp(outside, beyond, u)))


class Ridge:
    """The remainder of a strip of lava that runs straight down a slope: a levee on each side.

    Uniform down the slope, the stress has the parts rho g d sin b down it and rho g d cos b d'
    across it. It equals tau_y where d d' = tan b (dc^2 - d^2)^(1/2), dc = tau_y / (rho g sin b).
    From d = 0 at the edge, y = 0, that gives d^2 = dc^2 - (dc - y tan b)^2: a quarter of an
    ellipse up to d = dc, where lava runs off. With d = dc sin c in the middle of a ridge, its
    half-width is dc (1 - cos c) / tan b and its section dc^2 (c - sin c cos c) / tan b.

    Hulme (1974, Geophys. J. R. Astron. Soc. 39) leaves the stress down the slope out of the edge:
    d^2 = 2 dc y tan b / cos^2 b, which takes tau_y / (2 rho g sin^2 b) to reach dc, about half.

    Attributes:
        critical: dc [m].
        half_width: Distance of the edge from the middle [m].
        section: Area of the cross-section normal to the slope [m2].
    """

    def __init__(self, fullness: float, strength: float, slope: float, weight: float) -> None:
        """Set thickness in the middle over dc, at most 1, tau_y [Pa], b [rad], rho g [N/m3]."""
        self._tan, angle = math.tan(slope), math.asin(fullness)
        self.critical = strength / (weight * math.sin(slope))
        self.half_width = self.critical * (1.0 - math.cos(angle)) / self._tan
        segment = angle - math.sin(angle) * math.cos(angle)
        self.section = self.critical**2 * segment / self._tan

    def thickness(self, distance: np.ndarray) -> np.ndarray:
        """Return the thickness normal to the slope [m] at distances from the middle [m]."""
        rest = self.critical - np.maximum(self.half_width - distance, 0.0) * self._tan
        return np.sqrt(np.maximum(self.critical**2 - rest**2, 0.0))

    def distance_of_thickness(self, thickness: float) -> float:
        """Return the distance from the middle [m] at which the normal thickness is this [m]."""
        rest = math.sqrt(self.critical**2 - thickness**2)
        return self.half_width - (self.critical - rest) / self._tan
