# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Repeated forecasts of the live simulation in a separate process."""

from collections.abc import Callable
from concurrent.futures import CancelledError
from concurrent.futures import TimeoutError as FutureTimeoutError
from contextlib import suppress
from dataclasses import dataclass, replace
import math
import time
from typing import Any

from lava_ros.errors import LavaError, RefusalError
from lava_ros.layers.forecast import EnsembleForecast, Forecast
from lava_ros.live.ensemble_forecasts import EnsembleForecasts, ForecastRules, ForecastStatus
from lava_ros.live.process_thread import ProcessThread
from lava_ros.live.session import Fork
from lava_ros.live.worker import SimulationWorker
from lava_ros.live.worker_status import WorkerState
from lava_ros.processes.requests import ChildProcess

#: Minimum wall time between the starts of two forecasts [s].
MIN_PERIOD = 1.0

#: Minimum wall time between two copies of the state, as a multiple of the time that a copy takes:
#: the thread of the live simulation makes the copies.
FORK_REST = 20.0

#: Maximum lag of the live simulation behind the clock at which forecasts still get more time [s]:
#: above the lag of normal slices and steps, below the lag at which time is lost.
MAX_LAG_INCREASE = 0.5

#: Wall time between two checks of the live simulation [s].
_WATCH_TIME = 0.1

#: Minimum fraction of a device's time for forecasts, by kind of device. Each of two busy processes
#: gets half of a GPU, so the live simulation loses half of this fraction. On a CPU, forecasts have
#: a low priority and slow the simulation only by their use of caches and memory.
MIN_DUTY_CYCLES = {'cpu': 0.25, 'cuda': 0.1}

#: Increase of the fraction per second [1/s] while the live simulation keeps up.
DUTY_CYCLE_RATE = 0.1

#: First and maximum wall time before the retry after a failure [s]; each failure doubles it.
_RETRY_TIMES = (2.0, 60.0)


class DutyCycle:
    """The fraction of time for forecasts, which is minimal while the simulation falls behind."""

    def __init__(self) -> None:
        """Initialize with the full time."""
        self._share = 1.0
        self._noted = math.inf

    def note(self, is_behind: bool, now: float) -> None:
        """Record whether the simulation is behind its clock at wall time ``now`` [s]."""
        increase = DUTY_CYCLE_RATE * max(0.0, now - self._noted)
        self._share = 0.0 if is_behind else min(1.0, self._share + increase)
        self._noted = now

    def share(self, max_share: float, device: str) -> float:
        """Return the current fraction on a device, at most ``max_share``."""
        min_share = MIN_DUTY_CYCLES[device.partition(':')[0]]
        return min(max(round(self._share, 1), min_share), max_share)


def start_process() -> ChildProcess:
    """Start a process that computes forecasts."""
    return ChildProcess('lava_ros.forecast.process:Forecasting')


