# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs of a scene that are timed and looked at on their way, and what they tell of a finer one.

Cost: the wall time of a run is s + E (a + b r^k), in proportion to the run with the nearest
refinement r. Its evaluations E grow as a power of r, that of the last two runs. The time of an
evaluation has a constant part and one that goes as the number of particles, r^2; the iterations of
the lateral stress make k 3 in place of 2. Between two runs the time is a power of r.

A run that was stopped would have continued as a coarser one did, with evaluations and particles in
proportion. Its own evaluations, and those of the coarser one with the same physics, tell how long
each takes with so many particles.

Error: the share of what two runs cover that only one of them covers. An edge is off by a bias,
C r^-p, and by the random places of particles, q C r^-p. Two runs then differ by

    d_ij = C sqrt((r_i^-p - r_j^-p)^2 + q^2 (r_i^-2p + r_j^-2p))

and each from the limit by C r^-p sqrt(1 + q^2). A run that was stopped is compared where it
stopped; from there to the horizon differences grow as those of the coarser runs did. Few runs do
not tell p and q: values of a grid are weighed by their likelihood and by how usual they are.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
import math
import time as wall_clock
from typing import Any

import numpy as np

from lava_ros.effects import Effects
from lava_ros.scene import Scene
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.presets import PRESETS
from lava_ros.simulation.resolution import resolution_of

#: Times at which pilots are compared.
MARKS = 10

#: Smallest error of a run as a share of what it covers: twice the error of the edge that the
#: finest preset has in docs/accuracy, since an area goes as the square of its radius.
FLOOR = 0.004

#: Least factors between two refinements that tell how evaluations grow, and how errors fall.
APART, WELL_APART = 1.15, 1.3

#: Powers p of the error, and how usual each is: docs/accuracy has 1 on slopes, and more where
#: coarse runs hardly resolve the ground or the thickness.
ORDERS = {0.6: 1.0, 0.8: 1.0, 1.0: 1.0, 1.25: 1.0, 1.5: 1.0, 1.8: 0.5}

#: Scatter q over bias.
SCATTERS = (0.0, 0.3, 0.6, 1.0, 2.0)

#: Standard deviation of the logarithm of a difference from the law.
_SPREAD = 0.3


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

    Kernels are compiled before the clock starts. Looks at the flow before the end do not shorten
    its time steps, and count as time spent only. ``effects`` are the physics, or a mapping that
    switches some effects.
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
    for mark in range(1, MARKS + 1):
        until = horizon * (mark / MARKS)
        for _ in simulation.advancing(until, limit=horizon):
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
        covered.append(snapshot.inundated)
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
    most = 1.001 * refinement
    below = [name for name in ('standard', 'fine') if PRESETS[name].accuracy.refinement <= most]
    return below[-1] if below else 'draft'


def completed(pilot: Pilot, model: Pilot) -> Pilot:
    """Extrapolate a stopped run to the horizon, in proportion to a coarser run that got there."""
    share, taken, *_ = pilot.progress[-1]
    shares = model.progress[:, 0]
    at_that = np.array([np.interp(share, shares, column) for column in model.progress.T[2:]])
    scale = pilot.progress[-1, 2:] / np.maximum(at_that, 1.0)
    if pilot.progress[-1, 3] < 1.0:
        # as many on the same area
        scale[1] = (pilot.refinement / model.refinement) ** 2
    is_later = shares > share
    to_come = np.vstack([at_that, model.progress[is_later, 2:]]) * scale
    runs = [pilot, model] if model.effects == pilot.effects else [pilot]
    sizes, more, times = np.concatenate([_increments(run) for run in runs]).T
    constant, slope = _line(sizes, times / more, more)
    sizes, more, _ = _increments(pilot).T
    expected = float((more * (constant + slope * sizes)).sum())
    # without a particle so far it is as fast as the coarser one
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
    """Power of the particles' number that an evaluation goes as."""
    return 1.5 if 'helmholtz' in effects else 1.0


def _increments(pilot: Pilot) -> np.ndarray:
    """Particles to their power, evaluations and wall time [s] of each part, shape [n, 3]."""
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
        # nothing to compare with but its own parts
        sizes, more, times = _increments(nearest).T
        weights = more / np.sqrt(times)
        sizes, times = sizes / max(np.average(sizes, weights=more), 1.0), times / more
    else:
        sizes = np.array([run.refinement / nearest.refinement for run in pilots]) ** (2.0 * power)
        times = np.array([
            (pilot.wall_time - pilot.setup) / max(pilot.evaluations, 1.0) for pilot in pilots
        ])
        # a run that is twice as long is half as uncertain, that is four times the weight
        weights = np.sqrt(sizes) / np.maximum(times, 1e-12)
    constant, slope = _line(sizes, times, weights)
    each = (constant + slope * scale ** (2.0 * power)) / (constant + slope)
    return nearest.setup + (nearest.wall_time - nearest.setup) * scale ** _growth(pilots) * each


