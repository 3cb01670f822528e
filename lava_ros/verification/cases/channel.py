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

"""A channel with walls: what lateral stress does to the mean velocity."""

from dataclasses import replace
import math

import numpy as np

from lava_ros.accuracy import Accuracy
from lava_ros.scene import Scene, Terrain
from lava_ros.simulation import Particles
from lava_ros.verification import exact
from lava_ros.verification.cases.case import (
    Case,
    FLAT,
    GRAVITY,
    ISOTHERMAL,
    joined,
    Measurement,
    Run,
    Trial,
)

#: Widths of the channel over the thickness, and particles across half of it, for the solve.
WIDTHS = {1.0: 10, 2.5: 15, 5.0: 15}

#: The same for the Green's function, and its support over 1 / k.
GREEN_WIDTH, GREEN_PARTICLES, GREEN_SUPPORT = 6.0, 10, 6.0

#: Slope of the channel's floor.
SLOPE = 0.01

#: Length of the channel, and of its middle where the velocity is read, over the thickness.
LENGTH, MIDDLE = 12.0, 2.0


def channel_velocity(
    width: float, *, effect: str, accuracy: Accuracy, device: str = 'cpu'
) -> tuple[Trial, Measurement]:
    """Mean over local velocity in a channel of lava 1 m thick.

    The channel lies between mirrored ones whose slope is the opposite: the flow is odd about the
    walls, so it vanishes there, as on a wall without slip.

    Args:
        width: Width of the channel [m], an even multiple of the spacing: no particle is on a wall.
        effect: ``green`` or ``helmholtz``.
        accuracy: Resolution, the spacing included.
        device: Warp device.
    """
    spacing = accuracy.spacing
    assert spacing is not None
    across, cell = 4.0 * width, min(0.1, 0.5 * spacing)
    rows, columns = round(1.4 * across / cell), round(1.4 * LENGTH / cell)
    y = (np.arange(rows) + 0.5 - 0.5 * rows) * cell
    x = (np.arange(columns) + 0.5 - 0.5 * columns) * cell
    sign = np.where(np.floor(y / width + 0.5) % 2 == 0, 1.0, -1.0)
    terrain = Terrain(
        -SLOPE * np.outer(sign, x), cell, origin=(-0.5 * columns * cell, -0.5 * rows * cell)
    )
    ticks = [
        (np.arange(round(side / spacing)) + 0.5) * spacing - 0.5 * side
        for side in (LENGTH, across)
    ]
    places = np.stack(np.meshgrid(*ticks), axis=-1).reshape(-1, 2)
    trial = Trial(
        Scene(terrain, lava=ISOTHERMAL, gravity=GRAVITY),
        effects=replace(FLAT, **{effect: True}),
        accuracy=replace(accuracy, thickness=1.0),
        particles=Particles(places, spacing**2, 1400.0),
        device=device,
    )
    sample = trial.simulation.sample()
    inside = np.abs(sample.position) < (0.5 * MIDDLE, 0.5 * width)
    local = exact.sheet_velocity(
        1.0,
        math.asin(SLOPE),
        density=ISOTHERMAL.density,
        viscosity=ISOTHERMAL.viscosity,
        gravity=GRAVITY,
    )
    return trial, Measurement(
        f'{effect} W/h {width:g}',
        float(sample.velocity[inside.all(axis=1), 0].mean()) / local,
        exact.channel_mean_velocity(width, 1.0),
        '1',
    )


def _run(accuracy: Accuracy, device: str) -> Run:
    """The solve in three channels, and the Green's function in a wide one.

    The model's own limit is that it averages over the depth: full Stokes flow has means of 0.172,
    0.515, 0.748 and 0.937 at W/h 1, 2.5, 5 and 20 where this equation has 0.192, 0.550, 0.769 and
    0.942.
    """
    runs = []
    for width, count in WIDTHS.items():
        trial, measurement = channel_velocity(
            width,
            effect='helmholtz',
            accuracy=replace(accuracy, spacing=_spacing(width, count * accuracy.refinement)),
            device=device,
        )
        runs.append(trial.run('channel', measurement))
    # the support is the kernel's radius: with it given, finer is more neighbours, up to a limit
    spacing = _spacing(GREEN_WIDTH, GREEN_PARTICLES * min(1.0, accuracy.refinement))
    ratio = GREEN_SUPPORT / math.sqrt(3.0) / spacing
    trial, measurement = channel_velocity(
        GREEN_WIDTH,
        effect='green',
        # differences would smooth the jump of the slope at a wall over the whole support
        accuracy=replace(accuracy, spacing=spacing, ratio=ratio, gradient='energy'),
        device=device,
    )
    return joined('channel', [*runs, trial.run('channel', measurement)])


def _spacing(width: float, across_half: float) -> float:
    return 0.5 * width / max(2, round(across_half))


CASES = (Case('channel', 'lateral stress in a channel with walls', 'Kedadry 2023', _run),)
