# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Session of a simulation: the current scene, which messages change."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
import threading
from typing import Any, NamedTuple, TYPE_CHECKING

from lava_ros.bag.description import effect_table
from lava_ros.effects import EFFECTS, Effects
from lava_ros.errors import LavaError, RefusalError
from lava_ros.live.failures import SimulationError
from lava_ros.scene import constants_of, Scene, Terrain, Vent
from lava_ros.scene.events import TerrainEvent
from lava_ros.scene.terrain import is_same_ground
from lava_ros.scene.vents import are_alike, schedule
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.carriers import COUNTED
from lava_ros.simulation.method import lacking_on_cells
from lava_ros.simulation.output.checkpoint import Checkpoint
from lava_ros.simulation.output.measurement import current_resolution
from lava_ros.simulation.output.snapshot import ParticleSample
from lava_ros.simulation.resolution import Resolution
from lava_ros.simulation.selection import warnings_of

if TYPE_CHECKING:
    # the solver loads Warp: done in the worker's thread, not at import
    from lava_ros.simulation import Simulation, Snapshot


#: Remedy for effects that only particles have.
WITH_PARTICLES = 'Set method to particles or auto, and start again with ~/reset'

#: Maximum change of an elevation that counts as noise of a sensor [m].
ELEVATION_NOISE = 0.1


class Origin(NamedTuple):
    """The checkpoint from which a simulation was resumed.

    ``bag`` contains it, ``time`` is its simulated time [s], ``stamp_ns`` its ROS time [ns].
    """

    bag: str
    time: float
    stamp_ns: int


class Fork(NamedTuple):
    """A copy of the state, from which another simulation can start.

    ``changes`` is ``SessionView.changes`` at the copy, ``clock`` the time of the clock that
    simulated time follows [s], and ``wall_time`` the wall time of the copying [s].
    """

    checkpoint: Checkpoint
    changes: int
    clock: float
    wall_time: float


@dataclass(frozen=True)
class SessionView:
    """The values of a session that other threads read. They are replaced together.

    Attributes:
        time: Simulated time [s], 0 without a simulation.
        step: Length of the pending step or, without one, of the latest step [s].
        device: Name of the device, empty without a simulation.
        accuracy: Resolution of the simulation, None without one.
        scene: Current scene, None without a terrain.
        schedule: Its vents with their discharges over the whole run, including earlier vents.
        repeatable: Scene at the start, from which the run can be repeated with ``schedule``; None
            without one, and after a change of the ground under lava.
        origin: Checkpoint from which the simulation was resumed, None if it started at time 0.
        effects: Table of effects (``effect_table``), empty without a simulation.
        missed: Warnings about effects that the flow needs and the method does not have.
        resolution: Expected resolution of the flow, None without a simulation.
        changes: Number of changes that make a forecast invalid: starts, changes of effects, and
            changes of vents or terrain beyond the noise of a sensor (``are_alike``,
            ``ELEVATION_NOISE``).
        starts: Number of simulations started or resumed.
    """

    time: float = 0.0
    step: float = 0.0
    device: str = ''
    accuracy: Accuracy | None = None
    scene: Scene | None = None
    schedule: tuple[Vent, ...] = ()
    repeatable: Scene | None = None
    origin: Origin | None = None
    effects: Mapping[str, str] = field(default_factory=dict)
    missed: tuple[str, ...] = ()
    resolution: Resolution | None = None
    changes: int = 0
    starts: int = 0


