# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulation of a scene: algorithm 1 of the paper with a step that follows the limits."""

from collections.abc import Generator, Iterable, Iterator, Mapping
from dataclasses import asdict, replace
from functools import partial
import math
import threading
import time as wall_clock

from lava_ros import validation
from lava_ros.effects import Effects, excluded_by
from lava_ros.effects.scales import Scales
from lava_ros.errors import LavaError
from lava_ros.scene import check_vents, Scene, Terrain, Vent
from lava_ros.scene.terrain import is_same_ground
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.advance import advancing_to
from lava_ros.simulation.backend.memory import within_memory
from lava_ros.simulation.batch import at_work
from lava_ros.simulation.output.budget import VolumeBudget
from lava_ros.simulation.output.checkpoint import Checkpoint
from lava_ros.simulation.output.looks import Looks, Seen
from lava_ros.simulation.output.measurement import measured_scales
from lava_ros.simulation.output.snapshot import (
    Particles,
    particles_of,
    ParticleSample,
    PendingSnapshot,
    Snapshot,
)
from lava_ros.simulation.particles import layout as at
from lava_ros.simulation.resolution import (
    estimated_effects,
    naming_the_cause,
    Resolution,
    resolution_of,
    resolved_accuracy,
)
from lava_ros.simulation.restart import arrays_of, restore_arrays
from lava_ros.simulation.selection import (
    decide,
    decide_by,
    Decision,
    effects_for,
    HORIZON,
    noted,
)
from lava_ros.simulation.setup.defaults import device_of, formulated
from lava_ros.simulation.setup.review import next_review, Review, watched_effects
from lava_ros.simulation.solver import Solver
from lava_ros.simulation.step.vents import check_rates


