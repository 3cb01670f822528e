# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The numerical error of the live simulation, measured by partner runs in a separate process."""

from collections.abc import Callable
from dataclasses import dataclass, replace
import time

from lava_ros.bag.description import is_on
from lava_ros.effects import EFFECTS, Effects
from lava_ros.errors import RefusalError
from lava_ros.layers.numbers import duration
from lava_ros.live.process_thread import ProcessThread
from lava_ros.live.worker import SimulationWorker
from lava_ros.live.worker_status import WorkerState
from lava_ros.processes.requests import ChildProcess
from lava_ros.simulation.numerical_error import Areas, error_text, NumericalError

#: Wall time from the start of a simulation to the first measurement [s].
FIRST_WALL_TIME = 60.0

#: Ratio of the simulated times of two measurements: all partner runs together take about a fifth
#: of the time of the simulation.
LATER = 3.0

#: Wall time between two checks [s].
_WATCH_TIME = 0.2


def partner_process() -> ChildProcess:
    """Start a process for one measurement."""
    return ChildProcess('lava_ros.forecast.partner_process:PartnerRuns')


@dataclass(eq=False)
class ErrorMeasurement(ProcessThread):
    """Measures the error after the first minute, again when time has tripled, and at the end.

    The partner runs repeat the run from its start with its vents. After a change of the ground
    under lava they cannot, and the error is not measured.

    ``share`` returns the maximum fraction of one core's time for partner runs while the simulation
    runs; 0 measures nothing. ``latest`` is the newest error, None before the first, ``failure``
    the reason why the last measurement failed.
    """

    worker: SimulationWorker
    share: Callable[[], float]
    make_process: Callable[[], ChildProcess] = partner_process
    first_wall_time: float = FIRST_WALL_TIME

    def __post_init__(self) -> None:
        """Prepare the thread; ``start`` runs it."""
        super().__init__('lava error', 'the numerical error')
        self.latest: NumericalError | None = None
        self.failure = ''
        self._starts, self._begun = -1, 0.0
        # simulated time of the measurement in progress, or of the last one that failed
        self._asked = 0.0

    def text(self) -> str:
        """Return the error and its simulated time, or why it is not yet measured."""
        text = error_text(self.latest)
        if self.latest is not None:
            return f'{text}, at {duration(self.latest.time)}'
        reason = self.failure or ('' if self.share() else 'error_share is 0')
        if self.worker.view.repeatable is None and self.worker.view.starts:
            reason = 'the ground has changed under lava'
        return f'{text}: {reason}' if reason else text

    def _step(self) -> None:
        view = self.worker.view
        if view.starts != self._starts:
            self._end_process()
            self._starts, self._begun = view.starts, time.monotonic()
            self.latest, self.failure, self._asked = None, '', 0.0
        if self._process is None:
            if self._is_due():
                self._begin()
            else:
                self._stopping.wait(_WATCH_TIME)
            return
        is_finished = self.worker.status.state is WorkerState.FINISHED
        if is_finished and self._asked < view.time:
            # measure the error at the end instead, without pauses
            self._end_process()
            return
        reply = self._process.reply(_WATCH_TIME)
        if reply is not None:
            name, values = reply
            self._end_process()
            if name == 'refused':
                remedy = 'The error is measured again when the simulation has advanced'
                raise RefusalError('numerical error', values['reason'], remedy)
            self.latest, self.failure = values['error'], ''

    def _is_due(self) -> bool:
        snapshot, view, state = self.worker.latest, self.worker.view, self.worker.status.state
        if snapshot is None or view.repeatable is None or view.accuracy is None:
            return False
        if not self.share():
            return False
        if snapshot.time <= self._asked or not Areas.of(snapshot).inundated.any():
            return False
        if state is WorkerState.FINISHED:
            return snapshot.time == view.time
        is_early = time.monotonic() < self._begun + self.first_wall_time
        return state is WorkerState.RUNNING and not (
            is_early or snapshot.time < LATER * self._asked
        )

    def _begin(self) -> None:
        """Start a process, and request the error of the newest snapshot."""
        view, snapshot = self.worker.view, self.worker.latest
        assert snapshot is not None and view.repeatable is not None
        self._asked = snapshot.time
        self._process = self.make_process()
        is_running = self.worker.status.state is WorkerState.RUNNING
        self._process.request(
            'measure',
            share=self.share() if is_running else 1.0,
            scene=replace(view.repeatable, vents=view.schedule),
            run=Areas.of(snapshot),
            time=snapshot.time,
            accuracy=view.accuracy,
            effects=Effects(**{name: is_on(view.effects.get(name, '')) for name in EFFECTS}),
            horizon=snapshot.time,
            device=view.device or None,
        )

    def _fail(self, error: Exception) -> None:
        self.failure = str(error)
        self._end_process()