class SimulationSession:
    """A scene that changes while it is simulated.

    A refused change or request raises LavaError and leaves scene and simulation unchanged. The
    thread that makes the simulation uses the session; other threads read ``view``, ``latest`` and
    ``measured_resolution``.

    Attributes:
        simulation: The simulation, None without a terrain or after a failure.
        view: The published values.
        latest: Newest snapshot, None before the first; it stays after a failure.
        constants: Lava and surroundings of the next start.
    """

    def __init__(
        self,
        make_simulation: Callable[[Scene], 'Simulation'],
        *,
        constants: Mapping[str, Any] | None = None,
    ) -> None:
        """Initialize without a terrain; ``constants`` apply until a scene replaces them."""
        self._make_simulation = make_simulation
        self.constants = constants or constants_of(None)
        self._is_changed = False
        self._numbers, self._latest_number = count(), -1
        self._taking = threading.Lock()
        self.simulation: Simulation | None = None
        self.view = SessionView()
        self.latest: Snapshot | None = None
        self._counted: tuple[Scene | None, Effects | None] = None, None
        self._measured: tuple[Snapshot | None, Resolution | None] = None, None
        # terrain and events before the first event, for a reset
        self._before_events: tuple[Terrain, tuple[TerrainEvent, ...]] | None = None

    @property
    def time(self) -> float:
        """Simulated time [s], 0 without a simulation."""
        return self.view.time

    @property
    def scene(self) -> Scene | None:
        """Current scene, None without a terrain."""
        return self.view.scene

    def _put(self, **values: Any) -> None:
        """Replace published values."""
        self.view = replace(self.view, **values)

    @property
    def measured_resolution(self) -> Resolution | None:
        """Resolution of the newest snapshot; the expected resolution while its flow is small."""
        view, latest = self.view, self.latest
        if view.accuracy is None or view.resolution is None or latest is None:
            return view.resolution
        if self._measured[0] is not latest:
            found = current_resolution(latest, view.accuracy, view.resolution)
            self._measured = latest, found
        return self._measured[1]

    def start(self, scene: Scene) -> None:
        """Start a scene at time 0 in place of the current simulation."""
        self.resume_with(self._make_simulation(scene), scene)

    def resume_with(
        self,
        simulation: 'Simulation',
        scene: Scene,
        origin: Origin | None = None,
        before: tuple[Vent, ...] = (),
    ) -> None:
        """Replace the current simulation by one of ``scene``, which may be at any time.

        ``before`` contains the vents up to that time if they differ from those of the scene; it
        determines the volume emitted so far.
        """
        self.simulation, self.constants = simulation, constants_of(scene)
        self._before_events = None
        self._note_change(
            scene=scene,
            repeatable=scene,
            schedule=schedule(before or scene.vents, scene.vents, simulation.time),
            origin=origin,
            device=simulation.device,
            accuracy=simulation.accuracy,
            starts=self.view.starts + 1,
        )

    def checkpoint(self) -> Checkpoint:
        """Copy the state to a checkpoint."""
        return self._running('checkpoint').checkpoint()

    def sample(self) -> ParticleSample:
        """Read the particles.

        Raises:
            LavaError: If the lava is on cells, or there is no simulation.
        """
        simulation = self._running('particles')
        if simulation.accuracy.method != 'particles':
            raise RefusalError('particles', 'The simulation runs on cells', WITH_PARTICLES)
        return simulation.sample()

    def _running(self, what: str) -> 'Simulation':
        if self.simulation is None:
            problem = 'There is no running simulation'
            raise RefusalError(what, problem, 'Publish a terrain, or start again with ~/reset')
        return self.simulation

    def advance(
        self,
        until: float,
        *,
        wall_limit: float,
        max_particles: int,
        limit: float | None = None,
        whole_steps: bool = False,
    ) -> float:
        """Simulate up to ``until`` [s] for at most ``wall_limit`` [s].

        ``limit`` and ``whole_steps`` are as in ``Simulation.advance``.

        Returns:
            The time reached [s].

        Raises:
            SimulationError: If there are more than ``max_particles`` particles or cells with lava;
                ``latest`` contains them.
        """
        assert self.simulation is not None
        before = self.time
        reviews = self.simulation.review_count
        reached = self.simulation.advance(
            until, limit=limit, wall_limit=wall_limit, whole_steps=whole_steps
        )
        self._put(time=reached, step=self.simulation.step)
        self._is_changed |= reached > before
        self._follow_events()
        if self.simulation.review_count != reviews:
            # an effect may have been switched on
            self._note_change(is_noise=True)
        # reading the count from the device takes time, and it changes only in a step
        count = self.simulation.particle_count if reached > before else 0
        if count > max_particles:
            self.renew_snapshot()
            raise SimulationError(
                f'{count} {COUNTED[self.simulation.accuracy.method]}, expected at most '
                f'{max_particles} (max_particles); a larger spacing needs fewer'
            )
        return reached

    def _follow_events(self) -> None:
        assert self.simulation is not None and self.scene is not None
        current = self.simulation.scene
        if len(current.events) < len(self.scene.events):
            self._before_events = self._before_events or (self.scene.terrain, self.scene.events)
            self._note_change(
                scene=replace(self.scene, terrain=current.terrain, events=current.events)
            )

    def set_terrain(self, terrain: Terrain) -> bool:
        """Replace the terrain under the flow; return True if it differs from the current one."""
        assert self.scene is not None
        # publishers often repeat their terrain: an identical terrain changes nothing
        if _is_same(terrain, self.scene.terrain):
            return False
        scene = replace(self.scene, terrain=terrain)
        if self.simulation is not None:
            self.simulation.set_terrain(terrain)
        if self._before_events is not None:
            self._before_events = terrain, self._before_events[1]
        is_noise = self._is_like_counted(scene)
        repeatable = self.view.repeatable
        if repeatable is not None and not is_noise:
            is_bare = self.simulation is not None and self._is_without_lava()
            repeatable = replace(repeatable, terrain=terrain) if is_bare else None
        self._note_change(is_noise=is_noise, scene=scene, repeatable=repeatable)
        return True

    def set_vents(self, vents: tuple[Vent, ...]) -> None:
        """Replace all vents.

        The first vents of a simulation without lava restart it, because its resolution depends on
        them.
        """
        assert self.scene is not None
        scene = replace(self.scene, vents=vents)
        # publishers often repeat their vents: identical vents change nothing
        if scene.vents == self.scene.vents:
            return
        if self.simulation is None:
            self._note_change(scene=scene, schedule=vents)
        elif vents and not self.scene.vents and self._is_without_lava():
            self.start(replace(scene, **self.constants))
        else:
            self.simulation.set_vents(vents)
            self._note_change(
                is_noise=self._is_like_counted(scene),
                scene=scene,
                schedule=schedule(self.view.schedule, vents, self.simulation.time),
            )

    def add_vents(self, vents: Sequence[Vent]) -> dict[int, LavaError]:
        """Add vents as one change; return the errors of those that are refused, by number."""
        scene, errors, good = self.scene, {}, []
        for number, vent in enumerate(vents):
            try:
                if scene is None:
                    problem = 'There is no terrain for the vent'
                    raise RefusalError('vent', problem, 'Publish a terrain first')
                replace(scene, vents=(vent,))
            except LavaError as error:
                errors[number] = error
            else:
                good.append(number)
        return errors | self._add_together(vents, good)

    def _add_together(self, vents: Sequence[Vent], numbers: list[int]) -> dict[int, LavaError]:
        if not numbers or self.scene is None:
            return {}
        try:
            self.set_vents((*self.scene.vents, *(vents[number] for number in numbers)))
        except LavaError as error:
            if len(numbers) == 1:
                return {numbers[0]: error}
            # the vents may be refused only together, because of the sum of their discharges
            middle = len(numbers) // 2
            former = self._add_together(vents, numbers[:middle])
            return former | self._add_together(vents, numbers[middle:])
        return {}

    def set_constants(self, constants: Mapping[str, Any]) -> None:
        """Replace lava and surroundings at the next start; the current scene keeps its own."""
        if self.scene is not None:
            # raises the error about constants that its vents cannot have
            replace(self.scene, **constants)
        self.constants = constants

    def set_effects(self, forced: Mapping[str, bool], *, horizon: float) -> None:
        """Choose the effects again for ``horizon`` [s], with some forced on or off."""
        if self.simulation is not None:
            wanted = [name for name, is_on in forced.items() if is_on and name in EFFECTS]
            lacking = lacking_on_cells(wanted)
            if lacking and self.simulation.accuracy.method == 'cells':
                problem = f'The simulation runs on cells, which have no {", ".join(lacking)}'
                raise RefusalError('effects', problem, WITH_PARTICLES)
            self.simulation.set_effects(forced, horizon=horizon)
            self._note_change()

    def reset(self) -> None:
        """Start the scene again at time 0, even after a failure."""
        if self.scene is None:
            problem = 'There is no simulation to reset'
            raise RefusalError('reset', problem, 'Publish a terrain first')
        before: dict[str, Any] = {}
        if self._before_events is not None:
            before['terrain'], before['events'] = self._before_events
        self.start(replace(self.scene, **before, **self.constants))

    def fail(self) -> None:
        """Drop the simulation after a failure; the scene and the last snapshot remain."""
        self.simulation = None
        self._put(time=0.0, step=0.0, device='', accuracy=None, changes=self.view.changes + 1)

    def renew_snapshot(self) -> bool:
        """Update ``latest``; return True if it changed.

        Raises:
            SimulationError: If the flow is not valid; ``latest`` is then unchanged.
        """
        if self.simulation is None or not self._is_changed:
            return False
        self._take(self.simulation.snapshot(), next(self._numbers))
        self._is_changed = False
        return True

    def begin_snapshot(self) -> Callable[[], None] | None:
        """Begin an update of ``latest``.

        Returns:
            A function that completes the update in any thread and raises the same errors as
            ``renew_snapshot``; None if nothing has changed.
        """
        if self.simulation is None or not self._is_changed:
            return None
        number, pending = next(self._numbers), self.simulation.begin_snapshot()
        self._is_changed = False
        return lambda: self._take(pending.result(), number)

    def _take(self, snapshot: 'Snapshot', number: int) -> None:
        flaw = snapshot.flaw()
        if flaw:
            raise SimulationError(f'the flow has become unusable: {flaw}')
        with self._taking:
            # a snapshot that was begun later may have been completed earlier
            if number > self._latest_number:
                self.latest, self._latest_number = snapshot, number

    def _note_change(self, *, is_noise: bool = False, **values: Any) -> None:
        """Publish a change; noise of a sensor is not counted in ``changes``."""
        simulation = self.simulation
        if simulation is not None:
            effects, changes = simulation.effects, self.view.changes
            decisions = simulation.decisions()
            if not is_noise or effects != self._counted[1]:
                changes += 1
                self._counted = values.get('scene', self.scene), effects
            values |= {
                'time': simulation.time,
                'step': simulation.step,
                'resolution': simulation.resolution,
                'effects': effect_table(effects, decisions),
                'missed': tuple(warnings_of(decisions)),
                'changes': changes,
            }
            self._is_changed = True
        self._put(**values)

    def _is_like_counted(self, scene: Scene) -> bool:
        """Return True if a scene differs from the last counted one only by sensor noise."""
        counted = self._counted[0]
        return counted is not None and (
            are_alike(scene.vents, counted.vents)
            and _is_same(scene.terrain, counted.terrain, within=ELEVATION_NOISE)
        )

    def _is_without_lava(self) -> bool:
        self.renew_snapshot()
        return self.latest is not None and self.latest.budget.emitted == 0.0


def _is_same(one: Terrain, other: Terrain, *, within: float = 0.0) -> bool:
    """Return True if two terrains are alike (``is_same_ground``) in the same coordinate system."""
    return one.georeference == other.georeference and is_same_ground(one, other, within=within)
