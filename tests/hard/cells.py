# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Hard scenes with lava on cells: the required steps, and the differences from particles.

Scenes run without the effects that cells lack, as for a user who chooses cells without forcing
effects. A scene has one particle spacing for both methods, and cells the nearest size: two
terrain cells along a side at `draft`, one at `standard`, half of one at `reference`. The columns
of the cells take the place of particles in the invariants, except in these:

climb      Without the tolerance for heights that a sum over neighbours does not resolve.
fall       Does not apply: lava on cells has no bound of free fall (docs/MODEL.md).
cost       A frame has ``CUTS`` evaluations more than its lava requires, not those of emitted
           particles. ``HardScene.most_steps`` does not apply: it is for noise in the speeds of
           particles.
rest       The thickness of each cell, in addition to which cells have lava.
distinct   Always true.
halving    Steps of at most half their mean length in the same frame, because no setting scales
           them. The footprint is that of lava as thick as the threshold: in front of a flow there
           is a film, down to 1e-24 m. Its border has cells of the solver.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from lava_ros.effects import EFFECTS, Effects
from lava_ros.simulation import Simulation
from lava_ros.simulation.cells.flow import MAX_STAGES, most_displaced
from lava_ros.simulation.cells.state import RATE
from lava_ros.simulation.step.stage import longest_step

#: Largest ratio of the fall of the surface to the thickness that still shortens the steps.
STEEPEST = 10.0

#: Evaluations of a frame in addition: its end divides a step, and steps grow again by half each.
CUTS = 30.0

def without_missing(effects: Effects) -> Effects:
    """Return effects without those that cells lack."""
    return replace(effects, **{name: False for name in EFFECTS if EFFECTS[name].needs_particles})


def take_single_steps(solver: Any) -> None:
    """Make each launch of a solver take one step, so that all steps can be observed."""
    solver._take_steps = partial(solver._launch, solver.clock, 1)


def limit_steps(simulation: Simulation, longest: float) -> None:
    """Make the next steps of a simulation no longer than a time [s]."""
    solver: Any = simulation.solver
    # new arguments of the kernels come with a limit of their own
    solver._set(simulation.time)
    solver._longest_step = longest


def pace(simulation: Simulation) -> float:
    """Return the evaluations per second that the current lava requires, with maximum steps.

    A step has the smallest odd number s of stages with 0.9 (s^2 + s - 2) / 4 >= r dt, r twice the
    largest decay rate of a wave of two cells, more where the ground falls by more than the
    thickness. Lava whose speed is not proportional to the slope has the r of its latest step.
    """
    solver: Any = simulation.solver
    state, cell = solver.state, solver.grid.resolution
    longest = longest_step(simulation.scene, simulation.accuracy, simulation.effects, cell)
    longest = min(longest, solver.heat.longest_step(cell))
    thickness, film = state.thickness.numpy(), state.film
    thickest, source = float(thickness.max()), float(state.source.numpy().max())
    if source > 0.0:
        longest = min(longest, (0.5 * thickest + 1e3 * film) / source)
    if thickest <= film:
        return 3.0 / longest
    ground = solver.heat.elevation.numpy() + solver.heat.frozen.numpy()
    lava = np.where(thickness > film, thickness, 0.0)
    fluid = lava * state.fluidity.numpy()
    stiffness = fastest = 0.0
    for axis, passed in ((1, state.first_x), (0, state.first_y)):
        (a, b), (low, high), (one, other) = (
            (np.delete(array, -1, axis), np.delete(array, 0, axis))
            for array in (lava, ground, fluid)
        )
        total, thick = a + b, np.maximum(np.maximum(a, b), film)
        fall = a - b + low - high
        mobility = state.weight / (12.0 * cell**2) * (one + other) / (total + 1e-30)
        down = np.maximum(fall * a, -fall * b) / thick**2
        rate = mobility * total * (a * a + b * b) * np.maximum(down, 1.0)
        stiffness = max(stiffness, 4.0 * float(rate.max()))
        part = 2.0 / (total + 1e3 * film)
        speed = np.abs(np.delete(passed.numpy(), -1, axis)) * part
        fastest = max(
            fastest, float((speed * (1.0 + np.minimum(part * np.abs(fall), STEEPEST))).max())
        )
    if simulation.effects.having('speed'):
        stiffness = float(state.peaks.numpy()[RATE])
    most = most_displaced(simulation.effects, is_heated=solver._is_heated)
    stages = np.arange(3, MAX_STAGES + 1, 2)
    stable = 0.9 * 0.25 * (stages**2 + stages - 2.0)
    step = min(longest, most / max(fastest, 1e-300), stable[-1] / max(stiffness, 1e-300))
    fewest = min(int(np.searchsorted(stable, step * stiffness)), len(stages) - 1)
    return float(stages[fewest]) / step
