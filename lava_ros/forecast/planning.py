# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Planning of runs: spacing, preset and members for a scene and a wall time, or an error.

Coarse pilots (pilot_search.py) run first, in at most ``PLANNING_FRACTION`` of the time.

Members of an ensemble share the time. The probability from n members has a sampling error of up to
1 / (2 sqrt(n)). If n is not given, it is the number with the smallest sum of both errors.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
import math
import time as wall_clock

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.forecast.member_scenes import changes_of, member_scene
from lava_ros.forecast.pilot_runs import (
    accuracy_at,
    cells_at,
    Pilot,
    preset_below,
    standard_resolution,
)
from lava_ros.forecast.pilot_search import (
    FINER,
    FINEST,
    Option,
    PILOT_MARGIN,
    PilotSearch,
    PLANNING_FRACTION,
)
from lava_ros.forecast.preset_spacing import spacing_of_preset
from lava_ros.forecast.sampling import Member
from lava_ros.scene import Scene
from lava_ros.scene.ranges import with_ranges
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.numerical_error import difference, NumericalError
from lava_ros.simulation.presets import PRESETS
from lava_ros.simulation.resolution import Resolution, resolution_of
from lava_ros.simulation.selection import effects_for

#: Particles across the flow of the first pilot.
FIRST_ACROSS = 4.0

#: Minimum refinement, and refinement of the first pilot if the width of the flow is unknown.
COARSEST, UNKNOWN = 0.01, 0.15

#: Refinement of the first pilot on cells, over those of the terrain.
FIRST_CELLS = 0.25

#: Minimum ratio of the particles' part to the ground's part of the error: finer particles change
#: little.
USEFUL = 0.25

#: Maximum fraction of the pilots' time for pilots with changed inputs.
CHANGES_FRACTION = 0.4

#: Fraction of the time that a plan uses, with a margin for other load on the machine.
PLANNED_TIME_FRACTION = 0.7

#: Ratio of the refinements of two rows of the table.
ROW = 2.0**0.5

#: Maximum number of members, which has a sampling error of 1 %.
_MAX_MEMBERS = 2500


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
        options: Runs of other spacings, including those of the presets, from the coarsest to the
            finest.
        presets: Refinements of the presets with a target, by name.
        inputs: Effects of the uncertain quantities that the scene gives or leaves open, by name,
            from coarse pilots; those that did not fit in the time are missing.
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
    presets: Mapping[str, float] = field(default_factory=dict)
    inputs: Mapping[str, InputChange] = field(default_factory=dict)

    @property
    def error(self) -> float:
        """Numerical error of the inundated area."""
        return self.numerical_error.inundated.total


def plan_runs(
    scene: Scene,
    *,
    within: float | None = None,
    error: float | None = None,
    horizon: float,
    members: int | None = 1,
    forced: Mapping[str, bool] | None = None,
    device: str | None = None,
    method: str = 'particles',
    on_pilot: Callable[[Pilot], None] = lambda _: None,
    clock: Callable[[], float] = wall_clock.monotonic,
    with_inputs: bool = False,
    adapted: Callable[[Accuracy], Accuracy] = lambda accuracy: accuracy,
) -> RunPlan:
    """Find the finest runs that fit in a wall time, or the coarsest below a numerical error.

    Pilots take at most 15 % of the time of the runs, except for the first two.

    The accuracy of the runs is ``adapted(preset_accuracy(plan.preset, spacing=plan.spacing))``,
    with the method.

    Args:
        scene: The scene; for an ensemble, the one with median inputs.
        within: Wall time for the runs [s]; None if ``error`` is given.
        error: Numerical error of the inundated area that the runs may have, a fraction; None if
            ``within`` is given.
        horizon: Simulated duration of each run [s].
        members: Number of successive runs; None for the number with the smallest error.
        forced: Effects forced on or off, by name.
        device: Warp device; None for the first GPU, or the CPU without one.
        method: Carriers of the lava. Cells are 2^k times as large as those of the terrain.
        on_pilot: Called after each pilot.
        clock: Returns the time [s]; ``time.process_time`` on a shared CPU.
        with_inputs: True for the effects of the uncertain quantities, ``RunPlan.inputs``.
        adapted: Changes the accuracy of a preset to that of the runs.

    Raises:
        LavaError: If an argument is not valid, the time is too short for the coarsest run, or no
            run has an error that small.
    """
    if error is None:
        within = validation.number('within', within, above=0.0, unit='s')
    else:
        error, within = validation.number('error', error, above=0.0, at_most=1.0), math.inf
    horizon = validation.number('horizon', horizon, above=0.0, unit='s')
    if members is not None and members < 1:
        raise LavaError('members', members, 'at least 1')
    # all pilots use the effects of the preset standard
    are_cells, standard = method == 'cells', standard_resolution(scene, horizon)
    first = UNKNOWN if math.isnan(standard.width) else min(
        max(FIRST_ACROSS / standard.across, COARSEST), 1.0
    )

    def accuracy(refinement: float) -> Accuracy:
        if are_cells:
            return cells_at(scene, refinement)
        return accuracy_at(scene, refinement, horizon)

    search = PilotSearch(
        scene, horizon, lambda refinement: adapted(accuracy(refinement)),
        effects_for(scene, forced, accuracy=accuracy(1.0), horizon=horizon),
        FIRST_CELLS if are_cells else first, device, clock, on_pilot,
        finer=2.0 if are_cells else FINER, doubles=are_cells,
    )
    search.compile_kernels()
    changes = changes_of(with_ranges(scene)) if with_inputs else {}

    def useful() -> float:
        """Return the refinement above which pilots are not needed."""
        wanted = finest_useful(search)
        return wanted if error is None else min(wanted, refinement_below(search, error))

    def budget() -> float:
        """Return the time for all pilots [s]."""
        if error is None:
            return PLANNING_FRACTION * within
        # the time of the runs is known after two pilots
        each = search.cost(useful()) if len(search.pilots) > 1 else math.inf
        return PLANNING_FRACTION * (members or 1) * each

    def reserved(left: float) -> float:
        """Return the time for coarse pilots with changed inputs [s]."""
        least = 2.0 * len(changes) * PILOT_MARGIN * search.pilots[0].wall_time
        return min(least, CHANGES_FRACTION * left)

    search.run_pilots(budget, useful, limit=within / (members or 1), reserved=reserved)
    if len(search.pilots) < 2:
        raise LavaError('within', within, 'a longer time: even the coarsest runs take more')
    inputs = change_inputs(search, budget(), changes)
    search.measure_finest_ground(budget() - search.spent)
    if error is None:
        refinement, count = choose(search, within, members)
    else:
        refinement, count = refinement_below(search, error), members or 1
        least = search.error(FINEST).inundated.total
        if least > error:
            expected = f'at least {100.0 * least:.2g} %, that of the finest particles; only finer '
            expected += 'cells of the terrain have a smaller error'
            raise LavaError('error', error, expected)
    wall_time = count * search.cost(refinement)
    if wall_time > within:
        expected = f'about {wall_time:.2g} s or more, the time of the coarsest {count} runs'
        raise LavaError('within', within, expected)
    chosen = search.option(refinement)
    presets = {
        name: _refinement_of(name, search, horizon, standard)
        for name, preset in PRESETS.items() if preset.target is not None
    }
    near = refinement * (2.0 if are_cells else ROW) ** np.arange(-4.0, 5.0)
    # one doubling beyond the pilots can be foreseen
    finest = max(2.0 * search.pilots[-1].refinement, refinement) if are_cells else FINEST
    rows = np.unique([
        *near[(near <= finest) & (near >= FIRST_CELLS * are_cells)], *presets.values()
    ])
    return RunPlan(
        preset=preset_below(refinement),
        spacing=chosen.spacing,
        refinement=refinement,
        members=count,
        wall_time=wall_time,
        numerical_error=chosen.error,
        sampling_error=sampling_error(count),
        is_finest=refinement >= 0.999 * finest_useful(search),
        pilots=search.count,
        spent=search.spent,
        options=tuple(map(search.option, rows.tolist())),
        presets=presets,
        inputs=inputs,
    )


