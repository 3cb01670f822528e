# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Planning of runs: spacing, preset and members for a scene, a horizon and a wall time.

Coarse pilots run first, each finer than the one before, until one takes a good part of the time.
pilots.py predicts the cost and the error of a finer run from them. The error is that of the
numerical method, without errors of terrain, discharge and material.

The planned run is then started with the effects that it calls for (selection.py), and stopped
after a seventh of the time; its full duration follows from the coarse runs. If it differs from the
prediction, the plan is changed and started again. Otherwise the full run is made, and a somewhat
coarser one, whose difference determines most of the error. If effects do not fit and much of the
time is left, a plan may omit them if ``may_force`` is set.

Members of an ensemble share the time. The probability from n members has a sampling error of up to
1 / (2 sqrt(n)). If n is not given, it is the number with the smallest sum of both errors.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from itertools import pairwise
import math
import time as wall_clock

import numpy as np

from lava_ros import validation
from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.forecast.pilot_runs import (
    accuracy_at,
    completed,
    cost_at,
    error_law,
    Pilot,
    preset_below,
    run_at,
)
from lava_ros.scene import Scene
from lava_ros.simulation.resolution import resolution_of
from lava_ros.simulation.selection import effects_for

#: Refinement of the first pilot, and factors to the next pilot: the larger one if time allows.
FIRST, FINER, MUCH_FINER = 0.2, 1.4, 2.0

#: Limits of a plan's refinement, and its maximum ratio to that of the finest pilot.
COARSEST, FINEST, REACH = FIRST, 8.0, 2.0

#: Number of pilots that run to the horizon if time allows: with two, the error law is not known.
AT_LEAST = 3

#: The search ends with a pilot that takes at least this fraction of the time.
LAST_PILOT_TIME_FRACTION = 0.15
#: Maximum fraction of the time for all pilots after a step of ``MUCH_FINER``.
COARSE_STEP_TIME_FRACTION = 0.4
#: Maximum fraction of the time for all pilots.
MAX_PILOT_TIME_FRACTION = 0.9

#: A partial run is stopped after this fraction of the time.
PARTIAL_RUN_TIME_FRACTION = 0.15
#: Maximum fraction of the time for all runs including a partial run.
MAX_PARTIAL_TIME_FRACTION = 1.25
#: Maximum number of partial runs.
MAX_PARTIAL_RUNS = 6

#: Maximum ratios of the refinement and of the time of a plan and a partial run that confirms it.
PARTIAL_RUN_REFINEMENT_RATIO, PARTIAL_RUN_TIME_RATIO = 1.08, 1.35

#: A full run is stopped after this fraction of the time.
FULL_RUN_TIME_FRACTION = 1.1
#: Maximum number of full runs.
MAX_FULL_RUNS = 2
#: Maximum ratio of the refinements of a plan and a full run that confirms it.
FULL_RUN_REFINEMENT_RATIO = 1.2

#: Ratio of the refinements of the full run and the coarser one from which the error follows, and
#: maximum ratio of the latter to an existing run that replaces it.
COARSER, ABOUT = 1.45, 1.2

#: Fraction of the time that a plan uses, with a margin for other load on the machine.
PLANNED_TIME_FRACTION = 0.7

#: A plan that uses a smaller fraction of the time than this may use more than planned.
MIN_PLANNED_TIME_FRACTION = 0.6
#: Maximum fraction of the time in that case.
MAX_PLANNED_TIME_FRACTION = 0.9

#: Maximum increase of the refinement by omitting effects that are called for: on a ridge, omitting
#: the lateral stress changes the area as much as moving a vent by 3 cm.
WITHOUT = 2.0

#: Maximum number of members, which has a sampling error of 1 %.
_MAX_MEMBERS = 2500


