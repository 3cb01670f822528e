# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Exact solutions of shallow flow with inertia: sheets, dam breaks, a bowl.

Du/Dt = -g grad(h + H) - drag and h_t + div(h u) = 0.
"""

from dataclasses import dataclass
import math

import numpy as np

from lava_ros.verification.exact.slopes import bisection


@dataclass(frozen=True)
class AcceleratingSheet:
    """A uniform sheet that is released from rest on a slope.

    h du/dt = g h tan(b) cos^2(b) - gamma h u with gamma = 3 nu / (h cos b)^2, all on the map: from
    rest u = u_eq (1 - exp(-gamma t)), u_eq = g h^2 tan(b) cos^4(b) / (3 nu). A sheet without
    inertia is ahead by u_eq (1 - exp(-gamma t)) / gamma. h is vertical [m], b in rad.
    """

    thickness: float
    slope: float
    nu: float
    gravity: float

    @property
    def rate(self) -> float:
        """Gamma [1/s], one over the relaxation time."""
        return 3.0 * self.nu / (self.thickness * math.cos(self.slope)) ** 2

    @property
    def final_speed(self) -> float:
        """u_eq [m/s]."""
        return self.gravity * math.tan(self.slope) * math.cos(self.slope) ** 2 / self.rate

    def speed(self, time: float) -> float:
        """Return the speed u [m/s]."""
        return self.final_speed * -math.expm1(-self.rate * time)

    def lag(self, time: float) -> float:
        """Return the lead of a sheet without inertia [m]."""
        return self.speed(time) / self.rate


@dataclass(frozen=True)
class RitterDamBreak:
    """A dam at x = 0 breaks onto a dry bed, without drag (Ritter 1892).

    Along dx/dt = u - c, c = sqrt(g h), the invariant u + 2 c keeps its value 2 c0 behind the dam.
    In the fan from the dam x / t = u - c, so c = (2 c0 - x / t) / 3 between x = -c0 t and 2 c0 t.
    ``height`` is the thickness behind the dam [m].
    """

    height: float
    gravity: float

    def thickness(self, x: np.ndarray, time: float) -> np.ndarray:
        """Return the thickness [m] at places x [m]."""
        pace = math.sqrt(self.gravity * self.height)
        return np.clip((2.0 * pace - x / time) / 3.0, 0.0, pace) ** 2 / self.gravity


class StokerDamBreak:
    """A dam at x = 0 breaks onto a layer at rest, without drag (Stoker 1957, section 10.8).

    A fan as Ritter's ends at x / t = u_m - c_m with u_m = 2 (c0 - c_m). A plateau h_m follows up
    to the bore at x / t = s. The flux into the bore balances, h_m (s - u_m) = h_1 s, and so does
    momentum, s^2 = g h_m (h_m + h_1) / (2 h_1). The two give u_m = s (1 - h_1 / h_m), an equation
    for h_m whose left side falls and whose right side rises.

    Attributes:
        plateau: h_m [m].
        bore: s [m/s].
    """

    def __init__(self, height: float, bed: float, gravity: float) -> None:
        """Set the thickness behind the dam and that in front of it, h_1 [m], and g [m/s2]."""
        self._bed, self._fan = bed, RitterDamBreak(height, gravity)

        def bore(plateau: float) -> float:
            return math.sqrt(0.5 * gravity * plateau * (plateau + bed) / bed)

        def is_faster(plateau: float) -> bool:
            speed = 2.0 * (math.sqrt(gravity * height) - math.sqrt(gravity * plateau))
            return speed > bore(plateau) * (1.0 - bed / plateau)

        self.plateau = float(bisection(is_faster, bed, height))
        self.bore = bore(self.plateau)

    def thickness(self, x: np.ndarray, time: float) -> np.ndarray:
        """Return the thickness [m] at places x [m]."""
        fan = self._fan.thickness(x, time)
        return np.where(x > self.bore * time, self._bed, np.maximum(fan, self.plateau))


@dataclass(frozen=True)
class OscillatingBowl:
    """Liquid that swings in a paraboloid, wide and thin or narrow and thick (Thacker 1981).

    On H = h0 r^2 / a^2 the thickness h = h0 (q - q^2 r^2 / a^2) with u = -r q' / (2 q) fulfils
    continuity for any q(t). With R = q^(-1/2) it is u = r R' / R, and Du/Dt = r R'' / R =
    -2 g h0 r / a^2 (1 - q^2) asks for R'' = w^2 / 4 (R^-3 - R), w^2 = 8 g h0 / a^2. With y = R^2
    that is y'' + w^2 y = const, so y swings at w: from rest q = sqrt(1 - A^2) / (1 - A cos(w t)).
    ``depth`` is h0 and ``radius`` a at rest [m]; ``swing`` is A, between 0 and 1.
    """

    depth: float
    radius: float
    swing: float
    gravity: float

    @property
    def period(self) -> float:
        """2 pi / w [s]."""
        return 2.0 * math.pi * self.radius / math.sqrt(8.0 * self.gravity * self.depth)

    def narrowness(self, time: float) -> float:
        """Return the thickness in the middle over that at rest, q = (a / radius)^2."""
        phase = 2.0 * math.pi * time / self.period
        return math.sqrt(1.0 - self.swing**2) / (1.0 - self.swing * math.cos(phase))

    def thickness(self, distance: np.ndarray, time: float) -> np.ndarray:
        """Return the thickness [m] at distances from the middle [m]."""
        q = self.narrowness(time)
        return np.maximum(0.0, self.depth * (q - (q * distance / self.radius) ** 2))
