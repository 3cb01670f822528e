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

"""Exact solutions of layers of even thickness: speed, lateral stress, heat."""

from collections.abc import Callable
import math
from typing import Any

import numpy as np

from lava_ros.scene import Lava

#: Stefan-Boltzmann constant [W/(m2 K4)] (CODATA 2018), apart from the solver's on purpose.
STEFAN_BOLTZMANN = 5.670374419e-8


def bisection(is_below: Callable[[Any], Any], low: Any, high: Any) -> Any:
    """Find where ``is_below`` turns from true to false between two numbers, or two arrays."""
    for _ in range(100):
        middle = 0.5 * (low + high)
        below = is_below(middle)
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)


def sheet_velocity(thickness: float, slope: float, nu: float, gravity: float) -> float:
    """Depth-averaged speed along the slope of a uniform sheet, g h^2 sin(b) / (3 nu) [m/s].

    It follows from the balance of weight and drag, mu d2u/dz2 = -rho g sin(b), without slip below
    and without stress on top. h [m] is normal to the slope b [rad]; nu is the kinematic viscosity
    [m2/s] and g ``gravity`` [m/s2].
    """
    return gravity * thickness**2 * math.sin(slope) / (3.0 * nu)


def green_response(wave_number: float, thickness: float) -> float:
    """Velocity over local velocity for a driving term sin(q x), 1 / (1 + q^2 / k^2).

    It follows from lap u' - k^2 u' = b with k = sqrt(3) / h (see ``effects.green``); q [1/m], h
    [m].
    """
    return 1.0 / (1.0 + wave_number**2 * thickness**2 / 3.0)


def channel_mean_velocity(width: float, thickness: float) -> float:
    """Mean velocity in a channel with no-slip walls, relative to that of a wide sheet.

    The channel is W [m] wide and h [m] thick. u'' - k^2 u = -k^2 u0 with k = sqrt(3) / h and u = 0
    at y = -W/2 and W/2 has u = u0 (1 - cosh(k y) / cosh(k W / 2)), whose mean is u0 (1 - tanh(k W
    / 2) / (k W / 2)).
    """
    half = 0.5 * math.sqrt(3.0) * width / thickness
    return 1.0 - math.tanh(half) / half


class RadiatingSheet:
    """A sheet at one temperature that radiates from its top.

    rho c h dT/dt = -eps sigma (T^4 - Ta^4). With partial fractions of 1 / (T^4 - Ta^4),
    F(T) - F(T0) = eps sigma t / (rho c h) for
    F(T) = [ln((T + Ta) / (T - Ta)) + 2 atan(T / Ta)] / (4 Ta^3), which falls with T.
    """

    def __init__(self, lava: Lava, *, initial: float, ambient: float, thickness: float) -> None:
        """Set T0 [K], Ta [K] and h [m]; ``lava`` has eps, rho and c."""
        self.initial = initial
        self.ambient = ambient
        capacity = lava.density * lava.specific_heat * thickness
        self.rate = lava.emissivity * STEFAN_BOLTZMANN / capacity

    def _integral(self, temperature: float) -> float:
        ambient = self.ambient
        logarithm = math.log((temperature + ambient) / (temperature - ambient))
        return (logarithm + 2.0 * math.atan(temperature / ambient)) / (4.0 * ambient**3)

    def temperature(self, time: float) -> float:
        """T [K] at a time [s]."""
        target = self._integral(self.initial) + self.rate * time
        coldest = math.nextafter(self.ambient, math.inf)
        return float(
            bisection(lambda now: self._integral(now) <= target, self.initial, coldest)
        )