def _refinement_of(
    preset: str, search: PilotSearch, horizon: float, standard: Resolution
) -> float:
    """Return the refinement of a preset with a target."""
    accuracy = replace(PRESETS[preset].accuracy, method=search.accuracy_at(1.0).method)
    expected = resolution_of(search.scene, accuracy, horizon=horizon)
    if search.doubles:
        return search.scene.terrain.resolution / expected.spacing
    return min(standard.spacing / spacing_of_preset(preset, search, expected), FINEST)


def change_inputs(
    search: PilotSearch, budget: float, changes: Mapping[str, tuple[Member, Member]]
) -> dict[str, InputChange]:
    """Return the effect of changes of the inputs, from coarse pilots while time remains.

    All have the same particle spacing: that of the finest pilot, except the last, for which they
    fit in the time.

    Args:
        search: Pilots of the scene as it is.
        budget: Time for all pilots [s].
        changes: Members with the two ends of each change, by the quantity.
    """
    scene, found, runs = with_ranges(search.scene), dict[str, InputChange](), 2.0 * PILOT_MARGIN
    fitting = [
        pilot for pilot in search.pilots[:-1]
        if runs * len(changes) * pilot.wall_time <= budget - search.spent
    ]
    base = fitting[-1] if fitting else search.pilots[0]
    for name, ends in changes.items():
        left = budget - search.spent
        if runs * base.wall_time > left:
            break
        scenes = [member_scene(scene, member, rough=any(member.seed)) for member in ends]
        pilots = [search.run(one, base.refinement, left, is_told=False) for one in scenes]
        low, high = (
            None if pilot is None else np.asarray(pilot.areas.inundated) for pilot in pilots
        )
        if low is not None and high is not None:
            growth = float(high.sum()) / max(float(low.sum()), 1e-9) - 1.0
            found[name] = InputChange(growth, difference(low, high))
    return found


def finest_useful(search: PilotSearch) -> float:
    """Return the refinement above which the error hardly decreases."""
    refinement = search.refinement_for(lambda ground: USEFUL * ground)
    return min(max(refinement, search.first), FINEST)


def refinement_below(search: PilotSearch, error: float) -> float:
    """Return the smallest refinement with at most an error of the inundated area, or FINEST."""
    found = (step for step in search.steps(FINEST) if search.error(step).inundated.total <= error)
    return next(found, FINEST)


def choose(search: PilotSearch, within: float, members: int | None) -> tuple[float, int]:
    """Choose the refinement and the members that fit in the time with the smallest error."""
    best, least = (search.first, members or 1), math.inf
    for refinement in search.steps(finest_useful(search)):
        each = max(search.cost(refinement), 1e-9)
        fitting = int(min(PLANNED_TIME_FRACTION * within / each, _MAX_MEMBERS))
        count = fitting if members is None else members
        if not 1 <= count <= fitting:
            continue
        error = math.hypot(search.error(refinement).inundated.total, sampling_error(count))
        # if errors are equal, prefer the finer run
        if error <= least:
            best, least = (refinement, count), error
    return best


def sampling_error(members: int) -> float:
    """Return the standard error of a probability of one half, 0 for a single run."""
    return 0.5 / math.sqrt(members) if members > 1 else 0.0
