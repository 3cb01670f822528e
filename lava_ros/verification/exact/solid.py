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

"""Lava that freezes."""

from dataclasses import dataclass
import math

import numpy as np


@dataclass(frozen=True)
class FreezingLens:
    """A paraboloid of lava at rest that freezes from its rim inwards.

    The thickness is h(r) = D (1 - r^2 / R^2). Every column cools through its surface by
    rho c h dT/dt = -lambda (T - Ta), so T - Ta = (T0 - Ta) exp(-lambda t / (rho c h)), and reaches
    the solidus Ts at

        t(h) = (rho c h / lambda) ln((T0 - Ta) / (Ts - Ta)),

    which is proportional to its thickness. At time t all is frozen that is thinner than
    D t / t(D), the ring r^2 > s R^2 with s = 1 - t / t(D). What is fluid has the volume

        integral over 0..s of D (1 - s') pi R^2 ds' = pi R^2 D (s - s^2 / 2),

    of all, pi R^2 D / 2, the share 2 s - s^2. So the share (1 - s)^2 = (t / t(D))^2 is frozen.

    Attributes:
        depth: Thickness D in the middle [m].
        radius: Radius R of the rim [m].
        heat_capacity: rho c [J/(m3 K)].
        transfer: lambda [W/(m2 K)].
        first: Temperature T0 at the start [K].
        solidus: Temperature Ts [K].
        ambient: Temperature Ta of the air [K].
    """

    depth: float
    radius: float
    heat_capacity: float
    transfer: float
    first: float
    solidus: float
    ambient: float

    @property
    def volume(self) -> float:
        """Volume of the lava [m3]."""
        return 0.5 * math.pi * self.radius**2 * self.depth

    @property
    def end(self) -> float:
        """Time at which the middle freezes, the last to do so [s]."""
        span = math.log((self.first - self.ambient) / (self.solidus - self.ambient))
        return self.heat_capacity * self.depth / self.transfer * span

    def thickness(self, r: np.ndarray) -> np.ndarray:
        """Thickness at a distance from the axis [m]."""
        return self.depth * np.maximum(1.0 - (r / self.radius) ** 2, 0.0)

    def frozen_share(self, time: float) -> float:
        """Share of the volume that is frozen at a time [s]."""
        return min(1.0, time / self.end) ** 2
