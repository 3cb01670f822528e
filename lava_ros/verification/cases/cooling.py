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

"""Cases of lava that stiffens as it cools on its way down a slope of 6 degrees."""

from dataclasses import replace
import math

import numpy as np

from lava_ros.effects import Effects
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification import exact
from lava_ros.verification.cases import case
from lava_ros.verification.cases.case import FLAT, FRONT, GRAVITY, SLOPING

#: Its viscosity is 20 times as large after 100 K.
STIFFENING = Lava(
    density=2600.0, viscosity=1e4, specific_heat=1150.0, arrhenius=0.03, emissivity=0.9,
    convection=50.0, reference_temperature=1360.0,
)

#: The same with a strength of three tenths of the stress at its base, and more as it cools.
STRONG = replace(STIFFENING, yield_strength=700.0, yield_rate=0.01)

#: Temperatures of vents and of the air [K], and the slope [rad].
HOT, COLD, SLOPE = 1360.0, 300.0, math.radians(6.0)

#: Flux of the sheets [m2/s], width between the walls that hold them and length [m].
FLUX, WIDTH, LENGTH = 0.1, 36.0, 100.0

#: Half of the length along the slope over which lava comes out [m].
REACH = 2.5

#: Discharge of the point source [m3/s], its radius [m], and when its flow is looked at [s].
DISCHARGE, RADIUS, END = 5.0, 10.0, 7200.0

#: Smallest x, smallest y, largest x, largest y of that flow's ground [m].
WINDOW = (-60.0, -90.0, 420.0, 90.0)


def _channel(
    lava: Lava, effects: Effects, length: float, accuracy: Accuracy, device: str
) -> case.Trial:
    """A fissure across a channel that goes down the slope to the border, between steep walls."""
    cell = 1.0
    window = (-3.0 * REACH, -0.5 * WIDTH - 6.0, length, 0.5 * WIDTH + 6.0)
    ground = case.plane(window, cell, SLOPE)
    x, y = (
        origin + (np.arange(count) + 0.5) * cell
        for origin, count in zip(ground.origin, ground.shape[::-1], strict=True)
    )
    # above the fissure a wall too: what lies there would cool and flow back
    walls = np.maximum(-REACH - x, 0.0) + np.maximum(np.abs(y) - 0.5 * WIDTH, 0.0)[:, None]
    ground = Terrain(ground.elevation + 2.0 * walls, cell, origin=ground.origin)
    half = 0.5 * WIDTH - REACH
    vent = Vent((0.0, -half), FLUX * WIDTH, radius=REACH, end=(0.0, half), temperature=HOT)
    return case.Trial(
        Scene(ground, (vent,), lava, ambient_temperature=COLD), accuracy, device,
        effects=effects, spacing=1.5 / accuracy.refinement, thickness=1.5,
    )


def _run_sheet(accuracy: Accuracy, device: str) -> case.Run:
    """Thickness and temperature along the sheet, long after the front has left the map."""
    runs = []
    for name, lava in (('Newtonian', STIFFENING), ('Bingham', STRONG)):
        solution = exact.CoolingSheet(
            lava, flux=FLUX, slope=SLOPE, length=LENGTH + REACH, initial=HOT, ambient=COLD,
            gravity=GRAVITY,
        )
        effects = replace(
            SLOPING, arrhenius=True, cooling=True, yielding=lava.yield_strength > 0.0
        )
        trial = _channel(lava, effects, LENGTH, accuracy, device)
        trial.advance(6000.0)
        first, last = 10.0, 0.8 * LENGTH
        half = 0.5 * WIDTH - 6.0
        grid = trial.field((first, -half, last, half))
        right = solution.thickness(grid.x + REACH)
        trial.compare_mean(grid.along_x(half), right, f'thickness, {name}')
        sample = trial.sample()
        x, y = sample.position.T
        here = (x > first) & (x < last) & (np.abs(y) < half)
        expected = solution.temperature(x[here] + REACH)
        apart = np.abs(sample.temperature[here] - expected).mean()
        cooled = HOT - float(solution.temperature(np.array(last)))
        trial.compare(f'temperature, {name}', apart, 0.0, 'K', scale=cooled)
        runs.append(trial.run())
    return case.joined(runs)


CASES = (
    case.Case('cooling_sheet', 'steady sheet that stiffens as it cools', 'heat balance',
              _run_sheet),
)
