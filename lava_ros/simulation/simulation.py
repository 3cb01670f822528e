# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulation of a scene: what to simulate, up to when, and with which effects."""

from collections.abc import Generator, Iterable, Iterator, Mapping
from dataclasses import replace
import math
import threading
import time as wall_clock

from lava_ros import validation
from lava_ros.effects import Effects
from lava_ros.effects.scales import Scales
from lava_ros.errors import LavaError
from lava_ros.scene import check_vents, Scene, Terrain, Vent
from lava_ros.scene.terrain import conflict_of_frames, is_same_ground
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend.memory import within_memory
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
from lava_ros.simulation.particles.solver import ParticleSolver
from lava_ros.simulation.resolution import (
    estimated_effects,
    naming_the_cause,
    Resolution,
    resolution_of,
    resolved_accuracy,
)
from lava_ros.simulation.selection import Decision, HORIZON
from lava_ros.simulation.setup.defaults import device_of
from lava_ros.simulation.setup.review import EffectChoice

#: A solver owns the lava on a device, and advances it for one scene and one set of effects.
Solver = ParticleSolver | CellSolver

#: Solvers by method (``Accuracy.method``).
SOLVERS: dict[str, type[Solver]] = {'particles': ParticleSolver, 'cells': CellSolver}


class Simulation:
    """Lava that flows over a terrain.

    Only the thread that created a simulation may use it: launches of a second thread would
    invalidate a CUDA graph during its capture.

    Attributes:
        step: Length of the latest step [s]; after ``advance`` with ``whole_steps`` that of the
            next one, if it has not begun because it would end too late.
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
        given = accuracy or Accuracy()
        self._prepare(scene, effects, given, device, horizon)
        if particles is None:
            particles = particles_of(scene, self.solver.column_spacing)
        with naming_the_cause(scene, given):
            self.solver.start_with(particles)
        self._schedule_review(is_due=particles is not None)

    def _prepare(
        self, scene: Scene, effects: Effects | Mapping[str, bool] | None, given: Accuracy,
        device: str | None, horizon: float,
    ) -> None:
        """Choose resolution and effects, and allocate a solver without vents."""
        self._owner = threading.get_ident()
        self.step = 0.0
        # the next step would end after the requested time, and has not begun
        self._is_step_pending, self._requested_time = False, -math.inf
        # the wall limit has stopped a step before its end
        self._is_interrupted = False
        used = device_of(device, given.method)
        self._choice = EffectChoice(effects, horizon)
        accuracy = resolved_accuracy(given, scene, self._choice.all_forced(), horizon=horizon)
        chosen = self._choice.first(scene, accuracy)
        with naming_the_cause(scene, given):
            self._solver = SOLVERS[accuracy.method](scene, chosen, accuracy, used)

    @property
    def solver(self) -> Solver:
        """The lava, grids and kernels on the device (``Solver``, by ``Accuracy.method``).

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
        return self.solver.scene

    @property
    def accuracy(self) -> Accuracy:
        """The resolution that is used, without automatic values."""
        return self._solver.accuracy

    @property
    def effects(self) -> Effects:
        """The effects that are on."""
        return self.solver.effects

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
        """Number of particles, or of cells with lava."""
        return self.solver.count

    @property
    def most_particles(self) -> int:
        """Maximum of ``particle_count`` at any readback so far, known without device access."""
        return self.solver.most_particles

    @property
    def steps(self) -> int:
        """Number of time steps so far."""
        return self.solver.steps

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
        """Generator form of ``advance``: yields after each batch of launches.

        The caller can do other work while the GPU computes (``batch.side_by_side``). The
        simulation can be read or changed only when the generator is exhausted.

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
                # a review follows the end of a step, and shortens none
                due = min(stop, self._choice.due)
                reached, self.step, self._is_step_pending = yield from self.solver.advancing_to(
                    due, last, deadline, max_end
                )
                if self._is_step_pending:
                    self._requested_time = until
                    return reached
                if wall_clock.monotonic() >= deadline:
                    self._is_interrupted = True
                    return reached
                if reached >= self._choice.due:
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
            if self.time >= self._choice.due:
                self.review()

    @within_memory()
    def snapshot(self) -> Snapshot:
        """Map the current flow to the terrain's cells."""
        return self.begin_snapshot(overlaps=False).result()

    @within_memory()
    def begin_snapshot(self, *, overlaps: bool = True) -> PendingSnapshot:
        """Start a map of the current flow to the terrain's cells.

        If it ``overlaps``, a GPU copies the maps to the host while it computes the next steps.
        """
        self._complete()
        return self.solver.begin_snapshot(overlaps=overlaps)

    @within_memory()
    def start_peaks(self, threshold: float) -> Peaks:
        """Return empty peaks, for observations from the current time onwards.

        Args:
            threshold: Thickness at or above which lava has arrived [m].

        Raises:
            LavaError: If the simulation has another threshold.
        """
        own = self.accuracy.inundation_threshold
        if not math.isclose(threshold, own):
            raise LavaError('threshold', threshold, f'{own:g} m, the threshold of the simulation')
        self.solver.start_peaks()
        return Peaks(self.scene.terrain.shape, own, self.time, self.solver.device)

    @property
    def keeps_peaks(self) -> bool:
        """True if steps keep the peaks themselves, so that few observations suffice."""
        return self.solver.keeps_peaks

    def observing(self, peaks: Peaks) -> Iterator[None]:
        """Raise peaks to the values of the current flow, without a copy to the host.

        Yields to the other members of a batch, if it is in one.

        Raises:
            LavaError: If too many particles are in one place.
        """
        with within_memory():
            self._complete()
            yield from self.solver.observing(peaks)

    def read_peaks(self, peaks: Peaks, *, where_wet: bool = False) -> PeakMaps:
        """Return the peaks so far, of all cells or of the rectangle that lava can reach."""
        return self.solver.read_peaks(peaks, where_wet=where_wet)

    @within_memory()
    def budget(self) -> VolumeBudget:
        """Return the volume budget: the integral of the effusion rate, and where the lava is."""
        self._complete()
        return self.solver.budget()

    @within_memory()
    def sample(self) -> ParticleSample:
        """Read the particles, or the columns of the cells, with thickness and velocity."""
        self._complete()
        return self.solver.sample()

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
        if vents != self.scene.vents:
            self._catch_up()
            self.solver.replace_vents(replace(self.scene, vents=vents))
            self._update_effects()

    @within_memory()
    def set_terrain(self, terrain: Terrain) -> None:
        """Replace the ground under the flow; lava outside the new terrain counts as lost.

        A terrain is the ground without lava: solidified lava remains on top of it.

        Raises:
            LavaError: If there is lava and the terrain places the map frame elsewhere, a vent or a
                future barrier is not on the new terrain, or the spacing is too small for it. The
                previous terrain then remains.
        """
        conflict = conflict_of_frames(terrain, self.scene.terrain)
        if conflict is not None and self.budget().emitted > 0.0:
            raise conflict
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

    def _catch_up(self) -> None:
        """Complete the current step, and take a shorter one to the requested time if necessary."""
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
        choice = self._choice
        former = choice.forced, choice.horizon
        if (dict(forced), horizon) != former:
            self._catch_up()
        choice.horizon = validation.number('horizon', horizon, above=0.0, unit='s')
        choice.forced = dict(forced)
        try:
            self._update_effects(choice.since)
        except LavaError:
            choice.forced, choice.horizon = former
            raise

    @within_memory()
    def checkpoint(self) -> Checkpoint:
        """Return a copy of all data from which a simulation can be resumed at this time."""
        self._complete()
        arrays = self.solver.save()
        return Checkpoint(
            time=self.time,
            scene=self.scene,
            effects=self.effects,
            forced=self._choice.forced,
            horizon=self._choice.horizon,
            switched_on=dict(self._choice.since),
            measured=dict(self._choice.largest),
            accuracy=self.accuracy,
            emitted=self.solver.volume_before,
            since=self.solver.vents.since,
            capacity=self.solver.capacity,
            arrays=arrays,
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
        choice = simulation._choice
        choice.forced = None if checkpoint.forced is None else dict(checkpoint.forced)
        choice.since.update(checkpoint.switched_on)
        choice.largest.update(checkpoint.measured)
        simulation._schedule_review()
        warn_of_other_model(checkpoint)
        return simulation

    @property
    def review_count(self) -> int:
        """Number of reviews of the effects so far."""
        return self._choice.review_count

    @property
    def resolution(self) -> Resolution:
        """Number of particles across the flow of the current scene, and its spacing."""
        choice = self._choice
        return resolution_of(
            self.scene, self.accuracy, choice.all_forced(self.effects), horizon=choice.horizon
        )

    def decisions(self) -> tuple[Decision, ...]:
        """Return the current decision about each effect, with its number and its threshold."""
        return self._choice.decisions(self.scene, self.effects, self.accuracy)

    @within_memory()
    def measure_scales(self) -> Scales | None:
        """Measure the scales of the current flow; None without flowing lava."""
        self._complete()
        grids, sample = self.solver.maps_and_sample()
        if not len(sample.volume):
            return None
        now, duration = self.time, max(self._choice.horizon, self.time)
        emitted = self.solver.volume_before + self.solver.vents.emitted(now)
        later = sum(vent.volume_between(now, duration) for vent in self.scene.vents)
        forced = self._choice.all_forced(self.effects)
        effects = estimated_effects(self.scene, self.accuracy, forced, horizon=duration)
        return measured_scales(
            self.scene, effects, sample, grids,
            threshold=self.accuracy.inundation_threshold, duration=duration,
            emitted=emitted / max(emitted + later, 1e-30),
        )

    def _schedule_review(self, *, is_due: bool = False) -> None:
        """Schedule the next review of the effects, for now if it ``is_due``."""
        self._choice.schedule(self.scene, self.effects, self.time, is_due=is_due)

    def review(self, names: Iterable[str] | None = None) -> None:
        """Measure the numbers of effects now, and switch on those above their thresholds.

        Args:
            names: The effects, by default those that are off and not forced.
        """
        self._complete()
        scales = self.measure_scales()
        if scales is not None:
            self._switch_to(
                self._choice.reviewed(scales, self.effects, self.accuracy, self.time, names)
            )
        self._schedule_review()

    def _update_effects(self, remaining: Iterable[str] | None = None) -> None:
        """Choose the effects again, unless the user has given all of them.

        Once there is lava, active effects, or those in ``remaining``, stay on: they have shaped
        it.
        """
        if self._choice.forced is None:
            return
        if remaining is None:
            remaining = self.effects if self.time > 0.0 or self.particle_count else ()
        self._switch_to(self._choice.updated(self.scene, self.accuracy, remaining))
        self._schedule_review()

    def _switch_to(self, effects: Effects) -> None:
        """Continue with other effects."""
        if effects != self.effects:
            self._is_step_pending = False
            self.solver.switch_effects(effects)
