# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs of the members of an ensemble, one at a time or as a batch on a GPU."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
import math
from typing import Any, TYPE_CHECKING

import numpy as np

from lava_ros import validation
from lava_ros.effects import compatible, EFFECTS, Effects, possible
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
from lava_ros.simulation.output.checkpoint import Checkpoint
from lava_ros.simulation.resolution import resolved_accuracy
from lava_ros.simulation.selection import effects_for

if TYPE_CHECKING:
    from lava_ros.simulation.simulation import Simulation

#: Maximum and minimum number of samples of the flow in a run, and their interval [s] if that is
#: possible. Half of the interval is the error of an arrival; a sample costs as much as one stage
#: of a time step.
MAX_SAMPLES, MIN_SAMPLES, SAMPLE_INTERVAL = 120, 20, 60.0

#: Lava has arrived where its thickness is at or above this value [m].
THRESHOLD = 0.1

#: Quantiles for which effects are chosen. An effect that only fewer members call for would slow
#: down all, and matters little to these, because effects do not set in abruptly.
_ENDS = (0.1, 0.9)

#: Maximum number of times that a displacement is halved before the vent is not displaced.
_HALVINGS = 12

#: Memory of a member for each cell of the terrain [bytes].
_BYTES = 64


@dataclass(frozen=True, eq=False)
class Plan:
    """Common properties of all members of an ensemble.

    Attributes:
        scene: The scene before drawing.
        horizon: Simulated duration of each member [s].
        accuracy: The resolution.
        effects: The effects that are on.
        threshold: Lava has arrived where its thickness is at or above this value [m].
        looks: Number of samples of the flow, evenly spaced up to the horizon, each at the end of
            the time step in which it is due.
        start: State from which all members start, at time 0; None for the scene without lava.
        forced: Effects that the user forces on or off, by name. If None, sentinels do not review
            the effects.
        switched_on: Effects that are on because sentinels have called for them.
    """

    scene: Scene
    horizon: float
    accuracy: Accuracy
    effects: Effects
    threshold: float = THRESHOLD
    looks: int = MAX_SAMPLES
    start: Checkpoint | None = None
    forced: Mapping[str, bool] | None = None
    switched_on: tuple[CalledEffect, ...] = ()

    @property
    def interval(self) -> float:
        """Time between two samples [s]."""
        return self.horizon / self.looks

    def switching_on(self, called: Sequence[CalledEffect]) -> 'Plan':
        """Return the plan with the effects that sentinels have called for."""
        effects = replace(self.effects, **{item.effect: True for item in called})
        return replace(self, effects=effects, switched_on=(*self.switched_on, *called))

    def explain_effects(self) -> dict[str, str]:
        """Return ``on`` or ``off``, and the reason if known, of each effect that is chosen."""
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
        index: Number of the member.
        arrival: Time at which lava reached the threshold thickness [s], float32, shape [rows,
            columns] of the part; NaN if it did not before the horizon.
        peak: Largest thickness [m], float32, same shape; 0 without lava.
        left: Fraction of the emitted volume that has left the map.
        corner: Row and column of the part's first cell.
        called: Effects that the flow of a sentinel calls for although they are off in its plan.
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
    """Plan an ensemble that starts at time 0.

    An effect is on for all members if about a tenth of them are expected to call for it because of
    one of their values. Sentinels review this choice on their flow (``sentinels``).

    Args:
        scene: The scene.
        horizon: Simulated duration of each member [s].
        accuracy: The resolution; None for automatic.
        effects: Effects forced on or off, by name.
        threshold: Lava has arrived where its thickness is at or above this value [m].
        looks: Number of samples of the flow; None to derive it from the horizon.

    Raises:
        LavaError: If an argument is not valid.
    """
    horizon = validation.number('horizon', horizon, above=0.0, unit='s')
    threshold, looks = _sampling(threshold, looks, horizon)
    # one spacing for all members
    accuracy = resolved_accuracy(accuracy or Accuracy(), median_scene(scene), horizon=horizon)
    chosen = [
        effects_for(one, effects, accuracy=accuracy, horizon=horizon)
        for one in (scene, *_end_scenes(scene))
    ]
    called_for = {name for one in chosen for name in one}
    # of effects that exclude each other, prefer the one that the scene itself calls for
    together = compatible((*chosen[0], *(name for name in EFFECTS if name in called_for)))
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

    Members have the resolution and the effects of the simulation, which reviews them itself. The
    properties drawn for a member apply after the checkpoint ``start``. The other arguments are as
    in ``make_plan``.

    Raises:
        LavaError: If an argument is not valid.
    """
    horizon = validation.number('horizon', horizon, above=0.0, unit='s')
    threshold, looks = _sampling(threshold, looks, horizon)
    return Plan(start.scene, horizon, start.accuracy, start.effects, threshold, looks, start)


def member_scene(scene: Scene, member: Member, *, rough: bool = True) -> Scene:
    """Return the scene of a member.

    ``rough`` adds the errors of the terrain, which is slow. A displacement that would move a vent
    off the terrain is halved until it does not.

    Raises:
        LavaError: If the drawn values do not make a valid scene; the message names the member.
    """
    try:
        roughness = scene.uncertainty.terrain
        if rough and roughness is not None:
            scene = scene.on(lambda terrain: rough_terrain(terrain, roughness, member.seed))
        vents = scene.vents
        if member.eruption is not None:
            vents = erupting(vents, duration=member.eruption[0], volume=member.eruption[1])
        vents = tuple(_member_vent(vent, member, scene.terrain) for vent in vents)
        return replace(scene, vents=vents, lava=_member_lava(scene.lava, member))
    except LavaError as error:
        expected = f'{error.expected}; limits on its distribution keep it there'
        raise LavaError(
            f'{error.field} of member {member.index}', error.value, expected
        ) from error


def median_scene(scene: Scene) -> Scene:
    """Return the scene with every uncertain value at its median, except classes of eruptions."""
    uncertainty = scene.uncertainty
    drawn: dict[str, Any] = {
        name: distribution.quantile(0.5)
        for name, distribution in vars(uncertainty).items()
        if isinstance(distribution, Distribution)
    }
    constants = tuple((key, item.quantile(0.5)) for key, item in uncertainty.constants.items())
    return member_scene(scene, Member(0, **drawn, constants=constants), rough=False)


def check_members(scene: Scene, members: Sequence[Member]) -> None:
    """Check the scenes of members before any of them runs.

    Raises:
        LavaError: If a scene is not valid, or members have places and the scene does not have
            exactly one vent.
    """
    if not scene.vents and not scene.emplaced_flows:
        raise LavaError('scene.vents', [], 'a vent: without lava there is nothing to forecast')
    if any(member.place is not None for member in members) and len(scene.vents) != 1:
        expected = 'one vent with a susceptibility map: the vent defines '
        expected += 'the effusion rate, the map its position'
        raise LavaError('scene.vents', len(scene.vents), expected)
    for member in members:
        member_scene(scene, member, rough=False)


def batch_of(plan: Plan, device: str | None) -> int:
    """Return the number of members that run as one batch on a Warp device."""
    from lava_ros.simulation.batch import AT_ONCE
    from lava_ros.simulation.setup.defaults import device_of

    if not device_of(device).is_cuda:
        return 1
    fit = device_of(device).free_memory // (2 * _BYTES * plan.scene.terrain.elevation.size)
    return min(max(fit, 1), AT_ONCE)


def run_members(
    plan: Plan, members: Sequence[Member], *, device: str | None = None
) -> list[MemberFields]:
    """Run members from the plan's start to the horizon.

    If a sentinel calls for effects that are off, all members run again with these effects.
    ``device`` is the Warp device; None for the first GPU, or the CPU without one.

    Returns:
        The fields of the members, in their order.

    Raises:
        LavaError: If a member has no valid scene, or its simulation fails.
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
    """Run members in parts, so that the caller can do other work after each part.

    On a GPU they run as a batch; fast members finish first. The next member is taken from
    ``members`` when the batch has room for it.

    Args:
        plan: Plan of the members.
        members: The members.
        device: Warp device; None for the first GPU, or the CPU without one.
        max_particles: Maximum number of particles of a member, None for no limit.
        progress: Receives the fraction of the samples that each member has taken, by its number.

    Yields:
        The fields of a member that is finished, None after any other part.

    Raises:
        LavaError: If a member has no valid scene, or its simulation fails.
    """
    # the solver loads Warp, which drawing and merging members do not need
    from lava_ros.simulation.batch import side_by_side
    from lava_ros.simulation.setup.defaults import device_of

    done: list[MemberFields] = []

    def route(member: Member) -> Iterator[None]:
        run = MemberRun(plan, member, device=device, max_particles=max_particles)
        while not run.is_done:
            yield from run.advancing()
            if progress is not None:
                progress[member.index] = run.progress
        done.append(run.fields())
        # yield the fields before the next member begins
        yield

    routes, at_once = map(route, members), batch_of(plan, device)
    for _ in side_by_side(routes, str(device_of(device)), at_once=at_once):
        yield from done
        done.clear()
        yield None
    yield from done


