# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulation of a scene: algorithm 1 of the paper with a step that follows the limits."""

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from dataclasses import asdict, replace
from functools import partial
import math
import time as wall_clock
from typing import Any

import numpy as np
import warp as wp

from lava_ros import validation
from lava_ros.effects import Effects, excluded_by
from lava_ros.effects.scales import Scales
from lava_ros.errors import LavaError
from lava_ros.scene import check_vents, Scene, Terrain, Vent
from lava_ros.scene.vents import match_vents
from lava_ros.simulation import state as at
from lava_ros.simulation.accuracy import Accuracy, COVERED
from lava_ros.simulation.backend.graph import Launch
from lava_ros.simulation.backend.streams import read, Reader
from lava_ros.simulation.backend.threads import is_alone
from lava_ros.simulation.batch import at_work, Batch
from lava_ros.simulation.budget import VolumeBudget
from lava_ros.simulation.checkpoint import Checkpoint, restore, take
from lava_ros.simulation.defaults import device_of, formulated
from lava_ros.simulation.diagnostics import FlowDiagnostics, moment_of, snapshot_of
from lava_ros.simulation.looks import Looks, Seen
from lava_ros.simulation.measurement import measure_columns
from lava_ros.simulation.neighbors import NeighborGrid
from lava_ros.simulation.rasterization import Raster
from lava_ros.simulation.resolution import (
    is_extended,
    Resolution,
    resolution_of,
    resolved_accuracy,
)
from lava_ros.simulation.review import next_review, Review, watched_effects
from lava_ros.simulation.selection import (
    decide,
    decide_by,
    Decision,
    effects_for,
    HORIZON,
    noted,
    scales_of,
)
from lava_ros.simulation.snapshot import (
    Particles,
    ParticleSample,
    PendingSnapshot,
    rows_of,
    Snapshot,
)
from lava_ros.simulation.stage import Stage
from lava_ros.simulation.state import centre_of, count_in, room_for, State
from lava_ros.simulation.terrain import sampled, StaggeredTerrain
from lava_ros.simulation.vents import check_rates, Emission, VentSet

#: Particles there is room for at the start.
_FIRST_CAPACITY = 4096

#: Stages between two looks at the clock, by whether it is a GPU.
_GRAPH_STAGES = {True: 16, False: 1}

#: Launches under way at a time, by whether it is a GPU, as long as the target is far enough away.
_UNDER_WAY = {True: 2, False: 1}

#: Share of what a launch gains that rounding may make of it.
_ROUNDING = 1e-3

#: Places of no particles.
_NOWHERE = np.empty((0, 2))

#: Copies of the clock and the counts of a ``State``.
_Look = tuple[np.ndarray, np.ndarray]


