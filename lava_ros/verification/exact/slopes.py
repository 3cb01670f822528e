# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Exact solutions of lava on an even slope of angle b, along the slope x and normal to it h.

h_t + (g / 3 nu) [(h^3 (sin b - cos b h_x))_x - cos b (h^3 h_y)_y] = source. The last two solutions
are the speed and the lateral stress of layers of uniform thickness.
"""

from collections.abc import Callable
import math
from typing import Any

import numpy as np


class SlopeFixedArea:
    """A fixed area A down a slope at late times (Huppert 1982, Nature 300).

    Long after the release h_x is small against tan b: h_t + (g sin b / nu) h^2 h_x = 0. From a
    point, each h travels at g sin b h^2 / nu, so h = [nu x / (g sin b t)]^(1/2), and
    A = int_0^(x_N) h dx puts the front at x_N = [9 A^2 g sin b t / (4 nu)]^(1/3). Neglected
    terms are of the order h_N cot b / x_N.
    """

    def __init__(self, area: float, slope: float, nu: float, gravity: float) -> None:
        """Set A [m2], b [rad], nu [m2/s] and g [m/s2]."""
        self.area = area
        self._rate = gravity * math.sin(slope) / nu

    def length(self, time: float) -> float:
        """Return x_N [m] at a time [s] after the release from a line."""
        return float(np.cbrt(2.25 * self.area**2 * self._rate * time))

    def time_of_length(self, length: float) -> float:
        """Return the time [s] at which the front is at a distance [m]."""
        return length**3 / (2.25 * self.area**2 * self._rate)

    def thickness(self, distance: np.ndarray, time: float) -> np.ndarray:
        """Return the thickness [m] at distances from the line [m]."""
        x = np.asarray(distance)
        wet = (x >= 0.0) & (x <= self.length(time))
        return np.where(wet, np.sqrt(np.clip(x, 0.0, None) / (self._rate * time)), 0.0)


class SlopeFlux:
    """A constant flux q down a slope (Huppert 1982, Nature 300, with the front's own shape).

    Behind the front h0 = (3 nu q / (g sin b))^(1/3), and the front travels at
    c = q / h0 = (g sin b q^2 / 3 nu)^(1/3). A profile that travels unchanged has flux c h, so
    h_x = tan b (1 - h0^2 / h^2), which integrates to x = x_f - cot b [h0 atanh(h/h0) - h]. Its toe
    x_f is ahead of a sharp step of the same volume by
    cot b int_0^h0 h^2 / (h0 + h) dh = (ln 2 - 1/2) h0 cot b.

    Behind the source there is no flux: h rises with slope tan b to h0, a pond of area
    h0^2 cot b / 2. When both shapes have formed the volume q t puts the toe at
    c t + (ln 2 - 1) h0 cot b.
    """

    def __init__(self, flux: float, slope: float, nu: float, gravity: float) -> None:
        """Set q [m2/s], b [rad], nu [m2/s] and g [m/s2]."""
        drive = gravity * math.sin(slope) / (3.0 * nu)
        self.thickness = float(np.cbrt(flux / drive))
        self.speed = flux / self.thickness
        self.run_out = self.thickness / math.tan(slope)

    def behind_toe(self, thickness: float) -> float:
        """Return the distance from the toe [m] at which the front has a thickness [m]."""
        ratio = thickness / self.thickness
        return self.run_out * (math.atanh(ratio) - ratio)

    def arrival(self, distance: float, thickness: float) -> float:
        """Return the time [s] at which a thickness [m] arrives at a distance [m]."""
        lag = (1.0 - math.log(2.0)) * self.run_out + self.behind_toe(thickness)
        return (distance + lag) / self.speed


class SteadySource:
    """A steady point source on a slope, far down (Smith 1973, J. Fluid Mech. 58).

    Where the flow is long against its width, tan b (h^3)_x = (h^3 h_y)_y and
    (g sin b / 3 nu) int h^3 dy = Q. With w = K x^(3/7) and h = c x^(-1/7) f(y / w) the first is
    -(3/7) tan b (s f^3)' = (c / K^2) (f^3 f')', so f = 1 - s^2 and c = (3/14) tan b K^2. The
    second, int_-1^1 (1 - s^2)^3 ds = 32/35, gives
    K^7 = (105 / 32) (14 / 3)^3 nu Q cos^3 b / (g sin^4 b): a half-width of
    2.29317 [nu Q cos^3 b / (g sin^4 b)]^(1/7) x^(3/7) and on the axis
    1.12685 tan b [same]^(2/7) x^(-1/7). Neglected terms are of the order of the source's run-out
    over x.
    """

    WIDTH = (105.0 / 32.0 * (14.0 / 3.0) ** 3) ** (1.0 / 7.0)
    HEIGHT = 3.0 / 14.0 * WIDTH**2

    def __init__(self, discharge: float, slope: float, nu: float, gravity: float) -> None:
        """Set Q [m3/s], b [rad], nu [m2/s] and g [m/s2]."""
        self._tangent = math.tan(slope)
        pull = gravity * math.sin(slope) ** 4
        self._scale = (nu * discharge * math.cos(slope) ** 3 / pull) ** (1.0 / 7.0)

    def half_width(self, distance: float, thickness: float = 0.0) -> float:
        """Return half of the width over which the flow is thicker than a value [m]."""
        width = self.WIDTH * self._scale * distance ** (3.0 / 7.0)
        return width * math.sqrt(1.0 - thickness / self.axis(distance))

    def axis(self, distance: float) -> float:
        """Return the thickness on the axis [m] at a distance from the source [m]."""
        return self.HEIGHT * self._tangent * self._scale**2 * distance ** (-1.0 / 7.0)


class ListerScales:
    """The scales of a point source on a slope (Lister 1992, J. Fluid Mech. 242).

    With h0 = [3 nu Q / (g cos b)]^(1/4), L = h0 cot b and T = 3 nu L / (g sin b h0^2) the equation
    has no constants left but the source's: h_t + (h^3)_x = div(h^3 grad h), source 1. Spreading
    therefore balances flow down the slope at h0 and L, and Q T = L^2 h0.
    """

    def __init__(self, discharge: float, slope: float, nu: float, gravity: float) -> None:
        """Set Q [m3/s], b [rad], nu [m2/s] and g [m/s2]."""
        drive = 3.0 * nu / gravity
        self.thickness = (drive * discharge / math.cos(slope)) ** 0.25
        self.length = self.thickness / math.tan(slope)
        self.time = drive * self.length / (math.sin(slope) * self.thickness**2)


#: t / T: (front x_N / L, half-width y_N / L) of a source of radius 0.3 L, where h > 0.02 h0. A
#: finite-volume solution of Lister's equation; no closed form is known. To about 1 % in y_N, of
#: which two digits are given.
LISTER_REFERENCE: dict[float, tuple[float, float]] = {
    5.0: (3.00, 1.50), 10.0: (5.00, 2.00), 20.0: (8.40, 2.60), 50.0: (17.05, 3.60),
    100.0: (29.20, 4.60), 200.0: (49.9, 5.9),
}


def bisection(is_below: Callable[[Any], Any], low: Any, high: Any) -> Any:
    """Find where ``is_below`` changes from true to false between two numbers, or two arrays."""
    for _ in range(100):
        middle = 0.5 * (low + high)
        below = is_below(middle)
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)


def sheet_velocity(thickness: float, slope: float, nu: float, gravity: float) -> float:
    """Return the depth-averaged speed of a uniform sheet, g h^2 sin(b) / (3 nu) [m/s].

    It follows from the balance of weight and drag, mu d2u/dz2 = -rho g sin(b), along the slope, no
    slip below and no stress on top. h [m] is normal to the slope b [rad]; nu is the viscosity
    [m2/s] and g ``gravity`` [m/s2].
    """
    return gravity * thickness**2 * math.sin(slope) / (3.0 * nu)


def wave_response(wave_number: float, thickness: float) -> float:
    """Return depth-averaged Stokes flow over local velocity for a force sin(q y) along x.

    A layer of thickness h without slip below and without stress on top has u = U(z) sin(q y) with
    mu (U'' - q^2 U) = -F, so U = F / (mu q^2) (1 - cosh(q (h - z)) / cosh(q h)). Its mean over
    F h^2 / (3 mu) is 3 / x^2 (1 - tanh(x) / x), x = q h: 1 - 2/5 x^2 + 17/105 x^4 - ... for long
    waves.

    Args:
        wave_number: q [1/m].
        thickness: h [m].

    Returns:
        The ratio, from 0 to 1.
    """
    x = wave_number * thickness
    return 3.0 / x**2 * (1.0 - math.tanh(x) / x)


def channel_mean_velocity(width: float, thickness: float) -> float:
    """Return the mean Stokes flow in an open channel, with no-slip walls, over that of a sheet.

    A channel of width W and thickness h is half of a duct of width W and height 2 h, whose series
    (Boussinesq 1868; White 1991, Viscous Fluid Flow) gives, with the odd n,
    1 - 384 h / (pi^5 W) sum tanh(n pi W / (4 h)) / n^5.

    Args:
        width: W [m].
        thickness: h [m].

    Returns:
        The ratio, from 0 to 1.
    """
    n = np.arange(1.0, 2000.0, 2.0)
    series = np.sum(np.tanh(0.25 * math.pi * n * width / thickness) / n**5)
    return float(1.0 - 384.0 * thickness / (math.pi**5 * width) * series)
