# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Pilot runs, from which the cost and the error of a finer run are predicted.

Cost: the wall time of a run is s + E (a + b r^k), in proportion to the run with the nearest
refinement r. The number of evaluations E grows as a power of r, fitted to the last two runs. The
time of an evaluation has a constant part and one proportional to the number of particles, r^2;
with the iterations of the lateral stress, k is 3 instead of 2. Between two runs the time is a
power of r.

A stopped run is extrapolated like a coarser run, with evaluations and particles in proportion. Its
own evaluations, and those of the coarser run with the same physics, give the time of an evaluation
for a number of particles.

Error: the fraction of the cells inundated by either of two runs that only one inundates. An edge
has a bias, C r^-p, and a scatter from the random positions of particles, q C r^-p. Two runs differ
by

    d_ij = C sqrt((r_i^-p - r_j^-p)^2 + q^2 (r_i^-2p + r_j^-2p))

and each from the limit by C r^-p sqrt(1 + q^2). A stopped run is compared at the time when it
stopped; from there to the horizon, differences grow as those of the coarser runs did. A few runs
do not determine p and q, so values on a grid are weighted by likelihood and prior.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
import math
import time as wall_clock
from typing import Any

import numpy as np

from lava_ros.effects import EFFECTS, Effects
from lava_ros.scene import Scene
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.presets import PRESETS
from lava_ros.simulation.resolution import resolution_of

#: Number of times at which pilots are compared.
N_COMPARISON_TIMES = 10

#: Minimum error of a run as a fraction of its inundated area: twice the finest preset's error of
#: the edge in docs/accuracy, because an area is proportional to the square of its radius.
MIN_RELATIVE_ERROR = 0.004

#: Minimum ratios of two refinements for fitting the growth of evaluations and the fall of errors.
APART, WELL_APART = 1.15, 1.3