@dataclass(frozen=True)
class RunPlan:
    """A plan for the runs.

    A run builds a simulation, advances it to the horizon and takes a snapshot, as ``run_at`` does;
    its kernels are compiled before. It uses ``PLANNED_TIME_FRACTION`` of the time;
    docs/benchmarks/plan.csv compares that and the error with measurements.

    Attributes:
        preset: Name of the nearest coarser preset.
        spacing: Particle spacing [m].
        refinement: The terrain's resolution over the spacing.
        members: Number of ensemble members, 1 for a single run.
        wall_time: Expected time of all runs [s].
        error: Expected wrong fraction of the inundated area up to the horizon: one minus the
            Jaccard index with the limit of fine spacing.
        cell_error: Expected wrong fraction due to the cells of the terrain.
        sampling_error: Standard error of a probability of one half, 0 for a single run.
        is_finest: Whether more time would not increase the refinement.
        pilots: Number of pilots.
        spent: Wall time of the pilots, without compilation [s].
        forced: Effects that differ from those that the scene calls for at this spacing.
    """

    preset: str
    spacing: float
    refinement: float
    members: int
    wall_time: float
    error: float
    cell_error: float
    sampling_error: float
    is_finest: bool
    pilots: int
    spent: float
    forced: dict[str, bool] = field(default_factory=dict)


def plan_within(
    scene: Scene,
    *,
    within: float,
    horizon: float,
    members: int | None = 1,
    device: str | None = None,
    may_force: bool = False,
    on_pilot: Callable[[Pilot], None] = lambda _: None,
    clock: Callable[[], float] = wall_clock.monotonic,
) -> RunPlan:
    """Find the finest runs that fit in a wall time, with pilots that take one to three times that.

    The accuracy of the runs is ``preset_accuracy(plan.preset, spacing=plan.spacing)``, and their
    effects are ``plan.forced``.

    Args:
        scene: The scene; for an ensemble, the one with median inputs.
        within: Wall time for the runs [s].
        horizon: Simulated duration of each run [s].
        members: Number of successive runs; None for the number with the smallest error.
        device: Warp device; None for the first GPU, or the CPU without one.
        may_force: Whether a plan may omit effects that do not fit (``RunPlan.forced``) if most
            of the time would otherwise be left.
        on_pilot: Called after each pilot.
        clock: Returns the time [s]; ``time.process_time`` on a shared CPU.

    Raises:
        LavaError: If an argument is not valid, or the time is too short for the coarsest run.
    """
    within = validation.number('within', within, above=0.0, unit='s')
    horizon = validation.number('horizon', horizon, above=0.0, unit='s')
    if members is not None and members < 1:
        raise LavaError('members', members, 'at least 1')
    search = _Search(scene, within, horizon, members, device, may_force, on_pilot, clock)
    search.refine_pilots()
    best = search.choose()
    refinement, count = best.refinement, best.members
    wall_time = count * search.cost(refinement, best.effects)
    if wall_time > within:
        expected = f'about {wall_time:.2g} s or more, the time of the coarsest {count} runs'
        raise LavaError('within', within, expected)
    resolution = resolution_of(scene, accuracy_at(scene, refinement, horizon), horizon=horizon)
    called_for, given = asdict(search.effects_at(refinement)), asdict(best.effects)
    return RunPlan(
        preset=preset_below(refinement),
        spacing=resolution.spacing,
        refinement=refinement,
        members=count,
        wall_time=wall_time,
        error=search.law()(refinement),
        cell_error=resolution.cell_error,
        sampling_error=sampling_error(count),
        is_finest=refinement >= 0.999 * FINEST,
        forced={name: is_on for name, is_on in given.items() if called_for[name] != is_on},
        pilots=len(search.runs),
        spent=search.spent,
    )


@dataclass(frozen=True)
class _Choice:
    """A provisional plan; ``used`` is the fraction of the time that it uses."""

    refinement: float
    members: int
    effects: Effects
    used: float


