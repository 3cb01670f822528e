# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lava that stiffens as it cools on its way down an even slope, seen from above.

The viscosity is mu(T) = mu_0 exp(alpha (T_0 - T)), the yield strength
tau_y(T) = tau_0 exp(r (T_0 - T)), and the surface loses F(T) (``surface_loss``).
"""

import math

import numpy as np

from lava_ros.scene import Lava
from lava_ros.verification.exact.heat import surface_loss
from lava_ros.verification.exact.spreading import runge_kutta

#: Thickness of the sheet of the case ``cooling_front`` [m], by finite volumes on cells of 1.25 m
#: (docs/benchmarks/cooling_plane.py), from the upper edge of the source on.
FRONT_PROFILE = (
    0.936, 1.008, 1.067, 1.104, 1.115, 1.125, 1.136, 1.147, 1.158, 1.169, 1.18, 1.191, 1.203,
    1.214, 1.226, 1.237, 1.249, 1.261, 1.272, 1.284, 1.296, 1.308, 1.321, 1.333, 1.345, 1.358,
    1.37, 1.383, 1.396, 1.408, 1.421, 1.434, 1.447, 1.461, 1.474, 1.487, 1.501, 1.514, 1.528,
    1.542, 1.556, 1.57, 1.584, 1.598, 1.612, 1.626, 1.641, 1.655, 1.67, 1.685, 1.7, 1.714,
    1.73, 1.745, 1.76, 1.775, 1.791, 1.806, 1.822, 1.837, 1.853, 1.869, 1.885, 1.901, 1.917,
    1.933, 1.949, 1.966, 1.982, 1.998, 2.014, 2.031, 2.047, 2.064, 2.08, 2.096, 2.112, 2.128,
    2.144, 2.16, 2.175, 2.191, 2.205, 2.22, 2.234, 2.247, 2.259, 2.271, 2.281, 2.288, 2.291,
    2.285, 2.257, 2.181, 1.975, 1.02, 0.006, 0.0,
)

#: Where the flow of the case ``cooling_plane`` is thicker than 0.1 m, by the same finite volumes
#: (docs/benchmarks/cooling_plane.csv): the cells of 5 m on one side of the axis whose
#: mean is, from the column whose middle is at the first place [m] on, and the front [m].
PLANE_FIRST = -12.5
PLANE_CELLS = (
    2, 3, 4, 5, 5, 5, 6, 6, 6, 6, 6, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7,
    7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 6, 6, 6, 5, 2,
)
PLANE_FRONT = 267.5


class CoolingSheet:
    """A steady sheet that cools and stiffens as it runs down an even slope b.

    The flux q past every place is the same, so rho c q dT/dx = -F(T), whatever the thickness is.
    The thickness is the one that carries the flux at this temperature. With d = h cos^2 b and the
    slope of the surface s = tan b - dh/dx,

        q = (rho g h d^2 s / 3 mu(T)) (1 - 3 B / 2 + B^3 / 2),   B = tau_y(T) / (rho g d s).

    That is an ordinary differential equation of h. Going down the slope its deviations grow, so it
    is integrated up the slope, from a place at twice the length at which dh/dx is neglected. There
    is no lava above x = 0, where T is that of the source.
    """

    def __init__(
        self, lava: Lava, *, flux: float, slope: float, length: float, initial: float,
        ambient: float, gravity: float,
    ) -> None:
        """Set q [m2/s], b [rad], the length of interest [m], T at x = 0 [K], Ta [K], g [m/s2]."""
        self._lava, self._flux, self._tangent = lava, flux, math.tan(slope)
        self._weight = lava.density * gravity
        self._square = math.cos(slope) ** 4
        capacity = lava.density * lava.specific_heat * flux
        self._x = np.linspace(0.0, 2.0 * length, 2001)
        temperature = runge_kutta(
            lambda x, t: -surface_loss(lava, t, ambient) / capacity, self._x, np.array([initial])
        )
        self._temperature = temperature[:, 0]
        # upstream of the last place
        last = self._even_thickness(float(self._temperature[-1]))
        heights = runge_kutta(
            lambda x, h: np.array([self._tangent - self._slope(x, float(h[0]))]),
            self._x[::-1], np.array([last]),
        )
        self._thickness = heights[::-1, 0]

    def temperature(self, x: np.ndarray) -> np.ndarray:
        """Return T [K] at map distances from the upper edge of the source [m]."""
        return np.interp(x, self._x, self._temperature)

    def thickness(self, x: np.ndarray) -> np.ndarray:
        """Return the vertical thickness h [m] at these distances [m]."""
        return np.interp(x, self._x, self._thickness)

    def _law(self, temperature: float) -> tuple[float, float]:
        """Return viscosity [Pa s] and yield strength [Pa]."""
        cooler = self._lava.reference_temperature - temperature
        viscosity = self._lava.viscosity * math.exp(self._lava.arrhenius * cooler)
        return viscosity, self._lava.yield_strength * math.exp(self._lava.yield_rate * cooler)

    def _slope(self, x: float, thickness: float) -> float:
        """Return the slope of the surface that drives the flux through a thickness [m].

        With a = tau_y / (rho g d), s - 3 a / 2 + a^3 / (2 s^2) is the slope that lava without
        strength needs. Newton's method comes down to the root from above.
        """
        viscosity, strength = self._law(float(self.temperature(np.array(x))))
        without = 3.0 * viscosity * self._flux / (self._weight * self._square * thickness**3)
        a = strength / (self._weight * math.sqrt(self._square) * thickness)
        slope = without + 1.5 * a
        for _ in range(30):
            excess = slope - 1.5 * a + 0.5 * a**3 / slope**2 - without
            slope -= excess / (1.0 - (a / slope) ** 3)
        return slope

    def _even_thickness(self, temperature: float) -> float:
        """Return the thickness whose surface is parallel to the ground."""
        low, high = 1e-3, 1e3
        for _ in range(60):
            middle = math.sqrt(low * high)
            viscosity, strength = self._law(temperature)
            b = strength / (self._weight * math.sqrt(self._square) * middle * self._tangent)
            carried = 0.0
            if b < 1.0:
                carried = self._weight * self._square * middle**3 * self._tangent
                carried *= (1.0 - 1.5 * b + 0.5 * b**3) / (3.0 * viscosity)
            low, high = (middle, high) if carried < self._flux else (low, middle)
        return middle
