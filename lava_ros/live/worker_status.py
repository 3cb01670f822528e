# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Status of the worker, and the speed of its simulation."""

from collections import deque
from dataclasses import dataclass
from enum import Enum
import time

from lava_ros.errors import RefusalError

#: A step or command at or above this wall time is reported as a delay [s]: ten slices.
MAX_TASK_DURATION = 1.0

#: Lag at or below which simulated time has reached the clock [s].
ROUNDING = 1e-3


class WorkerState(Enum):
    """State of the worker."""

    WAITING = 'waiting for terrain'
    STARTING = 'starting'
    RUNNING = 'running'
    PAUSED = 'paused'
    FINISHED = 'finished'
    FAILED = 'failed'
    STOPPED = 'stopped'


#: Remedies of a refused step, by the state of the simulation.
_STEP_REMEDIES = {
    WorkerState.WAITING: 'Publish a terrain first',
    WorkerState.FINISHED: 'Raise end_time, or start again with ~/reset',
    WorkerState.FAILED: 'Start again with ~/reset',
}


def step_refusal(state: WorkerState) -> RefusalError:
    """Return the error about a step of a simulation that is not paused."""
    remedy = _STEP_REMEDIES.get(state, 'Pause it first')
    return RefusalError('step', f'The simulation is {state.value}', remedy)


@dataclass(frozen=True)
class WorkerStatus:
    """Status of the worker.

    Attributes:
        state: State of the worker.
        error: Reason of the failure, empty unless the state is FAILED.
        speed: Simulated time per wall time over the last seconds.
        mean_speed: Simulated time per wall time since the start, without pauses.
        device: Name of the simulation's device, empty before there is one.
        lag: Lag of simulated time behind the time of the clock before its newest step, without
            the wait for the end of a time step [s of the clock].
        lost: Time of the clock since the start that simulated time has not followed [s].
        jump: Newest jump of the clock [s], negative for a jump back. Jumps are not followed.
        jumps: Number of jumps of the clock since the start.
        time: Simulated time of the current state [s].
        age: Simulated time from the current state to the time of the clock [s]. It includes the
            wait for the end of a time step, and grows while the thread is busy or has ended.
        max_age: Age above which the state is stale [s]: the time step, and some delay.
        is_catching_up: True if a resumed simulation has not reached the time of the clock yet.
        fault: Unexpected exception of the thread outside the simulation, empty without one.
        current_task: Task of the thread: ``a step`` or the kind of a command; empty in between.
        task_duration: Wall time of the current task so far or, if longer, of the last step [s].
        waiting: Kinds of the waiting commands.
    """

    state: WorkerState
    error: str = ''
    speed: float = 0.0
    mean_speed: float = 0.0
    device: str = ''
    lag: float = 0.0
    lost: float = 0.0
    jump: float = 0.0
    jumps: int = 0
    time: float = 0.0
    age: float = 0.0
    max_age: float = 0.0
    is_catching_up: bool = False
    fault: str = ''
    current_task: str = ''
    task_duration: float = 0.0
    waiting: tuple[str, ...] = ()

    @property
    def is_behind(self) -> bool:
        """True if simulated time falls behind the clock."""
        return self.state is WorkerState.RUNNING and self.lag > ROUNDING

    @property
    def is_stale(self) -> bool:
        """True if the state does not follow the clock, so that its maps must not be repeated."""
        return self.state is WorkerState.FAILED or self.age > self.max_age

    @property
    def blocked_by(self) -> str:
        """Description of a task that delays commands, with its duration; empty if it is short."""
        if self.task_duration < MAX_TASK_DURATION:
            return ''
        task = self.current_task or 'a step'
        waiting = f'; waiting for it: {", ".join(self.waiting)}' if self.waiting else ''
        return f'{task} takes {self.task_duration:.1f} s or more{waiting}'


#: Wall time over which the speed is averaged [s].
SPEED_WINDOW = 5.0


class SpeedMeter:
    """Averages simulated time per wall time, over the last seconds and over the whole run."""

    def __init__(self) -> None:
        """Initialize without notes."""
        self._history: deque[tuple[float, float]] = deque()
        self._wall_time = 0.0
        self._simulated_time = 0.0

    @property
    def value(self) -> float:
        """Simulated time per wall time over ``SPEED_WINDOW``, 0 before the second note."""
        if len(self._history) < 2:
            return 0.0
        (start, first), (end, last) = self._history[0], self._history[-1]
        return (last - first) / (end - start) if end > start else 0.0

    @property
    def mean(self) -> float:
        """Simulated time per wall time over all notes, without pauses."""
        return self._simulated_time / self._wall_time if self._wall_time > 0.0 else 0.0

    def note(self, reached: float) -> None:
        """Record that a simulated time [s] has just been reached."""
        now = time.monotonic()
        if self._history:
            self._wall_time += now - self._history[-1][0]
            self._simulated_time += reached - self._history[-1][1]
        self._history.append((now, reached))
        while now - self._history[0][0] > SPEED_WINDOW:
            self._history.popleft()

    def clear(self) -> None:
        """End an interval; the next note starts a new one."""
        self._history.clear()