@dataclass
class _Search:
    scene: Scene
    within: float
    horizon: float
    members: int | None
    device: str | None
    may_force: bool
    on_pilot: Callable[[Pilot], None]
    clock: Callable[[], float]
    runs: list[Pilot] = field(default_factory=list)

    @property
    def pilots(self) -> list[Pilot]:
        """The pilots that reached the horizon, coarsest first."""
        done = [run for run in self.runs if run.is_done]
        return sorted(done, key=lambda pilot: pilot.refinement)

    @property
    def spent(self) -> float:
        """Wall time of all pilots [s]."""
        return sum(pilot.spent for pilot in self.runs)

    def refine_pilots(self) -> None:
        """Run pilots to the horizon, each finer than the one before."""
        refinement, within = FIRST, self.within
        # without a given number of members, as for a single run
        share = within / (self.members or 1)
        while refinement <= FINEST:
            left = MAX_PILOT_TIME_FRACTION * within - self.spent
            if not self._run(refinement, left if len(self.pilots) >= 2 else within, None):
                # finer physics or a busy machine: the pilots so far suffice
                break
            done = self.pilots
            if done[-1].wall_time >= LAST_PILOT_TIME_FRACTION * share and len(done) >= AT_LEAST:
                break
            then = {
                step: self.spent + self.cost(step * refinement, done[-1].effects)
                for step in (FINER, MUCH_FINER)
            }
            step = FINER if then[MUCH_FINER] > COARSE_STEP_TIME_FRACTION * within else MUCH_FINER
            if then[step] > MAX_PILOT_TIME_FRACTION * within and len(done) >= 2:
                break
            refinement *= step
        if len(self.pilots) < 2:
            raise LavaError('within', within, 'a longer time: the coarsest runs take more')

    def choose(self) -> _Choice:
        """Choose refinement, members and effects that fit in the time with the smallest error."""
        for _ in range(MAX_PARTIAL_RUNS):
            best = self._best(self._guess)
            cost = self.cost(best.refinement, best.effects)
            is_known = any(
                1.0 / PARTIAL_RUN_TIME_RATIO <= cost / run.wall_time <= PARTIAL_RUN_TIME_RATIO
                for run in self._near(best.refinement, PARTIAL_RUN_REFINEMENT_RATIO, best.effects)
            )
            limit = PARTIAL_RUN_TIME_FRACTION * self.within
            if is_known or self.spent + limit > MAX_PARTIAL_TIME_FRACTION * self.within:
                break
            self._run(best.refinement, limit, best.effects)
        for _ in range(MAX_FULL_RUNS):
            best = self._best(self.cost)
            near = self._near(best.refinement, FULL_RUN_REFINEMENT_RATIO, best.effects)
            if any(run.is_done for run in near):
                break
            limit = FULL_RUN_TIME_FRACTION * self.within / best.members
            self._run(best.refinement, limit, best.effects)
        best = self._best(self.cost)
        coarser = best.refinement / COARSER
        if not any(run.is_done for run in self._near(coarser, ABOUT)):
            self._run(coarser, self.within, best.effects)
        return best

    def law(self) -> Callable[[float], float]:
        """Return the error law, fitted without partial runs with effects of other refinements."""
        return error_law([
            run
            for run in self.runs
            if run.is_done or run.effects == self.effects_at(run.refinement)
        ])

    def cost(self, refinement: float, effects: Effects) -> float:
        """Return the wall time of a run [s], infinite if no pilot had its physics."""
        known = []
        for pilot in sorted(self.runs, key=lambda pilot: pilot.refinement):
            near = self._near(pilot.refinement, FULL_RUN_REFINEMENT_RATIO, effects)
            # ignore a stopped run close to a complete or a much longer one
            is_best = not any(run.is_done or run.spent > 2.0 * pilot.spent for run in near)
            if pilot.effects == effects and (pilot.is_done or is_best):
                known.append(pilot)
        return cost_at(known, refinement) if known else math.inf

    def _guess(self, refinement: float, effects: Effects) -> float:
        """Guess the wall time of a run [s], without extra cost for physics that no pilot had."""
        cost = self.cost(refinement, effects)
        return cost if math.isfinite(cost) else self.cost(refinement, self.pilots[-1].effects)

    def _near(self, refinement: float, by: float, effects: Effects | None = None) -> list[Pilot]:
        return [
            run
            for run in self.runs
            if 1.0 / by <= run.refinement / refinement <= by and effects in (None, run.effects)
        ]

    def _run(self, refinement: float, patience: float, effects: Effects | None) -> bool:
        """Run a pilot for at most ``patience`` [s]; return True if it reached the horizon."""
        pilot = run_at(
            self.scene, refinement, self.horizon, device=self.device, wall_limit=patience,
            effects=effects, clock=self.clock,
        )
        if not pilot.is_done:
            alike = [run for run in self.runs if run.is_done and run.effects == pilot.effects]
            if not self.pilots:
                reached = 100.0 * pilot.progress[-1, 0]
                expected = f'more time: the coarsest run reaches {reached:.2g} % of the horizon'
                raise LavaError('within', self.within, expected)
            pilot = completed(pilot, (alike or self.pilots)[-1])
        self.runs.append(pilot)
        self.on_pilot(pilot)
        return pilot.is_done

    def _best(self, cost: Callable[[float, Effects], float]) -> _Choice:
        law, best, least = self.law(), None, math.inf
        finest = min(FINEST, REACH * max(pilot.refinement for pilot in self.runs))
        for refinement in np.geomspace(COARSEST, finest, 400).tolist():
            effects = self.effects_at(refinement)
            each = max(cost(refinement, effects), 1e-9)
            # not at a change of effects, where rounding would decide
            if effects != self.effects_at(1.001 * refinement) or not math.isfinite(each):
                continue
            if best is None:
                best = _Choice(refinement, self.members or 1, effects, 0.0)
            # at a jump of the cost, prefer to use nearly all of the time instead of half
            is_leap = 0.0 < best.used < MIN_PLANNED_TIME_FRACTION and not self.may_force
            most = MAX_PLANNED_TIME_FRACTION if is_leap else PLANNED_TIME_FRACTION
            fitting = int(min(most * self.within / each, _MAX_MEMBERS))
            count = fitting if self.members is None else self.members
            if not 1 <= count <= fitting:
                continue
            error = math.hypot(law(refinement), sampling_error(count))
            # of equal errors (the minimum error), prefer the finer run
            if error <= least:
                best = _Choice(refinement, count, effects, count * each / self.within)
                least = error
        assert best is not None
        is_small = best.used < MIN_PLANNED_TIME_FRACTION
        return self._without(best) if self.may_force and is_small else best

    def _without(self, best: _Choice) -> _Choice:
        """Find the finest run that fits with the effects of a choice, even if others are due."""
        finest = min(FINEST, WITHOUT * best.refinement)
        for refinement in np.geomspace(best.refinement, finest, 50).tolist():
            used = best.members * self.cost(refinement, best.effects) / self.within
            if used <= PLANNED_TIME_FRACTION:
                best = replace(best, refinement=refinement, used=used)
        return best

    def effects_at(self, refinement: float) -> Effects:
        """Return the effects that the scene calls for."""
        return [effects for start, effects in self._bands if start <= refinement][-1]

    @cached_property
    def _bands(self) -> list[tuple[float, Effects]]:
        def at(refinement: float) -> Effects:
            accuracy = accuracy_at(self.scene, refinement, self.horizon)
            return effects_for(self.scene, {}, accuracy=accuracy, horizon=self.horizon)

        grid = np.geomspace(COARSEST, FINEST, 25).tolist()
        bands = [(grid[0], at(grid[0]))]
        for low, high in pairwise(grid):
            above = at(high)
            if above == bands[-1][1]:
                continue
            while high > 1.0005 * low:
                middle = math.sqrt(low * high)
                low, high = (low, middle) if at(middle) == above else (middle, high)
            bands.append((high, above))
        return bands


def sampling_error(members: int) -> float:
    """Return the standard error of a probability of one half, 0 for a single run."""
    return 0.5 / math.sqrt(members) if members > 1 else 0.0
