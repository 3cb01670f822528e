# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs of the members of an ensemble, one at a time or as a batch on a GPU."""

from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
import math
from typing import TYPE_CHECKING

import numpy as np

from lava_ros import validation
from lava_ros.effects import compatible, EFFECTS, Effects
from lava_ros.forecast.member_scenes import end_scenes, median_scene, member_scene
from lava_ros.forecast.sampling import Member
from lava_ros.forecast.sentinels import (
    CalledEffect,
    find_called,
    is_sentinel,
    log_called,
    REVIEWS,
    Sentinels,
)
from lava_ros.layers.spacing_error import COARSER, has_pair, pair_of, SpacingPair
from lava_ros.runs.drive import driving
from lava_ros.runs.sinks import PeakSink
from lava_ros.scene import Scene, Terrain
from lava_ros.scene.from_outline import with_outline
from lava_ros.scene.ranges import with_ranges
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.output.checkpoint import Checkpoint
from lava_ros.simulation.output.inundation import footprint_cells, TOUCHED
from lava_ros.simulation.resolution import resolved_accuracy
from lava_ros.simulation.selection import effects_for

if TYPE_CHECKING:
    from lava_ros.simulation.simulation import Simulation

#: Maximum and minimum number of samples of the flow in a run, and their interval [s] if that is
#: possible. Half of the interval is the error of an arrival; a sample costs as much as one stage
#: of a time step.
MAX_SAMPLES, MIN_SAMPLES, SAMPLE_INTERVAL = 120, 20, 60.0


