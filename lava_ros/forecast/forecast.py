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

"""What comes: when lava reaches each cell, and how thick and hot it gets until then."""

from dataclasses import dataclass, replace

import numpy as np

from lava_ros.scene import Terrain

#: What ``Layer.raw_values`` gives for the arrival in cells of which nothing is known [s].
UNKNOWN = -1.0


@dataclass(frozen=True, eq=False)
class Forecast:
    """A look ahead from one moment of a simulation, on the cells of its terrain.

    Attributes:
        time: Simulated time at its start [s].
        horizon: How far ahead it looks [s].
        threshold: Thickness from which on lava has arrived [m].
        terrain: The ground, which the arrays belong to.
        arrival: Simulated time from the start until lava is that thick [s], float32, shape [rows,
            columns]; 0 where it was at the start, NaN where it will not be within the horizon.
        thickness: Largest thickness within the horizon [m], float32, same shape; 0 where there
            is no lava, NaN where nothing is known: outside the terrain, and after a withdrawal.
        temperature: Highest depth-averaged temperature within the horizon [K], float32, same
            shape; NaN without lava.
        duration: Wall time it took [s].
        particle_count: Particles at its end.
    """

    time: float
    horizon: float
    threshold: float
    terrain: Terrain
    arrival: np.ndarray
    thickness: np.ndarray
    temperature: np.ndarray
    duration: float
    particle_count: int

    def withdrawn(self) -> 'Forecast':
        """The same forecast, in which nothing is known of any cell."""
        unknown = np.full(self.arrival.shape, np.nan, dtype=np.float32)
        return replace(self, arrival=unknown, thickness=unknown, temperature=unknown)