@dataclass(frozen=True, eq=False)
class Pilot:
    """A coarse run.

    Attributes:
        refinement: Its refinement.
        wall_time: Wall time to the horizon [s], extrapolated (``completed``) for a stopped run.
        evaluations: Number of velocity evaluations, also extrapolated.
        effects: Its physics.
        covered: Cells with lava at the ends of ``N_COMPARISON_TIMES`` equal parts of the horizon,
            up to the end of the run, bool, shape [times, rows, columns].
        spent: Wall time of the run [s].
        setup: Part of the wall time before the first step [s].
        progress: Simulated time as a fraction of the horizon, wall time after the setup [s],
            evaluations and particles over the run, shape [n, 4].
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
        """True if the run reached the horizon."""
        return len(self.covered) == N_COMPARISON_TIMES


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
    """Run a scene to ``horizon`` [s], or for at most ``wall_limit`` [s] of wall time.

    Kernels are compiled before the clock starts. Observations before the end do not shorten time
    steps, and count only as ``spent``. ``effects`` are the physics, or a mapping that switches
    some effects.
    """
    accuracy = accuracy_at(scene, refinement, horizon)
    settings: dict[str, Any] = {
        'accuracy': accuracy, 'device': device, 'effects': effects, 'horizon': horizon,
    }
    warm = Simulation(scene, **settings)
    warm.advance(1e-3)
    warm.snapshot()
    begun = clock()
    simulation = Simulation(scene, **settings)
    setup = clock() - begun
    progress, covered = [(0.0, 0.0, 0, 0)], []
    parts, looked, taken = 0, 0.0, 0.0
    for mark in range(1, N_COMPARISON_TIMES + 1):
        until = horizon * (mark / N_COMPARISON_TIMES)
        for _ in simulation.advancing(until, limit=horizon):
            parts += 1
            taken = clock() - begun - setup - looked
            # a few hundred rows, independent of the number of parts
            if taken > 1.02 * progress[-1][1]:
                share = simulation.time / horizon
                progress.append((share, taken, parts, simulation.particle_count))
            if taken > wall_limit:
                # finish the current step
                simulation.advance(simulation.time)
                break
        before = clock()
        progress.append((simulation.time / horizon, taken, parts, simulation.particle_count))
        snapshot = simulation.snapshot()
        if simulation.time < until:
            break
        covered.append(snapshot.inundated)
        if mark < N_COMPARISON_TIMES:
            # only the last observation is part of the run
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
    """Interpolate the accuracy of the presets at a refinement, for a horizon [s]."""
    accuracy = PRESETS[preset_below(refinement)].accuracy
    return replace(accuracy, spacing=spacing_at(scene, refinement, horizon))


def spacing_at(scene: Scene, refinement: float, horizon: float) -> float:
    """Return the particle spacing [m] of a refinement, for a horizon [s]."""
    between = replace(PRESETS[preset_below(refinement)].accuracy, refinement=refinement)
    return resolution_of(scene, between, horizon=horizon).spacing


def preset_below(refinement: float) -> str:
    """Return the finest preset at or below a refinement, ``draft`` below all."""
    most = 1.001 * refinement
    below = [name for name in ('standard', 'fine') if PRESETS[name].accuracy.refinement <= most]
    return below[-1] if below else 'draft'


def completed(pilot: Pilot, model: Pilot) -> Pilot:
    """Extrapolate a stopped run to the horizon, in proportion to a complete coarser run."""
    share, taken, *_ = pilot.progress[-1]
    shares = model.progress[:, 0]
    at_that = np.array([np.interp(share, shares, column) for column in model.progress.T[2:]])
    scale = pilot.progress[-1, 2:] / np.maximum(at_that, 1.0)
    if pilot.progress[-1, 3] < 1.0:
        # same number of particles per area
        scale[1] = (pilot.refinement / model.refinement) ** 2
    is_later = shares > share
    to_come = np.vstack([at_that, model.progress[is_later, 2:]]) * scale
    runs = [pilot, model] if model.effects == pilot.effects else [pilot]
    sizes, more, times = np.concatenate([_increments(run) for run in runs]).T
    constant, slope = _line(sizes, times / more, more)
    sizes, more, _ = _increments(pilot).T
    expected = float((more * (constant + slope * sizes)).sum())
    # before the first particle, use the speed of the coarser run
    faster = taken / expected if expected > 0.0 else 1.0
    sizes = (0.5 * (to_come[1:, 1] + to_come[:-1, 1])) ** _power(pilot.effects)
    times = faster * np.diff(to_come[:, 0]) * (constant + slope * sizes)
    rest = np.column_stack([shares[is_later], taken + np.cumsum(times), to_come[1:]])
    return replace(
        pilot,
        wall_time=pilot.setup + float(rest[-1, 1]),
        evaluations=pilot.evaluations * float(rest[-1, 2] / pilot.progress[-1, 2]),
        progress=np.concatenate([pilot.progress, rest]),
    )


def _power(effects: Effects) -> float:
    """Return the power of the number of particles in the time of an evaluation."""
    return max((EFFECTS[name].work_power for name in effects), default=1.0)


def _increments(pilot: Pilot) -> np.ndarray:
    """Return (particles to their power, evaluations, wall time [s]) per part, shape [n, 3]."""
    _, times, evaluations, particles = pilot.progress.T
    sizes = (0.5 * (particles[1:] + particles[:-1])) ** _power(pilot.effects)
    parts = np.stack([sizes, np.diff(evaluations), np.diff(times)], axis=1)
    return parts[(parts[:, 1:] > 0.0).all(axis=1)]


def cost_at(pilots: Sequence[Pilot], refinement: float) -> float:
    """Predict the wall time of a run at a refinement [s].

    ``pilots`` are runs with the same physics, from the coarsest to the finest.
    """
    if len(pilots) > 1 and pilots[0].refinement <= refinement <= pilots[-1].refinement:
        known = np.log([(pilot.refinement, pilot.wall_time) for pilot in pilots]).T
        return math.exp(float(np.interp(math.log(refinement), *known)))
    pilots = pilots[-4:]
    nearest = min(pilots, key=lambda pilot: abs(math.log(pilot.refinement / refinement)))
    scale = refinement / nearest.refinement
    power = _power(nearest.effects)
    if len(pilots) == 1:
        # a single run is compared only with its own parts
        sizes, more, times = _increments(nearest).T
        weights = more / np.sqrt(times)
        sizes, times = sizes / max(np.average(sizes, weights=more), 1.0), times / more
    else:
        sizes = np.array([run.refinement / nearest.refinement for run in pilots]) ** (2.0 * power)
        times = np.array([
            (pilot.wall_time - pilot.setup) / max(pilot.evaluations, 1.0) for pilot in pilots
        ])
        # a run of twice the duration has half the uncertainty, so four times the weight
        weights = np.sqrt(sizes) / np.maximum(times, 1e-12)
    constant, slope = _line(sizes, times, weights)
    each = (constant + slope * scale ** (2.0 * power)) / (constant + slope)
    return nearest.setup + (nearest.wall_time - nearest.setup) * scale ** _growth(pilots) * each


def _growth(pilots: Sequence[Pilot]) -> float:
    """Return the power of the refinement with which evaluations grow."""
    last = pilots[-1]
    # runs of similar refinement show mostly scatter
    far = [pilot for pilot in pilots[:-1] if pilot.refinement * APART < last.refinement]
    before = far[-1] if far else pilots[0]
    if before.refinement == last.refinement:
        return 1.0
    more = max(last.evaluations, 1.0) / max(before.evaluations, 1.0)
    growth = math.log(more) / math.log(last.refinement / before.refinement)
    return min(max(growth, 0.0), 2.0)


def _line(sizes: np.ndarray, times: np.ndarray, weights: np.ndarray) -> tuple[float, float]:
    """Fit a line by weighted least squares; return constant and slope, neither negative."""
    rows = np.stack([weights, weights * sizes], axis=1)
    (constant, slope), *_ = np.linalg.lstsq(rows, weights * times, rcond=None)
    if slope < 0.0:
        return float(np.average(times, weights=weights**2)), 0.0
    if constant < 0.0:
        # before a vent opens there are no particles, and a size is 0
        return 0.0, float((weights**2 * sizes * times).sum() / (weights**2 * sizes**2).sum())
    return float(constant), float(slope)


def error_law(pilots: Sequence[Pilot]) -> Callable[[float], float]:
    """Fit laws C r^-p to the finest pilots, at least two of which reached the horizon.

    Returns:
        Function from a refinement to the wrong fraction of the inundated area, from
        ``MIN_RELATIVE_ERROR`` to 1: the geometric mean of the laws.
    """
    done = _well_separated([pilot for pilot in pilots if pilot.is_done])[-4:]
    begun = _well_separated([
        pilot for pilot in pilots if not pilot.is_done and len(pilot.covered)
        and pilot.refinement > WELL_APART * done[-1].refinement
    ])[-2:]
    # ratios of the differences to those at the horizon
    growth = np.mean([_differences(one, other) for one, other in combinations(done, 2)], axis=0)
    growth -= growth[-1]
    pairs = list(combinations([*done, *begun], 2))
    ones, others = np.array([(one.refinement, other.refinement) for one, other in pairs]).T
    seen = [_differences(one, other) for one, other in pairs]
    differences = np.array([item[-1] - growth[len(item) - 1] for item in seen])
    laws = []
    # powers p with prior weights: docs/accuracy has 1 on slopes, and more where coarse runs hardly
    # resolve the terrain or the thickness; ratios q of scatter to bias
    orders = {0.6: 1.0, 0.8: 1.0, 1.0: 1.0, 1.25: 1.0, 1.5: 1.0, 1.8: 0.5}
    for (order, usual), scatter in product(orders.items(), (0.0, 0.3, 0.6, 1.0, 2.0)):
        x, y = ones**-order, others**-order
        law = np.sqrt((x - y) ** 2 + scatter**2 * (x**2 + y**2))
        logarithm = differences - np.log(law)
        constant = float(logarithm.mean())
        # the logarithm of a difference between runs deviates from the law by 0.3
        misfit = float(((logarithm - constant) ** 2).sum()) / (2.0 * 0.3**2)
        size = math.exp(constant) * math.hypot(1.0, scatter)
        laws.append((usual * math.exp(-misfit), size, order))
    weights, sizes, powers = np.array(laws).T
    weights /= weights.sum()

    def error(refinement: float) -> float:
        logarithms = np.log(sizes) - powers * math.log(refinement)
        return min(max(math.exp(float(weights @ logarithms)), MIN_RELATIVE_ERROR), 1.0)

    return error


def _well_separated(pilots: Sequence[Pilot]) -> list[Pilot]:
    """Select runs with well-separated refinements, coarsest first; of close runs the finest."""
    kept: list[Pilot] = []
    for pilot in sorted(pilots, key=lambda pilot: (pilot.refinement, pilot.spent), reverse=True):
        if not kept or kept[0].refinement > WELL_APART * pilot.refinement:
            kept.insert(0, pilot)
    return kept


def _differences(one: Pilot, other: Pilot) -> np.ndarray:
    """Return the logarithm of the fraction that only one of two runs covers, per common mark."""
    count = min(len(one.covered), len(other.covered))
    here, there = one.covered[:count], other.covered[:count]
    both = np.count_nonzero(here | there, axis=(1, 2))
    wrong = np.count_nonzero(here ^ there, axis=(1, 2))
    # add half a cell, so that runs that agree have an error above 0
    return np.log(np.maximum(wrong, 0.5) / np.maximum(both, 1))
