# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulation thread, which executes commands and makes snapshots."""

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass, InitVar, replace
from functools import partial
import queue
import threading
import time
from typing import Any, TYPE_CHECKING

from lava_ros.errors import Guard, LavaError, RefusalError
from lava_ros.live.catch_up import Published
from lava_ros.live.commands import Command, command, CommandQueue, finish
from lava_ros.live.failures import failure_text, SimulationError
from lava_ros.live.pace import Pace
from lava_ros.live.session import Fork, Origin, SessionView, SimulationSession
from lava_ros.live.worker_status import (
    MAX_TASK_DURATION,
    step_refusal,
    WorkerState,
    WorkerStatus,
)
from lava_ros.scene import check_vents, Scene, Terrain, Vent
from lava_ros.scene.materials import DEFAULT
from lava_ros.scene.uncertainty import Uncertainty

if TYPE_CHECKING:
    # Importing the solver loads Warp, so only the thread imports it.
    from lava_ros.simulation import Simulation, Snapshot

#: Default uncertainty of a scene that was received on topics.
OPEN = Uncertainty(material=DEFAULT)

#: Default of the maximum number of particles, or of cells with lava.
MAX_PARTICLES = 20_000_000

#: Wall time of a slice of simulation [s]. A command waits at most for a slice and a time step.
SLICE_WALL_TIME = 0.1

#: Wall time between two readings of the clock if the simulation keeps up or is held [s].
IDLE_WALL_TIME = 0.1

#: Minimum wall time between two rounds of commands [s].
ROUND_WALL_TIME = 0.02

#: Wall time after which a round of commands begins no further command before the next slice [s].
MAX_ROUND_WALL_TIME = 0.1

#: Maximum wall time for which a restarted simulation catches up before it is shown [s].
MAX_CATCH_UP = 5.0

#: Error of a command after ``stop``.
STOPPED = RefusalError('simulation', 'The simulation has stopped', 'Start a new one')


