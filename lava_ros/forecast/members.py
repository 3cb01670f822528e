# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs of members: one interface, whether they run one after the other or side by side."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
import math
from typing import Any, TYPE_CHECKING

import numpy as np

from lava_ros import validation
from lava_ros.effects import EFFECTS, Effects, possible
from lava_ros.errors import LavaError
from lava_ros.forecast.lookahead import Looking
from lava_ros.forecast.sampling import Member, rough_terrain
from lava_ros.forecast.sentinels import (
    CalledEffect,
    find_called,
    is_sentinel,
    log_called,
    REVIEWS,
    Sentinels,
)
from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.scene.lava import Lava
from lava_ros.scene.uncertainty import Distribution
from lava_ros.scene.vents import erupting
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.checkpoint import Checkpoint
from lava_ros.simulation.resolution import resolved_accuracy
from lava_ros.simulation.selection import effects_for

if TYPE_CHECKING:
    from lava_ros.simulation.simulation import Simulation

#: Most and fewest looks at the flow in a run, and the time between two where that lies between: an
#: arrival is known to half of it, and a look takes as long as a stage of a step.
MOST_LOOKS, FEWEST_LOOKS, LOOK = 120, 20, 60.0

#: Thickness from which on lava has arrived [m].
THRESHOLD = 0.1

#: Shares of a distribution at which the choice of effects looks: what fewer members call for would
#: be paid for by all, and matters little to those, for no effect begins with a jump.
_ENDS = (0.1, 0.9)

#: Times that a displacement is halved before the vent stays where it was.
_HALVINGS = 12

#: Effects of which only one can be on.
_RIVALS = ('inertia', 'green', 'helmholtz')

#: Bytes that a member takes for each cell of the terrain.
_BYTES = 64


@dataclass(frozen=True, eq=False)
class Plan:
    """What all members of an ensemble have in common.

    Attributes:
        scene: The scene without anything drawn.
        horizon: How far ahead each member runs [s].
        accuracy: The resolution.
        effects: The physics, the same for all members.
        threshold: Thickness from which on lava has arrived [m].
        looks: Looks at the flow, evenly spaced up to the horizon, each at the end of the time step
            in which it is due.
        start: Where all members start; None: the scene before there is lava. Times count from it.
        forced: Effects that the user forces on or off, by name; None: sentinels do not review the
            effects.
        switched_on: The effects that sentinels have called for, and that are on because of that.
    """

    scene: Scene
    horizon: float
    accuracy: Accuracy
    effects: Effects
    threshold: float = THRESHOLD
    looks: int = MOST_LOOKS
    start: Checkpoint | None = None
    forced: Mapping[str, bool] | None = None
    switched_on: tuple[CalledEffect, ...] = ()

    @property
    def interval(self) -> float:
        """Time between two looks [s]."""
        return self.horizon / self.looks

    def switching_on(self, called: Sequence[CalledEffect]) -> 'Plan':
        """Return this plan with effects that sentinels have called for, on from the start."""
        effects = replace(self.effects, **{item.effect: True for item in called})
        return replace(self, effects=effects, switched_on=(*self.switched_on, *called))

    def explain_effects(self) -> dict[str, str]:
        """Return for each effect that can be chosen whether it is on, and the reason if known."""
        reasons = {item.effect: f': {item.reason}' for item in self.switched_on}
        reasons |= dict.fromkeys(self.forced or {}, ': forced')
        return {
            name: ('on' if name in self.effects else 'off') + reasons.get(name, '')
            for name, item in EFFECTS.items()
            if item.number is not None
        }


@dataclass(frozen=True, eq=False)
class MemberFields:
    """The result of a member on the part of the terrain that its lava reached.

    Attributes:
        index: The member's number.
        arrival: Time at which lava reached the threshold thickness [s], float32, shape [rows,
            columns] of the part; NaN where it did not up to the horizon.
        peak: Largest thickness [m], float32, same shape; 0 without lava.
        left: Share of the emitted volume that has left the map.
        corner: Row and column of the part's first cell.
        called: The effects that the flow of a sentinel calls for, and that are off in its plan.
    """

    index: int
    arrival: np.ndarray
    peak: np.ndarray
    left: float = 0.0
    corner: tuple[int, int] = (0, 0)
    called: tuple[CalledEffect, ...] = ()


