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

"""What a simulation shows of itself: plain numpy data, free of device arrays."""

from collections.abc import Callable
from dataclasses import dataclass
import math

import numpy as np

from lava_ros.scene import Terrain
from lava_ros.simulation.budget import VolumeBudget


@dataclass(frozen=True)
class StepReport:
    """How the simulation has been stepping.

    Attributes:
        count: Time steps taken since the start.
        evaluations: Velocity evaluations taken: the sum of the steps' stages.
        stages: Stages of the latest step.
        length: Length of the latest full step [s].
        limit: What bounded that step: ``diffusion``, ``advection`` or ``longest``.
    """

    count: int
    evaluations: int
    stages: int
    length: float
    limit: str


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The state of the flow at one moment, on the cells of its terrain.

    Attributes:
        time: Simulated time [s].
        terrain: The ground before the eruption, which the arrays belong to.
        thickness: Thickness of all lava on it, fluid and frozen [m], float32, shape [rows,
            columns], 0 where there is none and NaN where the terrain has no data.
        temperature: Depth-averaged temperature of the fluid lava [K], float32, same shape; the
            solidus, which it is no hotter than, where all has frozen; NaN where there is no lava.
        budget: The volume budget.
        particle_count: Particles on the terrain.
        steps: The time stepping so far.
        frozen: The frozen part of ``thickness`` [m], float32, same shape; None without
            solidification.
        arrived: Time at which lava from ``COVERED`` on came to a cell, to a step [s], float32,
            same shape, NaN where it has not come; None where that is not noted.
    """

    time: float
    terrain: Terrain
    thickness: np.ndarray
    temperature: np.ndarray
    budget: VolumeBudget
    particle_count: int
    steps: StepReport
    frozen: np.ndarray | None = None
    arrived: np.ndarray | None = None

    def flaw(self) -> str:
        """Say what makes this snapshot unfit to be shown as a map; empty when nothing does."""
        budget = self.budget
        numbers = (self.time, budget.emitted, budget.held, budget.left, budget.frozen)
        if not all(math.isfinite(number) for number in numbers):
            return f'time or volume is not a number: time {self.time} s, {budget}'
        is_thickness = np.isfinite(self.thickness) & (self.thickness >= 0.0)
        bad = int((self.terrain.has_data & ~is_thickness).sum())
        if bad:
            return f'thickness is not a number of metres in {bad} cells'
        is_temperature = np.isfinite(self.temperature) & (self.temperature > 0.0)
        bad = int(((self.thickness > 0.0) & ~is_temperature).sum())
        if bad:
            return f'temperature is not a number of kelvin in {bad} cells with lava'
        return ''


class PendingSnapshot:
    """A snapshot of a moment that has passed, on its way from the device."""

    def __init__(self, finish: Callable[[], Snapshot]) -> None:
        """Take what waits for it and makes it, called once."""
        self._finish: Callable[[], Snapshot] | None = finish
        self._snapshot: Snapshot | None = None

    def result(self) -> Snapshot:
        """Wait for it; in any thread, but in one of them only."""
        if self._finish is not None:
            self._snapshot = self._finish()
            self._finish = None
        assert self._snapshot is not None
        return self._snapshot
