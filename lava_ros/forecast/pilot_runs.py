# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Pilot runs: coarse runs of a scene, from which the time and error of a finer run are predicted.

The time of a run is s + E (a + b r^k): E evaluations, each with a constant part and one that is
proportional to the number of particles, r^2 for a refinement r; with the iterations of the lateral
stress, k is 3 instead of 2. E grows as a power of r, fitted to the last pilots.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
import math
import time as wall_clock

import numpy as np

from lava_ros.effects import EFFECTS, Effects
from lava_ros.runs.drive import drive
from lava_ros.scene import Scene
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.carriers import METHODS
from lava_ros.simulation.numerical_error import Areas
from lava_ros.simulation.presets import PRESETS
from lava_ros.simulation.resolution import Resolution, resolution_of

#: Work of building a run and taking its snapshot, as a time on one core of a CPU [s]. Unlike
#: measured times, work is the same in every repetition.
SETUP_WORK = 8e-3

#: Work of an evaluation, and of a particle or a cell in it [s], by method.
WORK = {'particles': (18e-6, 1e-7), 'cells': (9e-6, 6e-9)}

#: Minimum ratio of two refinements for fitting the growth of evaluations, and minimum growth: in
#: fine runs a step is limited by the displacement of particles, or has more stages.
APART, MIN_GROWTH = 1.15, 1.0


@dataclass(frozen=True, eq=False)
class Pilot:
    """A coarse run to the horizon.

    Attributes:
        refinement: Its refinement.
        spacing: Its particle spacing [m].
        wall_time: Wall time [s].
        setup: Part of the wall time before the first step [s].
        evaluations: Number of velocity evaluations.
        particles: Largest number of particles, or of cells with lava.
        effects: Its physics.
        areas: Its areas at the horizon.
        method: Carriers of the lava.
    """

    refinement: float
    spacing: float
    wall_time: float
    setup: float
    evaluations: int
    particles: int
    effects: Effects
    areas: Areas
    method: str = METHODS[0]

    def timed_by_work(self) -> 'Pilot':
        """Return the pilot with its work in place of its wall times."""
        evaluation, carrier = WORK[self.method]
        each = evaluation + carrier * self.particles
        work = SETUP_WORK + each * self.evaluations
        return replace(self, wall_time=work, setup=SETUP_WORK)


def run_at(
    scene: Scene,
    refinement: float,
    horizon: float,
    *,
    device: str | None,
    accuracy: Accuracy | None = None,
    effects: Effects | None = None,
    wall_limit: float = math.inf,
    clock: Callable[[], float] = wall_clock.monotonic,
) -> Pilot | None:
    """Run a scene to ``horizon`` [s]; None if it takes more than ``wall_limit`` [s].

    ``accuracy`` has the refinement, by default with the settings of a preset (``accuracy_at``),
    and ``effects`` are the physics, by default those that the scene needs. Kernels are compiled at
    their first use: a first call for a short ``horizon`` excludes that from the wall time.
    """
    accuracy = accuracy or accuracy_at(scene, refinement, horizon)
    begun = clock()
    simulation = Simulation(
        scene, accuracy=accuracy, device=device, effects=effects, horizon=horizon
    )
    setup = clock() - begun
    if not drive(simulation, horizon, is_over=lambda: clock() - begun > wall_limit):
        return None
    snapshot = simulation.snapshot()
    assert accuracy.spacing is not None
    return Pilot(
        refinement, accuracy.spacing, clock() - begun, setup, snapshot.steps.evaluations,
        simulation.most_particles, simulation.effects, Areas.of(snapshot), accuracy.method,
    )


def accuracy_at(scene: Scene, refinement: float, horizon: float) -> Accuracy:
    """Return the accuracy of the preset below a refinement with its spacing (``spacing_at``)."""
    accuracy = PRESETS[preset_below(refinement)].accuracy
    return replace(accuracy, spacing=spacing_at(scene, refinement, horizon))


def cells_at(scene: Scene, refinement: float) -> Accuracy:
    """Return the accuracy of cells smaller than those of the terrain by a refinement."""
    accuracy = PRESETS[preset_below(refinement)].accuracy
    return replace(accuracy, method='cells', spacing=scene.terrain.resolution / refinement)


def spacing_at(scene: Scene, refinement: float, horizon: float) -> float:
    """Return the particle spacing [m]: the spacing of ``standard`` for a horizon [s], refined."""
    return standard_resolution(scene, horizon).spacing / refinement


def standard_resolution(scene: Scene, horizon: float) -> Resolution:
    """Return the resolution of the preset ``standard`` for a horizon [s]."""
    return resolution_of(scene, PRESETS['standard'].accuracy, horizon=horizon)


def preset_below(refinement: float) -> str:
    """Return the finest preset at or below a refinement, or ``draft`` if there is none."""
    most = 1.001 * refinement
    below = [name for name in ('standard', 'fine') if PRESETS[name].accuracy.refinement <= most]
    return below[-1] if below else 'draft'


def cost_at(
    pilots: Sequence[Pilot], refinement: float, *, min_growth: float = MIN_GROWTH
) -> float:
    """Predict the wall time of a run at a refinement [s].

    ``pilots`` are at least two runs, from the coarsest to the finest; evaluations grow at least
    with the power ``min_growth`` of the refinement.
    """
    if pilots[0].refinement <= refinement <= pilots[-1].refinement:
        known = np.log([(pilot.refinement, pilot.wall_time) for pilot in pilots]).T
        return math.exp(float(np.interp(math.log(refinement), *known)))
    pilots = pilots[-4:]
    nearest = min(pilots, key=lambda pilot: abs(math.log(pilot.refinement / refinement)))
    scale = refinement / nearest.refinement
    power = 2.0 * max((EFFECTS[name].work_power for name in nearest.effects), default=1.0)
    sizes = np.array([run.refinement / nearest.refinement for run in pilots]) ** power
    times = np.array([
        (pilot.wall_time - pilot.setup) / max(pilot.evaluations, 1) for pilot in pilots
    ])
    # a run of twice the duration has half the uncertainty, so four times the weight
    growth = _growth(pilots, min_growth)
    constant, slope = _line(sizes, times, np.sqrt(sizes) / np.maximum(times, 1e-12))
    each = (constant + slope * scale**power) / (constant + slope)
    return nearest.setup + (nearest.wall_time - nearest.setup) * scale ** growth * each


def _growth(pilots: Sequence[Pilot], least: float) -> float:
    """Return the exponent with which the number of evaluations grows with the refinement."""
    last = pilots[-1]
    # runs of similar refinement show mostly scatter
    far = [pilot for pilot in pilots[:-1] if pilot.refinement * APART < last.refinement]
    if not far:
        return least
    more = max(last.evaluations, 1) / max(far[-1].evaluations, 1)
    growth = math.log(more) / math.log(last.refinement / far[-1].refinement)
    return min(max(growth, least), 2.0)


def _line(sizes: np.ndarray, times: np.ndarray, weights: np.ndarray) -> tuple[float, float]:
    """Fit a line by weighted least squares; return constant and slope, neither negative."""
    rows = np.stack([weights, weights * sizes], axis=1)
    (constant, slope), *_ = np.linalg.lstsq(rows, weights * times, rcond=None)
    if slope < 0.0:
        return float(np.average(times, weights=weights**2)), 0.0
    if constant < 0.0:
        return 0.0, float((weights**2 * sizes * times).sum() / (weights**2 * sizes**2).sum())
    return float(constant), float(slope)
