# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The accuracy one can afford: spacing, preset and members for a scene, a horizon and a time.

Coarse pilots run first, each finer than the one before, until one takes a good part of the time.
pilots.py tells from them the cost and the error of a finer run; the error is of the method
alone, not of terrain, discharge and material.

The planned run is then begun with the effects (selection.py) that it calls for, and stopped after
a seventh of the time; the coarse runs tell how long it would take. If that differs from the
forecast, the plan is changed and begun again. If not, the whole run is made, and one somewhat
coarser, whose difference tells most of the error. Where effects do not fit and much of the time is
left, a plan may do without them, if ``may_force`` is set.

Members of an ensemble share the time. The probability that n of them give has a sampling error of
up to 1 / (2 sqrt(n)). Where n is left open, it is the one with the smallest sum of both errors.
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
from lava_ros.forecast.pilots import (
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

#: Refinement of the first pilot, and factors to the next one: the larger one if time allows.
FIRST, FINER, MUCH_FINER = 0.2, 1.4, 2.0

#: Limits of a plan's refinement, and the largest factor on that of the finest pilot.
COARSEST, FINEST, REACH = FIRST, 8.0, 2.0

#: Number of pilots that run to the horizon if time allows: two do not show how errors fall.
AT_LEAST = 3

#: Shares of the time: of the last of them, of all before a much finer one is too expensive, and of
#: all at most.
ENOUGH, MUCH_CLIMBING, MOST_CLIMBING = 0.15, 0.4, 0.9

#: Share of the time after which a begun run is stopped, the largest share of all runs by then, and
#: the largest number of begun runs.
BEGINNING, MOST_BEGINNING, MOST_BEGUN = 0.15, 1.25, 6

#: How far a plan may be from a run that was begun, as factors of the refinement and of the time.
NEAR, ALIKE = 1.08, 1.35

#: Share of the time after which a whole run is stopped too, how many there are at most, and how
#: far a plan may be from one, as a factor of the refinement.
PATIENCE, MOST_WHOLE, NEAR_WHOLE = 1.1, 2, 1.2

#: How much coarser the run is that tells the error, and the largest factor between that and a run
#: that was made already.
COARSER, ABOUT = 1.45, 1.2

#: Share of the time that a plan uses: other work on the machine only makes it slower.
USED = 0.7

#: Share of the time below which a plan rather uses more than ``USED``, and how much then.
LEAST_USED, MOST_USED = 0.6, 0.9

#: How much finer a plan may be without the effects that are called for there: without the lateral
#: stress, on a ridge, the area changes as much as with a vent 3 cm away.
WITHOUT = 2.0

#: Most members worth having: 1 % of sampling error.
_MOST_MEMBERS = 2500


@dataclass(frozen=True)
class Affordable:
    """What to run.

    A run builds a simulation, advances it to the horizon and takes a snapshot, as ``run_at`` does;
    its kernels are compiled before. It uses ``USED`` of the time; docs/benchmarks/plan.csv
    compares that and the error with measurements.

    Attributes:
        preset: Name of the preset that is nearest below.
        spacing: Distance between particles [m].
        refinement: The terrain's resolution over it.
        members: Members of an ensemble, 1 for a single run.
        wall_time: Expected time of all runs [s].
        error: Expected fraction of the inundated area (up to the horizon)
            that is wrong: one less the Jaccard index with the limit of fine spacing.
        cell_error: Expected share that is wrong by the cells of the terrain.
        sampling_error: Standard error of a probability of one half, 0 for a single run.
        is_finest: Whether more time would not make it finer.
        pilots: Number of pilots.
        spent: Time of the pilots, without compiling kernels [s].
        forced: Effects that differ from what the scene calls for at this spacing.
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


def afford(
    scene: Scene,
    *,
    within: float,
    horizon: float,
    members: int | None = 1,
    device: str | None = None,
    may_force: bool = False,
    on_pilot: Callable[[Pilot], None] = lambda _: None,
    clock: Callable[[], float] = wall_clock.monotonic,
) -> Affordable:
    """Find the finest runs that fit into a time, by pilots that take one to three times as long.

    Their accuracy is ``preset_accuracy(plan.preset, spacing=plan.spacing)``, and their effects are
    ``plan.forced``.

    Args:
        scene: The scene; of an ensemble the one in the middle.
        within: Wall time there is [s].
        horizon: How far each run goes [s].
        members: Runs, one after the other; None for the number with the smallest error.
        device: Warp device; None for the first GPU, or the CPU without one.
        may_force: Whether a plan may do without effects that do not fit (``Affordable.forced``)
            where most of the time would be left otherwise.
        on_pilot: Called after each pilot.
        clock: What tells the time [s]; ``time.process_time`` on a CPU that others use too.

    Raises:
        LavaError: An argument is not usable, or the time is too short for the coarsest run.
    """
    within = validation.number('within', within, above=0.0, unit='s')
    horizon = validation.number('horizon', horizon, above=0.0, unit='s')
    if members is not None and members < 1:
        raise LavaError('members', members, 'at least 1')
    search = _Search(scene, within, horizon, members, device, may_force, on_pilot, clock)
    search.climb()
    best = search.choose()
    refinement, count = best.refinement, best.members
    wall_time = count * search.cost(refinement, best.effects)
    if wall_time > within:
        right = f'about {wall_time:.2g} s or more, the time of the coarsest {count} runs'
        raise LavaError('within', within, right)
    expected = resolution_of(scene, accuracy_at(scene, refinement, horizon), horizon=horizon)
    called_for, given = asdict(search.effects_at(refinement)), asdict(best.effects)
    return Affordable(
        preset=preset_below(refinement),
        spacing=expected.spacing,
        refinement=refinement,
        members=count,
        wall_time=wall_time,
        error=search.law()(refinement),
        cell_error=expected.cell_error,
        sampling_error=sampling_error(count),
        is_finest=refinement >= 0.999 * FINEST,
        forced={name: is_on for name, is_on in given.items() if called_for[name] != is_on},
        pilots=len(search.runs),
        spent=search.spent,
    )


@dataclass(frozen=True)
class _Choice:
    """A plan for now; ``used`` is its share of the time."""

    refinement: float
    members: int
    effects: Effects
    used: float


@dataclass
class _Search:
    """The pilots that are run for a plan, and what they tell."""

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
        """Those that came to the horizon, from the coarsest."""
        done = [run for run in self.runs if run.is_done]
        return sorted(done, key=lambda pilot: pilot.refinement)

    @property
    def spent(self) -> float:
        """Time of all pilots [s]."""
        return sum(pilot.spent for pilot in self.runs)

    def climb(self) -> None:
        """Run pilots to the horizon, each finer than the one before."""
        refinement, within = FIRST, self.within
        # where the number of members is open, as for a single run
        share = within / (self.members or 1)
        while refinement <= FINEST:
            left = MOST_CLIMBING * within - self.spent
            if not self._run(refinement, left if len(self.pilots) >= 2 else within, None):
                # finer physics, or a busy machine: what has been seen will do
                break
            done = self.pilots
            if done[-1].wall_time >= ENOUGH * share and len(done) >= AT_LEAST:
                break
            then = {
                step: self.spent + self.cost(step * refinement, done[-1].effects)
                for step in (FINER, MUCH_FINER)
            }
            step = FINER if then[MUCH_FINER] > MUCH_CLIMBING * within else MUCH_FINER
            if then[step] > MOST_CLIMBING * within and len(done) >= 2:
                break
            refinement *= step
        if len(self.pilots) < 2:
            raise LavaError('within', within, 'more time: the coarsest runs take longer')

    def choose(self) -> _Choice:
        """Refinement, members and effects that fit into the time with the smallest error."""
        for _ in range(MOST_BEGUN):
            best = self._best(self._guess)
            cost = self.cost(best.refinement, best.effects)
            is_known = any(
                1.0 / ALIKE <= cost / run.wall_time <= ALIKE
                for run in self._near(best.refinement, NEAR, best.effects)
            )
            if is_known or self.spent + BEGINNING * self.within > MOST_BEGINNING * self.within:
                break
            self._run(best.refinement, BEGINNING * self.within, best.effects)
        for _ in range(MOST_WHOLE):
            best = self._best(self.cost)
            if any(run.is_done for run in self._near(best.refinement, NEAR_WHOLE, best.effects)):
                break
            self._run(best.refinement, PATIENCE * self.within / best.members, best.effects)
        best = self._best(self.cost)
        coarser = best.refinement / COARSER
        if not any(run.is_done for run in self._near(coarser, ABOUT)):
            self._run(coarser, self.within, best.effects)
        return best

    def law(self) -> Callable[[float], float]:
        """The law of errors; begun runs with the effects of other refinements do not enter."""
        return error_law([
            run
            for run in self.runs
            if run.is_done or run.effects == self.effects_at(run.refinement)
        ])

    def cost(self, refinement: float, effects: Effects) -> float:
        """Wall time of a run [s], infinite where no pilot had its physics."""
        known = []
        for pilot in sorted(self.runs, key=lambda pilot: pilot.refinement):
            near = self._near(pilot.refinement, NEAR_WHOLE, effects)
            # one that was stopped says nothing beside one that was not, or much later
            is_best = not any(run.is_done or run.spent > 2.0 * pilot.spent for run in near)
            if pilot.effects == effects and (pilot.is_done or is_best):
                known.append(pilot)
        return cost_at(known, refinement) if known else math.inf

    def _guess(self, refinement: float, effects: Effects) -> float:
        """Wall time of a run [s]; physics that no pilot had may cost no more."""
        cost = self.cost(refinement, effects)
        return cost if math.isfinite(cost) else self.cost(refinement, self.pilots[-1].effects)

    def _near(self, refinement: float, by: float, effects: Effects | None = None) -> list[Pilot]:
        """Runs that are near to a refinement, by a factor, with some effects or with any."""
        return [
            run
            for run in self.runs
            if 1.0 / by <= run.refinement / refinement <= by and effects in (None, run.effects)
        ]

    def _run(self, refinement: float, patience: float, effects: Effects | None) -> bool:
        """Run a pilot for some time [s]; whether it came to the horizon."""
        pilot = run_at(
            self.scene, refinement, self.horizon, device=self.device, wall_limit=patience,
            effects=effects, clock=self.clock,
        )
        if not pilot.is_done:
            alike = [run for run in self.runs if run.is_done and run.effects == pilot.effects]
            if not self.pilots:
                raise LavaError('within', self.within, 'more time: the coarsest run takes longer')
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
            # not so near to other effects that rounding decides
            if effects != self.effects_at(1.001 * refinement) or not math.isfinite(each):
                continue
            if best is None:
                best = _Choice(refinement, self.members or 1, effects, 0.0)
            # where other effects make a leap in cost, rather nearly all of the time than half
            is_leap = 0.0 < best.used < LEAST_USED and not self.may_force
            most = MOST_USED if is_leap else USED
            fitting = int(min(most * self.within / each, _MOST_MEMBERS))
            count = fitting if self.members is None else self.members
            if not 1 <= count <= fitting:
                continue
            error = math.hypot(law(refinement), sampling_error(count))
            # errors below the least one are alike: finer is better
            if error <= least:
                best = _Choice(refinement, count, effects, count * each / self.within)
                least = error
        assert best is not None
        return self._without(best) if self.may_force and best.used < LEAST_USED else best

    def _without(self, best: _Choice) -> _Choice:
        """The finest that fits with the effects of a choice, also where others are called for."""
        finest = min(FINEST, WITHOUT * best.refinement)
        for refinement in np.geomspace(best.refinement, finest, 50).tolist():
            used = best.members * self.cost(refinement, best.effects) / self.within
            if used <= USED:
                best = replace(best, refinement=refinement, used=used)
        return best

    def effects_at(self, refinement: float) -> Effects:
        """The effects that the scene calls for."""
        return [effects for start, effects in self._bands if start <= refinement][-1]

    @cached_property
    def _bands(self) -> list[tuple[float, Effects]]:
        """The effects that the scene calls for, each from a refinement on."""

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
    """Standard error of a probability of one half from independent members, 0 for a single run."""
    return 0.5 / math.sqrt(members) if members > 1 else 0.0