def make_plan(
    scene: Scene,
    *,
    horizon: float,
    accuracy: Accuracy | None = None,
    effects: Mapping[str, bool] | None = None,
    threshold: float = THRESHOLD,
    looks: int | None = None,
) -> Plan:
    """Settle what all members have in common.

    An effect that a tenth of the members are expected to call for, by one of their values, is on
    for all. Sentinels review this choice on their flow (``sentinels``).

    Args:
        scene: The scene.
        horizon: How far ahead each member runs [s].
        accuracy: The resolution; automatic when left out.
        effects: Effects forced on or off by name.
        threshold: Thickness from which on lava has arrived [m].
        looks: Looks at the flow; None: by the horizon.

    Raises:
        LavaError: An argument is not usable.
    """
    horizon = validation.number('horizon', horizon, above=0.0, unit='s')
    threshold, looks = _seen(threshold, looks, horizon)
    # one spacing for all members
    accuracy = resolved_accuracy(accuracy or Accuracy(), median_scene(scene), horizon=horizon)
    chosen = [
        effects_for(one, effects, accuracy=accuracy, horizon=horizon)
        for one in (scene, *_end_scenes(scene))
    ]
    called_for = {name for one in chosen for name in one}
    # of those that exclude each other the one of the scene itself, if it has one
    rivals = [name for name in _RIVALS if name in chosen[0]]
    rivals = rivals or [name for name in _RIVALS if name in called_for][:1]
    called_for -= set(_RIVALS) - set(rivals)
    together = Effects(**{name: name in called_for for name in EFFECTS})
    forced = dict(effects or {})
    return Plan(scene, horizon, accuracy, together, threshold, looks, forced=forced)


def plan_from(
    start: Checkpoint,
    *,
    horizon: float,
    threshold: float = THRESHOLD,
    looks: int | None = None,
) -> Plan:
    """Plan an ensemble that continues a running simulation for ``horizon`` [s].

    Members have the simulation's resolution and effects, which the simulation itself reviews; the
    properties drawn for a member apply from the checkpoint ``start`` on. The other arguments are
    those of ``make_plan``.

    Raises:
        LavaError: An argument is not usable.
    """
    horizon = validation.number('horizon', horizon, above=0.0, unit='s')
    threshold, looks = _seen(threshold, looks, horizon)
    return Plan(start.scene, horizon, start.accuracy, start.effects, threshold, looks, start)


def member_scene(scene: Scene, member: Member, *, rough: bool = True) -> Scene:
    """The scene of a member.

    ``rough`` adds the errors of the terrain, which takes time. A displacement that would move a
    vent off the terrain is halved until it does not.

    Raises:
        LavaError: The drawn values do not make a valid scene; the message names the member.
    """
    try:
        terrain = scene.terrain
        if rough and scene.uncertainty.terrain is not None:
            terrain = rough_terrain(terrain, scene.uncertainty.terrain, member.seed)
        vents = scene.vents
        if member.eruption is not None:
            vents = erupting(vents, duration=member.eruption[0], volume=member.eruption[1])
        vents = tuple(_member_vent(vent, member, scene.terrain) for vent in vents)
        return replace(scene, terrain=terrain, vents=vents, lava=_member_lava(scene.lava, member))
    except LavaError as error:
        right = f'{error.expected}; limits on its distribution keep it there'
        raise LavaError(f'{error.field} of member {member.index}', error.value, right) from error


def median_scene(scene: Scene) -> Scene:
    """The scene with every uncertain value at its median; classes of eruptions have none."""
    uncertainty = scene.uncertainty
    drawn: dict[str, Any] = {
        name: distribution.quantile(0.5)
        for name, distribution in vars(uncertainty).items()
        if isinstance(distribution, Distribution)
    }
    constants = tuple((key, item.quantile(0.5)) for key, item in uncertainty.constants.items())
    return member_scene(scene, Member(0, **drawn, constants=constants), rough=False)


def check_members(scene: Scene, members: Sequence[Member]) -> None:
    """Refuse members that make no scene, before any of them runs.

    Raises:
        LavaError: One makes none, or members have places and the scene not one vent to put there.
    """
    if not scene.vents:
        raise LavaError('scene.vents', [], 'a vent: without lava there is nothing to forecast')
    if any(member.place is not None for member in members) and len(scene.vents) != 1:
        right = 'one vent beside a susceptibility map: it says '
        right += 'how much lava comes out, the map says where'
        raise LavaError('scene.vents', len(scene.vents), right)
    for member in members:
        member_scene(scene, member, rough=False)


