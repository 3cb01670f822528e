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

"""The scales of a scene, from which the numbers are made that decide about effects."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from lava_ros.scene import Lava, Scene

#: Share of the way to the solidus, cooled through up to the horizon, above which lava may freeze:
#: what is thinner than expected is colder.
FREEZES = 0.9


@dataclass(frozen=True)
class Scales:
    """The scales of a scene.

    Attributes:
        scene: The scene.
        temperature: Temperature of the hottest vent, or the material's reference [K].
        end_temperature: What a column of the expected thickness has cooled to at the horizon [K].
        thickness: Expected thickness h [m].
        viscosity: Viscosity at ``temperature`` [Pa s].
        slope: Typical slope of the flow's surface, rise over run: that of the terrain, or the
            flow's thickness over its reach where that is more.
        steepest: Largest slope of the terrain.
        relief: Highest less lowest elevation [m].
        speed: Depth-averaged speed of a sheet of that thickness on that slope [m/s].
        width: Width of the flow [m], NaN without a discharge.
        kernel_radius: Radius of the smoothing kernel l [m].
        spacing: Distance of particles [m].
        horizon: How far ahead is looked [s].
    """

    scene: Scene
    temperature: float
    end_temperature: float
    thickness: float
    viscosity: float
    slope: float
    steepest: float
    relief: float
    speed: float
    width: float
    kernel_radius: float
    spacing: float
    horizon: float

    @property
    def lava(self) -> Lava:
        """The material."""
        return self.scene.lava

    @property
    def warmth(self) -> float:
        """Temperature above that of the air [K], at least 1 K: lava without vents may be cold."""
        return max(self.temperature - self.scene.ambient_temperature, 1.0)

    @property
    def lateral(self) -> float:
        """Thickness over half of the flow's width, at the viscosity between vent and horizon.

        Half of the width is the shortest wave of a flow; where the kernel is wider, or there is no
        discharge, it is the kernel's radius.
        """
        end = self.lava.viscosity_at(max(self.end_temperature, self.lava.solidus))
        # lava a thousand times as stiff has all but stopped
        ratio = min(end / self.viscosity, 1e3)
        # the expected thickness is as mu^(1/4), and the geometric mean the root of a product
        half = np.fmax(0.5 * self.width, self.kernel_radius)
        return float(self.thickness * ratio**0.125 / half)

    @property
    def freezing(self) -> float:
        """How far towards the solidus a column cools up to the horizon."""
        above = max(self.temperature - self.lava.solidus, 1.0)
        return (self.temperature - self.end_temperature) / above

    @property
    def heat_lost(self) -> float:
        """What the share of its heat matters that a column loses up to the horizon."""
        return self.matters((self.temperature - self.end_temperature) / self.warmth)

    def matters(self, share: float) -> float:
        """What a share of a column's heat matters: itself, or its part in the speed.

        1 % of the number is 1 % of the temperature, or 3 % of the viscosity and of the speed.
        """
        change = share * self.warmth
        colder = max(self.temperature - change, self.scene.ambient_temperature)
        ratio = self.lava.viscosity_at(colder) / self.viscosity
        return max(share, abs(math.log(ratio)) / 3.0)
