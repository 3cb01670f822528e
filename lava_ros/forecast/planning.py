# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Planning of runs: spacing, preset and members for a scene, a horizon and a wall time.

Coarse pilots (pilot_runs.py) run first, each finer than the one before, in at most
``PLANNING_FRACTION`` of the time. The difference of the last ones is the particles' part of the
numerical error, and that of the one before it from a run on coarser ground the ground's part
(simulation/numerical_error.py). The particles' part is proportional to the spacing to the power
``PARTICLE_ORDER``; the ground's part does not depend on it.

Members of an ensemble share the time. The probability from n members has a sampling error of up to
1 / (2 sqrt(n)). If n is not given, it is the number with the smallest sum of both errors.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
import math
import time as wall_clock

import numpy as np

from lava_ros import validation
from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.forecast.member_scenes import changes_of, member_scene
from lava_ros.forecast.partner_runs import on_coarser_ground
from lava_ros.forecast.pilot_runs import (
    accuracy_at,
    cost_at,
    Pilot,
    preset_below,
    run_at,
    spacing_at,
    standard_resolution,
)
from lava_ros.forecast.sampling import Member
from lava_ros.scene import Scene
from lava_ros.scene.ranges import with_ranges
from lava_ros.simulation.numerical_error import (
    COARSER,
    difference,
    error_of,
    GROUND_ORDER,
    NumericalError,
    Pair,
    PARTICLE_ORDER,
    richardson,
    scaled,
)
from lava_ros.simulation.selection import effects_for

#: Maximum fraction of the time for all pilots.
PLANNING_FRACTION = 0.15

#: Particles across the flow of the first pilot, and the ratio of one pilot to the next.
FIRST_ACROSS, FINER = 4.0, 1.6

#: Minimum ratio of one pilot to the next, margin of the time of a pilot, and power of the
#: refinement with which the time of the second grows.
CLOSEST, PILOT_MARGIN, GROWTH = 1.2, 1.2, 4.0

#: Minimum refinement, and that of the first pilot if the width of the flow is unknown.
COARSEST, UNKNOWN = 0.01, 0.15

#: Maximum refinement of a plan.
FINEST = 8.0

#: Minimum part of the particles over that of the ground: finer particles change little.
USEFUL = 0.25

#: Maximum fraction of the pilots' time for those with changed inputs.
CHANGES_FRACTION = 0.4

#: Fraction of the time that a plan uses, with a margin for other load on the machine.
PLANNED_TIME_FRACTION = 0.7

#: Ratio of the refinements of two rows of the table.
ROW = 2.0**0.5

#: Maximum number of members, which has a sampling error of 1 %.
_MAX_MEMBERS = 2500


@dataclass(frozen=True)
class Option:
    """A run that could be made.

    Attributes:
        refinement: Its refinement.
        spacing: Its particle spacing [m].
        wall_time: Its expected wall time [s].
        error: Its numerical error.
    """

    refinement: float
    spacing: float
    wall_time: float
    error: NumericalError


@dataclass(frozen=True)
class InputChange:
    """Effect of a change of one uncertain quantity from its 10 % to its 90 % quantile.

    Attributes:
        area: Relative change of the inundated area.
        mismatch: 1 - J of the areas before and after.
    """

    area: float
    mismatch: float


@dataclass(frozen=True)
class RunPlan:
    """A plan for the runs.

    A run builds a simulation, advances it to the horizon and takes a snapshot, as ``run_at`` does;
    its kernels are compiled before.

    Attributes:
        preset: Name of the nearest coarser preset.
        spacing: Particle spacing [m].
        refinement: Spacing of the preset ``standard`` over it.
        members: Number of ensemble members, 1 for a single run.
        wall_time: Expected time of all runs [s].
        numerical_error: Error of the areas at the horizon.
        sampling_error: Standard error of a probability of one half, 0 for a single run.
        is_finest: Whether more time would hardly reduce the error.
        pilots: Number of pilots.
        spent: Time of the pilots, without compilation [s].
        options: Runs of other spacings, from the coarsest to the finest.
        inputs: Effects of the uncertain quantities that the scene gives or leaves open, by name,
            from the coarsest pilots; those that did not fit in the time are missing.
    """

    preset: str
    spacing: float
    refinement: float
    members: int
    wall_time: float
    numerical_error: NumericalError
    sampling_error: float
    is_finest: bool
    pilots: int
    spent: float
    options: tuple[Option, ...] = ()
    inputs: Mapping[str, InputChange] = field(default_factory=dict)

    @property
    def error(self) -> float:
        """Numerical error of the inundated area."""
        return self.numerical_error.inundated.total