def _growth(pilots: Sequence[Pilot]) -> float:
    """Power of the refinement at which evaluations grow."""
    last = pilots[-1]
    # those too near say more of chance
    far = [pilot for pilot in pilots[:-1] if pilot.refinement * APART < last.refinement]
    before = far[-1] if far else pilots[0]
    if before.refinement == last.refinement:
        return 1.0
    more = max(last.evaluations, 1.0) / max(before.evaluations, 1.0)
    growth = math.log(more) / math.log(last.refinement / before.refinement)
    return min(max(growth, 0.0), 2.0)


def _line(sizes: np.ndarray, times: np.ndarray, weights: np.ndarray) -> tuple[float, float]:
    """Constant and slope, neither negative, of the line with the least weighted errors."""
    rows = np.stack([weights, weights * sizes], axis=1)
    (constant, slope), *_ = np.linalg.lstsq(rows, weights * times, rcond=None)
    if slope < 0.0:
        return float(np.average(times, weights=weights**2)), 0.0
    if constant < 0.0:
        # before a vent opens there is no particle, and a size is 0
        return 0.0, float((weights**2 * sizes * times).sum() / (weights**2 * sizes**2).sum())
    return float(constant), float(slope)


def error_law(pilots: Sequence[Pilot]) -> Callable[[float], float]:
    """Fit laws C r^-p to the finest pilots, at least two of which reached the horizon.

    Returns:
        The share of the covered area that is wrong at a refinement, from ``FLOOR`` to 1: the mean
        of the laws' logarithms.
    """
    done = _apart([pilot for pilot in pilots if pilot.is_done])[-4:]
    begun = _apart([
        pilot for pilot in pilots if not pilot.is_done and len(pilot.covered)
        and pilot.refinement > WELL_APART * done[-1].refinement
    ])[-2:]
    # what differences are of those at the horizon
    growth = np.mean([_differences(one, other) for one, other in combinations(done, 2)], axis=0)
    growth -= growth[-1]
    pairs = list(combinations([*done, *begun], 2))
    ones, others = np.array([(one.refinement, other.refinement) for one, other in pairs]).T
    seen = [_differences(one, other) for one, other in pairs]
    differences = np.array([item[-1] - growth[len(item) - 1] for item in seen])
    laws = []
    for (order, usual), scatter in product(ORDERS.items(), SCATTERS):
        x, y = ones**-order, others**-order
        law = np.sqrt((x - y) ** 2 + scatter**2 * (x**2 + y**2))
        logarithm = differences - np.log(law)
        constant = float(logarithm.mean())
        misfit = float(((logarithm - constant) ** 2).sum()) / (2.0 * _SPREAD**2)
        size = math.exp(constant) * math.hypot(1.0, scatter)
        laws.append((usual * math.exp(-misfit), size, order))
    weights, sizes, orders = np.array(laws).T
    weights /= weights.sum()

    def error(refinement: float) -> float:
        logarithms = np.log(sizes) - orders * math.log(refinement)
        return min(max(math.exp(float(weights @ logarithms)), FLOOR), 1.0)

    return error


def _apart(pilots: Sequence[Pilot]) -> list[Pilot]:
    """Those that are far enough from each other, from the coarsest; of others the finest."""
    kept: list[Pilot] = []
    for pilot in sorted(pilots, key=lambda pilot: (pilot.refinement, pilot.spent), reverse=True):
        if not kept or kept[0].refinement > WELL_APART * pilot.refinement:
            kept.insert(0, pilot)
    return kept


def _differences(one: Pilot, other: Pilot) -> np.ndarray:
    """Logarithm of the share that only one of two covers, at each mark that both have."""
    count = min(len(one.covered), len(other.covered))
    here, there = one.covered[:count], other.covered[:count]
    both = np.count_nonzero(here | there, axis=(1, 2))
    wrong = np.count_nonzero(here ^ there, axis=(1, 2))
    # half a cell, lest runs that agree would be without error
    return np.log(np.maximum(wrong, 0.5) / np.maximum(both, 1))
