# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Exact solutions of lava that gains and loses heat.

Lava that stiffens as it cools has the viscosity mu(T) = mu_0 exp(alpha (T_0 - T)) and the yield
strength tau_y(T) = tau_0 exp(r (T_0 - T)); its surface loses F(T) (``surface_loss``).
"""

from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from lava_ros.scene import Lava
from lava_ros.verification.exact.slopes import bisection
from lava_ros.verification.exact.spreading import ConstantFluxSpread, runge_kutta

#: Stefan-Boltzmann constant [W/(m2 K4)] (CODATA 2018), deliberately separate from the solver's.
STEFAN_BOLTZMANN = 5.670374419e-8


def column_on_ground(
    lava: Lava, time: float, *, initial: float, ground: float, thickness: float
) -> float:
    """Return T [K] of a mixed column that loses heat only to a half-space of ground.

    rho c h T' = -q and the ground's surface is at T. In Laplace space (ground temperature over
    Tg: (T - Tg) exp(-z sqrt(s / a))) q = kg sqrt(s / a) (T - Tg), so
    (T - Tg) / (T0 - Tg) = 1 / (s + b sqrt(s)), b = kg / (sqrt(a) rho c h), whose original is
    exp(b^2 t) erfc(b sqrt(t)): up to a time of contact t [s] of 700 / b^2. T0 and Tg are in
    kelvin, h in metres; ``lava`` has kg, a, rho and c.
    """
    taken = lava.ground_conductivity / math.sqrt(lava.ground_diffusivity)
    rate = taken / (lava.density * lava.specific_heat * thickness)
    x = rate * math.sqrt(time)
    return ground + (initial - ground) * math.exp(x * x) * math.erfc(x)


def convecting_sheet(
    lava: Lava, time: float, *, initial: float, ambient: float, thickness: float
) -> float:
    """Return T [K] of a mixed sheet that loses heat by convection alone after a time [s].

    rho c d T' = -lambda (T - Ta), d the thickness across the sheet [m]. ``lava`` has rho, c and
    lambda.
    """
    rate = lava.convection / (lava.density * lava.specific_heat * thickness)
    return ambient + (initial - ambient) * math.exp(-rate * time)


def convecting_slab(
    lava: Lava, time: float, *, initial: float, ambient: float, thickness: float
) -> float:
    """Return the mean T [K] of a slab with conduction, convection on top and an insulated base.

    T_t = kappa T_zz with k T_z = -lambda (T - Ta) on top. Its modes cos(beta z / h) have
    beta tan(beta) = Bi = lambda h / k, and the mean over the thickness h [m] is
    sum 2 Bi^2 / (beta^2 (beta^2 + Bi^2 + Bi)) exp(-beta^2 kappa t / h^2) of T0 - Ta [K]
    (Carslaw & Jaeger 1959, section 3.11). ``lava`` has k, rho, c and lambda; t is in seconds.
    """
    biot = lava.convection * thickness / lava.conductivity
    # the first 400 modes
    low = np.arange(400) * math.pi
    roots = bisection(
        lambda beta: beta * np.abs(np.sin(beta)) < biot * np.abs(np.cos(beta)),
        low, low + 0.5 * math.pi,
    )
    squares = roots**2
    weights = 2.0 * biot**2 / (squares * (squares + biot**2 + biot))
    rate = lava.conductivity / (lava.density * lava.specific_heat * thickness**2)
    return ambient + (initial - ambient) * float(weights @ np.exp(-squares * rate * time))


def stefan_crust(lava: Lava, time: float | np.ndarray, *, ambient: float) -> Any:
    """Return the thickness [m] of solid lava on fluid lava whose surface is as cold as the air.

    Neumann's solution of Stefan's problem, 2 l sqrt(kappa t), with the heat
    E = c (T0 - Ts) + L F(T0) that lava loses until it is solid at the solidus Ts (Carslaw & Jaeger
    1959, section 11.2): sqrt(pi) l exp(l^2) erf(l) = c (Ts - Ta) / E. The fluid lava is at T0, the
    reference temperature, and t in seconds.
    """
    hot, capacity = lava.reference_temperature, lava.specific_heat
    melt = min((hot - lava.solidus) / (lava.liquidus - lava.solidus), 1.0)
    heat = capacity * (hot - lava.solidus) + getattr(lava, 'latent_heat', 0.0) * melt
    stefan = capacity * (lava.solidus - ambient) / heat
    constant = bisection(
        lambda value: math.sqrt(math.pi) * value * math.exp(value**2) * math.erf(value) < stefan,
        0.0, 4.0,
    )
    diffusivity = lava.conductivity / (lava.density * capacity)
    return 2.0 * constant * np.sqrt(diffusivity * time)


def insulated_sheet(
    lava: Lava, time: float, *, initial: float, ambient: float, thickness: float
) -> float:
    """Return T [K] of a sheet whose crust grows by ``stefan_crust``: T0 fluid, Ts solid."""
    solid = stefan_crust(lava, time, ambient=ambient) / thickness
    return float(initial - (initial - lava.solidus) * solid)


def crystallising_sheet(
    lava: Lava, time: float, *, initial: float, ambient: float, thickness: float
) -> float:
    """T [K] of a sheet that loses lambda (T - Ta) and crystallises from liquidus to solidus.

    rho c h m T' = -lambda (T - Ta) with m = 1 + L / (c (liquidus - solidus)) within the interval,
    1 outside. So each piece is an exponential, and the time to a temperature is
    rho c h / lambda times the sum of m ln((T1 - Ta) / (T2 - Ta)) over the pieces from T1 to T2.
    T0 and Ta are in kelvin, h in metres, t in seconds; ``lava`` has the rest.
    """
    slower = 1.0 + lava.latent_heat / (lava.specific_heat * (lava.liquidus - lava.solidus))
    now = initial
    left = time / (lava.density * lava.specific_heat * thickness / lava.convection)
    for low, high, slowness in (
        (lava.liquidus, math.inf, 1.0), (lava.solidus, lava.liquidus, slower),
        (0.0, lava.solidus, 1.0),
    ):
        if low < now <= high:
            needed = math.inf
            if low > ambient:
                needed = slowness * math.log((now - ambient) / (low - ambient))
            if left <= needed:
                return ambient + (now - ambient) * math.exp(-left / slowness)
            now, left = low, left - needed
    return now


def temperature_step(
    distance: np.ndarray, time: float, *, low: float, high: float, diffusivity: float
) -> np.ndarray:
    """Temperature [K] of a layer that began at ``low`` for x < 0 and at ``high`` for x > 0.

    T_t = kappa T_xx has T = (low + high) / 2 + (high - low) / 2 erf(x / (2 sqrt(kappa t))).
    x is ``distance`` [m], kappa ``diffusivity`` [m2/s] and t ``time`` since the start [s].
    """
    scaled = np.asarray(distance) / (2.0 * math.sqrt(diffusivity * time))
    shape = np.array([math.erf(value) for value in scaled.ravel()]).reshape(scaled.shape)
    return 0.5 * (low + high) + 0.5 * (high - low) * shape


def warming_by_descent(descent: float, *, gravity: float, specific_heat: float) -> float:
    """Rise of temperature when all potential energy becomes heat, g z / c [K].

    z is ``descent`` [m], c ``specific_heat`` [J/(kg K)] and g ``gravity`` [m/s2].
    """
    return gravity * descent / specific_heat


def surface_loss(lava: Lava, temperature: np.ndarray, ambient: float) -> np.ndarray:
    """Loss eps sigma (T^4 - Ta^4) + lambda (T - Ta) [W/m2] at temperatures [K], Ta in kelvin."""
    temperature = np.asarray(temperature)
    radiated = lava.emissivity * STEFAN_BOLTZMANN * (temperature**4 - ambient**4)
    return radiated + lava.convection * (temperature - ambient)


class CoolingCurrent:
    """A steady current from a point source that radiates and convects as it spreads.

    All of the discharge Q flows through every circle that the current has left far behind, and
    T is that of the circle: rho c Q dT/dr = -2 pi r F(T),
    F = eps sigma (T^4 - Ta^4) + lambda (T - Ta), whatever the thickness and the viscosity are. So
    r^2 = (rho c Q / pi) int_T^T0 dT / F. For F = lambda (T - Ta) that is
    T - Ta = (T0 - Ta) exp(-pi lambda r^2 / (rho c Q)), the thermal radius sqrt(rho c Q / (pi
    lambda)). This also holds for a source that is a disc of radius a: within it the difference is
    1 / (1 + a^2 / rT^2), which equals that of a point source at the edge to within half of the
    square of a^2 / rT^2.

    The surface loses the heat that the source supplies, rho c Q (T0 - Ta).

    Attributes:
        power: Heat that the source supplies [W].
        thermal_radius: Distance at which T - Ta has fallen to 1 / e [m].
    """

    def __init__(self, lava: Lava, *, initial: float, ambient: float, discharge: float) -> None:
        """Set T0 [K], Ta [K] and Q [m3/s]; ``lava`` has eps, lambda, rho and c."""
        self._initial, self._ambient, self._lava = initial, ambient, lava
        supply = lava.density * lava.specific_heat * discharge
        self.power = supply * (initial - ambient)
        # T falls by e each time the integral of dT / F does: even in the logarithm of T - Ta
        self._logs = logs = np.linspace(0.0, -12.0, 24001)
        differences = (initial - ambient) * np.exp(logs)
        slopes = differences / self.flux(ambient + differences)
        steps = 0.5 * (slopes[1:] + slopes[:-1]) * (logs[:-1] - logs[1:])
        self._squares = np.concatenate([[0.0], np.cumsum(steps)]) * supply / math.pi
        self.thermal_radius = math.sqrt(float(np.interp(1.0, -logs, self._squares)))

    def flux(self, temperature: np.ndarray) -> np.ndarray:
        """Return the heat loss of the surface [W/m2] at temperatures [K]."""
        return surface_loss(self._lava, temperature, self._ambient)

    def temperature(self, distance: np.ndarray) -> np.ndarray:
        """Return T [K] at distances from the source [m]."""
        logs = np.interp(np.asarray(distance) ** 2, self._squares, self._logs)
        return self._ambient + (self._initial - self._ambient) * np.exp(logs)


class CoolingSpread:
    """A constant flux that spreads on a plane and loses lambda (T - Ta) on its way.

    The isoviscous current of Garel et al. 2012 (J. Geophys. Res. 117), with one temperature per
    column and no loss to the ground. The flow is Huppert's (``ConstantFluxSpread``), whatever the
    temperature. Lava emitted at t0 is at r(t) with dr/dt = q / (2 pi r h), q the flux through its
    circle, and its excess temperature falls at lambda / (rho c h). In x = r / R(t) and s = t / t0
    this is one curve for all lava: d(x^2 s)/ds = q / (pi (R^2 / t) h), and the logarithm of the
    excess falls by lambda t0 / (rho c) int_1^s ds / h. Near the source the temperature therefore
    approaches that of ``CoolingCurrent``, while the front advances.
    """

    #: Maximum t / t0: earlier lava is in the last thousandth of the radius.
    OLDEST = 1e7

    def __init__(self, spread: ConstantFluxSpread, *, loss: float, capacity: float) -> None:
        """Set the flow, lambda [W/(m2 K)] and rho c [J/(m3 K)]."""
        self._spread, self._rate = spread, loss / capacity
        # even in the logarithms of s - 1 and, further on, of s
        self._ages = 1.0 + np.concatenate(
            [np.geomspace(1e-9, 1.0, 1500), np.geomspace(1.0, self.OLDEST, 1500)[1:]]
        )
        area = math.pi * spread.coefficient**2

        def rates(age: float, state: np.ndarray) -> np.ndarray:
            # the flow is self-similar, so evaluate it at one second
            place = np.array(spread.coefficient * math.sqrt(max(state[0], 0.0) / age))
            height = max(float(spread.thickness(place, 1.0)), 1e-12)
            flux = float(spread.flux(place, 1.0))
            return np.array([flux / (area * height), 1.0 / height])

        states = runge_kutta(rates, np.concatenate([[1.0], self._ages]), np.zeros(2))
        squares, self._falls = states[1:].T
        self._shares = np.sqrt(squares / self._ages)

    def difference(self, distance: np.ndarray, time: float) -> np.ndarray:
        """Return T - Ta over its value at the source, at distances [m] and a time [s]."""
        scaled = np.asarray(distance) / self._spread.radius(time)
        ages = np.interp(scaled, self._shares, self._ages)
        falls = np.interp(ages, self._ages, self._falls)
        return np.exp(-self._rate * time / ages * falls)

    def power(self, time: float) -> float:
        """Return the loss of the whole surface over the heat of the source, at a time [s]."""
        distance = self._shares * self._spread.radius(time)
        height = self._spread.thickness(distance, time)
        born = time / self._ages
        lost = self._rate * np.exp(-self._rate * born * self._falls) / np.maximum(height, 1e-12)
        lost[height <= 0.0] = 0.0
        return float((0.5 * (lost[1:] + lost[:-1]) * -np.diff(born)).sum())


@dataclass(frozen=True)
class FreezingLens:
    """A paraboloid of lava at rest that freezes from its rim inwards.

    The thickness is h(r) = D (1 - r^2 / R^2). Every column cools through its surface by
    rho c h dT/dt = -lambda (T - Ta), so T - Ta = (T0 - Ta) exp(-lambda t / (rho c h)), and reaches
    the solidus Ts at

        t(h) = (rho c h / lambda) ln((T0 - Ta) / (Ts - Ta)),

    which is proportional to its thickness. At time t all lava thinner than D t / t(D) is frozen:
    the ring r^2 > s R^2 with s = 1 - t / t(D). The fluid rest has the volume

        integral over 0..s of D (1 - s') pi R^2 ds' = pi R^2 D (s - s^2 / 2),

    which is the fraction 2 s - s^2 of the total, pi R^2 D / 2. So the fraction (1 - s)^2, which is
    (t / t(D))^2, is frozen. ``lava`` has rho, c, lambda and Ts; lengths are in metres, T0
    (``first``) and Ta in kelvin.
    """

    lava: Lava
    depth: float
    radius: float
    first: float
    ambient: float

    @property
    def end(self) -> float:
        """Time at which the middle solidifies, the last to do so [s]."""
        span = math.log((self.first - self.ambient) / (self.lava.solidus - self.ambient))
        capacity = self.lava.density * self.lava.specific_heat
        return capacity * self.depth / self.lava.convection * span

    def thickness(self, r: np.ndarray) -> np.ndarray:
        """Return the thickness at a distance from the axis [m]."""
        return self.depth * np.maximum(1.0 - (r / self.radius) ** 2, 0.0)

    def frozen_fraction(self, time: float) -> float:
        """Return the fraction of the volume that has solidified at a time [s]."""
        return min(1.0, time / self.end) ** 2


def radiating_sheet(
    lava: Lava, time: float, *, initial: float, ambient: float, thickness: float
) -> float:
    """T [K] of a sheet at one temperature that radiates from its top.

    rho c h dT/dt = -eps sigma (T^4 - Ta^4). With partial fractions of 1 / (T^4 - Ta^4),
    F(T) - F(T0) = eps sigma t / (rho c h) for
    F(T) = [ln((T + Ta) / (T - Ta)) + 2 atan(T / Ta)] / (4 Ta^3), which falls with T. T0 and Ta are
    in kelvin, h in metres, t in seconds; ``lava`` has eps, rho and c.
    """

    def integral(now: float) -> float:
        logarithm = math.log((now + ambient) / (now - ambient))
        return (logarithm + 2.0 * math.atan(now / ambient)) / (4.0 * ambient**3)

    capacity = lava.density * lava.specific_heat * thickness
    target = integral(initial) + lava.emissivity * STEFAN_BOLTZMANN / capacity * time
    coldest = math.nextafter(ambient, math.inf)
    return float(bisection(lambda now: integral(now) <= target, initial, coldest))


#: Thickness of the sheet of the case ``cooling_front`` [m], by finite volumes on cells of 1.25 m
#: (docs/benchmarks/cooling_plane.py), from the cell whose middle is at the first place [m] on.
FRONT_FIRST = -8.125
FRONT_PROFILE = (
    0.0, 0.114, 0.485, 0.651, 0.788, 0.919, 1.007, 1.067, 1.104, 1.114, 1.125, 1.136, 1.147,
    1.158, 1.169, 1.18, 1.191, 1.203, 1.214, 1.225, 1.237, 1.249, 1.261, 1.272, 1.284, 1.296,
    1.308, 1.321, 1.333, 1.345, 1.358, 1.37, 1.383, 1.396, 1.408, 1.421, 1.434, 1.448, 1.461,
    1.474, 1.487, 1.501, 1.514, 1.528, 1.542, 1.556, 1.57, 1.584, 1.598, 1.612, 1.627, 1.641,
    1.656, 1.67, 1.685, 1.7, 1.715, 1.73, 1.745, 1.76, 1.776, 1.791, 1.807, 1.822, 1.838,
    1.854, 1.87, 1.886, 1.902, 1.918, 1.934, 1.95, 1.967, 1.983, 2.0, 2.016, 2.033, 2.049,
    2.066, 2.082, 2.099, 2.115, 2.131, 2.148, 2.164, 2.18, 2.195, 2.21, 2.225, 2.239, 2.253,
    2.266, 2.277, 2.287, 2.291, 2.286, 2.261, 2.189, 1.99, 1.161, 0.011, 0.0,
)

#: Footprint of the flow of the case ``cooling_plane``, by the same finite volumes
#: (docs/benchmarks/cooling_plane.csv): the cells of 5 m on one side of the axis that are covered
#: at least half by lava thicker than 0.1 m, from the column whose middle is at the first place [m]
#: on, and the front [m].
PLANE_FIRST = -12.5
PLANE_CELLS = (
    1, 3, 4, 4, 5, 5, 5, 6, 6, 6, 6, 6, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7,
    7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 7, 6, 6, 6, 5, 4,
)
PLANE_FRONT = 267.5


class CoolingSheet:
    """A steady sheet that cools and stiffens as it runs down an even slope b.

    The flux q past every place is the same, so rho c q dT/dx = -F(T), whatever the thickness is.
    The thickness is the one that carries the flux at this temperature. With d = h cos^2 b and the
    slope of the surface s = tan b - dh/dx,

        q = (rho g h d^2 s / 3 mu(T)) (1 - 3 B / 2 + B^3 / 2),   B = tau_y(T) / (rho g d s).

    That is an ordinary differential equation of h. Its deviations grow down the slope, so it is
    integrated up the slope, from a place at twice the length at which dh/dx is neglected. There is
    no lava above x = 0, where T is that of the source.
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
