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

"""Hot silicone oil that spreads and cools on a plate: Garel et al. 2012, experiment C14.

Garel, Kaminski, Tait & Limare 2012 (J. Geophys. Res. 117), the third benchmark (BM3) of
Cordonnier, Lev & Garel 2015. The constants are those of the public case of
interThermalRadConvFoam (github.com/BiElisa/interThermalRadConvFoam, run/BM3), which took them from
the article. What the experiment measured was not at hand: this compares with the exact solution of
the balance that the paper is about, advection against the loss of the surface, for an isoviscous
current of one temperature to a column. The loss to the plate is left out.
"""

from dataclasses import replace
import math

import numpy as np

from lava_ros.scene import Lava, Scene, Vent
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification import exact
from lava_ros.verification.cases.case import Case, FLAT, GRAVITY, Measurement, plane, Run, Trial

#: What comes out [m3/s], through a hole of a radius [m] (2 to 4 mm).
DISCHARGE, HOLE = 2.2e-8, 0.003

#: Kinematic viscosity [m2/s], density [kg/m3] and specific heat [J/(kg K)].
VISCOSITY, DENSITY, SPECIFIC_HEAT = 3.56e-3, 954.0, 1500.0

#: Temperatures of the oil as it comes out and of the room [K], and emissivity.
OIL, ROOM, EMISSIVITY = 315.0, 293.0, 0.96

#: Convection by the article: between the first and the last [W/(m2 K)].
CONVECTION = (1.0, 2.0, 3.0)

#: Radiation and convection in the middle of that range over the difference [W/(m2 K)]: radiation
#: falls from 6.1 to 5.5 of it as the oil cools.
LOSS = 5.8 + CONVECTION[1]

#: What stands for oil and room: a vent has no lava as cold. With the loss as the difference, and a
#: viscosity that does not change, the scale of temperatures is free.
HOT, COLD = 700.0, 600.0


def _run_oil(accuracy: Accuracy, device: str) -> Run:
    """Front, heat that the surface loses, and its temperature, as the front goes on."""
    capacity = DENSITY * SPECIFIC_HEAT
    spread = exact.ConstantFluxSpread(DISCHARGE, VISCOSITY, GRAVITY)
    solution = exact.CoolingSpread(spread, loss=LOSS, capacity=capacity)
    thermal = math.sqrt(capacity * DISCHARGE / (math.pi * LOSS))
    half = 3.6 * thermal
    trial = Trial(
        Scene(
            plane((-half, -half, half, half), 0.005),
            vents=(Vent((0.0, 0.0), DISCHARGE, radius=HOLE, temperature=HOT),),
            lava=Lava(
                density=DENSITY,
                viscosity=VISCOSITY * DENSITY,
                arrhenius=0.0,
                specific_heat=SPECIFIC_HEAT,
                emissivity=0.0,
                convection=LOSS,
            ),
            ambient_temperature=COLD,
        ),
        accuracy,
        device,
        effects=replace(FLAT, cooling=True),
        spacing=0.0035 / accuracy.refinement,
        thickness=2e-3,
    )
    measured = []
    for radius in (1.0, 2.0, 3.0):
        time = (radius * thermal / spread.coefficient) ** 2
        trial.advance(time)
        sample = trial.simulation.sample()
        difference = (sample.temperature - COLD) / (HOT - COLD)
        power = LOSS * difference @ (sample.volume / sample.thickness) / (capacity * DISCHARGE)
        measured.append(
            Measurement(
                f'power at {radius:g} thermal radii', float(power), solution.power(time), '1'
            )
        )
    distance = np.hypot(*sample.position.T)
    for share in (0.5, 1.0, 1.5):
        ring = np.abs(distance / thermal - share) < 0.1
        expected = solution.difference(distance[ring], time)
        measured.append(
            Measurement(
                f'temperature at {share:g} thermal radii',
                float(difference[ring].mean()),
                float(expected.mean()),
                '1',
                scale=1.0,
            )
        )
    least = 0.5e-3
    front = trial.field((-half, -half, half, half)).mean_radius(least, half)
    measured.append(Measurement('front', front, spread.radius_of_thickness(least, time), 'm'))
    return trial.run(*measured)


CASES = (
    Case(
        'silicone_oil',
        'hot silicone oil that spreads and cools on a plate',
        'heat balance, constants of Garel et al. 2012',
        _run_oil,
    ),
)
