# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Exact solutions of lava that spreads on a plane by its own weight.

h_t = alpha div(h^3 grad h), alpha = g / (3 nu). Each is a similarity solution h ~ f(eta) with
f = 0 at the front eta_N, near which f^2 f' is minus the front's own speed in similarity
variables. The coefficients are eigenvalues of ordinary differential equations, which the tests
integrate again.
"""

from collections.abc import Callable
from functools import cached_property
from itertools import pairwise
import math

import numpy as np


def runge_kutta(
    rates: Callable[[float, np.ndarray], np.ndarray], places: np.ndarray, state: np.ndarray
) -> np.ndarray:
    """Integrate y' = rates(x, y) with the fourth-order Runge-Kutta method.

    ``places`` are the values of x, shape [count]; ``state`` is y at the first of them, shape
    [size].

    Returns:
        y at each place, shape [count, size].
    """
    states = [state]
    for place, end in pairwise(places):
        step, state = end - place, states[-1]
        k1 = rates(place, state)
        k2 = rates(place + 0.5 * step, state + 0.5 * step * k1)
        k3 = rates(place + 0.5 * step, state + 0.5 * step * k2)
        k4 = rates(end, state + step * k3)
        states.append(state + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4))
    return np.array(states)


def spiral(distance: np.ndarray) -> np.ndarray:
    """Return places [m], shape [count, 2], at distances from (0, 0) by the golden angle."""
    angle = np.arange(len(distance)) * math.pi * (3.0 - math.sqrt(5.0))
    return np.column_stack([distance * np.cos(angle), distance * np.sin(angle)])


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

    def __init__(self, volume: float, nu: float, gravity: float) -> None:
        """Set V [m3], nu [m2/s] and g [m/s2]."""
        self.volume, self.nu, self.gravity = volume, nu, gravity

    def radius(self, time: float) -> float:
        """Return R [m] at a time [s] after the release from a point."""
        scale = self.gravity * self.volume**3 * time / (3.0 * self.nu)
        return self.RADIUS * scale**0.125

    def time_of_radius(self, radius: float) -> float:
        """Return the time [s] at which the radius [m] is reached."""
        scale = 3.0 * self.nu / (self.gravity * self.volume**3)
        return (radius / self.RADIUS) ** 8 * scale

    def centre(self, time: float) -> float:
        """Return the thickness in the middle h0 [m] at a time [s]."""
        return self.HEIGHT * (3.0 * self.nu * self.volume / (self.gravity * time)) ** 0.25

    def thickness(self, distance: np.ndarray, time: float) -> np.ndarray:
        """Return the thickness [m] at distances from the centre [m]."""
        ratio = np.asarray(distance) / self.radius(time)
        return self.centre(time) * np.cbrt(np.clip(1.0 - ratio**2, 0.0, None))

    def radius_of_thickness(self, thickness: float, time: float) -> float:
        """Return the distance [m] at which the profile has a thickness [m]."""
        return self.radius(time) * math.sqrt(1.0 - (thickness / self.centre(time)) ** 3)

    def rms_radius(self, time: float) -> float:
        """Root of the volume-weighted mean of r^2, R sqrt(3 / 7) [m]."""
        return self.radius(time) * math.sqrt(3.0 / 7.0)

    def particles(self, count: int, time: float) -> np.ndarray:
        """Return positions [m], shape [count, 2], of equal volumes with the profile at a time.

        The radius that holds a fraction s of the volume is R sqrt(1 - (1 - s)^(3/4)); the angles
        follow the golden angle.
        """
        inside = (np.arange(count) + 0.5) / count
        return spiral(self.radius(time) * np.sqrt(1.0 - (1.0 - inside) ** 0.75))


class ConstantFluxSpread:
    """A constant flux from a point onto a plane (Huppert 1982, J. Fluid Mech. 121, axisymmetric).

    h = (Q / alpha)^(1/4) f(eta), eta = r / [(alpha Q^3)^(1/8) t^(1/2)] gives
    (eta f^3 f')' + eta^2 f' / 2 = 0 with 2 pi int eta f d eta = 1. Its front is at
    eta_N = 0.71502, so R = 0.71502 (g Q^3 / 3 nu)^(1/8) t^(1/2), and there
    f^3 = (3/2) eta_N (eta_N - eta).
    """

    RADIUS = 0.71502

    #: Minimum distance over R at which the thickness is defined: in the middle it is infinite.
    INNERMOST = 1e-3

    def __init__(self, discharge: float, nu: float, gravity: float) -> None:
        """Set Q [m3/s], nu [m2/s] and g [m/s2]."""
        self._discharge, alpha = discharge, gravity / (3.0 * nu)
        self._length = (alpha * discharge**3) ** 0.125
        self._height = (discharge / alpha) ** 0.25

    @property
    def coefficient(self) -> float:
        """R / t^(1/2) [m/s^(1/2)]."""
        return self.RADIUS * self._length

    def radius(self, time: float) -> float:
        """Return R [m] at a time [s] after the flux began."""
        return self.coefficient * math.sqrt(time)

    def radius_of_thickness(self, thickness: float, time: float) -> float:
        """Return the distance [m] at which the profile's front has a thickness [m]."""
        behind = (thickness / self._height) ** 3 / (1.5 * self.RADIUS)
        return (self.RADIUS - behind) * self._length * math.sqrt(time)

    def thickness(self, distance: np.ndarray, time: float) -> np.ndarray:
        """Return the thickness [m] at distances from the source [m], 0 beyond the front."""
        places, heights, _ = self._profile
        return self._height * np.interp(self._place(distance, time), places, heights, right=0.0)

    def flux(self, distance: np.ndarray, time: float) -> np.ndarray:
        """Return the flux through circles of radii [m], -2 pi r alpha h^3 dh/dr [m3/s]."""
        places, _, fluxes = self._profile
        return self._discharge * np.interp(self._place(distance, time), places, fluxes, right=0.0)

    def _place(self, distance: np.ndarray, time: float) -> np.ndarray:
        return np.maximum(np.asarray(distance) / self.radius(time), self.INNERMOST)

    @cached_property
    def _profile(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Increasing eta / eta_N, f and -2 pi eta f^3 f' there, integrated inwards."""
        behind = np.concatenate(
            [np.geomspace(1e-6, 0.5, 1000), 1.0 - np.geomspace(0.5, self.INNERMOST, 1000)[1:]]
        )
        places = self.RADIUS * (1.0 - behind)

        def rates(eta: float, state: np.ndarray) -> np.ndarray:
            fall = state[1] / (eta * state[0] ** 3)
            return np.array([fall, -0.5 * eta**2 * fall])

        front = (1.5 * self.RADIUS * (self.RADIUS - places[0])) ** (1.0 / 3.0)
        states = runge_kutta(rates, places, np.array([front, -0.5 * self.RADIUS**2 * front]))
        f, flux = states[::-1].T
        return places[::-1] / self.RADIUS, f, -2.0 * math.pi * flux


class PlaneFixedArea:
    """A fixed area A per side, released along a line (Huppert 1982, J. Fluid Mech. 121, plane).

    x = x_N(t) s turns the equation into (h^3 h')' = -(x_N' x_N^2 / alpha) (s h)' (x_N scaled
    out), which integrates to h = h0 (1 - s^2)^(1/3) with
    x_N dx_N/dt = (2/3) alpha h0^3. With A = h0 x_N B, B = int_0^1 (1 - s^2)^(1/3) ds
    = sqrt(pi) Gamma(4/3) / (2 Gamma(11/6)), that is
    x_N = [(10 / 3) / B^3]^(1/5) (alpha A^3 t)^(1/5), a coefficient of 1.41124.
    """

    SHAPE = math.sqrt(math.pi) * math.gamma(4.0 / 3.0) / (2.0 * math.gamma(11.0 / 6.0))
    LENGTH = (10.0 / 3.0 / SHAPE**3) ** 0.2

    def __init__(self, area: float, nu: float, gravity: float) -> None:
        """Set A [m2], of one of the two sides, nu [m2/s] and g [m/s2]."""
        self.area = area
        self._scale = gravity * area**3 / (3.0 * nu)

    def length(self, time: float) -> float:
        """Return x_N [m] at a time [s] after the release from a line."""
        return self.LENGTH * (self._scale * time) ** 0.2

    def time_of_length(self, length: float) -> float:
        """Return the time [s] at which the front is at a distance [m]."""
        return (length / self.LENGTH) ** 5 / self._scale

    def centre(self, time: float) -> float:
        """Return the thickness in the middle h0 [m]."""
        return self.area / (self.SHAPE * self.length(time))

    def thickness(self, distance: np.ndarray, time: float) -> np.ndarray:
        """Return the thickness [m] at distances from the line [m]."""
        ratio = np.asarray(distance) / self.length(time)
        return self.centre(time) * np.cbrt(np.clip(1.0 - ratio**2, 0.0, None))

    def length_of_thickness(self, thickness: float, time: float) -> float:
        """Return the distance [m] at which the profile has a thickness [m]."""
        return self.length(time) * math.sqrt(1.0 - (thickness / self.centre(time)) ** 3)


class DamBreak:
    """A viscous step of height h0 released at x = 0, before its far end is affected.

    Cordonnier, Lev & Garel 2015 (Geol. Soc. London Spec. Publ. 426), benchmark BM1.
    h = h0 f(eta), eta = x / sqrt(alpha h0^3 t) gives (f^3 f')' + eta f' / 2 = 0 with f = 1 far
    behind, whose front is at 0.49242 = 0.28430 sqrt(3): x_f = 0.28430 h0 sqrt(g h0 t / nu). There
    f^3 = (3/2) 0.49242 (0.49242 - eta). int f d eta over eta > 0 is 0.25732.
    """

    FRONT = 0.28430 * math.sqrt(3.0)
    PASSED = 0.25732

    def __init__(self, height: float, nu: float, gravity: float) -> None:
        """Set h0 [m], nu [m2/s] and g [m/s2]."""
        self.height = height
        self._diffusivity = gravity * height**3 / (3.0 * nu)

    def time_of_reach(self, reach: float) -> float:
        """Return the time [s] at which the diffusive length sqrt(alpha h0^3 t) has a value [m]."""
        return reach**2 / self._diffusivity

    def front_of_thickness(self, thickness: float, time: float) -> float:
        """Return the distance from the dam [m] at which the front has a thickness [m]."""
        behind = (thickness / self.height) ** 3 / (1.5 * self.FRONT)
        return (self.FRONT - behind) * math.sqrt(self._diffusivity * time)

    def passed(self, time: float) -> float:
        """Return the area that has passed the dam [m2]."""
        return self.PASSED * self.height * math.sqrt(self._diffusivity * time)