@dataclass(frozen=True, eq=False)
class Plan:
    """Common properties of all members of an ensemble.

    Attributes:
        scene: The scene before drawing.
        horizon: Simulated duration of each member [s].
        accuracy: The resolution.
        effects: The effects that are on.
        samples: Number of samples of the flow, evenly spaced up to the horizon, each at the end of
            the time step in which it is due.
        start: State from which all members start, at time 0; None for the scene without lava.
        forced: Effects that the user forces on or off, by name. If None, sentinels do not review
            the effects.
        switched_on: Effects that are on because sentinels have called for them.
        covered: Fraction of each cell that lava had covered before the start, float32, shape
            [rows, columns]; None for no more than the lava of the scene covers.
    """

    scene: Scene
    horizon: float
    accuracy: Accuracy
    effects: Effects
    samples: int = MAX_SAMPLES
    start: Checkpoint | None = None
    forced: Mapping[str, bool] | None = None
    switched_on: tuple[CalledEffect, ...] = ()
    covered: np.ndarray | None = None

    @property
    def threshold(self) -> float:
        """Minimum thickness of lava that has arrived [m]."""
        return self.accuracy.inundation_threshold

    def ground_at(self, time: float) -> Terrain:
        """Return the ground at a time since the start [s], on which its maps are."""
        begun = 0.0 if self.start is None else self.start.time
        return self.scene.ground_at(begun + time)

    @property
    def interval(self) -> float:
        """Time between two samples [s]."""
        return self.horizon / self.samples

    def has_pair(self, member: Member) -> bool:
        """Return True if a member also runs with particles farther apart, or larger cells.

        Members of a running simulation continue with its lava, and have no pairs.
        """
        return self.start is None and has_pair(member.index)

    @property
    def coarser(self) -> 'Plan':
        """The plan of the coarser runs of pairs, which no sentinel reviews."""
        assert self.accuracy.spacing is not None
        ratio = COARSER[self.accuracy.method]
        accuracy = replace(self.accuracy, spacing=ratio * self.accuracy.spacing)
        return replace(self, accuracy=accuracy, forced=None)

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
        arrival: Time at which lava at or above the threshold touched the cell [s], float32, shape
            [rows, columns] of the part; NaN if it did not before the horizon.
        half_inundated: Time at which it had covered half of the cell [s], as ``arrival``.
        inundated: Fraction of the cell that it has covered by the horizon, float32, same shape; 0
            where the terrain then has no data.
        peak: Largest thickness [m], float32, same shape; 0 without lava or data.
        left: Fraction of the emitted volume that has left the map.
        corner: Row and column of the part's first cell.
        called: Effects that the flow of a sentinel needs although they are off in its plan.
        pair: Differences of a run of the member with particles farther apart; None without one.
    """

    index: int
    arrival: np.ndarray
    half_inundated: np.ndarray
    inundated: np.ndarray
    peak: np.ndarray
    left: float = 0.0
    corner: tuple[int, int] = (0, 0)
    called: tuple[CalledEffect, ...] = ()
    pair: SpacingPair | None = None

    def on(self, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        """Return arrival times and covered fractions of all cells of a terrain of a shape."""
        arrival, inundated = np.full(shape, np.nan, np.float32), np.zeros(shape, np.float32)
        rows, columns = (
            slice(first, first + size)
            for first, size in zip(self.corner, self.arrival.shape, strict=True)
        )
        arrival[rows, columns], inundated[rows, columns] = self.arrival, self.inundated
        return arrival, inundated

    def with_covered(self, covered: np.ndarray) -> 'MemberFields':
        """Return the fields with the lava that had covered parts of cells before the start.

        Args:
            covered: Fraction of each cell of the terrain, float32, shape [rows, columns].
        """
        touched = np.argwhere(covered >= TOUCHED)
        if not len(touched):
            return self
        corner = np.minimum(self.corner, touched.min(axis=0))
        ends = np.maximum(np.add(self.corner, self.arrival.shape), touched.max(axis=0) + 1)
        part = covered[corner[0] : ends[0], corner[1] : ends[1]]
        own = np.subtract(self.corner, corner)
        pads = list(zip(own, ends - corner - own - self.arrival.shape, strict=True))

        def on_part(values: np.ndarray, elsewhere: float) -> np.ndarray:
            return np.pad(values, pads, constant_values=elsewhere)

        return replace(
            self,
            arrival=np.where(part >= TOUCHED, np.float32(0.0), on_part(self.arrival, np.nan)),
            half_inundated=np.where(
                footprint_cells(part), np.float32(0.0), on_part(self.half_inundated, np.nan)
            ),
            inundated=with_outline(on_part(self.inundated, 0.0), part),
            peak=on_part(self.peak, 0.0),
            corner=(int(corner[0]), int(corner[1])),
        )


def make_plan(
    scene: Scene,
    *,
    horizon: float,
    accuracy: Accuracy | None = None,
    effects: Mapping[str, bool] | None = None,
    threshold: float | None = None,
    samples: int | None = None,
) -> Plan:
    """Plan an ensemble that starts at time 0.

    An effect is on for all members if about a tenth of them are expected to need it because of one
    of their values. Sentinels review this choice on their flow (``sentinels``).

    Args:
        scene: The scene; open quantities have their usual ranges (``ranges.with_ranges``).
        horizon: Simulated duration of each member [s].
        accuracy: The resolution; None for automatic.
        effects: Effects forced on or off, by name.
        threshold: Lava has arrived where its thickness is at or above this value [m]; None for the
            automatic one of the accuracy.
        samples: Number of samples of the flow; None to derive it from the horizon.

    Raises:
        LavaError: If an argument is not valid.
    """
    horizon = validation.number('horizon', horizon, above=0.0, unit='s')
    samples = _sampling(samples, horizon)
    # one spacing for all members, chosen for the values of the scene
    median, scene = median_scene(scene), with_ranges(scene)
    accuracy = resolved_accuracy(accuracy or Accuracy(), median, effects, horizon=horizon)
    if threshold is not None:
        threshold = validation.number('threshold', threshold, above=0.0, unit='m')
        accuracy = replace(accuracy, threshold=threshold)
    chosen = [
        effects_for(one, effects, accuracy=accuracy, horizon=horizon)
        for one in (scene, *end_scenes(scene))
    ]
    called_for = {name for one in chosen for name in one}
    # if effects exclude each other, prefer the one that the scene itself needs
    together = compatible((*chosen[0], *(name for name in EFFECTS if name in called_for)))
    forced = dict(effects or {})
    return Plan(scene, horizon, accuracy, together, samples, forced=forced)


def plan_from(
    start: Checkpoint,
    *,
    horizon: float,
    threshold: float | None = None,
    samples: int | None = None,
) -> Plan:
    """Plan an ensemble that continues a running simulation for ``horizon`` [s].

    Members have the resolution and the effects of the simulation, which reviews its effects
    itself. The properties drawn for a member apply after the checkpoint ``start``. The other
    arguments are as in ``make_plan``.

    Raises:
        LavaError: If an argument is not valid.
    """
    horizon = validation.number('horizon', horizon, above=0.0, unit='s')
    samples = _sampling(samples, horizon)
    if threshold is not None:
        start = start.counting(validation.number('threshold', threshold, above=0.0, unit='m'))
    scene = with_ranges(start.scene)
    return Plan(scene, horizon, start.accuracy, start.effects, samples, start)


def batch_of(plan: Plan, device: str | None, sharing: int = 1) -> int:
    """Return the number of members that run as one batch on a Warp device.

    ``sharing`` is the number of processes that run members on it.
    """
    from lava_ros.simulation.batch import AT_ONCE
    from lava_ros.simulation.setup.defaults import device_of
    from lava_ros.simulation.simulation import SOLVERS

    accuracy, start = plan.accuracy, plan.start
    used = device_of(device, accuracy.method)
    if not used.is_cuda:
        return 1
    begun, volume = (0.0, 0.0) if start is None else (start.time, start.emitted)
    volume += sum(vent.volume_between(begun, begun + plan.horizon) for vent in plan.scene.vents)
    needed = SOLVERS[accuracy.method].bytes_for(plan.scene, plan.effects, accuracy, volume)
    # half of the memory, for members with more lava than the median and for their neighbour grids
    return min(max(used.free_memory // (2 * sharing * needed), 1), AT_ONCE)


def run_members(
    plan: Plan, members: Sequence[Member], *, device: str | None = None
) -> list[MemberFields]:
    """Run members from the plan's start to the horizon.

    If a sentinel needs effects that are off, all members run again with these effects.
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
    sharing: int = 1,
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
        sharing: Number of processes that run members on the device.

    Yields:
        The fields of a member that is finished, None after any other part.

    Raises:
        LavaError: If a member has no valid scene, or its simulation fails.
    """
    # the solver loads Warp, which drawing and merging members do not need
    from lava_ros.simulation.batch import side_by_side
    from lava_ros.simulation.setup.defaults import device_of

    done: list[MemberFields] = []
    # members and the coarser runs of their pairs, until the other one ends, and members without
    waiting: dict[int, MemberFields] = {}
    coarse: dict[int, MemberFields] = {}
    without_pair: set[int] = set()

    def end(index: int) -> None:
        if index in waiting and (index in coarse or index in without_pair):
            fields = waiting.pop(index)
            if (coarser := coarse.pop(index, None)) is not None:
                shape = plan.scene.terrain.shape
                fields = replace(fields, pair=pair_of(*fields.on(shape), *coarser.on(shape)))
            done.append(fields)

    def route(member: Member) -> Iterator[None]:
        known = {} if progress is None else progress
        fields = yield from _fields_of(plan, member, device, max_particles, known)
        waiting[member.index] = fields
        if fields.called or not plan.has_pair(member):
            without_pair.add(member.index)
        end(member.index)
        # yield the fields before the next member begins
        yield

    def coarser_route(member: Member) -> Iterator[None]:
        # on a CPU it begins after its member, on a GPU both run side by side
        if member.index not in without_pair:
            fields = yield from _fields_of(plan.coarser, member, device, None, {})
            if member.index not in without_pair:
                coarse[member.index] = fields
                end(member.index)
                yield

    def routes_of(members: Iterable[Member]) -> Iterator[Iterator[None]]:
        for member in members:
            yield route(member)
            if plan.has_pair(member):
                yield coarser_route(member)

    routes, at_once = routes_of(members), batch_of(plan, device, sharing)
    used = device_of(device, plan.accuracy.method)
    for _ in side_by_side(routes, str(used), at_once=at_once):
        yield from done
        done.clear()
        yield None
    yield from done


def _fields_of(
    plan: Plan, member: Member, device: str | None, max_particles: int | None,
    progress: dict[int, float],
) -> Generator[None, None, MemberFields]:
    """Run a member in parts, and return its fields."""
    simulation = _started(plan, member, device)
    sink = _MemberSink(plan, member, simulation, max_particles=max_particles)
    for _ in driving(simulation, sink.times[-1], [sink]):
        progress[member.index] = sink.progress
        yield
    progress[member.index] = sink.progress
    return sink.fields(simulation)


class _MemberSink(PeakSink):
    """Peaks and arrivals of a member, and the reviews of its effects if it is a sentinel."""

    def __init__(
        self, plan: Plan, member: Member, simulation: 'Simulation', *, max_particles: int | None
    ) -> None:
        start = simulation.time
        self._index, self._start = member.index, start
        self._forced, self._covered = plan.forced or {}, plan.covered
        self._called: tuple[CalledEffect, ...] = ()
        is_reviewed = plan.forced is not None and is_sentinel(member.index)
        self._reviews: tuple[float, ...] = REVIEWS if is_reviewed else ()
        super().__init__(
            simulation,
            [
                *(start + number * plan.interval for number in range(1, plan.samples)),
                # exactly the horizon, without a rounding error
                start + plan.horizon,
            ],
            threshold=plan.threshold,
            max_particles=max_particles,
            of=f' of member {member.index}',
        )

    def observe(self, simulation: 'Simulation', time: float) -> Iterator[None]:
        """Add the flow to the peaks, and review the effects if that is due."""
        yield from super().observe(simulation, time)
        later = tuple(fraction for fraction in self._reviews if fraction > self.progress)
        if len(later) < len(self._reviews):
            self._called = find_called(
                simulation, self._forced, member=self._index, start=self._start
            )
            # stop at the first review that needs more effects: they would have changed the later
            # flow
            self._reviews = () if self._called else later

    def fields(self, simulation: 'Simulation') -> MemberFields:
        """Return the fields so far."""
        seen = self.seen(simulation, where_wet=True)
        arrival, half_inundated = (
            (times - self._start).astype(np.float32)
            for times in (seen.arrival, seen.half_inundated)
        )
        budget = simulation.budget()
        lost = budget.lost - budget.lost_in_sea
        left = min(max(lost / max(budget.emitted, 1e-9), 0.0), 1.0)
        fields = MemberFields(
            self._index, arrival, half_inundated, np.nan_to_num(seen.inundated),
            np.nan_to_num(seen.thickness), left, seen.corner, self._called,
        )
        return fields if self._covered is None else fields.with_covered(self._covered)


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


def _sampling(samples: int | None, horizon: float) -> int:
    if samples is None:
        samples = min(max(math.ceil(horizon / SAMPLE_INTERVAL), MIN_SAMPLES), MAX_SAMPLES)
    return validation.whole('samples', samples, at_least=1, at_most=10_000)
