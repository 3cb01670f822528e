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

"""Runs of a scene that are timed and looked at on their way."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
import time as wall_clock

import numpy as np

from lava_ros.effects import Effects
from lava_ros.scene import Scene
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy, COVERED
from lava_ros.simulation.presets import PRESETS
from lava_ros.simulation.resolution import resolution_of

#: Times at which pilots are compared.
MARKS = 10


@dataclass(frozen=True, eq=False)
class Pilot:
    """A coarse run.

    Attributes:
        refinement: Its refinement.
        wall_time: Wall time to the horizon [s], extrapolated (``completed``) where it was stopped.
        evaluations: Velocity evaluations, likewise.
        effects: Its physics.
        covered: Cells with lava at the ends of ``MARKS`` equal parts of the horizon, as far as it
            came, bool, shape [marks, rows, columns].
        spent: Wall time that it took [s].
        setup: Part of the wall time before the first step [s].
        progress: Simulated time as a share of the horizon, wall time after the setup [s],
            evaluations and particles, as they grew, shape [n, 4].
    """

    refinement: float
    wall_time: float
    evaluations: float
    effects: Effects
    covered: np.ndarray
    spent: float
    setup: float
    progress: np.ndarray

    @property
    def is_done(self) -> bool:
        """Whether it came to the horizon."""
        return len(self.covered) == MARKS


def run_at(
    scene: Scene,
    refinement: float,
    horizon: float,
    *,
    device: str | None,
    wall_limit: float,
    effects: Effects | Mapping[str, bool] | None = None,
    clock: Callable[[], float] = wall_clock.monotonic,
) -> Pilot:
    """Run a scene to ``horizon`` [s], or for ``wall_limit`` [s] of wall time if that is less.

    Kernels are compiled before the clock starts. Looks at the flow before the end count as time
    spent only. ``effects`` are the physics, or a mapping that switches some effects.
    """
    accuracy = accuracy_at(scene, refinement, horizon)
    warm = Simulation(scene, accuracy=accuracy, device=device, effects=effects)
    warm.advance(1e-3)
    warm.snapshot()
    begun = clock()
    simulation = Simulation(scene, accuracy=accuracy, device=device, effects=effects)
    setup = clock() - begun
    progress, covered = [(0.0, 0.0, 0, 0)], []
    parts, looked, taken = 0, 0.0, 0.0
    for mark in range(1, MARKS + 1):
        until = horizon * mark / MARKS
        for _ in simulation.advancing(until):
            parts += 1
            taken = clock() - begun - setup - looked
            # some hundred rows, whatever the number of parts
            if taken > 1.02 * progress[-1][1]:
                share = simulation.time / horizon
                progress.append((share, taken, parts, simulation.particle_count))
            if taken > wall_limit:
                # finish the step at hand
                simulation.advance(simulation.time)
                break
        before = clock()
        progress.append((simulation.time / horizon, taken, parts, simulation.particle_count))
        snapshot = simulation.snapshot()
        if simulation.time < until:
            break
        covered.append(snapshot.thickness >= COVERED)
        if mark < MARKS:
            # only the last one is part of the run
            looked += clock() - before
    wall_time = clock() - begun - looked
    return Pilot(
        refinement,
        wall_time,
        snapshot.steps.evaluations,
        simulation.effects,
        np.array(covered, dtype=bool).reshape(-1, *scene.terrain.shape),
        wall_time + looked,
        setup,
        np.array(progress),
    )


def accuracy_at(scene: Scene, refinement: float, horizon: float) -> Accuracy:
    """The accuracy of the presets at a refinement between theirs, for a horizon [s]."""
    accuracy = PRESETS[preset_below(refinement)].accuracy
    return replace(accuracy, spacing=spacing_at(scene, refinement, horizon))


def spacing_at(scene: Scene, refinement: float, horizon: float) -> float:
    """The spacing [m] of a refinement, for a horizon [s]."""
    between = replace(PRESETS[preset_below(refinement)].accuracy, refinement=refinement)
    return resolution_of(scene, between, horizon=horizon).spacing


def preset_below(refinement: float) -> str:
    """The finest preset that is no finer, ``draft`` below all."""
    names = ['draft', 'standard', 'fine']
    below = [name for name in names if PRESETS[name].accuracy.refinement <= refinement * 1.001]
    return below[-1] if below else names[0]
