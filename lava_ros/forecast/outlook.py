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

"""How likely lava comes: what an ensemble says from one moment of a simulation on."""

from dataclasses import dataclass, replace

import numpy as np

from lava_ros.forecast.forecast import Forecast
from lava_ros.forecast.probability import HazardMaps
from lava_ros.scene import Terrain


@dataclass(frozen=True, eq=False)
class Outlook:
    """An ensemble that went on from one moment, on the cells of its terrain.

    Attributes:
        time: Simulated time at its start [s].
        horizon: How far ahead it looks [s].
        threshold: Thickness from which on lava has arrived [m].
        terrain: The ground, which the maps belong to.
        maps: Probability, arrival times and thickness.
        asked: Members that were asked for; ``maps.members`` are in it.
        is_done: Whether no more are to come.
        outlines: Outlines that the members have been weighed by.
        duration: Wall time from the fork until the maps were there [s].
    """

    time: float
    horizon: float
    threshold: float
    terrain: Terrain
    maps: HazardMaps
    asked: int
    is_done: bool
    outlines: int
    duration: float

    def forecast(self, share: float) -> Forecast:
        """What a forecast would say: arrival by a share of the members, mean thickness.

        Args:
            share: One of ``lava_ros.forecast.probability.QUANTILES``.
        """
        thickness = self.maps.thickness
        return Forecast(
            time=self.time,
            horizon=self.horizon,
            threshold=self.threshold,
            terrain=self.terrain,
            arrival=self.maps.arrival[share],
            thickness=thickness,
            temperature=np.full_like(thickness, np.nan),
            duration=self.duration,
            particle_count=0,
        )

    def withdrawn(self) -> 'Outlook':
        """The same, in which nothing is known of any cell."""
        unknown = np.full_like(self.maps.thickness, np.nan)
        maps = replace(
            self.maps,
            probability=unknown,
            arrival=dict.fromkeys(self.maps.arrival, unknown),
            thickness=unknown,
        )
        return replace(self, maps=maps)
