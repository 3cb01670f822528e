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

#: Where the flow of the case ``cooling_plane`` is thicker than 0.1 m, by ``cooling_flow`` on cells
#: of 1.25 m (docs/benchmarks/cooling_plane.csv): the cells of 5 m on one side of the axis whose
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


def cooling_flow(
    lava: Lava, source: np.ndarray, cell: float, slope: float, until: float, *, initial: float,
    ambient: float, gravity: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Thickness [m] and temperature [K] of a cooling flow by finite volumes, from no lava.

    Explicit steps for the volume and the heat of square cells with closed borders. Both are of
    second order where the flow is smooth: the thickness that runs down the slope and the
    temperature that it carries are extrapolated to the faces of cells, with van Leer's limiter.
    Spreading is central, with the mean of h^3 along the line between two thicknesses. cos^4 b is
    left out.

    Args:
        lava: Arrhenius law, heat capacity and heat loss; the yield strength is ignored.
        source: Emission [m/s], shape [rows, columns]; the ground falls along a row.
        cell: Side of a cell [m].
        slope: tan b.
        until: The end [s].
        initial: Temperature of emitted lava [K].
        ambient: Temperature of the air [K].
        gravity: g [m/s2].
    """
    shape = source.shape
    thickness, temperature = np.zeros(shape), np.full(shape, initial)
    capacity = lava.density * lava.specific_heat
    weight = lava.density * gravity / (3.0 * lava.viscosity)
    time = 0.0
    while time < until:
        cooler = lava.reference_temperature - temperature
        mobility = weight * np.exp(-lava.arrhenius * cooler)
        fastest = float((mobility * thickness**2).max()) + 1e-9
        step = min(
            0.2 * cell**2 / (fastest * float(thickness.max()) + 1e-9),
            0.1 * cell / (fastest * (slope + 0.3)), 0.8 * cell, until - time,
        )
        volume = thickness + step * source
        heat = thickness * temperature + step * source * initial
        for axis, fall in ((1, slope), (0, 0.0)):
            fields = [
                np.moveaxis(field, axis, 0)
                for field in (thickness, temperature, mobility, volume, heat)
            ]
            _exchange(fields, fall, step / cell, cell)
        is_wet = volume > 1e-12
        thickness = np.where(is_wet, volume, 0.0)
        mixed = np.where(is_wet, heat / np.maximum(volume, 1e-12), initial)
        stored = capacity * np.maximum(thickness, 1e-9) * np.maximum(mixed - ambient, 1e-9)
        rate = surface_loss(lava, mixed, ambient) / stored
        cooled = ambient + (mixed - ambient) * np.exp(-rate * step)
        temperature = np.where(is_wet, cooled, initial)
        time += step
    return thickness, temperature


def _exchange(fields: list[np.ndarray], fall: float, ratio: float, cell: float) -> None:
    """Move volume and heat, the last fields, between neighbours along the first axis.

    The others are thickness, temperature and mobility before the step, which is ``ratio`` times as
    long [s] as the cell [m].
    """
    h, t, mobility, volume, heat = fields
    if len(h) == 1:
        return
    wet = h > 0.0
    a, b = h[:-1], h[1:]
    both = 0.5 * (mobility[:-1] + mobility[1:])
    both = np.where(wet[:-1] & wet[1:], both, np.where(wet[:-1], mobility[:-1], mobility[1:]))
    spread = 0.25 * (a + b) * (a * a + b * b) * (b - a) / cell
    upper = np.maximum((h + 0.5 * _limited(h))[:-1], 0.0)
    flux = np.clip(both * (upper**3 * fall - spread) * ratio, -0.25 * b, 0.25 * a)
    # dry neighbours have no temperature
    rise = 0.5 * _limited(t)
    rise[1:-1] *= wet[:-2] & wet[2:]
    carried = flux * np.where(flux > 0.0, (t + rise)[:-1], (t - rise)[1:])
    for total, moved in ((volume, flux), (heat, carried)):
        total[:-1] -= moved
        total[1:] += moved


def _limited(field: np.ndarray) -> np.ndarray:
    """Return the difference across a cell along axis 0 by van Leer's limiter; 0 at borders."""
    found = np.zeros_like(field)
    before, after = field[1:-1] - field[:-2], field[2:] - field[1:-1]
    product, total = before * after, before + after
    is_smooth = product > 0.0
    found[1:-1][is_smooth] = 2.0 * product[is_smooth] / total[is_smooth]
    return found