class Simulation:
    """Lava flowing over a terrain.

    Attributes:
        scene: The scene as it is now.
        effects: The physics that is switched on.
        accuracy: The resolution, with every automatic value filled in.
        device: Name of the Warp device.
        particle_volume: Volume of the particles that vents emit [m3].
        radius: Radius of the smoothing kernel [m].
    """

    def __init__(
        self,
        scene: Scene,
        *,
        effects: Effects | Mapping[str, bool] | None = None,
        accuracy: Accuracy | None = None,
        device: str | None = None,
        horizon: float = HORIZON,
        particles: Particles | None = None,
    ) -> None:
        """Prepare a simulation at time 0.

        Args:
            scene: Terrain, vents and lava.
            effects: The physics to switch on. When left out it is chosen from the scene, and again
                when vents or terrain change it; a mapping forces some effects on or off by name.
            accuracy: The resolution; automatic when left out.
            device: ``cpu`` or ``cuda:0``; the first CUDA device when there is one, else the CPU.
            horizon: How far ahead the choice of effects and of the spacing looks [s].
            particles: Lava that is on the terrain at the start.

        Raises:
            LavaError: The device does not exist, a particle is not on the terrain, or an effect is
                unknown.
        """
        self._device = device_of(device)
        self.scene = scene
        self.accuracy = resolved_accuracy(accuracy or Accuracy(), scene, horizon=horizon)
        self._horizon = horizon
        self._forced = None if isinstance(effects, Effects) else dict(effects or {})
        self._review = Review()
        chosen = effects if isinstance(effects, Effects) else self._chosen(scene)
        self.effects = formulated(chosen, self.accuracy)
        spacing, thickness = self.accuracy.spacing, self.accuracy.thickness
        assert spacing is not None and thickness is not None
        # a float32 keeps the sum of the particles' volumes equal to their number times this
        self.particle_volume = float(np.float32(spacing * spacing * thickness))
        self.radius = self.accuracy.ratio * spacing
        self._state = State(_FIRST_CAPACITY, self.effects, self.accuracy, self._device)
        self._diagnostics, self._reader = FlowDiagnostics(), Reader(self._device)
        self._emitted_before = 0.0
        self._most_particles = 0
        self._after_step: dict[str, Any] = {}
        self._arrived: tuple[Terrain, Any] | None = None
        self._place(scene.terrain)
        self._start_with(particles)
        check_rates(scene.vents, self.particle_volume)
        new = Emission.of_new_vents(len(scene.vents))
        self._vents = self._vent_set(scene.vents, since=0.0, before=new)
        #: The vents, and the numbers of those that ``_raise_top`` has already counted.
        self._counted: tuple[VentSet, set[int]] = self._vents, set()
        places = _NOWHERE if particles is None else self._state.read_particles()[:, :2]
        self._raise_top(places, until=0.0)
        self._watch(is_due=particles is not None)

    @property
    def device(self) -> str:
        """Name of the Warp device."""
        return str(self._device)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self._state.read_clock()[0][at.TIME])

    @property
    def particle_count(self) -> int:
        """Particles there are."""
        return self._state.count

    @property
    def most_particles(self) -> int:
        """Most particles there were at any look on the way: asks nothing of the device."""
        return self._most_particles

    @property
    def steps(self) -> int:
        """Time steps taken so far."""
        return int(self._state.read_clock()[1][at.STEPS])

    def advance(
        self, until: float, *, limit: float | None = None, wall_limit: float | None = None
    ) -> float:
        """Simulate up to a time, or to the first end of a time step after it.

        With the same ``limit`` the flow is the same to the bit however many stops there are before
        it, when the simulation is deterministic.

        Args:
            until: Simulated time to reach [s]; a time that has passed changes nothing.
            limit: Time that no step may pass [s]. The last step before it is shortened; when left
                out, this is ``until``.
            wall_limit: Stop early after about this much wall time [s].

        Returns:
            The simulated time reached [s].

        Raises:
            LavaError: ``until`` is not a finite number, or ``limit`` is before it.
        """
        for _ in self.advancing(until, limit=limit, wall_limit=wall_limit):
            pass
        return self.time

    def advancing(
        self, until: float, *, limit: float | None = None, wall_limit: float | None = None
    ) -> Generator[None, None, float]:
        """Simulate up to a time, in parts, as ``advance`` does in one go.

        After each part there is time for something else: a GPU is at work on it
        (``batch.side_by_side``). Only when all parts are taken the simulation is at rest.
        """
        until = validation.number('until', until, unit='s')
        if limit is not None:
            limit = validation.number('limit', limit, at_least=until, unit='s')
        end = until if limit is None else limit
        deadline = math.inf if wall_limit is None else wall_clock.monotonic() + wall_limit
        self._raise_top(until=end)
        while True:
            # reviews are at ends of natural steps: they change no step
            due = min(until, self._review_due)
            reached = yield from self._advancing_to(due, end, deadline)
            if reached >= self._review_due:
                self.review()
            if reached >= until or reached < due:
                return reached

    def _advancing_to(
        self, until: float, end: float, deadline: float
    ) -> Generator[None, None, float]:
        """Simulate up to a time [s], with no step beyond ``end`` [s], or to a wall time [s]."""
        self._state.write_target(until, end)
        batch = at_work()
        if batch is None:
            clock, counts = yield from self._advance_alone(until, deadline)
        else:
            clock, counts = yield from self._advance_in_batch(batch, until, deadline)
        if clock[at.TIME] < until:
            # the stages that the step at hand still needs, and no other
            self._state.write_target(clock[at.TIME])
        while counts[at.STAGE]:
            self._run_stages()
            yield
            clock, counts = self._state.read_clock()
        # a part that ends with its first stage makes room as well
        self._make_room(counts)
        return float(clock[at.TIME])

    def _advance_alone(self, until: float, deadline: float) -> Generator[None, None, _Look]:
        """Simulate up to a time [s], or to a wall time [s]; return clock and counts."""
        clock, counts = self._state.read_clock()
        # a GPU has the next stages to do while the host looks at what came of the last ones
        under_way: deque[Any] = deque()
        gain = math.inf
        while clock[at.TIME] < until and wall_clock.monotonic() < deadline:
            is_free = len(under_way) < _UNDER_WAY[self._device.is_cuda]
            # what is under way may get there but for rounding: more of it would idle
            reached = clock[at.TIME] + (len(under_way) + _ROUNDING) * gain
            if not under_way or (is_free and reached < until):
                self._run_stages()
                under_way.append(self._state.begin_readback())
                yield
                continue
            former = clock[at.TIME]
            clock, counts = under_way.popleft()()
            gain = clock[at.TIME] - former
            self._most_particles = max(self._most_particles, count_in(counts))
            if self._state.needs_room(counts) or counts[at.NEAR_BORDER]:
                while under_way:
                    clock, counts = under_way.popleft()()
                self._make_room(counts)
        while under_way:
            clock, counts = under_way.popleft()()
        return clock, counts

    def _advance_in_batch(
        self, batch: Batch, until: float, deadline: float
    ) -> Generator[None, None, _Look]:
        """The same with others: the batch looks at all clocks at once, and this one at none."""
        while True:
            self._bin()
            batch.bring(self._state, partial(self._taken_down, self._take), until)
            yield
            clock, counts = batch.seen
            self._most_particles = max(self._most_particles, count_in(counts))
            if clock[at.TIME] >= until:
                return clock, counts
            if wall_clock.monotonic() >= deadline:
                # stages that were launched meanwhile have gone on
                return self._state.read_clock()
            self._make_room(counts)

    def _make_room(self, counts: np.ndarray) -> None:
        self._state.make_room(counts)
        if counts[at.NEAR_BORDER]:
            if self._neighbors.is_binned:
                # what has left is counted as such already
                self._neighbors.rebuild(self._state)
                self._state.take_order(within_step=True)
            self._state.write_count(at.NEAR_BORDER, 0)
            self._neighbors.widen(int(counts[at.NEAR_BORDER]))
            self._state.launches.forget()

    def snapshot(self) -> Snapshot:
        """Put the flow on the terrain's cells."""
        self._sort()
        return self._show(beside=False).result()

    def begin_snapshot(self) -> PendingSnapshot:
        """Begin to put the flow of now on the terrain's cells.

        A GPU copies it to the host while it takes the next steps; whoever asks for the result does
        what is left to do there.
        """
        self._order()
        return self._show(beside=True)

    def looks(self, threshold: float, most: int) -> Looks:
        """Make ready for ``most`` looks at lava from ``threshold`` [m] on (``looking``)."""
        noted = self._state.arrived if math.isclose(threshold, COVERED) else None
        return Looks(self.scene.terrain.shape, threshold, most, self._device, noted=noted)

    def looking(self, looks: Looks) -> Iterator[None]:
        """Take a look as ``look`` does, in parts as ``advancing``."""
        batch = at_work()
        if batch is None:
            self.look(looks)
            return
        self._bin()
        batch.launch(self._state, partial(self._taken_down, self._looker(looks)))
        yield

    def look(self, looks: Looks) -> None:
        """Take a look at the flow of now, without a copy to the host.

        Raises:
            LavaError: Too many particles are in one place.
        """
        self._bin()
        self._looker(looks)()
        self._neighbors.refuse_crowds()

    def _looker(self, looks: Looks) -> Callable[[], None]:
        """A stage, which idles at the end of a step, with a look before the motion."""
        return partial(self._take, look=partial(self._map, looks))

    def _map(self, looks: Looks) -> None:
        self._fill_raster()
        raster = self._raster
        looks.take(self._state, self._terrain.known, raster.thickness, raster.temperature)

    def seen(self, looks: Looks, *, where_wet: bool = False) -> Seen:
        """What looks have seen so far, of all cells or of the rectangle of wet ones."""
        return looks.seen(self._state, where_wet=where_wet)

    def budget(self) -> VolumeBudget:
        """Account for the volume: emitted by the integral of Q(t), held by summing particles."""
        self._settle()
        self._reader.before_writing()
        numbers = read(self._diagnostics.take(self._state, self._vents))
        return moment_of(numbers, self._state, self._vents, self._emitted_before).budget

    def sample(self) -> ParticleSample:
        """Read the particles back, with the thickness and velocity they have now."""
        self._sort()
        self._stage.compute_velocity()
        rows = self._state.read_particles()
        flow = read(self._state.flow)[: len(rows)].astype(np.float64)
        return ParticleSample(
            position=rows[:, :2] + centre_of(self.scene.terrain),
            volume=rows[:, 2],
            temperature=rows[:, 3],
            thickness=flow[:, 0],
            velocity=flow[:, 1:],
        )

    def evaluate(self) -> None:
        """Compute the particles' thickness and velocity where they are, neighbours included.

        Nothing is read back and nothing moves: it is what a stage of a time step costs.
        """
        self._neighbors.rebuild(self._state)
        self._stage.compute_velocity()

    def set_vents(self, vents: Iterable[Vent]) -> None:
        """Replace the vents from now on.

        A vent that is the same as before (``scene.vents.match_vents``) keeps what is in its
        conduit and its sequence of places at which particles come out. The conduit of a vent that
        closes is emptied at once.

        Raises:
            LavaError: A vent is not on the terrain, its lava solid or its discharge more than the
                particles can be; the old vents stay.
        """
        vents = check_vents(vents, self.scene.terrain, self.scene.lava)
        if vents == self._vents.vents:
            return
        check_rates(vents, self.particle_volume)
        self._settle()
        scene = replace(self.scene, vents=vents)
        now = self.time
        former = self._vents
        matches = match_vents(former.vents, vents, least=self.accuracy.spacing or 0.0)
        closing = set(range(len(former.vents))).difference(matches)
        waiting = former.pending(now)
        self._emitted_before += former.emitted(now)
        new = Emission.of_new_vents(len(vents), self._emitted_before, self.particle_volume)
        before = former.emission(now).continued(matches, new)
        self._vents = self._vent_set(vents, since=now, before=before)
        self.scene = scene
        self._raise_top()
        self._decide()
        self._append([
            row for number in closing for row in former.parting(number, waiting[number])
        ])
        self._state.launches.forget()

    def set_terrain(self, terrain: Terrain) -> None:
        """Replace the ground under the flow; lava outside the new one has left.

        A terrain is the ground without lava: what has frozen stays on top of it.

        Raises:
            LavaError: A vent does not lie on the new terrain; the old one stays.
        """
        scene = replace(self.scene, terrain=terrain)
        self._settle()
        rows = self._state.read_particles()
        rows[:, :2] += centre_of(self.scene.terrain) - centre_of(terrain)
        before = self._vents.emission(self.time)
        self._emitted_before += self._vents.emitted(self.time)
        self.scene = scene
        self._place(terrain)
        self._state.write_particles(rows)
        self._cover()
        self._vents = self._vent_set(scene.vents, since=self.time, before=before)
        self._decide()
        self._sort()
        self._state.top.fill_(-at.FAR)
        self._raise_top(self._state.read_particles()[:, :2])

    def set_effects(self, forced: Mapping[str, bool], *, horizon: float = HORIZON) -> None:
        """Choose the effects anew from now on; what has frozen stays ground.

        Args:
            forced: Effects switched on or off whatever the scene says, by name.
            horizon: How far ahead is looked [s].

        Raises:
            LavaError: An effect is unknown, or two do not go together; the old ones stay.
        """
        former = self._forced, self._horizon
        self._horizon = validation.number('horizon', horizon, above=0.0, unit='s')
        self._forced = dict(forced)
        kept = {*self._review.since, *({'solidification'} & set(self.effects))}
        try:
            self._decide(kept)
        except LavaError:
            self._forced, self._horizon = former
            raise

    def checkpoint(self) -> Checkpoint:
        """Copy all that is needed to go on from here."""
        self._settle()
        return take(self)

    @classmethod
    def resume(cls, checkpoint: Checkpoint, *, device: str | None = None) -> 'Simulation':
        """Make a simulation that goes on from a checkpoint, on the same device to the bit.

        Raises:
            LavaError: The checkpoint does not fit together, or the device does not exist.
        """
        scene, effects, accuracy = checkpoint.scene, checkpoint.effects, checkpoint.accuracy
        simulation = cls(
            scene, effects=effects, accuracy=accuracy, device=device, horizon=checkpoint.horizon
        )
        return restore(simulation, checkpoint)

    @property
    def review_count(self) -> int:
        """Number of reviews of the effects so far."""
        return self._review.count

    @property
    def resolution(self) -> Resolution:
        """How many particles lie across the flow of the scene as it is now."""
        return resolution_of(self.scene, self.accuracy, horizon=self._horizon)

    def decisions(self) -> tuple[Decision, ...]:
        """Say what decides about each effect now; of those that exclude each other one is on."""
        forced = asdict(self.effects) if self._forced is None else self._forced
        decisions = decide(self.scene, forced, accuracy=self.accuracy, horizon=self._horizon)
        return tuple(
            noted(
                item, self.effects, self._review.largest.get(item.name, math.nan),
                self._review.since.get(item.name, math.nan),
            )
            for item in decisions
        )

    def measure_scales(self) -> Scales | None:
        """Measure the scales of the flow as it is now; None without flowing lava."""
        sample = self.sample()
        if not len(sample.volume):
            return None
        snapshot = self.snapshot()
        columns = measure_columns(snapshot, sample)
        distance = float(np.median(np.sqrt(columns.volume / columns.thickness)))
        terrain = self.scene.terrain
        sources = np.reshape([vent.position for vent in self.scene.vents], (-1, 2))
        heights = terrain.elevations_at(np.concatenate([sample.position, sources]))
        return scales_of(
            self.scene,
            columns,
            fall=float(np.nanmax(heights) - np.nanmin(heights)),
            spacing=float(self.accuracy.spacing or 0.0),
            kernel_radius=self.radius,
            duration=max(self._horizon, self.time),
            is_measured=True,
            is_extended=is_extended(snapshot.area(snapshot.standing), distance),
        )

    def _watch(self, *, is_due: bool = False) -> None:
        """Find out which effects reviews evaluate, and when the next review ``is_due``."""
        self._watched = [] if self._forced is None else watched_effects(
            self.scene, self.effects, self._forced
        )
        self._review_due = math.inf
        if self._watched:
            time = self.time
            self._review_due = time if is_due else next_review(time, self._horizon)

    def review(self, names: Iterable[str] | None = None) -> None:
        """Measure the numbers of effects now, and switch on those that the flow calls for.

        Args:
            names: The effects; when left out, those that are off and not forced.
        """
        scales = self.measure_scales()
        found: list[str] = []
        if scales is not None:
            names = self._watched if names is None else names
            decisions = decide_by(scales, self._forced or {}, names=names)
            found = self._review.note(decisions, self.effects)
        if found:
            self._review.since |= dict.fromkeys(found, self.time)
            self._put_on(replace(self.effects, **dict.fromkeys(found, True)))
        self._watch()

    def _chosen(self, scene: Scene) -> Effects:
        """The effects that a scene calls for, with what the user forces."""
        return effects_for(scene, self._forced, accuracy=self.accuracy, horizon=self._horizon)

    def _decide(self, kept: Iterable[str] | None = None) -> None:
        """Choose the effects anew where they follow the scene.

        Once there is lava, the effects that are on stay on, or those ``kept``: what the lava has
        become is their work.
        """
        if self._forced is None:
            return
        if kept is None:
            kept = self.effects if self.time > 0.0 or self.particle_count else ()
        chosen = self._chosen(self.scene)
        on = [name for name in chosen if name in self._forced]
        kept = [name for name in kept if self._forced.get(name, True)]
        for name in (*kept, *chosen):
            if not any(excluded_by(name, other) for other in on):
                on.append(name)
        self._put_on(replace(chosen, **{name: name in on for name in (*kept, *chosen)}))
        self._watch()

    def _put_on(self, effects: Effects) -> None:
        """Continue with other effects."""
        effects = formulated(effects, self.accuracy)
        if effects == self.effects:
            return
        self._settle()
        former = self._state
        self.effects = effects
        self._state = State(former.capacity, effects, self.accuracy, self._device)
        self._state.take_over(former)
        self._place(self.scene.terrain)

    def _place(self, terrain: Terrain) -> None:
        """Put a terrain, and the grids and kernels that depend on it, on the device."""
        accuracy = self.accuracy
        # what freezes raises the ground of this simulation alone
        shared = StaggeredTerrain.shared(terrain, accuracy.precision, self._device)
        self._terrain = shared.own() if 'solidification' in self.effects else shared
        self._neighbors = NeighborGrid(self._terrain, self.radius, accuracy.ratio, self._device)
        output_radius = max(accuracy.raster_ratio * self.radius, 1.5 * terrain.resolution)
        # what has frozen, and the arrival
        more = ('solidification' in self.effects) + 1
        self._raster = Raster(
            self._terrain, output_radius, accuracy.kernel, accuracy.ratio, self._device, more=more
        )
        self._note_arrival(terrain)
        former = self._after_step
        self._after_step = {
            name: module.AfterStep(self.scene, accuracy, self._terrain, self._state)
            for name, module in self.effects.having('AfterStep').items()
        }
        if 'solidification' in former:
            self._after_step['solidification'].take_over(former['solidification'], self._state)
        self._stage = Stage(self.scene, accuracy, self._state, self._neighbors, self._after_step)
        self._cover()

    def _note_arrival(self, terrain: Terrain) -> None:
        """Let the motion note when lava reaches cells, beginning with what is known of them."""
        if self._arrived is None:
            times = np.full(terrain.shape, -1.0, dtype=np.float32)
            self._arrived = terrain, wp.array(times, dtype=wp.float32, device=self._device)
        former, noted = self._arrived
        cells = [(item.shape, item.resolution, item.origin) for item in (former, terrain)]
        if cells[0] != cells[1]:
            times = sampled(read(noted), former, terrain, outside=-1.0)
            noted = wp.array(times, dtype=wp.float32, device=self._device)
        self._arrived = terrain, noted
        self._state.arrived = noted

    def _start_with(self, particles: Particles | None) -> None:
        if particles is None:
            return
        assert self.accuracy.spacing is not None
        rows = rows_of(particles, self.scene.terrain, self.accuracy.spacing)
        self._append(rows)
        if 'inertia' in self.effects:
            self._state.velocity[: len(rows)].assign(particles.velocity)
        self._cover()
        self._emitted_before = float(self._state.read_particles()[:, 2].sum())
        self._sort()

    def _raise_top(self, places: np.ndarray = _NOWHERE, *, until: float | None = None) -> None:
        """Update the elevation of the highest ground that lava came from, for places and vents.

        ``places`` are relative to the centre [m], shape [count, 2]. Each vent counts once, and
        only if it has emitted lava or will by the time ``until`` [s], by default now.
        """
        if self._counted[0] is not self._vents:
            self._counted = self._vents, set()
        until = self.time if until is None else until
        new = self._vents.giving(until, others_than=self._counted[1])
        if not len(places) and not new:
            return
        self._counted[1].update(new)
        every = [places]
        centre, resolution = centre_of(self.scene.terrain), self.scene.terrain.resolution
        for vent in (self.scene.vents[number] for number in new):
            start, end = np.subtract((vent.position, vent.end or vent.position), centre)
            count = 1 + math.ceil(math.dist(start, end) / resolution)
            every.append(start + np.linspace(0.0, 1.0, count)[:, None] * (end - start))
        self._terrain.raise_to(np.concatenate(every), self._state.top)

    def _append(self, rows: np.ndarray | list[tuple[float, ...]]) -> None:
        """Add particles given as (map x, map y, volume, temperature)."""
        if not len(rows):
            return
        added = np.array(rows, dtype=np.float64)
        added[:, :2] -= centre_of(self.scene.terrain)
        self._state.write_particles(np.concatenate([self._state.read_particles(), added]))
        self._state.launches.forget()

    def _vent_set(self, vents: tuple[Vent, ...], *, since: float, before: Emission) -> VentSet:
        terrain, volume = self.scene.terrain, self.particle_volume
        return VentSet(
            vents, terrain, self.accuracy, volume, self._device, since=since, before=before
        )

    def _load_vents(self, arrays: Mapping[str, np.ndarray], *, since: float) -> None:
        """Load the emission of the vents from the arrays of a checkpoint."""
        before = Emission.from_arrays(arrays, len(self.scene.vents))
        self._vents = self._vent_set(self.scene.vents, since=since, before=before)

    def _run_stages(self) -> None:
        """Take one stage on the CPU, a graph of several on a GPU; past the target they idle."""
        state, is_cuda = self._state, self._device.is_cuda
        if not is_alone(state):
            self._take()
            return
        self._bin()
        if not state.launches.can_replay(state.extent):
            if is_cuda:
                self._take()
            # on a CPU each particle there might be takes time
            extent = min(room_for(state.extent), state.capacity)
            take = partial(self._take, stages=_GRAPH_STAGES[is_cuda])
            state.launches.capture(take, extent)
        state.launches.replay()

    def _bin(self) -> None:
        """Put the particles into their cells, which a motion has done where one came before."""
        if self._state.bins_in_motion and not self._neighbors.is_binned:
            self._neighbors.bin(self._state)

    def _taken_down(self, take: Callable[[], None]) -> list[Launch]:
        """What a stage launches, for who makes it together with others'."""
        return self._state.launches.taken_down(take, self._state.capacity)

    def _take(self, *, stages: int = 1, look: Callable[[], None] | None = None) -> None:
        for _ in range(stages):
            self._stage.take(self.scene, self._vents, look=look)

    def _cover(self) -> None:
        """Let the neighbour grid cover the lava and the vents."""
        self._settle()
        self._state.write_count(at.NEAR_BORDER, 0)
        ends = [end for vent in self.scene.vents for end in (vent.position, vent.end) if end]
        places = np.reshape(ends, (-1, 2)) - centre_of(self.scene.terrain)
        self._neighbors.fit(np.concatenate([self._state.read_particles()[:, :2], places]))
        self._state.launches.forget()

    def _settle(self) -> None:
        """Drop what has left and is counted as such already, before anyone looks or changes."""
        if self._neighbors.is_binned:
            self._sort()

    def _sort(self) -> None:
        """Bring the particles into the order of their cells and drop those that have left."""
        self._order()
        self._neighbors.refuse_crowds()

    def _order(self) -> None:
        self._neighbors.rebuild(self._state)
        self._state.take_order()

    def _fill_raster(self) -> None:
        self._raster.fill(self._state, self._neighbors)
        if 'solidification' in self.effects:
            self._after_step['solidification'].show(self._state, self._raster.grids)

    def _show(self, *, beside: bool) -> PendingSnapshot:
        """Put the ordered particles on the terrain's cells, copied while others go on or now."""
        state, raster = self._state, self._raster
        self._stage.compute_flow()
        self._reader.before_writing()
        self._fill_raster()
        wp.copy(raster.grids[-1], state.arrived)
        numbers = self._diagnostics.take(state, self._vents)
        copies = self._reader.begin([raster.grids, numbers], beside=beside)
        terrain, vents, before = self.scene.terrain, self._vents, self._emitted_before
        return PendingSnapshot(lambda: snapshot_of(copies(), terrain, state, vents, before))