def batch_of(plan: Plan, device: str | None) -> int:
    """Members of a plan that go through their stages together on a Warp device."""
    from lava_ros.simulation.batch import AT_ONCE
    from lava_ros.simulation.defaults import device_of

    if not device_of(device).is_cuda:
        return 1
    fit = device_of(device).free_memory // (2 * _BYTES * plan.scene.terrain.elevation.size)
    return min(max(fit, 1), AT_ONCE)


def run_members(
    plan: Plan, members: Sequence[Member], *, device: str | None = None
) -> list[MemberFields]:
    """Run members from the plan's start to the horizon.

    Members run again for as long as a sentinel calls for effects that are off, with these effects
    on for all. ``device`` is the Warp device; None for the first GPU, or the CPU without one.

    Returns:
        The fields of the members, in their order.

    Raises:
        LavaError: A member has no valid scene, or its simulation fails.
    """
    while True:
        done = {item.index: item for item in running(plan, members, device=device) if item}
        sentinels = Sentinels(())
        for item in done.values():
            sentinels.note(item.index, item.called)
        if not sentinels.called:
            return [done[member.index] for member in members]
        log_called(sentinels.called)
        plan = plan.switching_on(sentinels.called)


def running(
    plan: Plan,
    members: Iterable[Member],
    *,
    device: str | None = None,
    max_particles: int | None = None,
    progress: dict[int, float] | None = None,
) -> Iterator[MemberFields | None]:
    """Run members in parts, with time for something else after each.

    On a GPU they go as a batch, and end in the order of what they cost. A member is asked for when
    there is room for it.

    Args:
        plan: What they have in common.
        members: The members.
        device: Warp device; None for the first GPU, or the CPU without one.
        max_particles: Most particles of a member, None for any number.
        progress: Is told the share of the looks that each member has taken, by its number.

    Yields:
        The fields of a member that is done, None after any other part.

    Raises:
        LavaError: A member has no valid scene, or its simulation fails.
    """
    # the solver loads Warp, which drawing and merging members do not need
    from lava_ros.simulation.batch import side_by_side
    from lava_ros.simulation.defaults import device_of

    done: list[MemberFields] = []

    def route(member: Member) -> Iterator[None]:
        run = MemberRun(plan, member, device=device, max_particles=max_particles)
        while not run.is_done:
            yield from run.advancing()
            if progress is not None:
                progress[member.index] = run.progress
        done.append(run.fields())
        # it is known before another one begins
        yield

    routes, at_once = map(route, members), batch_of(plan, device)
    for _ in side_by_side(routes, str(device_of(device)), at_once=at_once):
        yield from done
        done.clear()
        yield None
    yield from done


class MemberRun(Looking):
    """A member on its way from the plan's start to the horizon."""

    def __init__(
        self, plan: Plan, member: Member, *, device: str | None, max_particles: int | None = None
    ) -> None:
        """Start the member's simulation.

        Raises:
            LavaError: The member has no valid scene, or as in ``advance``.
        """
        simulation = _started(plan, member, device)
        start = simulation.time
        self._index, self._start = member.index, start
        self._forced = plan.forced or {}
        self._called: tuple[CalledEffect, ...] = ()
        is_reviewed = plan.forced is not None and is_sentinel(member.index)
        self._reviews: tuple[float, ...] = REVIEWS if is_reviewed else ()
        super().__init__(
            simulation,
            [
                *(start + look * plan.interval for look in range(1, plan.looks)),
                # exactly, however many looks there are
                start + plan.horizon,
            ],
            threshold=plan.threshold,
            max_particles=max_particles,
            of=f' of member {member.index}',
        )

    def fields(self) -> MemberFields:
        """What it has done to the cells so far."""
        seen = self.seen(where_wet=True)
        arrival = (seen.arrival - self._start).astype(np.float32)
        budget = self.simulation.budget()
        left = min(max(budget.left / max(budget.emitted, 1e-9), 0.0), 1.0)
        return MemberFields(
            self._index, arrival, np.nan_to_num(seen.thickness), left, seen.corner, self._called
        )

    def _note_look(self, time: float) -> None:
        super()._note_look(time)
        later = tuple(share for share in self._reviews if share > self.progress)
        if len(later) < len(self._reviews):
            self._called = find_called(
                self.simulation, self._forced, member=self._index, start=self._start
            )
            # what the first of them have not changed yet would mislead the others
            self._reviews = () if self._called else later


