# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The thread that owns the simulation: commands go in, snapshots come out. No rclpy in here."""

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from functools import partial
import queue
import threading
import time
from typing import Any, TYPE_CHECKING

from lava_ros.errors import LavaError
from lava_ros.ros.followed_clock import FollowedClock, MAX_LAG
from lava_ros.ros.session import Eruption, failure_text, Fork, Origin
from lava_ros.ros.worker_status import (
    Command,
    CommandQueue,
    finish,
    SpeedMeter,
    WorkerState,
    WorkerStatus,
)
from lava_ros.scene import check_vents, Scene, Terrain, Vent

if TYPE_CHECKING:
    # The solver's package loads Warp; the thread does that, not the importer.
    from lava_ros.simulation import Simulation, Snapshot

#: Most particles unless the user says otherwise.
MAX_PARTICLES = 20_000_000

#: Wall time of a slice of simulation, the longest a command waits beside one time step [s].
SLICE_WALL_TIME = 0.1

#: Wall time between two slices of a simulation that keeps up [s].
IDLE_WALL_TIME = 0.1

#: Least wall time between two turns of commands, however many come [s].
TURN_WALL_TIME = 0.02

#: Lag at or below which simulated time has reached the clock [s].
ROUNDING = 1e-3

#: Maximum wall time for which a restarted simulation catches up before it is shown [s].
MAX_CATCH_UP = 5.0

#: Why a command is refused once the thread was told to end.
_STOPPED = LavaError('simulation', 'stopped', 'one that runs')