@dataclass(eq=False)
class Forecaster(ProcessThread):
    """Repeatedly computes a forecast from the newest state, in a separate process.

    When the scene or the effects change, a forecast in progress is dropped and a new one starts. A
    state at rest is forked only once. While the live simulation falls behind its clock, the
    process may use a smaller fraction of the time. If ensembles are enabled, the next one starts
    from a fork as soon as the previous one is complete.

    ``rules`` returns the current settings. ``on_change`` is called in the thread when ``latest``,
    the newest forecast, or the scene has changed. ``status`` is the status of the forecasts.
    """

    worker: SimulationWorker
    rules: Callable[[], ForecastRules]
    on_change: Callable[[], None] = lambda: None
    make_process: Callable[[], ChildProcess] = start_process

    def __post_init__(self) -> None:
        """Prepare the thread; ``start`` runs it."""
        super().__init__('lava forecasts', 'the forecasts')
        self.ensembles = EnsembleForecasts()
        self.latest: Forecast | None = None
        self.status = ForecastStatus()
        self._duty_cycle = DutyCycle()
        self.is_wanted = False
        self._failures = self._number = self._reported = 0
        self._forked: tuple[int, float] | None = None
        self._changes: int | None = None
        # the fork from which the forecast in progress started
        self._current_fork: Fork | None = None
        self._due = self._due_after_change = 0.0

    def age(self, forecast: Forecast | EnsembleForecast | None) -> float:
        """Return the simulated time since the start of a forecast or ensemble [s], 0 for None.

        It passes with the clock, even while the simulation waits for the end of a time step.
        """
        if forecast is None:
            return 0.0
        status = self.worker.status
        return max(0.0, status.time + status.age - forecast.time)

    def staleness(self, forecast: Forecast | EnsembleForecast | None) -> str:
        """Return the reason why a forecast or ensemble is stale, empty if it is valid."""
        if forecast is None:
            return 'there is none yet'
        if self.worker.view.changes != forecast.changes:
            return 'the scene or the effects have changed'
        if self.worker.status.state is WorkerState.FAILED:
            return 'the simulation has failed'
        age, max_age = self.age(forecast), self.rules().max_age
        if age > max_age:
            return f'it is {age:.0f} s old, and valid for at most {max_age:.0f} s'
        return '' if self.is_wanted else 'the node is not active'

    def want(self, is_wanted: bool) -> None:
        """Start or stop making forecasts."""
        self.is_wanted = is_wanted

    def _step(self) -> None:
        """Begin a forecast that is due, forward outlines, and process one reply."""
        self._report_changes()
        self._cancel_outdated(self.worker.view.changes)
        is_another = self.worker.view.changes != self._changes
        due = self._due_after_change if is_another else self._due
        is_due = self.is_wanted and time.monotonic() >= due
        if is_due and self._process is None:
            # starting takes a while, so start before there is a state to forecast from
            self._process = self.make_process()
            if self.rules().members:
                self._process.request('prepare')
        if is_due and self._current_fork is None and self._is_something_new():
            self._begin()
        if self._process is None:
            self._stopping.wait(_WATCH_TIME)
            return
        rules, view, status = self.rules(), self.worker.view, self.worker.status
        self.ensembles.send(
            self._process.request, changes=view.changes, time_scale=rules.time_scale,
            now=status.time + min(view.step, status.age),
        )
        if self._current_fork is not None and self._renew_share(rules):
            self._process.request('share', share=self.status.share)
        reply = self._process.reply(_WATCH_TIME)
        if reply is not None:
            name, values = reply
            self._handle_reply(name, **values)

    def _report_changes(self) -> None:
        changes = self.worker.view.changes
        if changes != self._reported:
            self._reported = changes
            self.on_change()

    def _is_something_new(self) -> bool:
        snapshot = self.worker.latest
        if snapshot is None or self.worker.status.state is WorkerState.FAILED:
            return False
        state = (self.worker.view.changes, snapshot.time)
        has_members = self.rules().members > 0
        return state != self._forked or (has_members and self.ensembles.is_wanted(*state))

    def _cancel_outdated(self, changes: int) -> None:
        """Cancel what is in progress if the scene has had other ``changes``, or is not wanted."""
        is_outdated = not self.is_wanted or changes != self._changes
        if is_outdated and (self._current_fork is not None or self.ensembles.is_busy):
            if self._process is not None:
                self._process.request('cancel')
            self._report_changes()
            self._cancel('the scene has changed' if self.is_wanted else 'the node is not active')

    def _cancel(self, reason: str) -> None:
        # a state that has been dropped may be forked again
        self._current_fork = self._forked = None
        self.ensembles.cancel(reason)
        self._put_status(progress=None)

    def _fail(self, error: Exception) -> None:
        is_known = isinstance(error, (LavaError, ChildProcessError))
        reason = str(error) if is_known else f'{type(error).__name__}: {error}'
        self._put_status(error=reason)
        rest = min(_RETRY_TIMES[0] * 2.0**self._failures, _RETRY_TIMES[1])
        self._failures += 1
        self._due = self._due_after_change = time.monotonic() + rest
        self._cancel(reason)
        self._end_process()

    def _begin(self) -> None:
        """Fork the simulation and request a forecast from the copy."""
        assert self._process is not None
        rules, begun = self.rules(), time.monotonic()
        fork = self._fork()
        if fork is None:
            return
        # the scene may have changed since this step began
        self._cancel_outdated(fork.changes)
        self._number += 1
        self._renew_share(rules)
        self._put_status(progress=0.0)
        self._current_fork = fork
        # the next fork must differ from this state
        self._forked = fork.changes, fork.checkpoint.time
        self._changes = fork.changes
        # a changed scene has no forecast at all, so it need not wait for MIN_PERIOD
        self._due_after_change = begun + FORK_REST * fork.wall_time
        self._due = max(begun + MIN_PERIOD, self._due_after_change)
        self._process.request('share', share=self.status.share)
        self._process.request(
            'fork',
            number=self._number,
            checkpoint=fork.checkpoint,
            horizon=rules.horizon,
            threshold=rules.threshold_for(fork.checkpoint.accuracy),
            device=self.worker.status.device or None,
            max_particles=rules.max_particles,
            is_first=self.latest is None or self.latest.changes != fork.changes,
            ensemble=self.ensembles.request(fork, self._number, rules),
        )

    def _fork(self) -> Fork | None:
        future = self.worker.fork()
        while not (self._stopping.is_set() or future.cancelled()):
            with suppress(FutureTimeoutError, CancelledError):
                fork: Fork = future.result(_WATCH_TIME)
                return fork
        return None

    def _handle_reply(self, name: str, **values: Any) -> None:
        if self.ensembles.handle_reply(name, **values):
            self.on_change()
        fork = self._current_fork
        if fork is None or values.pop('number', None) != self._number:
            return
        if name == 'refused':
            raise RefusalError('forecast', values['reason'], 'The forecast will be tried again')
        if name == 'forecast':
            self._current_fork = None
            values['terrain'] = fork.checkpoint.scene.terrain
            values |= {'stamp_ns': round(fork.clock * 1e9), 'changes': fork.changes}
            self.latest = Forecast(**values)
            self._failures = 0
            self._put_status(progress=None, count=self.status.count + 1, error='')
            self.on_change()
        elif name == 'progress':
            self._put_status(progress=values['progress'])

    def _renew_share(self, rules: ForecastRules) -> bool:
        """Adapt the fraction of time to the live simulation's lag; return True if it changed."""
        worker, former = self.worker.status, self.status.share
        is_running = worker.state is WorkerState.RUNNING
        self._duty_cycle.note(is_running and worker.lag > MAX_LAG_INCREASE, time.monotonic())
        self._put_status(share=self._duty_cycle.share(rules.share, worker.device))
        return self.status.share != former

    def _put_status(self, **changes: Any) -> None:
        self.status = replace(self.status, **changes)
