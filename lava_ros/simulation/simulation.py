# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulation of a scene: algorithm 1 of the paper, with time steps of variable length."""

from collections.abc import Generator, Iterable, Iterator, Mapping
from dataclasses import asdict, replace
from functools import partial
import math
import threading
import time as wall_clock
from typing import Any

from lava_ros import validation
from lava_ros.effects import Effects, excluded_by
from lava_ros.effects.scales import Scales
from lava_ros.errors import LavaError
from lava_ros.scene import check_vents, Scene, Terrain, Vent
from lava_ros.scene.terrain import is_same_ground
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.advance import ParticleSolver
from lava_ros.simulation.backend.memory import within_memory
from lava_ros.simulation.batch import current_batch
from lava_ros.simulation.cells.solver import CellSolver
from lava_ros.simulation.output.budget import VolumeBudget
from lava_ros.simulation.output.checkpoint import Checkpoint, warn_of_other_model
from lava_ros.simulation.output.measurement import measured_scales
from lava_ros.simulation.output.peaks import PeakMaps, Peaks
from lava_ros.simulation.output.snapshot import (
    Particles,
    particles_of,
    ParticleSample,
    PendingSnapshot,
    Snapshot,
)
from lava_ros.simulation.resolution import (
    estimated_effects,
    naming_the_cause,
    Resolution,
    resolution_of,
    resolved_accuracy,
)
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

#: Solvers by method (``Accuracy.method``).
SOLVERS: dict[str, Any] = {'particles': ParticleSolver, 'cells': CellSolver}