class MemberRun(Looking):
    """A run of a member from the plan's start to the horizon."""

    def __init__(
        self, plan: Plan, member: Member, *, device: str | None, max_particles: int | None = None
    ) -> None:
        """Start the member's simulation.

        Raises:
            LavaError: If the member has no valid scene, or as in ``advance``.
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
                # exactly the horizon, without a rounding error
                start + plan.horizon,
            ],
            threshold=plan.threshold,
            max_particles=max_particles,
            of=f' of member {member.index}',
        )

    def fields(self) -> MemberFields:
        """Return the fields so far."""
        seen = self.seen(where_wet=True)
        arrival = (seen.arrival - self._start).astype(np.float32)
        budget = self.simulation.budget()
        left = min(max(budget.left / max(budget.emitted, 1e-9), 0.0), 1.0)
        return MemberFields(
            self._index, arrival, np.nan_to_num(seen.thickness), left, seen.corner, self._called
        )

    def _note_look(self, time: float) -> None:
        super()._note_look(time)
        later = tuple(fraction for fraction in self._reviews if fraction > self.progress)
        if len(later) < len(self._reviews):
            self._called = find_called(
                self.simulation, self._forced, member=self._index, start=self._start
            )
            # stop at the first call: the effects would have changed the flow of later reviews
            self._reviews = () if self._called else later


def _started(plan: Plan, member: Member, device: str | None) -> 'Simulation':
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
    # resume with the old vents and then change them, because a new discharge applies from then on
    before = replace(scene, vents=plan.scene.vents)
    simulation = Simulation.resume(
        replace(plan.start, scene=before, forced=None), device=device
    )
    simulation.set_vents(scene.vents)
    return simulation


def _sampling(threshold: float, looks: int | None, horizon: float) -> tuple[float, int]:
    threshold = validation.number('threshold', threshold, above=0.0, unit='m')
    if looks is None:
        looks = min(max(math.ceil(horizon / SAMPLE_INTERVAL), MIN_SAMPLES), MAX_SAMPLES)
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
    """Move a vent's centre to a place; a fissure is shortened to fit on the terrain."""
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
    """Return scenes with one uncertain quantity each at a quantile of ``_ENDS``."""
    uncertainty, drawn = scene.uncertainty, list[dict[str, Any]]()
    for fraction in _ENDS:
        for name, distribution in vars(uncertainty).items():
            if isinstance(distribution, Distribution):
                drawn.append({name: distribution.quantile(fraction)})
        for name, distribution in uncertainty.constants.items():
            drawn.append({'constants': ((name, distribution.quantile(fraction)),)})
        for kind in uncertainty.eruption:
            ends = kind.duration.quantile(fraction), kind.volume.quantile(fraction)
            drawn.append({'eruption': ends})
    return [member_scene(scene, Member(0, **values), rough=False) for values in drawn]
