# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The solver of particles behind a simulation: vents, steps, and the loop that takes them."""

from collections import deque
from collections.abc import Callable, Generator, Iterator
from functools import partial
import math
import time as wall_clock
from typing import Any

import numpy as np

from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.scene import Scene
from lava_ros.scene.vents import match_vents
from lava_ros.simulation.backend.threads import is_alone
from lava_ros.simulation.batch import Batch, current_batch
from lava_ros.simulation.output.budget import lost_volumes, VolumeBudget
from lava_ros.simulation.output.checkpoint import Checkpoint, joined
from lava_ros.simulation.output.checkpoint_contents import (
    capacity_for,
    check_conserved,
    check_contents,
    check_restored,
)
from lava_ros.simulation.output.peaks import Peaks
from lava_ros.simulation.output.snapshot import Particles, rows_of
from lava_ros.simulation.particles import layout as at
from lava_ros.simulation.particles.lava import corners_of, ParticleLava
from lava_ros.simulation.particles.layout import centre_of, fitting
from lava_ros.simulation.particles.solidified import volume_of
from lava_ros.simulation.particles.state import room_for, State
from lava_ros.simulation.particles.terrain import StaggeredTerrain
from lava_ros.simulation.step.timestep import LIMITS
from lava_ros.simulation.step.vents import check_rates, Emission, VentSet
from lava_ros.simulation.stop import Stop

#: Stages per launch, by whether the device is a GPU.
_GRAPH_STAGES = {True: 16, False: 1}

#: Stages that may run before the host reacts to the counts of particles: two launches are in
#: flight while it reads those of a third.
_STAGES_AHEAD = {True: 3 * _GRAPH_STAGES[True], False: 1}

#: Launches in flight, by whether the device is a GPU, while the target is far enough away.
_IN_FLIGHT = {True: 2, False: 1}

#: Maximum fraction of a launch's progress that rounding may change.
_ROUNDING = 1e-3

#: Maximum number of particles for which room is kept in advance.
_MAX_AHEAD = 2**20

#: Positions of no particles.
_NOWHERE = np.empty((0, 2))