def _started(plan: Plan, member: Member, device: str | None) -> 'Simulation':
    """A member's simulation, where all of them start."""
    # the solver loads Warp, which drawing and merging members do not need
    from lava_ros.simulation.simulation import Simulation

    scene = member_scene(plan.scene, member)
    if plan.start is None:
        return Simulation(
            scene,
            effects=plan.effects,
            accuracy=plan.accuracy,
            device=device,
            horizon=plan.horizon,
        )
    # vents change once it goes on, for a discharge counts from when its vent has it
    before = replace(scene, vents=plan.scene.vents)
    simulation = Simulation.resume(
        replace(plan.start, scene=before, forced=None), device=device
    )
    simulation.set_vents(scene.vents)
    return simulation


def _seen(threshold: float, looks: int | None, horizon: float) -> tuple[float, int]:
    """Threshold and looks, clean."""
    threshold = validation.number('threshold', threshold, above=0.0, unit='m')
    if looks is None:
        looks = min(max(math.ceil(horizon / LOOK), FEWEST_LOOKS), MOST_LOOKS)
    return threshold, validation.whole('looks', looks, at_least=1, at_most=10_000)


def _member_lava(lava: Lava, member: Member) -> Lava:
    if member.constants:
        lava = replace(lava, **dict(member.constants))
    drawn = {'viscosity': lava.viscosity * member.viscosity}
    if lava.is_vft:
        drawn = {'vft_a': lava.vft_a + math.log10(member.viscosity)}
    if 'yielding' in possible(lava):
        drawn['yield_strength'] = lava.yield_strength * member.yield_strength
    return replace(lava, **drawn)


def _member_vent(vent: Vent, member: Member, terrain: Terrain) -> Vent:
    discharge: float | tuple[tuple[float, float], ...]
    if isinstance(vent.discharge, float):
        discharge = vent.discharge * member.discharge
    else:
        discharge = tuple((time, flux * member.discharge) for time, flux in vent.series)
    vent = replace(vent, discharge=discharge, temperature=vent.temperature + member.temperature)
    if member.place is not None:
        vent = _placed(vent, member.place, terrain)
    return _displaced(vent, member.displacement, terrain)


def _placed(vent: Vent, place: tuple[float, float], terrain: Terrain) -> Vent:
    """The vent with its middle at a place; a fissure is as long as the terrain has room for."""
    if vent.end is None:
        return replace(vent, position=place)
    half = [0.5 * (end - start) for start, end in zip(vent.position, vent.end, strict=True)]
    for _ in range(_HALVINGS):
        ends = [
            (place[0] + sign * half[0], place[1] + sign * half[1]) for sign in (-1.0, 1.0)
        ]
        if all(terrain.covers(*end) for end in ends):
            return replace(vent, position=ends[0], end=ends[1])
        half = [0.5 * value for value in half]
    return replace(vent, position=place, end=None)


def _displaced(vent: Vent, shift: tuple[float, float], terrain: Terrain) -> Vent:
    if not any(shift):
        return vent
    for halving in range(_HALVINGS):
        dx, dy = (0.5**halving * value for value in shift)
        position = (vent.position[0] + dx, vent.position[1] + dy)
        end = None if vent.end is None else (vent.end[0] + dx, vent.end[1] + dy)
        if terrain.covers(*position) and (end is None or terrain.covers(*end)):
            return replace(vent, position=position, end=end)
    return vent


def _end_scenes(scene: Scene) -> list[Scene]:
    """The scene with one uncertain quantity near the one or the other end of its values."""
    uncertainty, drawn = scene.uncertainty, list[dict[str, Any]]()
    for share in _ENDS:
        for name, distribution in vars(uncertainty).items():
            if isinstance(distribution, Distribution):
                drawn.append({name: distribution.quantile(share)})
        for name, distribution in uncertainty.constants.items():
            drawn.append({'constants': ((name, distribution.quantile(share)),)})
        for kind in uncertainty.eruption:
            ends = kind.duration.quantile(share), kind.volume.quantile(share)
            drawn.append({'eruption': ends})
    return [member_scene(scene, Member(0, **values), rough=False) for values in drawn]