class Simulation:
    """Lava flowing over a terrain.

    A simulation belongs to the thread that made it: work of a second thread on the device would
    invalidate a CUDA graph that is being captured.

    Attributes:
        accuracy: The resolution, without automatic values.
        step: Length of the step that is waited for (``advance``), or of the latest step [s].
    """

    @within_memory()
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
            particles: Lava that is on the terrain at the start; when left out, the emplaced flows
                of the scene.

        Raises:
            LavaError: The device does not exist, a particle is not on the terrain, an effect is
                unknown or contradicts the formulation, or spacing or thickness is out of range.
            OutOfMemoryError: The simulation does not fit into memory; all methods may raise it.
        """
        self._prepare(scene, effects, accuracy or Accuracy(), device, horizon)
        if particles is None:
            particles = particles_of(scene, self.accuracy.spacing)
        self.solver.start_with(particles)
        self._watch(is_due=particles is not None)

    def _prepare(
        self, scene: Scene, effects: Effects | Mapping[str, bool] | None, given: Accuracy,
        device: str | None, horizon: float,
    ) -> None:
        """Choose resolution and effects, and allocate a solver that has no vents yet."""
        self._owner = threading.get_ident()
        self.step = 0.0
        self._is_waiting, self._asked = False, -math.inf
        used = device_of(device)
        self._horizon = horizon
        self._forced = None if isinstance(effects, Effects) else dict(effects or {})
        forced = asdict(effects) if isinstance(effects, Effects) else self._forced
        self.accuracy = resolved_accuracy(given, scene, forced, horizon=horizon)
        self._review = Review()
        self._is_interrupted = False
        chosen = effects if isinstance(effects, Effects) else self._choose_effects(scene)
        chosen = formulated(chosen, self.accuracy)
        with naming_the_cause(scene, given):
            self._solver = Solver(scene, chosen, self.accuracy, used)

    @property
    def solver(self) -> Solver:
        """The particles, grids and kernels on the device.

        Raises:
            RuntimeError: If another thread than the one that made the simulation asks for it.
        """
        if threading.get_ident() != self._owner:
            raise RuntimeError(
                f'thread {threading.current_thread().name!r} has used a simulation of another '
                'thread; only the thread that made it may use it'
            )
        return self._solver

    @property
    def scene(self) -> Scene:
        """The current scene."""
        return self.solver.scene

    @property
    def effects(self) -> Effects:
        """The effects that are on."""
        return self.solver.effects

    @property
    def particle_volume(self) -> float:
        """Volume of the particles that vents emit [m3]."""
        return self.solver.particle_volume

    @property
    def radius(self) -> float:
        """Radius of the smoothing kernel [m]."""
        return self.solver.radius

    @property
    def device(self) -> str:
        """Name of the Warp device."""
        return str(self.solver.device)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.solver.time

    @property
    def particle_count(self) -> int:
        """Number of particles."""
        return self.solver.state.count

    @property
    def most_particles(self) -> int:
        """Largest number of particles at any readback so far; needs no access to the device."""
        return self.solver.most_particles

    @property
    def steps(self) -> int:
        """Number of time steps so far."""
        return int(self.solver.state.read_clock()[1][at.STEPS])

    def advance(
        self,
        until: float,
        *,
        limit: float | None = None,
        wall_limit: float | None = None,
        whole_steps: bool = False,
    ) -> float:
        """Simulate up to a time, or to the first end of a time step after it.

        With the same ``limit`` the flow is the same to the bit however many stops there are before
        it, when the simulation is deterministic.

        Args:
            until: Simulated time to reach [s]; a time that has passed changes nothing.
            limit: Time that no step may pass [s]. The last step before it is shortened; when left
                out, this is ``until``, or with ``whole_steps`` there is none.
            wall_limit: Stop early after this wall time [s] and at most one more launch or review
                of the effects. A step that is then incomplete is completed by the next call with
                a later ``until``, which it may pass, or before anything else reads or changes the
                flow.
            whole_steps: Do not begin a step that would end after ``until``. The time reached is
                then earlier by less than this ``step``. A later change of vents, terrain or
                effects takes place at ``until``: it shortens the step.

        Returns:
            The simulated time reached [s].

        Raises:
            LavaError: ``until`` is not a finite number, or ``limit`` is before it.
        """
        for _ in self.advancing(
            until, limit=limit, wall_limit=wall_limit, whole_steps=whole_steps
        ):
            pass
        return self.time

    def advancing(
        self,
        until: float,
        *,
        limit: float | None = None,
        wall_limit: float | None = None,
        whole_steps: bool = False,
    ) -> Generator[None, None, float]:
        """Simulate up to a time, in parts, as ``advance`` does in one go.

        The events of the scene change the ground at their times, which no step passes; that of
        ``until`` itself comes with the next part.

        After each part there is time for something else: a GPU is at work on it
        (``batch.side_by_side``). Only when all parts are taken the simulation is at rest.
        """
        until = validation.number('until', until, unit='s')
        if limit is not None:
            limit = validation.number('limit', limit, at_least=until, unit='s')
        end, max_end = until if limit is None else limit, math.inf
        self._asked = -math.inf
        if whole_steps:
            end, max_end = math.inf if limit is None else limit, until
            now = self.time
            if self._is_waiting and until < min(now + self.step, end):
                self._asked = until
                return now
        self._is_waiting = False
        deadline = math.inf if wall_limit is None else wall_clock.monotonic() + wall_limit
        if self._is_interrupted and until <= self.time:
            return self.time
        self._is_interrupted = False
        with within_memory():
            while True:
                change = self.scene.events[0].time if self.scene.events else math.inf
                stop, last = min(until, change), min(end, change)
                self.solver.raise_top(until=last)
                if self.solver.is_bare:
                    self.solver.rest(stop, last)
                # reviews are at ends of natural steps: they change no step
                due = min(stop, self._review_due)
                reached, self.step, self._is_waiting = yield from advancing_to(
                    self.solver, due, last, deadline, max_end
                )
                if self._is_waiting:
                    self._asked = until
                    return reached
                if wall_clock.monotonic() >= deadline:
                    self._is_interrupted = True
                    return reached
                if reached >= self._review_due:
                    self.review()
                if change <= reached and change < until:
                    self._change_ground()
                elif reached >= until:
                    return reached

    def _complete(self) -> None:
        """Complete the step and the review at which a wall limit has interrupted ``advance``."""
        if self._is_interrupted:
            self._is_interrupted = False
            for _ in advancing_to(self.solver, self.time, None, math.inf):
                pass
            if self.time >= self._review_due:
                self.review()

    @within_memory()
    def snapshot(self) -> Snapshot:
        """Map the current flow to the terrain's cells."""
        self._complete()
        self.solver.sort()
        return self.solver.begin_snapshot(beside=False).result()

    @within_memory()
    def begin_snapshot(self) -> PendingSnapshot:
        """Start to map the current flow to the terrain's cells.

        A GPU copies the maps to the host while it computes the next steps.
        """
        self._complete()
        self.solver.order()
        return self.solver.begin_snapshot(beside=True)

    @within_memory()
    def looks(self, threshold: float, most: int) -> Looks:
        """Prepare observations of lava, the first of which is at the current time.

        Args:
            threshold: Minimum thickness of lava that has arrived [m]: that of the simulation.
            most: Maximum number of observations, which take no memory.

        Raises:
            LavaError: If the simulation has another threshold.
        """
        own = self.accuracy.inundation_threshold
        if not math.isclose(threshold, own):
            raise LavaError('threshold', threshold, f'{own:g} m, that of the simulation')
        return Looks(self.scene.terrain, own, self.time, self.solver.device)

    def looking(self, looks: Looks) -> Iterator[None]:
        """Take a look as ``look`` does, in parts as ``advancing``."""
        batch = at_work()
        if batch is None:
            self.look(looks)
            return
        self._complete()
        self.solver.bin()
        take = partial(self.solver.take_look, looks)
        batch.launch(self.solver.state, partial(self.solver.record_launches, take))
        yield

    @within_memory()
    def look(self, looks: Looks) -> None:
        """Add the current flow to looks, without a copy to the host.

        Raises:
            LavaError: If too many particles are in one place.
        """
        self._complete()
        self.solver.bin()
        self.solver.take_look(looks)
        self.solver.neighbors.refuse_crowds()

    def seen(self, looks: Looks, *, where_wet: bool = False) -> Seen:
        """Return the results of looks so far, for all cells or those that lava can reach."""
        solver, (rows, columns) = self.solver, self.scene.terrain.shape
        part = slice(0, rows), slice(0, columns)
        if where_wet:
            part = solver.raster.window.rectangle(solver.state)
        return looks.seen(solver.state, part)

    @within_memory()
    def budget(self) -> VolumeBudget:
        """Return the budget: volume emitted, by the integral of Q(t), and sums over particles."""
        self._complete()
        return self.solver.budget()

    @within_memory()
    def sample(self) -> ParticleSample:
        """Read the particles back, with their current thickness and velocity."""
        self._complete()
        self.solver.sort()
        self.solver.stage.compute_flow()
        return self.solver.read_sample()

    @within_memory()
    def evaluate(self) -> None:
        """Compute thickness and velocity of the particles, including the search for neighbours.

        Nothing is read back and nothing moves: this is the cost of a stage of a time step.
        """
        self._complete()
        self.solver.neighbors.rebuild(self.solver.state)
        self.solver.stage.compute_flow()
        self.solver.stage.finish_flow()

    @within_memory()
    def set_vents(self, vents: Iterable[Vent]) -> None:
        """Replace the vents from now on.

        A vent that is the same as before (``scene.vents.match_vents``) keeps what is in its
        conduit and its sequence of places at which particles come out. The conduit of a vent that
        closes is emptied at once.

        Raises:
            LavaError: A vent is not on the terrain, its lava solid, its discharge more than the
                particles can be, or the spacing too small for the distances of the vents; the old
                vents stay.
        """
        vents = check_vents(vents, self.scene.terrain, self.scene.lava)
        if vents != self.solver.vents.vents:
            check_rates(vents, self.particle_volume)
            self._catch_up()
            parting = self.solver.replace_vents(replace(self.scene, vents=vents))
            self._update_effects()
            self.solver.add_particles(parting)
            self.solver.state.launches.forget()

    @within_memory()
    def set_terrain(self, terrain: Terrain) -> None:
        """Replace the ground under the flow; lava outside the new one has left.

        A terrain is the ground without lava: solidified lava stays on top of it.

        Raises:
            LavaError: A vent or a barrier to come does not lie on the new terrain, or the spacing
                is too small for it; the old one stays.
        """
        later, scene = terrain, replace(self.scene, terrain=terrain)
        for event in scene.events:
            later = event.ground(later)
        if is_same_ground(terrain, self.scene.terrain):
            # only the georeference is new, of which the solver knows nothing
            self.solver.scene = scene
            return
        self._catch_up()
        self._replace_terrain(scene)

    def _replace_terrain(self, scene: Scene) -> None:
        """Replace the terrain by that of another scene, and choose the effects again."""
        self.solver.replace_terrain(scene)
        self._update_effects()
        self.solver.sort()
        self.solver.lower_top()

    def _catch_up(self) -> None:
        """Complete the step, or end one that is waited for early, at the time asked for."""
        self._complete()
        if self._is_waiting:
            self.advance(max(self._asked, self.time))

    def _change_ground(self) -> None:
        """Let the next event of the scene change the ground."""
        event, *later = self.scene.events
        ground = event.ground(self.scene.terrain)
        self._replace_terrain(replace(self.scene, terrain=ground, events=tuple(later)))

    @within_memory()
    def set_effects(self, forced: Mapping[str, bool], *, horizon: float = HORIZON) -> None:
        """Choose the effects again from now on; solidified lava stays ground.

        Args:
            forced: Effects switched on or off whatever the scene says, by name.
            horizon: How far ahead is looked [s].

        Raises:
            LavaError: An effect is unknown, or two do not go together; the old ones stay.
        """
        self._complete()
        former = self._forced, self._horizon
        if (dict(forced), horizon) != former:
            self._catch_up()
        self._horizon = validation.number('horizon', horizon, above=0.0, unit='s')
        self._forced = dict(forced)
        try:
            self._update_effects(self._review.since)
        except LavaError:
            self._forced, self._horizon = former
            raise

    @within_memory()
    def checkpoint(self) -> Checkpoint:
        """Copy everything that is needed to continue from the current time."""
        self._complete()
        self.solver.order()
        return Checkpoint(
            time=self.time,
            scene=self.scene,
            effects=self.effects,
            forced=self._forced,
            horizon=self._horizon,
            switched_on=dict(self._review.since),
            measured=dict(self._review.largest),
            accuracy=self.accuracy,
            emitted=self.solver.volume_before,
            since=self.solver.vents.since,
            capacity=self.solver.state.capacity,
            arrays=arrays_of(self.solver),
        )

    @classmethod
    @within_memory()
    def resume(cls, checkpoint: Checkpoint, *, device: str | None = None) -> 'Simulation':
        """Return a simulation that continues from a checkpoint, on the same device to the bit.

        Raises:
            LavaError: If the checkpoint is inconsistent, or the device does not exist.
        """
        scene, effects, accuracy = checkpoint.scene, checkpoint.effects, checkpoint.accuracy
        simulation = cls.__new__(cls)
        simulation._prepare(scene, effects, accuracy, device, checkpoint.horizon)
        restore_arrays(simulation.solver, checkpoint)
        simulation._forced = None if checkpoint.forced is None else dict(checkpoint.forced)
        simulation._review.since.update(checkpoint.switched_on)
        simulation._review.largest.update(checkpoint.measured)
        simulation._watch()
        return simulation

    @property
    def review_count(self) -> int:
        """Number of reviews of the effects so far."""
        return self._review.count

    @property
    def resolution(self) -> Resolution:
        """How many particles lie across the flow of the scene as it is now."""
        return resolution_of(self.scene, self.accuracy, self._all_forced, horizon=self._horizon)

    def decisions(self) -> tuple[Decision, ...]:
        """Say what decides about each effect now; of those that exclude each other one is on."""
        decisions = decide(
            self.scene, self._all_forced, accuracy=self.accuracy, horizon=self._horizon
        )
        return tuple(
            noted(
                item, self.effects, self._review.largest.get(item.name, math.nan),
                self._review.since.get(item.name, math.nan),
            )
            for item in decisions
        )

    @within_memory()
    def measure_scales(self) -> Scales | None:
        """Measure the scales of the flow as it is now; None without flowing lava."""
        self._complete()
        self.solver.sort()
        grids, sample = self.solver.draw_maps(), self.solver.read_sample()
        if not len(sample.volume):
            return None
        duration = max(self._horizon, self.time)
        effects = estimated_effects(
            self.scene, self.accuracy, self._all_forced, horizon=duration
        )
        return measured_scales(
            self.scene, effects, sample, grids,
            threshold=self.accuracy.inundation_threshold, duration=duration,
            emitted=self.solver.emitted_fraction(duration),
        )

    @property
    def _all_forced(self) -> dict[str, bool]:
        """Effects that the user has switched on or off, by name: all of a fixed set."""
        return asdict(self.effects) if self._forced is None else self._forced

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
        self._complete()
        scales = self.measure_scales()
        found: list[str] = []
        if scales is not None:
            names = self._watched if names is None else names
            decisions = decide_by(scales, self._forced or {}, self.accuracy, names=names)
            found = self._review.note(decisions, self.effects)
        if found:
            self._review.since |= dict.fromkeys(found, self.time)
            self._switch_to(replace(self.effects, **dict.fromkeys(found, True)))
        self._watch()

    def _choose_effects(self, scene: Scene) -> Effects:
        """The effects that a scene calls for, with what the user forces."""
        return effects_for(scene, self._forced, accuracy=self.accuracy, horizon=self._horizon)

    def _update_effects(self, kept: Iterable[str] | None = None) -> None:
        """Choose the effects anew where they follow the scene.

        Once there is lava, the effects that are on stay on, or those ``kept``: what the lava has
        become is their work.
        """
        if self._forced is None:
            return
        if kept is None:
            kept = self.effects if self.time > 0.0 or self.particle_count else ()
        chosen = self._choose_effects(self.scene)
        on = [name for name in chosen if name in self._forced]
        kept = [name for name in kept if self._forced.get(name, True)]
        for name in (*kept, *chosen):
            if not any(excluded_by(name, other) for other in on):
                on.append(name)
        self._switch_to(replace(chosen, **{name: name in on for name in (*kept, *chosen)}))
        self._watch()

    def _switch_to(self, effects: Effects) -> None:
        """Continue with other effects."""
        effects = formulated(effects, self.accuracy)
        if effects != self.effects:
            self._is_waiting = False
            self.solver.switch_effects(effects)