class ParticleSolver(ParticleLava):
    """Lava as particles, with vents, and kernels for one scene and set of effects."""

    def start_with(self, particles: Particles | None) -> None:
        """Place the initial particles, open the vents of the scene, and find the highest ground.

        Raises:
            LavaError: If a particle is not on the terrain, a discharge is out of range, or the
                spacing is too small for the terrain.
        """
        places = _NOWHERE
        if particles is None:
            self.cover()
        else:
            assert self.accuracy.spacing is not None
            rows = rows_of(particles, self.scene.terrain, self.accuracy.spacing)
            self.add_particles(rows)
            if self.state.form.has_velocity:
                self.state.velocity[: len(rows)].assign(particles.velocity)
            self.cover()
            self.volume_before = float(self.state.read_particles()[:, 2].sum())
            self.sort()
            self.record_covered_ground()
            places = self.state.read_particles()[:, :2]
        check_rates(self.scene.vents, self.accuracy.particle_volume)
        self.open_vents(0.0, Emission.of_new_vents(len(self.scene.vents)))
        self.raise_top(places, until=0.0)

    def open_vents(self, since: float, before: Emission) -> None:
        """Put the vents of the scene on the device.

        Args:
            since: Simulated time at which they open [s].
            before: Their emission before that time.
        """
        self.vents = VentSet(
            self.scene.vents, self.scene.terrain, self.accuracy, self.device, since=since,
            before=before,
        )
        self._reserve_room()

    def _reserve_room(self) -> None:
        """Reserve capacity for particles that vents emit before the host reads the counts."""
        # otherwise lava would wait in the vents, and be emitted all at once
        state = self.state
        _, steps, rates = self.vents.step_limits.T
        assert self.accuracy.longest_step is not None
        volume = (np.minimum(steps, self.accuracy.longest_step) * rates).max()
        per_step = volume / self.accuracy.particle_volume
        # steps have at least two stages with RKL2
        ahead = math.ceil(_STAGES_AHEAD[self.device.is_cuda] / (2 if state.form.is_staged else 1))
        state.particles_ahead = math.ceil(min(ahead * per_step, _MAX_AHEAD))
        state.make_room(state.read_clock()[1])

    def raise_top(self, places: np.ndarray = _NOWHERE, *, until: float | None = None) -> None:
        """Update the elevation of the highest ground that lava came from.

        Args:
            places: Additional places relative to the terrain's centre [m], shape [count, 2].
            until: Time by which a vent must have emitted lava to count [s], by default now. Each
                vent counts once.
        """
        new = self.vents.emitting_by(self.state.time if until is None else until)
        if not len(places) and not new:
            return
        self.vents.counted |= new
        every = [places]
        centre, resolution = centre_of(self.scene.terrain), self.scene.terrain.resolution
        for vent in (self.scene.vents[number] for number in new):
            start, end = np.subtract((vent.position, vent.end or vent.position), centre)
            count = 1 + math.ceil(math.dist(start, end) / resolution)
            every.append(start + np.linspace(0.0, 1.0, count)[:, None] * (end - start))
        self.terrain.raise_to(np.concatenate(every), self.state.top)

    def replace_vents(self, scene: Scene) -> None:
        """Continue with the vents of another scene; closing vents empty their conduits.

        Raises:
            LavaError: If the spacing is too small for the distances between the vents, or a
                discharge needs too many particles. The previous vents then remain.
        """
        check_rates(scene.vents, self.accuracy.particle_volume)
        self.neighbors.window(corners_of(scene))
        self.settle()
        now, former = self.state.time, self.vents
        matches = match_vents(former.vents, scene.vents, least=self.accuracy.spacing or 0.0)
        closing = set(range(len(former.vents))).difference(matches)
        waiting = former.pending(now)
        self.volume_before += former.emitted(now)
        particle_volume = self.accuracy.particle_volume
        new = Emission.of_new_vents(len(scene.vents), self.volume_before, particle_volume)
        before = former.emission(now).continued(matches, new)
        self.scene = scene
        self.open_vents(now, before)
        self.raise_top()
        self.add_particles([
            row for number in closing for row in former.conduit_particles(number, waiting[number])
        ])
        self.state.launches.forget()

    def replace_terrain(self, scene: Scene) -> None:
        """Replace the terrain by the terrain of another scene; particles outside it count as lost.

        Raises:
            LavaError: If the spacing is too small for the terrain. The previous one then remains.
        """
        self.settle()
        rows = self.state.read_particles()
        rows[:, :2] += centre_of(self.scene.terrain) - centre_of(scene.terrain)
        ground = StaggeredTerrain(scene.terrain, self.accuracy.precision, self.device)
        self.grid_over(ground).window(np.concatenate([rows[:, :2], corners_of(scene)]))
        now = self.state.time
        before = self.vents.emission(now)
        self.volume_before += self.vents.emitted(now)
        self.scene = scene
        self.place_terrain()
        self.state.write_particles(rows)
        self.cover()
        self.open_vents(now, before)
        self.sort()
        self.state.top.fill_(-at.FAR)
        self.raise_top(self.state.read_particles()[:, :2])

    def switch_effects(self, effects: Effects) -> None:
        """Continue with other effects."""
        # drop particles that have solidified or merged, which a state with other effects keeps
        self.order()
        former = self.state
        self.state = State(former.capacity, effects, self.accuracy, self.device)
        self.state.take_over(former)
        self._reserve_room()
        if effects.any('freezes') and self.raised is None:
            self.own_terrain()
        else:
            self.build_stage()

    def run_stages(self) -> None:
        """Run one stage on the CPU, or a graph of several stages on a GPU.

        Stages past the target time have no effect.
        """
        state, is_cuda = self.state, self.device.is_cuda
        if not is_alone(state):
            self.take_stages()
            return
        self.bin()
        if not state.launches.can_replay(state.extent):
            if is_cuda:
                self.take_stages()
            # on a CPU each possible particle costs time
            extent = min(room_for(state.extent), state.capacity)
            take = partial(self.take_stages, _GRAPH_STAGES[is_cuda])
            state.launches.capture(take, extent)
        state.launches.replay()

    def take_stages(self, count: int = 1, *, observe: Callable[[], None] | None = None) -> None:
        """Launch stages; ``observe`` is called before the motion of each."""
        for _ in range(count):
            self.stage.take(self.scene, self.vents, observe=observe)

    def count_particles(self, counts: np.ndarray) -> bool:
        """Update the numbers of particles from a readback; return True when the last has gone."""
        count, was_empty = at.count_in(counts), self.is_empty
        self.most_particles, self.is_empty = max(self.most_particles, count), count == 0
        return self.is_empty and not was_empty

    def _skip_idle_time(self, until: float, end: float) -> None:
        """Set the clock to the next opening of a vent if there is no lava before it.

        If that is later than ``until`` [s], or no vent emits by ``end`` [s], it is ``until``.
        """
        if not self.is_empty:
            return
        clock, counts = self.state.read_clock()
        is_idle = not at.count_in(counts) and not counts[at.STAGE]
        time = float(clock[at.TIME])
        if is_idle and time < until:
            later = min(self.vents.idle_until(time, end), until)
            if later > time:
                self.state.write_time(later)

    def make_room(self, counts: np.ndarray) -> None:
        """Enlarge the arrays or the neighbour grid if a readback of the counts requires it."""
        self.state.make_room(counts)
        if counts[at.NEAR_BORDER]:
            if self.neighbors.is_binned:
                # particles off the terrain have been counted
                self.neighbors.rebuild(self.state, self.stage.arguments)
                self.state.take_order(within_step=True)
            self.state.write_count(at.NEAR_BORDER, 0)
            self.neighbors.widen(int(counts[at.NEAR_BORDER]))
            self.state.launches.forget()

    def start_peaks(self) -> None:
        """Do nothing: observations gather the peaks of particles."""

    def observing(self, peaks: Peaks) -> Iterator[None]:
        """Raise peaks to the values of the current flow; yield to other members of a batch.

        Raises:
            LavaError: If too many particles are in one place.
        """
        self.bin()
        batch, state = current_batch(), self.state
        if batch is None:
            self._observe(peaks)
            self.neighbors.refuse_crowds()
        else:
            observe = partial(self._observe, peaks)
            batch.launch(state, partial(state.launches.record, observe, state.capacity))
            yield

    def _observe(self, peaks: Peaks) -> None:
        """Raise peaks to the values of the current flow, within a stage that moves nothing."""

        def observe() -> None:
            self._fill_raster()
            peaks.observe(self.state, self.terrain.known, self.raster)

        self.take_stages(observe=observe)

    def advancing_to(
        self, until: float, end: float | None, deadline: float, max_end: float = math.inf
    ) -> Generator[None, None, Stop]:
        """Advance to a time, or to the step after which no lava is left; yield between launches.

        After the deadline the last step may be incomplete. The next call continues it; with the
        current time as ``until`` it only completes that step.

        Args:
            until: Simulated time to reach [s].
            end: Simulated time that no step may pass [s]; None keeps the previous one.
            deadline: Time of ``time.monotonic`` after which to stop early [s].
            max_end: Simulated time after which no step may end [s]: a step that would end later
                does not begin. Infinite for a member of a batch.

        Returns:
            Where it stopped; the time is the end of the last complete step.
        """
        state = self.state
        if end is not None:
            # ground of the vents that open before it
            self.raise_top(until=end)
            self._skip_idle_time(until, end)
        state.write_target(until, end, max_end)
        batch, is_step_pending = current_batch(), False
        if batch is None:
            clock, counts, is_step_pending = yield from self._advance_alone(until, deadline)
        else:
            assert max_end == math.inf
            clock, counts = yield from self._advance_in_batch(batch, until, deadline)
        if clock[at.TIME] < until:
            # no step begins after the current one
            state.write_target(clock[at.TIME])
        while counts[at.STAGE] and wall_clock.monotonic() < deadline:
            self.run_stages()
            yield
            clock, counts = state.read_clock()
        # also needed if the first stage has reached the time
        self.make_room(counts)
        return Stop(float(clock[at.TIME]), float(clock[at.FULL_STEP]), is_step_pending)

    def _advance_alone(
        self, until: float, deadline: float
    ) -> Generator[None, None, tuple[np.ndarray, np.ndarray, bool]]:
        """Advance to a time [s], or a wall time [s].

        Returns:
            Clock, counts, and True if the next step would end too late.
        """
        state = self.state
        clock, counts = state.read_clock()
        # a GPU computes the next stages while the host reads the results of the previous ones
        in_flight: deque[Any] = deque()
        gain, is_step_pending = math.inf, False
        while clock[at.TIME] < until and wall_clock.monotonic() < deadline:
            is_free = len(in_flight) < _IN_FLIGHT[self.device.is_cuda]
            # the launches in flight may reach the target within rounding: more of them would idle
            reached = clock[at.TIME] + (len(in_flight) + _ROUNDING) * gain
            if not in_flight or (is_free and reached < until):
                self.run_stages()
                in_flight.append(state.begin_readback())
                yield
                continue
            former = clock[at.TIME]
            clock, counts = in_flight.popleft()()
            gain = clock[at.TIME] - former
            # stages after the last step idle: the next step would end too late
            is_step_pending = clock[at.TIME] < until and not counts[at.CURRENT]
            if self.count_particles(counts) or is_step_pending:
                break
            if state.needs_room(counts) or counts[at.NEAR_BORDER]:
                while in_flight:
                    clock, counts = in_flight.popleft()()
                self.make_room(counts)
        while in_flight:
            clock, counts = in_flight.popleft()()
            # also after a slice that is shorter than a launch
            is_step_pending = clock[at.TIME] < until and not counts[at.CURRENT]
        return clock, counts, is_step_pending

    def _advance_in_batch(
        self, batch: Batch, until: float, deadline: float
    ) -> Generator[None, None, tuple[np.ndarray, np.ndarray]]:
        """Advance as a member of a batch, which reads the clocks of all members at once."""
        while True:
            self.bin()
            state = self.state
            record = partial(state.launches.record, self.take_stages, state.capacity)
            batch.advance(state, record, until)
            yield
            clock, counts = batch.readback
            is_over = self.count_particles(counts)
            if clock[at.TIME] >= until:
                return clock, counts
            if is_over:
                # only the remaining stages of the current step
                until = float(clock[at.TIME])
                self.state.write_target(until)
            if wall_clock.monotonic() >= deadline:
                # the clock includes stages launched since that readback
                return self.state.read_clock()
            self.make_room(counts)

    def save(self) -> dict[str, np.ndarray]:
        """Copy all arrays from which the solver can be resumed, between two steps, by name.

        A GPU then captures the next stages again, as it does for a resumed simulation: both idle
        for the same number of stages past the next target.
        """
        self.order()
        self.state.launches.forget()
        return joined({
            'state': self.state.save(), 'vents': self.vents.save(), 'arrived': self.covered.save(),
            'solidified': {} if self.raised is None else self.raised.save(),
        })

    def load(self, checkpoint: Checkpoint) -> None:
        """Restore the arrays of a checkpoint of the same scene, effects and accuracy.

        Raises:
            LavaError: If an array is missing, does not belong to the scene and the effects, or has
                numbers that no simulation has.
        """
        check_contents(checkpoint)
        parts = checkpoint.by_owner()
        # lava may have solidified before the effect was switched off
        if self.raised is not None or 'solidified' in parts:
            self.own_terrain().load(parts.pop('solidified', {}))
        state = parts.pop('state', {})
        self.state.load(state, capacity_for(checkpoint))
        if (limit := int(state['counts'][at.LIMIT])) not in range(len(LIMITS)):
            expected = f'the index of a limit of a step, 0 to {len(LIMITS) - 1}'
            raise LavaError('checkpoint.state.counts', limit, expected)
        time = float(state['clock'][at.TIME])
        vents = parts.pop('vents', {})
        emission = Emission.from_arrays(vents, len(checkpoint.scene.vents))
        self.open_vents(checkpoint.since, emission)
        # the state has the vents' heights; lava solidified since then may have raised the ground
        shape = (len(checkpoint.scene.vents),)
        is_counted = fitting('vents.counted', vents.get('counted'), shape, np.int32)
        self.vents.counted = set(np.flatnonzero(is_counted).tolist())
        arrived = parts.pop('arrived', None)
        if arrived is not None:
            self.covered.load(arrived)
        check_restored(checkpoint, parts, time)
        self.volume_before = checkpoint.emitted
        # the neighbour grid was created without the particles
        self.cover()
        if arrived is None:
            self.record_covered_ground()
        check_conserved(self._saved_budget(checkpoint))

    def _saved_budget(self, checkpoint: Checkpoint) -> VolumeBudget:
        """Return the budget of a checkpoint, without reading the device."""
        arrays, time = checkpoint.arrays, checkpoint.time
        placed = arrays.get('solidified.placed')
        return VolumeBudget(
            emitted=self.volume_before + self.vents.emitted(time),
            flowing=float(arrays['state.particle'][:, 2].sum(dtype=np.float64)),
            solidified=(
                0.0 if placed is None else volume_of(placed, self.scene.terrain.resolution)
            ),
            waiting=float(self.vents.pending(time).sum()),
            **lost_volumes(arrays['state.left']),
        )