def plan_within(
    scene: Scene,
    *,
    within: float,
    horizon: float,
    members: int | None = 1,
    device: str | None = None,
    on_pilot: Callable[[Pilot], None] = lambda _: None,
    clock: Callable[[], float] = wall_clock.monotonic,
    with_inputs: bool = False,
) -> RunPlan:
    """Find the finest runs that fit in a wall time, with pilots that take at most 15 % of it.

    The accuracy of the runs is ``preset_accuracy(plan.preset, spacing=plan.spacing)``.

    Args:
        scene: The scene; for an ensemble, the one with median inputs.
        within: Wall time for the runs [s].
        horizon: Simulated duration of each run [s].
        members: Number of successive runs; None for the number with the smallest error.
        device: Warp device; None for the first GPU, or the CPU without one.
        on_pilot: Called after each pilot.
        clock: Returns the time [s]; ``time.process_time`` on a shared CPU.
        with_inputs: True for the effects of the uncertain quantities, ``RunPlan.inputs``.

    Raises:
        LavaError: If an argument is not valid, or the time is too short for the coarsest run.
    """
    within = validation.number('within', within, above=0.0, unit='s')
    horizon = validation.number('horizon', horizon, above=0.0, unit='s')
    if members is not None and members < 1:
        raise LavaError('members', members, 'at least 1')
    # all pilots have the effects of preset standard
    effects = effects_for(scene, accuracy=accuracy_at(scene, 1.0, horizon), horizon=horizon)
    search = _Search(scene, within, horizon, device, effects, on_pilot, clock, with_inputs)
    # compiles the kernels
    run_at(scene, search.first, 1e-3, device=device, effects=effects)
    search.run_pilots(members or 1)
    inputs = search.change_inputs()
    refinement, count = search.choose(members)
    wall_time = count * search.cost(refinement)
    if wall_time > within:
        expected = f'about {wall_time:.2g} s or more, the time of the coarsest {count} runs'
        raise LavaError('within', within, expected)
    chosen = search.option(refinement)
    rows = refinement * ROW ** np.arange(-4.0, 5.0)
    return RunPlan(
        preset=preset_below(refinement),
        spacing=chosen.spacing,
        refinement=refinement,
        members=count,
        wall_time=wall_time,
        numerical_error=chosen.error,
        sampling_error=sampling_error(count),
        is_finest=refinement >= 0.999 * search.finest,
        pilots=search.count,
        spent=search.spent,
        options=tuple(map(search.option, rows[rows <= FINEST].tolist())),
        inputs=inputs,
    )