class Simulation:
    """Lava that flows over a terrain.

    Only the thread that created a simulation may use it: launches of a second thread would
    invalidate a CUDA graph during its capture.

    Attributes:
        accuracy: The resolution, with all automatic values filled in.
        step: Length of the latest step, or of the next one if ``advance`` has not begun it because
            it would end too late [s].
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
            effects: The effects to switch on. By default they are chosen from the scene, and again
                when its vents or terrain change. A mapping forces some of them on or off by name.
            accuracy: The resolution, by default automatic.
            device: ``cpu`` or ``cuda:0``; by default the first CUDA device, or the CPU without.
            horizon: Time span for the choice of effects and of the spacing [s].
            particles: Lava on the terrain at the start, by default the scene's emplaced flows.

        Raises:
            LavaError: If the device does not exist, a particle is not on the terrain, an effect is
                unknown or contradicts the formulation, or spacing or thickness is out of range.
            OutOfMemoryError: If the simulation does not fit into memory. All methods may raise it.
        """
        self._prepare(scene, effects, accuracy or Accuracy(), device, horizon)
        if particles is None:
            particles = particles_of(scene, self.solver.column_spacing)
        self.solver.start_with(particles)
        self._watch(is_due=particles is not None)

    def _prepare(
        self, scene: Scene, effects: Effects | Mapping[str, bool] | None, given: Accuracy,
        device: str | None, horizon: float,
    ) -> None:
        """Choose resolution and effects, and allocate a solver without vents."""
        self._owner = threading.get_ident()
        self.step = 0.0
        # the next step would end after the requested time, and has not begun
        self._is_step_pending, self._requested_time = False, -math.inf
        # the cells of one run rarely fill a GPU
        used = device_of('cpu' if device is None and given.method == 'cells' else device)
        self._horizon = horizon
        self._forced = None if isinstance(effects, Effects) else dict(effects or {})
        forced = asdict(effects) if isinstance(effects, Effects) else self._forced
        self.accuracy = resolved_accuracy(given, scene, forced, horizon=horizon)
        self._review = Review()
        self._is_interrupted = False
        chosen = effects if isinstance(effects, Effects) else self._choose_effects(scene)
        chosen = formulated(chosen, self.accuracy)
        with naming_the_cause(scene, given):
            self._solver: Any = SOLVERS[self.accuracy.method](scene, chosen, self.accuracy, used)

    @property
    def solver(self) -> Any:
        """The lava, grids and kernels on the device: a ``ParticleSolver`` or a ``CellSolver``.

        Raises:
            RuntimeError: If the current thread did not create the simulation.
        """
        if threading.get_ident() != self._owner:
            raise RuntimeError(
                f'thread {threading.current_thread().name!r} has used a simulation of another '
                'thread; only the thread that created it may use it'
            )
        return self._solver

    @property
    def scene(self) -> Scene:
        """The current scene."""
        scene: Scene = self.solver.scene
        return scene

    @property
    def effects(self) -> Effects:
        """The effects that are on."""
        effects: Effects = self.solver.effects
        return effects

    @property
    def device(self) -> str:
        """Name of the Warp device."""
        return str(self.solver.device)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self.solver.time)

    @property
    def particle_count(self) -> int:
        """Number of particles."""
        return int(self.solver.count)

    @property
    def most_particles(self) -> int:
        """Maximum number of particles at any readback so far, known without device access."""
        return int(self.solver.most_particles)

    @property
    def steps(self) -> int:
        """Number of time steps so far."""
        return int(self.solver.steps)

    def advance(
        self,
        until: float,
        *,
        limit: float | None = None,
        wall_limit: float | None = None,
        whole_steps: bool = False,
    ) -> float:
        """Simulate until the end of the first time step at or after a time.

        A deterministic simulation with a given ``limit`` gives bitwise identical results however
        many calls reach it.

        Args:
            until: Simulated time to reach [s]. A time in the past has no effect.
            limit: Time that no step may pass [s]: the last step before it is shortened. By default
                this is ``until``; with ``whole_steps`` there is no limit.
            wall_limit: Wall time after which to stop early [s], after at most one more launch or
                review of the effects. An incomplete step is completed by the next call with a
                later ``until``, which it may pass, or before the flow is read or changed.
            whole_steps: Do not begin a step that would end after ``until``; ``step`` is then its
                length. If vents, terrain or effects change before it begins, a shorter step ends
                at ``until``.

        Returns:
            The simulated time reached [s].

        Raises:
            LavaError: If ``until`` is not a finite number, or ``limit`` is before it.
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
        """Generator form of ``advance``, which yields after each batch of launches.

        The caller can overlap other work with the GPU (``batch.side_by_side``). The simulation can
        be read or changed only when the generator is exhausted.

        No step passes the time of an event of the scene, at which the ground changes. An event at
        ``until`` takes place in the next call.
        """
        until = validation.number('until', until, unit='s')
        if limit is not None:
            limit = validation.number('limit', limit, at_least=until, unit='s')
        end, max_end = until if limit is None else limit, math.inf
        self._requested_time = -math.inf
        if whole_steps:
            end, max_end = math.inf if limit is None else limit, until
            now = self.time
            if self._is_step_pending and until < min(now + self.step, end):
                self._requested_time = until
                return now
        self._is_step_pending = False
        deadline = math.inf if wall_limit is None else wall_clock.monotonic() + wall_limit
        if self._is_interrupted and until <= self.time:
            return self.time
        self._is_interrupted = False
        with within_memory():
            while True:
                change = self.scene.events[0].time if self.scene.events else math.inf
                stop, last = min(until, change), min(end, change)
                self.solver.raise_top(until=last)
                if self.solver.is_empty:
                    self.solver.skip_to(stop, last)
                # reviews follow the ends of natural steps, and change none
                due = min(stop, self._review_due)
                reached, self.step, self._is_step_pending = yield from self.solver.advancing_to(
                    due, last, deadline, max_end
                )
                if self._is_step_pending:
                    self._requested_time = until
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
        """Complete the step and the review that the wall limit of ``advance`` interrupted."""
        if self._is_interrupted:
            self._is_interrupted = False
            for _ in self.solver.advancing_to(self.time, None, math.inf):
                pass
            if self.time >= self._review_due:
                self.review()

    @within_memory()
    def snapshot(self) -> Snapshot:
        """Map the current flow to the terrain's cells."""
        self._complete()
        self.solver.sort()
        return self.solver.begin_snapshot(overlaps=False).result()

    @within_memory()
    def begin_snapshot(self) -> PendingSnapshot:
        """Start to map the current flow to the terrain's cells.

        A GPU copies the maps to the host while it computes the next steps.
        """
        self._complete()
        self.solver.order()
        return self.solver.begin_snapshot(overlaps=True)

    @within_memory()
    def start_peaks(self, threshold: float) -> Peaks:
        """Prepare to gather peak values by observations, the first of which is of this time.

        Args:
            threshold: Thickness at or above which lava has arrived [m].

        Raises:
            LavaError: If the simulation has another threshold.
        """
        own = self.accuracy.inundation_threshold
        if not math.isclose(threshold, own):
            raise LavaError('threshold', threshold, f'{own:g} m, that of the simulation')
        self.solver.start_peaks()
        return Peaks(self.scene.terrain, own, self.time, self.solver.device)

    @property
    def keeps_peaks(self) -> bool:
        """True if steps keep the peaks themselves, so that few observations suffice."""
        return self.accuracy.method == 'cells'

    @within_memory()
    def observe(self, peaks: Peaks) -> None:
        """Raise peaks to the values of the current flow, without a copy to the host.

        Raises:
            LavaError: If too many particles are in one place.
        """
        self._complete()
        self.solver.observe_now(peaks)

    def observing(self, peaks: Peaks) -> Iterator[None]:
        """Generator form of ``observe``, which yields to the other members of a batch."""
        batch = current_batch()
        if batch is None or self.keeps_peaks:
            self.observe(peaks)
            return
        self._complete()
        self.solver.bin()
        state, observe = self.solver.state, partial(self.solver.observe, peaks)
        batch.launch(state, partial(state.launches.record, observe, state.capacity))
        yield

    def read_peaks(self, peaks: Peaks, *, where_wet: bool = False) -> PeakMaps:
        """Return the peaks so far, of all cells or of the rectangle that lava can reach."""
        found: PeakMaps = self.solver.read_peaks(peaks, where_wet=where_wet)
        return found

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
        return self.solver.sample()

    @within_memory()
    def evaluate(self) -> None:
        """Compute thickness and velocity of the particles, including the neighbour search.

        Nothing is read back and nothing moves: this measures the cost of a stage of a time step.
        """
        self._complete()
        self.solver.neighbors.rebuild(self.solver.state)
        self.solver.stage.compute_flow()
        self.solver.stage.finish_flow()

    @within_memory()
    def set_vents(self, vents: Iterable[Vent]) -> None:
        """Replace the vents from now on.

        A vent that continues (``scene.vents.match_vents``) keeps the lava in its conduit and its
        sequence of emission places. The conduit of a vent that closes is emptied at once.

        Raises:
            LavaError: If a vent is not on the terrain, its lava is solid, its discharge needs too
                many particles, or the spacing is too small for the distances between the vents.
                The previous vents then remain.
        """
        vents = check_vents(vents, self.scene.terrain, self.scene.lava)
        if vents != self.solver.vents.vents:
            self.solver.check_rates(vents)
            self._catch_up()
            last_particles = self.solver.replace_vents(replace(self.scene, vents=vents))
            self._update_effects()
            self.solver.add_particles(last_particles)
            self.solver.forget()

    @within_memory()
    def set_terrain(self, terrain: Terrain) -> None:
        """Replace the ground under the flow; lava outside the new terrain counts as lost.

        A terrain is the ground without lava: solidified lava remains on top of it.

        Raises:
            LavaError: If a vent or a future barrier is not on the new terrain, or the spacing is
                too small for it. The previous terrain then remains.
        """
        later, scene = terrain, replace(self.scene, terrain=terrain)
        for event in scene.events:
            later = event.ground(later)
        if is_same_ground(terrain, self.scene.terrain):
            # only the georeference differs, which the solver does not use
            self.solver.scene = scene
            return
        self._catch_up()
        self._replace_terrain(scene)

    def _replace_terrain(self, scene: Scene) -> None:
        """Replace the terrain by the terrain of another scene, and choose the effects again."""
        self.solver.replace_terrain(scene)
        self._update_effects()
        self.solver.sort()
        self.solver.lower_top()

    def _catch_up(self) -> None:
        """Complete the step; if one is pending, advance to the requested time by a shorter one."""
        self._complete()
        if self._is_step_pending:
            self.advance(max(self._requested_time, self.time))

    def _change_ground(self) -> None:
        """Change the ground by the next event of the scene."""
        event, *later = self.scene.events
        ground = event.ground(self.scene.terrain)
        self._replace_terrain(replace(self.scene, terrain=ground, events=tuple(later)))

    @within_memory()
    def set_effects(self, forced: Mapping[str, bool], *, horizon: float = HORIZON) -> None:
        """Choose the effects again from now on; solidified lava remains ground.

        Args:
            forced: Effects to force on or off regardless of the scene, by name.
            horizon: Time span for the choice [s].

        Raises:
            LavaError: If an effect is unknown, or two exclude each other. The previous effects
                then remain.
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
        """Return a copy of all data from which a simulation can be resumed at this time."""
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
            capacity=self.solver.capacity,
            arrays=self.solver.save(),
        )

    @classmethod
    @within_memory()
    def resume(cls, checkpoint: Checkpoint, *, device: str | None = None) -> 'Simulation':
        """Return a simulation resumed from a checkpoint, bitwise identical on the same device.

        Raises:
            LavaError: If the checkpoint is inconsistent, or the device does not exist.
        """
        scene, effects, accuracy = checkpoint.scene, checkpoint.effects, checkpoint.accuracy
        simulation = cls.__new__(cls)
        simulation._prepare(scene, effects, accuracy, device, checkpoint.horizon)
        simulation.solver.load(checkpoint)
        simulation._forced = None if checkpoint.forced is None else dict(checkpoint.forced)
        simulation._review.since.update(checkpoint.switched_on)
        simulation._review.largest.update(checkpoint.measured)
        simulation._watch()
        warn_of_other_model(checkpoint)
        return simulation

    @property
    def review_count(self) -> int:
        """Number of reviews of the effects so far."""
        return self._review.count

    @property
    def resolution(self) -> Resolution:
        """Number of particles across the flow of the current scene, and its spacing."""
        return resolution_of(self.scene, self.accuracy, self._all_forced, horizon=self._horizon)

    def decisions(self) -> tuple[Decision, ...]:
        """Return the current decision about each effect, with its number and its threshold."""
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
        """Measure the scales of the current flow; None without flowing lava."""
        self._complete()
        self.solver.sort()
        grids, sample = self.solver.draw_maps(), self.solver.read_flow()
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
        """Effects that the user has forced on or off, by name; all effects of a fixed set."""
        return asdict(self.effects) if self._forced is None else self._forced

    def _watch(self, *, is_due: bool = False) -> None:
        """Schedule the next review of the effects, for now if it ``is_due``."""
        self._watched = [] if self._forced is None else watched_effects(
            self.scene, self.effects, self._forced
        )
        self._review_due = math.inf
        if self._watched:
            time = self.time
            self._review_due = time if is_due else next_review(time, self._horizon)

    def review(self, names: Iterable[str] | None = None) -> None:
        """Measure the numbers of effects now, and switch on those above their thresholds.

        Args:
            names: The effects, by default those that are off and not forced.
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
        """Return the effects that a scene needs, with those that the user forces."""
        return effects_for(scene, self._forced, accuracy=self.accuracy, horizon=self._horizon)

    def _update_effects(self, remaining: Iterable[str] | None = None) -> None:
        """Choose the effects again, unless the user has given all of them.

        Once there is lava, active effects, or those in ``remaining``, stay on: they have shaped
        it.
        """
        if self._forced is None:
            return
        if remaining is None:
            remaining = self.effects if self.time > 0.0 or self.particle_count else ()
        chosen = self._choose_effects(self.scene)
        on = [name for name in chosen if name in self._forced]
        remaining = [name for name in remaining if self._forced.get(name, True)]
        for name in (*remaining, *chosen):
            if not any(excluded_by(name, other) for other in on):
                on.append(name)
        self._switch_to(replace(chosen, **{name: name in on for name in (*remaining, *chosen)}))
        self._watch()

    def _switch_to(self, effects: Effects) -> None:
        """Continue with other effects."""
        effects = formulated(effects, self.accuracy)
        if effects != self.effects:
            self._is_step_pending = False
            self.solver.switch_effects(effects)