@dataclass(eq=False)
class SimulationWorker:
    """Runs a simulation that follows a clock, in a separate thread.

    Time steps have their natural length: one begins when it ends at or before the simulated time
    that the clock requires (``Pace``). Only changes of vents, terrain and effects, a pause,
    ``step`` and the end time shorten a step.

    A ``command`` returns immediately with a future. A refused one sets a LavaError in its future
    and changes nothing. A command that replaces all of its kind (vents, terrain, a parameter)
    cancels the future of a waiting one. Any other exception stops the simulation: the state is
    FAILED, the last snapshot remains, and ``reset`` restarts it. An exception outside a command
    and the simulation is reported (``WorkerStatus.fault``), and the thread continues.

    ``make_simulation`` makes the simulation of a scene at time 0, in the thread. ``clock`` returns
    the time to follow [s]. ``constants`` are the lava and its surroundings until a scene defines
    them, ``end_time`` is the simulated end time [s]. ``on_snapshot`` is called when ``latest`` has
    changed or was requested, in any thread. Other threads only read ``view`` and ``latest``.
    """

    make_simulation: Callable[[Scene], 'Simulation']
    clock: Callable[[], float]
    constants: Mapping[str, Any] | None = None
    time_scale: InitVar[float] = 1.0
    end_time: InitVar[float | None] = None
    paused: InitVar[bool] = False
    max_particles: int = MAX_PARTICLES
    on_snapshot: Callable[[], None] = lambda: None

    def __post_init__(self, time_scale: float, end_time: float | None, paused: bool) -> None:
        """Prepare the thread; ``start`` runs it."""
        self._waiting_vents: tuple[tuple[Vent, ...], Future[None]] | None = None
        self._finisher = ThreadPoolExecutor(1, thread_name_prefix='lava snapshots')
        self._finishing: Future[None] | None = None
        self._status = WorkerStatus(WorkerState.WAITING)
        self.session = SimulationSession(self._make, constants=self.constants)
        self.pace = Pace(
            self.clock, self.session, time_scale, end_time=end_time, is_paused=paused
        )
        self._is_stopping = False
        self._threads_guard = Guard('simulation thread', SimulationError)
        self._updated = 0.0
        self.commands = CommandQueue()
        self._last_round = 0.0
        # the current task with its begin, and the duration of the last slice
        self._task, self._slice = ('', 0.0), 0.0
        self._thread = threading.Thread(target=self._run, name='lava simulation', daemon=True)

    @property
    def latest(self) -> 'Snapshot | None':
        """The newest snapshot, None before the first."""
        return self.session.latest

    @property
    def view(self) -> SessionView:
        """The published values of the session."""
        return self.session.view

    @property
    def status(self) -> WorkerStatus:
        """The current status of the worker, even if its thread is busy or has ended."""
        (task, begun), now = self._task, time.monotonic()
        so_far = now - begun if task else 0.0
        status = replace(
            self._status,
            current_task=task,
            task_duration=max(so_far, self._status.task_duration),
            waiting=self.commands.kinds,
            fault=self._threads_guard.error,
        )
        is_timed = status.state in (WorkerState.RUNNING, WorkerState.STARTING)
        if is_timed and now - self._updated > MAX_TASK_DURATION:
            unread = self.pace.clock.unread * self.pace.time_scale
            status = replace(status, age=status.age + unread)
        has_begun, is_alive = self._thread.ident is not None, self._thread.is_alive()
        if has_begun and not is_alive and status.state is not WorkerState.STOPPED:
            error = 'the thread of the simulation has ended'
            status = replace(status, state=WorkerState.FAILED, error=error)
        return status

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self, timeout: float | None = None) -> bool:
        """End the thread after its current slice; return True if it ended within ``timeout`` [s].

        Waiting and later commands are refused.
        """
        self._is_stopping = True
        self.commands.close(STOPPED)
        if self._thread.ident is not None:
            self._thread.join(timeout)
        return not self._thread.is_alive()

    @command()
    def set_scene(self, scene: Scene) -> None:
        """Replace the simulation by one of ``scene`` at time 0."""
        self.session.start(scene)

    @command()
    def resume_with(
        self,
        make_simulation: Callable[[], 'Simulation'],
        scene: Scene,
        origin: Origin | None = None,
        before: tuple[Vent, ...] = (),
        *,
        published: Published | None = None,
    ) -> None:
        """Continue with another simulation of a scene (see ``SimulationSession.resume_with``).

        Before its first snapshot, simulate up to the newest maps that a killed process has
        ``published``, for at most ``MAX_CATCH_UP``. Then catch up with the time to which the
        clock has advanced since.
        """
        self._status = replace(self._status, state=WorkerState.STARTING)
        self.session.resume_with(make_simulation(), scene, origin, before)
        self.pace.resume_from(published)
        reached = published.time if published is not None else 0.0
        reached = min(reached, self.pace.end_time or reached)
        end = time.monotonic() + MAX_CATCH_UP
        while self.session.time < reached and time.monotonic() < end and not self._is_stopping:
            self._advance_session(reached)

    @command('checkpoint')
    def checkpoint(self) -> bytes:
        """Serialise the state for a later resume; the future fails without a simulation."""
        return self.session.checkpoint().to_bytes()

    @command('fork')
    def fork(self) -> Fork:
        """Copy the state for another simulation; the future fails without a simulation."""
        begun = time.monotonic()
        checkpoint = self.session.checkpoint()
        # the state belongs to an earlier time of the clock
        clock = self.clock() - self.pace.age / self.pace.time_scale
        return Fork(checkpoint, self.session.view.changes, clock, time.monotonic() - begun)

    @command('terrain')
    def set_terrain(self, terrain: Terrain) -> None:
        """Replace the terrain under the flow; the first terrain starts the simulation."""
        if self.session.scene is not None:
            if self.session.set_terrain(terrain):
                self._show()
            return
        vents, future = self._waiting_vents or ((), None)
        error: LavaError | None = None
        try:
            vents = check_vents(vents, terrain)
        except LavaError as refused:
            vents, error = (), refused
        self.session.start(Scene(terrain, vents=vents, uncertainty=OPEN, **self.session.constants))
        self._waiting_vents = None
        if future is not None:
            finish(future, error)

    def set_vents(self, vents: Iterable[Vent]) -> 'Future[None]':
        """Replace all vents; before there is a terrain, the newest ones wait for it."""
        vents = tuple(vents)
        future: Future[None] = Future()

        def set_or_wait() -> None:
            if self.session.scene is not None:
                self.session.set_vents(vents)
                return
            if self._waiting_vents is not None:
                self._waiting_vents[1].cancel()
            self._waiting_vents = vents, future

        self.commands.put(Command(set_or_wait, future, 'vents'))
        return future

    def add_vent(self, vent: Vent) -> 'Future[None]':
        """Add a vent; refused before there is a terrain.

        Vents of commands that follow each other are added together.
        """
        return self.commands.submit(self._add_vents, item=vent)

    def _add_vents(self, commands: list[Command]) -> None:
        """Add the vents of commands as one change, and refuse those that cannot be added."""
        errors = self.session.add_vents([item.item for item in commands])
        for number, error in errors.items():
            finish(commands[number].future, error)

    @command('constants')
    def set_constants(self, constants: Mapping[str, Any]) -> None:
        """Replace the lava properties, effective at the next start or reset."""
        self.session.set_constants(constants)

    @command('effects')
    def set_effects(self, forced: Mapping[str, bool], *, horizon: float) -> None:
        """Choose the effects again, with some forced on or off, for a horizon [s].

        The thread then compiles new kernels; the last snapshot remains until that is done.
        """
        self.session.set_effects(forced, horizon=horizon)
        self._show()

    def set(self, name: str, value: float | None) -> 'Future[None]':
        """Change ``time_scale``, ``end_time`` or ``max_particles``."""
        owner = self if name == 'max_particles' else self.pace
        return self.commands.submit(partial(setattr, owner, name, value), name)

    @command('pause')
    def pause(self, paused: bool) -> None:
        """Hold simulated time, or let it continue."""
        pace, now = self.pace, self.session.time
        is_new = paused and not pace.is_paused
        if is_new and now < pace.target <= now + self.session.view.step:
            self._advance_session(pace.target)
        pace.pause(paused)

    @command('reset')
    def reset(self) -> None:
        """Restart the scene at time 0, even after a failure; a pause remains."""
        self.session.reset()

    @command('step')
    def step(self, duration: float) -> None:
        """Advance a paused simulation by a duration [s]."""
        if self.session.simulation is None or not self.pace.is_paused:
            raise step_refusal(self._status.state)
        begin = self.session.time if self.pace.step_target is None else self.pace.step_target
        self.pace.step_target = begin + duration

    @command('snapshot')
    def request_snapshot(self) -> None:
        """Begin an update of ``latest``; ``on_snapshot`` is called even without a change."""
        finishing = self._finishing
        if finishing is not None and not finishing.done():
            finishing.add_done_callback(lambda _: self.request_snapshot())
            return
        # Maps are due when the clock has advanced, so simulate to its current time first.
        self._guard(self._advance)
        rest = self.session.begin_snapshot()
        if rest is None:
            # a layer that has just become due may not have published the current snapshot
            self._report_snapshot()
        else:
            simulation = self.session.simulation
            self._finishing = self._finisher.submit(self._finish_snapshot, rest, simulation)

    def _run(self) -> None:
        while not self._is_stopping:
            self._threads_guard.run(self._run_commands)
            if not self._is_stopping:
                self._guard(self._advance)
                self._guard(self._update_status)
        self._status = replace(self._status, state=WorkerState.STOPPED, speed=0.0)
        if self._waiting_vents is not None:
            finish(self._waiting_vents[1], STOPPED)
        self._finisher.shutdown()
        # Free the device memory even if the worker is still referenced.
        self.session.fail()

    def _run_commands(self) -> None:
        time.sleep(max(0.0, self._last_round + ROUND_WALL_TIME - time.monotonic()))
        is_due = self.pace.target > self.pace.followed
        wait = 0.0 if is_due and self.pace.is_moving else IDLE_WALL_TIME
        with suppress(queue.Empty):
            first = self.commands.get(wait)
            self._last_round = begun = time.monotonic()
            self._execute(first)
            # Later commands wait for the next round, so that simulated time always advances.
            for _ in range(len(self.commands)):
                if self._is_stopping or time.monotonic() - begun >= MAX_ROUND_WALL_TIME:
                    return
                self._execute(self.commands.get(0.0))

    def _execute(self, commands: list[Command]) -> None:
        """Execute a command, or several that run together."""
        first, starts = commands[0], self.session.view.starts
        action = first.action if first.item is None else partial(first.action, commands)
        self._task = first.kind or 'a command', time.monotonic()
        try:
            result, error = action(), None
            if self.session.view.starts != starts:
                self._status = replace(self._status, error='')
                self.pace.restart()
                self._show()
        except Exception as raised:
            result, error = None, raised
            if not isinstance(error, LavaError) or isinstance(error, MemoryError):
                self._fail(error)
        self._task = '', 0.0
        # the status follows the command before the caller can read it
        self._guard(self._update_status)
        for future in (item.future for item in commands):
            # vents that wait for a terrain are not complete yet
            is_waiting = self._waiting_vents is not None and self._waiting_vents[1] is future
            if not (future.done() or (is_waiting and error is None)):
                finish(future, error, result=result)

    def _guard(self, action: Callable[[], None]) -> None:
        """Run an action of the simulation, which fails with any exception."""
        self._threads_guard.run(action, self._fail)

    def _fail(self, error: Exception) -> None:
        text = failure_text(error, self.session.latest)
        self.session.fail()
        self.pace.step_target = None
        self._status = replace(self._status, state=WorkerState.FAILED, error=text)

    def _advance(self) -> None:
        pace, before = self.pace, self.session.time
        pace.move()
        if not pace.is_moving:
            return
        self._slice = 0.0
        if pace.target > before:
            begun = time.monotonic()
            self._task = 'a step', begun
            is_waiting = pace.age <= pace.max_wait
            try:
                self._advance_session(
                    pace.target, whole_steps=is_waiting and pace.step_target is None
                )
            finally:
                self._task, self._slice = ('', 0.0), time.monotonic() - begun
            pace.speed.note(pace.followed)
        if pace.step_target is not None and self.session.time >= pace.target:
            pace.step_target = None

    def _advance_session(self, until: float, *, whole_steps: bool = False) -> None:
        """Simulate a slice up to a time [s]."""
        self.session.advance(
            until,
            wall_limit=SLICE_WALL_TIME,
            max_particles=self.max_particles,
            limit=self.pace.end_time if whole_steps else None,
            whole_steps=whole_steps,
        )

    def _update_status(self) -> None:
        pace, old, error = self.pace, self._status.state, self._status.error
        if error:
            state = WorkerState.FAILED
        elif self.session.simulation is None:
            state = WorkerState.WAITING
        elif pace.is_finished:
            state = WorkerState.FINISHED
        elif pace.is_paused:
            state = WorkerState.PAUSED
        else:
            state = WorkerState.RUNNING
        if state is WorkerState.RUNNING and old is not WorkerState.RUNNING:
            pace.follow()
        if state is not WorkerState.RUNNING and pace.step_target is None:
            pace.speed.clear()
        # At rest, update the snapshot before the status reports the state.
        is_new = not pace.is_moving and self._is_snapshot_new()
        self._updated = time.monotonic()
        self._status = WorkerStatus(
            state=state,
            error=error,
            device=self.session.view.device,
            task_duration=self._slice if pace.is_moving else 0.0,
            **pace.report(is_running=state is WorkerState.RUNNING),
        )
        if is_new:
            self._report_snapshot()

    def _report_snapshot(self) -> None:
        if not self._is_stopping:
            self._threads_guard.run(self.on_snapshot)

    def _show(self) -> None:
        if self._is_snapshot_new():
            self._report_snapshot()

    def _is_snapshot_new(self) -> bool:
        """Update ``latest`` now; return True if it may have changed."""
        finishing, self._finishing = self._finishing, None
        if finishing is not None:
            wait([finishing])
        return self.session.renew_snapshot() or finishing is not None

    def _finish_snapshot(self, rest: Callable[[], None], simulation: 'Simulation | None') -> None:
        """Complete a snapshot; an error is a failure of its simulation."""
        try:
            rest()
        except Exception as error:
            self._fail_in_thread(error, simulation)
        else:
            self._report_snapshot()

    @command('failure')
    def _fail_in_thread(self, error: Exception, simulation: 'Simulation | None') -> None:
        if self.session.simulation is simulation:
            self._fail(error)

    def _make(self, scene: Scene) -> 'Simulation':
        self._status = replace(self._status, state=WorkerState.STARTING)
        return self.make_simulation(scene)