@dataclass
class _Search:
    scene: Scene
    within: float
    horizon: float
    device: str | None
    effects: Effects
    on_pilot: Callable[[Pilot], None]
    clock: Callable[[], float]
    with_inputs: bool
    pilots: list[Pilot] = field(default_factory=list)
    spent: float = 0.0
    count: int = 0

    @cached_property
    def first(self) -> float:
        """Refinement of the first pilot, the coarsest that a plan has."""
        standard = standard_resolution(self.scene, self.horizon)
        if math.isnan(standard.width):
            return UNKNOWN
        return min(max(FIRST_ACROSS / standard.across, COARSEST), 1.0)

    def run_pilots(self, members: int) -> None:
        """Run pilots, each finer than the one before, until finer ones would add little."""
        ground, refinement = on_coarser_ground(self.scene), self.first
        budget = PLANNING_FRACTION * self.within
        while refinement <= FINEST:
            left = budget - self.spent
            limit = left if len(self.pilots) > 1 else self.within / members
            pilot = self._run(self.scene, refinement, limit)
            if pilot is None:
                break
            self.pilots = sorted([*self.pilots, pilot], key=lambda pilot: pilot.refinement)
            if len(self.pilots) > 1:
                before, coarse = self.pilots[-2], None
                if ground is not None:
                    # cheaper than one of the newest spacing
                    coarse = self._run(ground, before.refinement, 3.0 * before.wall_time + 1.0)
                self._error = self._measure(coarse)
                refinement = self._next(budget - self.spent)
                last = self.pilots[-1].refinement
                if refinement < CLOSEST * last or self.finest <= FINER * last:
                    break
            else:
                # a coarser one in a short time
                is_cheap = FINER**GROWTH * pilot.wall_time <= budget - self.spent
                refinement *= FINER if is_cheap else 1.0 / FINER
        if len(self.pilots) < 2:
            raise LavaError('within', self.within, 'a longer time: the coarsest runs take more')

    def _next(self, left: float) -> float:
        """Return the refinement of the next pilot, which fits into the time that is left [s]."""
        last = self.pilots[-1]
        steps = last.refinement * np.linspace(1.0, FINER, 13)
        # before those on coarser ground and with changed inputs, which are coarser
        changes = 2.0 * len(self.changes) * PILOT_MARGIN * self.pilots[0].wall_time
        left -= 1.3 * last.wall_time + min(changes, CHANGES_FRACTION * left)
        fitting = [step for step in steps.tolist() if PILOT_MARGIN * self.cost(step) <= left]
        return fitting[-1] if fitting else 0.0

    def _run(
        self, scene: Scene, refinement: float, limit: float, *, is_told: bool = True
    ) -> Pilot | None:
        begun = self.clock()
        pilot = run_at(
            scene, refinement, self.horizon, device=self.device, effects=self.effects,
            wall_limit=limit, clock=self.clock,
        )
        self.spent += self.clock() - begun
        self.count += 1
        if pilot is not None and is_told:
            self.on_pilot(pilot)
        return pilot

    def _measure(self, coarse: Pilot | None) -> NumericalError:
        """Return the error of the finest pilot.

        ``coarse`` is a run of the pilot before it, on coarser ground.
        """
        finest, before = self.pilots[-1], self.pilots[-2]
        wanted = COARSER * finest.spacing
        partner = min(
            self.pilots[:-1], key=lambda pilot: abs(math.log(pilot.spacing / wanted))
        )
        reduction = richardson(partner.spacing / finest.spacing, PARTICLE_ORDER)
        pairs = {'particles': Pair(finest.areas, partner.areas, reduction)}
        if coarse is not None:
            pairs['ground'] = Pair(before.areas, coarse.areas, richardson(2.0, GROUND_ORDER))
        return error_of(
            pairs, spacing=finest.spacing, cell=self.scene.terrain.resolution, time=self.horizon,
            cost=self.spent,
        )

    @cached_property
    def changes(self) -> dict[str, tuple[Member, Member]]:
        """Members with changed inputs, by the quantity."""
        return changes_of(with_ranges(self.scene)) if self.with_inputs else {}

    def change_inputs(self) -> dict[str, InputChange]:
        """Return what changes of the inputs change, with coarse pilots while there is time.

        All have the same particle spacing, that of the finest pilot but one for which they fit in
        the time.
        """
        scene, found, runs = with_ranges(self.scene), {}, 2.0 * PILOT_MARGIN
        left = PLANNING_FRACTION * self.within - self.spent
        fitting = [
            pilot for pilot in self.pilots[:-1]
            if runs * len(self.changes) * pilot.wall_time <= left
        ]
        base = fitting[-1] if fitting else self.pilots[0]

        def run(member: Member) -> Pilot | None:
            one = member_scene(scene, member, rough=any(member.seed))
            refinement = spacing_at(one, 1.0, self.horizon) / base.spacing
            return self._run(one, refinement, left, is_told=False)

        for name, ends in self.changes.items():
            left = PLANNING_FRACTION * self.within - self.spent
            if runs * base.wall_time > left:
                break
            pilots = [pilot for pilot in map(run, ends) if pilot is not None]
            if len(pilots) == len(ends):
                low, high = (np.asarray(pilot.areas.inundated) for pilot in pilots)
                growth = float(high.sum()) / max(float(low.sum()), 1e-9) - 1.0
                found[name] = InputChange(growth, difference(low, high))
        return found

    def cost(self, refinement: float) -> float:
        """Return the wall time of a run [s]."""
        return cost_at(self.pilots, refinement)

    def error(self, refinement: float) -> NumericalError:
        """Return the numerical error of a run."""
        ratio = self.pilots[-1].refinement / refinement
        inundated, standing = (
            replace(area, particles=scaled(area.particles, ratio**PARTICLE_ORDER))
            for area in (self._error.inundated, self._error.standing)
        )
        spacing = spacing_at(self.scene, refinement, self.horizon)
        return replace(self._error, inundated=inundated, standing=standing, spacing=spacing)

    def option(self, refinement: float) -> Option:
        """Return a run at a refinement."""
        error = self.error(refinement)
        return Option(refinement, error.spacing, self.cost(refinement), error)

    @property
    def finest(self) -> float:
        """Refinement above which the error hardly falls."""
        area, finest = self._error.inundated, self.pilots[-1].refinement
        if not area.ground > 0.0 or not area.particles > 0.0:
            return FINEST
        scale = (area.particles / (USEFUL * area.ground)) ** (1.0 / PARTICLE_ORDER)
        return min(max(scale * finest, self.first), FINEST)

    def choose(self, members: int | None) -> tuple[float, int]:
        """Choose the refinement and the members that fit in the time with the smallest error."""
        best, least = (self.first, members or 1), math.inf
        for refinement in np.geomspace(self.first, self.finest, 400).tolist():
            each = max(self.cost(refinement), 1e-9)
            fitting = int(min(PLANNED_TIME_FRACTION * self.within / each, _MAX_MEMBERS))
            count = fitting if members is None else members
            if not 1 <= count <= fitting:
                continue
            error = math.hypot(self.error(refinement).inundated.total, sampling_error(count))
            # of equal errors, prefer the finer run
            if error <= least:
                best, least = (refinement, count), error
        return best


def sampling_error(members: int) -> float:
    """Return the standard error of a probability of one half, 0 for a single run."""
    return 0.5 / math.sqrt(members) if members > 1 else 0.0