@dataclass(eq=False)
class SimulationWorker:
    """Runs a simulation in a thread of its own, after a clock.

    Simulated time follows the clock times ``time_scale``, in steps of any size up to ``MAX_LAG``.
    A simulation that cannot keep up falls behind by at most ``MAX_LAG`` and runs as fast as it
    can. The status counts the time that it gives up beyond that, and the jumps of the clock.

    Commands return at once with a future. It holds a LavaError when the command is refused; the
    simulation then goes on with what it had. A command that stands for everything of its kind
    (vents, terrain, a parameter) cancels the future of one that still waits. Any other exception
    stops the simulation: the state is FAILED, the last snapshot stays, and ``reset`` starts again.

    ``make_simulation`` makes the simulation of a scene at time 0, in the thread. ``clock`` is what
    simulated time follows [s]. ``constants`` are lava and surroundings until a scene brings its
    own, ``end_time`` is the simulated time at which to stop [s]. ``on_snapshot`` is called when
    ``latest`` has changed, in the thread or in another. The ``eruption`` has the scene and what is
    known of its simulation; others than the thread only read it.
    """

    make_simulation: Callable[[Scene], 'Simulation']
    clock: Callable[[], float]
    constants: Mapping[str, Any] | None = None
    time_scale: float = 1.0
    end_time: float | None = None
    paused: bool = False
    max_particles: int = MAX_PARTICLES
    on_snapshot: Callable[[], None] = lambda: None

    def __post_init__(self) -> None:
        """Prepare the thread; ``start`` runs it."""
        self._waiting_vents: tuple[tuple[Vent, ...], Future[None]] | None = None
        self._snapshot_asked = False
        self._finisher = ThreadPoolExecutor(1, thread_name_prefix='lava snapshots')
        self._finishing: Future[None] | None = None
        self._clock = FollowedClock(self.clock)
        self._target = 0.0
        self._step_target: float | None = None
        self._speed = SpeedMeter()
        self._status = WorkerStatus(WorkerState.WAITING, '', 0.0, 0.0, False, '')
        self.eruption = Eruption(self._starting(self.make_simulation), constants=self.constants)
        self._error = ''
        self._is_stopping = False
        self._commands = CommandQueue()
        self._last_turn = 0.0
        self._turn, self._slice = ('', 0.0), 0.0
        self._thread = threading.Thread(target=self._run, name='lava simulation', daemon=True)

    @property
    def latest(self) -> 'Snapshot | None':
        """The newest snapshot, None before the first."""
        return self.eruption.latest

    @property
    def status(self) -> WorkerStatus:
        """How the worker is doing."""
        doing, begun = self._turn
        so_far = time.monotonic() - begun if doing else 0.0
        turn = max(so_far, self._status.turn)
        return replace(self._status, doing=doing, turn=turn, waiting=self._commands.kinds)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self, timeout: float | None = None) -> bool:
        """End the thread after its present slice; whether it has ended within ``timeout`` [s].

        Commands that wait or come later are refused.
        """
        self._is_stopping = True
        self._commands.close(_STOPPED)
        if self._thread.ident is not None:
            self._thread.join(timeout)
        return not self._thread.is_alive()

    def set_scene(self, scene: Scene) -> 'Future[None]':
        """Start a simulation of the scene at time 0, in place of what there was."""
        return self._put(lambda: self.eruption.start(scene))

    def go_on_with(
        self,
        make_simulation: Callable[[], 'Simulation'],
        scene: Scene,
        origin: Origin | None = None,
        before: tuple[Vent, ...] = (),
        *,
        reached: float = 0.0,
    ) -> 'Future[None]':
        """Continue with another simulation of a scene, as ``Eruption.go_on_with`` does.

        ``make_simulation`` is called in the worker's thread. The thread then simulates up to the
        time ``reached`` [s], for at most ``MAX_CATCH_UP`` of wall time, before its first snapshot.
        """
        make = self._starting(make_simulation)

        def go_on() -> None:
            self.eruption.go_on_with(make(), scene, origin, before)
            self._catch_up(min(reached, self.end_time or reached))

        return self._put(go_on)

    def checkpoint(self) -> 'Future[bytes]':
        """Serialise all that is needed to go on from here; LavaError without a simulation."""
        return self._put(lambda: self.eruption.checkpoint().to_bytes(), kind='checkpoint')

    def fork(self) -> 'Future[Fork]':
        """Copy all that another simulation needs to go on; LavaError without a simulation."""
        return self._put(self._fork, kind='fork')

    def set_terrain(self, terrain: Terrain) -> 'Future[None]':
        """Replace the ground under the flow; the first terrain starts the simulation."""
        return self._put(lambda: self._set_terrain(terrain), kind='terrain')

    def set_vents(self, vents: Iterable[Vent]) -> 'Future[None]':
        """Replace all vents, as ``Eruption.set_vents`` does.

        Before there is a terrain the newest vents wait for it, and so does their future.
        """
        vents = tuple(vents)
        future: Future[None] = Future()
        return self._put(lambda: self._set_vents(vents, future), future, kind='vents')

    def add_vent(self, vent: Vent) -> 'Future[None]':
        """Open one more vent; refused before there is a terrain."""
        return self._put(lambda: self._add_vent(vent))

    def set_constants(self, constants: Mapping[str, Any]) -> 'Future[None]':
        """Replace the material from the next start or reset on."""
        return self._put(lambda: self.eruption.set_constants(constants), kind='constants')

    def set_effects(self, forced: Mapping[str, bool], *, horizon: float) -> 'Future[None]':
        """Choose the effects anew, with some forced on or off, looking ahead by a time [s].

        The thread then compiles what is new; the last snapshot stays until that is done.
        """
        return self._put(lambda: self._set_effects(forced, horizon), kind='effects')

    def set(self, name: str, value: float | None) -> 'Future[None]':
        """Change ``time_scale``, ``end_time`` or ``max_particles``, as at the start."""
        return self._put(lambda: self._set(name, value), kind=name)

    def pause(self, paused: bool) -> 'Future[None]':
        """Hold simulated time, also in the middle of a step, or let it go on."""
        return self._put(lambda: self._pause(paused), kind='pause')

    def reset(self) -> 'Future[None]':
        """Start the scene again at time 0, also after a failure; a pause stays."""
        return self._put(self.eruption.reset, kind='reset')

    def step(self, duration: float) -> 'Future[None]':
        """Advance a paused simulation by a duration [s]."""
        return self._put(lambda: self._begin_step(duration), kind='step')

    def request_snapshot(self) -> None:
        """Ask for ``latest`` to be renewed when the slice at hand is done, if anything changed.

        It is finished in a thread of its own while the simulation goes on, one after the other.
        """
        if not self._snapshot_asked:
            self._snapshot_asked = True
            self._put(self._begin_snapshot, kind='snapshot')

    def _put(
        self, action: Callable[[], Any], future: 'Future[Any] | None' = None, *, kind: str = ''
    ) -> 'Future[Any]':
        future = future or Future()
        self._commands.put(Command(action, future, kind))
        return future

    def _run(self) -> None:
        while not self._is_stopping:
            self._run_commands()
            if not self._is_stopping:
                self._guard(self._advance)
                self._guard(self._update_status)
        self._status = replace(self._status, state=WorkerState.STOPPED, speed=0.0)
        if self._waiting_vents is not None:
            finish(self._waiting_vents[1], _STOPPED)
        self._finisher.shutdown()
        # The device's memory is given back, whoever still holds the worker.
        self.eruption.fail()

    def _run_commands(self) -> None:
        """Run what is queued; wait for it as long as there is nothing else to do."""
        time.sleep(max(0.0, self._last_turn + TURN_WALL_TIME - time.monotonic()))
        is_behind = self._target > self.eruption.time
        wait = (0.0 if is_behind else IDLE_WALL_TIME) if self._is_moving() else None
        try:
            command = self._commands.get(wait)
            self._last_turn = time.monotonic()
            self._execute(command)
            # What comes meanwhile has to wait: simulated time goes on under any flood.
            for _ in range(len(self._commands)):
                if self._is_stopping:
                    return
                self._execute(self._commands.get(0.0))
        except queue.Empty:
            return

    def _execute(self, command: Command) -> None:
        future, starts = command.future, self.eruption.starts
        self._turn = command.kind or 'a command', time.monotonic()
        try:
            result = command.action()
            if self.eruption.starts != starts:
                self._note_start()
        except Exception as error:
            if not isinstance(error, LavaError):
                self._fail(error)
            finish(future, error)
        else:
            # vents that wait for a terrain are not done yet
            if self._waiting_vents is None or self._waiting_vents[1] is not future:
                finish(future, result=result)
        self._turn = '', 0.0
        self._guard(self._update_status)

    def _guard(self, action: Callable[[], None]) -> None:
        try:
            action()
        except Exception as error:
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        self._error = failure_text(error, self.eruption.latest)
        self.eruption.fail()
        self._step_target = None
        self._status = replace(self._status, state=WorkerState.FAILED, error=self._error)

    def _catch_up(self, reached: float) -> None:
        end = time.monotonic() + MAX_CATCH_UP
        while self.eruption.time < reached and time.monotonic() < end and not self._is_stopping:
            self.eruption.advance(
                reached, wall_limit=SLICE_WALL_TIME, max_particles=self.max_particles
            )

    def _advance(self) -> None:
        """Move simulated time one slice towards the clock."""
        if not self._is_moving():
            return
        before = self.eruption.time
        if self._step_target is not None:
            self._target = self._step_target
        else:
            self._target += self._clock.elapse() * self.time_scale
            self._give_up(before + MAX_LAG * self.time_scale)
        if self.end_time is not None:
            self._target = min(self._target, self.end_time)
        self._slice = 0.0
        if self._target > before:
            begun = time.monotonic()
            self._turn = 'a step', begun
            try:
                reached = self.eruption.advance(
                    self._target, wall_limit=SLICE_WALL_TIME, max_particles=self.max_particles
                )
            finally:
                self._turn, self._slice = ('', 0.0), time.monotonic() - begun
            self._speed.note(reached)
        if self._step_target is not None and self.eruption.time >= self._target:
            self._step_target = None

    def _give_up(self, until: float) -> None:
        """Give up the time of the clock beyond a simulated time [s], and count it as lost."""
        self._clock.lost += max(0.0, self._target - until) / self.time_scale
        self._target = min(self._target, until)

    def _is_moving(self) -> bool:
        if self.eruption.simulation is None or self._is_finished():
            return False
        return not self.paused or self._step_target is not None

    def _is_finished(self) -> bool:
        return self.end_time is not None and self.eruption.time >= self.end_time

    def _update_status(self) -> None:
        old = self._status.state
        if self._error:
            state = WorkerState.FAILED
        elif self.eruption.simulation is None:
            state = WorkerState.WAITING
        elif self._is_finished():
            state = WorkerState.FINISHED
        elif self.paused:
            state = WorkerState.PAUSED
        else:
            state = WorkerState.RUNNING
        if state is WorkerState.RUNNING and old is not WorkerState.RUNNING:
            self._follow_from_here()
        if state is not WorkerState.RUNNING and self._step_target is None:
            self._speed.clear()
        # What is at rest is shown as it is by the time its state says so.
        is_new = not self._is_moving() and self._is_snapshot_new()
        # The newest step of the clock does not count as a lag yet.
        lag = (self._target - self.eruption.time) / self.time_scale - self._clock.step
        self._status = WorkerStatus(
            state=state,
            error=self._error,
            speed=self._speed.value,
            mean_speed=self._speed.mean,
            is_behind=state is WorkerState.RUNNING and lag > ROUNDING,
            device=self.eruption.device,
            lag=max(0.0, lag),
            lost=self._clock.lost,
            jump=self._clock.jump,
            jumps=self._clock.jumps,
            turn=self._slice if self._is_moving() else 0.0,
        )
        if is_new:
            self.on_snapshot()

    def _follow_from_here(self) -> None:
        self._clock.start()
        self._target = self.eruption.time
        self._speed.clear()
        self._speed.note(self._target)

    def _show(self) -> None:
        if self._is_snapshot_new():
            self.on_snapshot()

    def _is_snapshot_new(self) -> bool:
        """Bring ``latest`` up to date now, and say whether it may not have been."""
        finishing, self._finishing = self._finishing, None
        if finishing is not None:
            wait([finishing])
        return self.eruption.renew_snapshot() or finishing is not None

    def _begin_snapshot(self) -> None:
        finishing = self._finishing
        if finishing is not None and not finishing.done():
            again = partial(self._put, self._begin_snapshot, kind='snapshot')
            finishing.add_done_callback(lambda _: again())
            return
        self._snapshot_asked = False
        # Maps are due when the clock has moved, so advance to its current time first.
        self._guard(self._advance)
        rest = self.eruption.begin_snapshot()
        if rest is not None:
            simulation = self.eruption.simulation
            self._finishing = self._finisher.submit(self._finish_snapshot, rest, simulation)

    def _finish_snapshot(self, rest: Callable[[], None], simulation: 'Simulation | None') -> None:
        """Do the rest of a snapshot; if that fails, its simulation has failed."""

        def fail(reason: Exception) -> None:
            if self.eruption.simulation is simulation:
                self._fail(reason)

        try:
            rest()
        except Exception as error:
            self._put(partial(fail, error), kind='failure')
        else:
            self.on_snapshot()

    def _starting(self, make: Callable[..., 'Simulation']) -> Callable[..., 'Simulation']:
        """The same, with a status that says so."""

        def start(*scene: Scene) -> 'Simulation':
            self._status = replace(self._status, state=WorkerState.STARTING)
            return make(*scene)

        return start

    def _note_start(self) -> None:
        self._error = ''
        self._step_target = None
        self._speed = SpeedMeter()
        self._clock = FollowedClock(self.clock)
        self._follow_from_here()
        self._show()

    def _fork(self) -> Fork:
        begun = time.monotonic()
        checkpoint = self.eruption.checkpoint()
        return Fork(checkpoint, self.eruption.changes, self.clock(), time.monotonic() - begun)

    def _set_terrain(self, terrain: Terrain) -> None:
        if self.eruption.scene is not None:
            if self.eruption.set_terrain(terrain):
                self._show()
            return
        vents, future = self._waiting_vents or ((), None)
        error: LavaError | None = None
        try:
            vents = check_vents(vents, terrain)
        except LavaError as refused:
            vents, error = (), refused
        self.eruption.begin(terrain, vents)
        self._waiting_vents = None
        if future is not None:
            finish(future, error)

    def _set_vents(self, vents: tuple[Vent, ...], future: 'Future[None]') -> None:
        if self.eruption.scene is None:
            if self._waiting_vents is not None:
                self._waiting_vents[1].cancel()
            self._waiting_vents = (vents, future)
        else:
            self.eruption.set_vents(vents)

    def _add_vent(self, vent: Vent) -> None:
        scene = self.eruption.scene
        if scene is None:
            raise LavaError('vent', vent.position, 'a terrain before the first single vent')
        self.eruption.set_vents((*scene.vents, vent))

    def _set_effects(self, forced: Mapping[str, bool], horizon: float) -> None:
        self.eruption.set_effects(forced, horizon=horizon)
        self._show()

    def _set(self, name: str, value: float | None) -> None:
        if name == 'time_scale':
            # keep the lag in seconds of the clock
            lag = (self._target - self.eruption.time) / self.time_scale
            self._target = self.eruption.time + lag * float(value or 0.0)
        setattr(self, name, value)

    def _pause(self, paused: bool) -> None:
        if paused and not self.paused:
            self._give_up(self.eruption.time)
        self.paused = paused
        self._step_target = None

    def _begin_step(self, duration: float) -> None:
        if self.eruption.simulation is None or not self.paused:
            raise LavaError('step', self._status.state.value, 'a paused simulation')
        self._step_target = self.eruption.time + duration
