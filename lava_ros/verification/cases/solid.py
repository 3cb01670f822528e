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

"""Lava that freezes into terrain."""

from dataclasses import replace

import numpy as np

from lava_ros.effects import Effects
from lava_ros.scene import Lava, Scene
from lava_ros.simulation import Particles
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification import exact
from lava_ros.verification.cases.case import (
    Case,
    mean_difference,
    Measurement,
    plane,
    Run,
    square,
    Trial,
)

#: Too stiff to flow, it cools by convection alone.
STIFF = Lava(
    density=2600.0, viscosity=1e9, arrhenius=0.0, emissivity=0.0, convection=25.0, solidus=1300.0
)

#: Temperature of the lava at the start and of the air [K].
FIRST, AMBIENT = 1423.0, 300.0

#: Half the side of the terrain [m].
HALF = 90.0

#: Shares of the time until all is frozen at which the frozen lava is measured.
SHARES = (0.3, 0.6, 0.9)


def _run(accuracy: Accuracy, device: str) -> Run:
    lens = exact.FreezingLens(STIFF, depth=3.0, radius=60.0, first=FIRST, ambient=AMBIENT)
    spacing = 3.0 / accuracy.refinement
    terrain = plane(square(HALF), spacing)
    ticks = np.arange(-HALF, HALF, spacing) + 0.5 * spacing
    places = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    thickness = lens.thickness(np.hypot(*places.T))
    wet = thickness > 0.0
    trial = Trial(
        Scene(terrain, lava=STIFF, ambient_temperature=AMBIENT),
        effects=Effects(arrhenius=False, cooling=True, steep=False, solidification=True),
        accuracy=replace(accuracy, spacing=spacing, thickness=0.5 * lens.depth),
        particles=Particles(places[wet], thickness[wet] * spacing**2, FIRST),
        device=device,
    )
    measured = []
    for share in SHARES:
        trial.advance(share * lens.end)
        budget = trial.simulation.budget()
        measured.append(
            Measurement(
                f'frozen after {share:g} of the time',
                budget.frozen / budget.emitted,
                lens.frozen_share(share * lens.end),
                '',
                scale=1.0,
            )
        )
    trial.advance(1.2 * lens.end)
    snapshot = trial.simulation.snapshot()
    assert snapshot.frozen is not None
    x0, y0 = terrain.origin
    rows, columns = terrain.shape
    x, y = np.meshgrid(
        x0 + (np.arange(columns) + 0.5) * spacing, y0 + (np.arange(rows) + 0.5) * spacing
    )
    solid = lens.thickness(np.hypot(x, y))
    measured.append(
        Measurement('frozen in the end', snapshot.budget.frozen / snapshot.budget.emitted, 1.0, '')
    )
    measured.append(mean_difference(snapshot.frozen, solid, 'deposit'))
    # all has frozen, no particle is left
    return replace(trial.run(*measured), particles=int(wet.sum()))


CASES = (Case('freezing_lens', 'lava at rest that freezes from its rim', 'Newton cooling', _run),)
