# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Forecasts during a live simulation."""

from concurrent.futures import CancelledError, Future
from contextlib import nullcontext, suppress
from dataclasses import replace
import os
import queue
import signal
import time
from types import SimpleNamespace

import numpy as np
import pytest

from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.forecast import process as forecast_process
from lava_ros.forecast.assimilation import Mask
from lava_ros.forecast.forecast_run import ForecastRun, N_FIRST_SAMPLES, N_SAMPLES
from lava_ros.live import forecaster
from lava_ros.live.ensemble_forecasts import ForecastRules
from lava_ros.live.forecaster import (
    DUTY_CYCLE_RATE,
    DutyCycle,
    Forecaster,
    MIN_DUTY_CYCLES,
    MIN_PERIOD,
)
from lava_ros.live.session import Fork
from lava_ros.live.worker import SimulationWorker
from lava_ros.live.worker_status import WorkerState, WorkerStatus
from lava_ros.processes import requests as request_loops
from lava_ros.processes.requests import NICENESS
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from waiting import PATIENCE, wait_until

RULES = ForecastRules(
    horizon=200.0, threshold=0.01, max_age=1e9, share=1.0, max_particles=1_000_000
)

#: Simulated time per wall time [s/s], far below the solver's maximum.
SCALE = 5.0


def scene(discharge=20.0):
    """Return a slope towards +x with a vent at its top."""
    ground = np.tile(500.0 - 2.0 * np.arange(30), (20, 1))
    vent = Vent((55.0, 100.0), discharge, radius=15.0)
    return Scene(Terrain(ground, 10.0), (vent,), Lava.paper(viscosity=1e4))


def simulation_of(scene):
    return Simulation(
        scene, effects=Effects(), accuracy=Accuracy(spacing=8.0, thickness=1.0), device='cpu'
    )


class Bench:
    """A worker and a forecaster."""

    def __init__(self):
        self.rules = RULES
        self.started = []
        self.horizon = None
        self.worker = SimulationWorker(simulation_of, clock=time.monotonic, time_scale=SCALE)
        self.reasons = []
        self.forecaster = Forecaster(
            self.worker, lambda: self.rules,
            on_change=lambda: self.reasons.append(self.staleness()), make_process=self._process,
        )
        self.worker.start()
        self.worker.set_scene(scene()).result(PATIENCE)
        self.forecaster.start()
        self.forecaster.want(True)

    def _process(self):
        process = forecaster.start_process()
        self.started.append(process.pid)
        request = process.request

        def noted(name, **values):
            self.horizon = values.get('horizon', self.horizon)
            request(name, **values)

        process.request = noted
        return process

    def forecast(self, condition=lambda _: True):
        """Wait for a forecast that fulfils a condition, while snapshots continue."""

        def found():
            self.worker.request_snapshot()
            latest = self.forecaster.latest
            return latest if latest is not None and condition(latest) else None

        return wait_until(found, lambda: self.forecaster.status)

    def staleness(self):
        """Return the reason why the newest forecast is stale."""
        return self.forecaster.staleness(self.forecaster.latest)

    def begin_a_long_one(self):
        """Wait until a forecast that takes hours is in progress."""
        self.rules = replace(RULES, horizon=1e7)

        def has_begun():
            self.worker.request_snapshot()
            return self.horizon == 1e7 and self.forecaster.status.progress is not None

        wait_until(has_begun)

    def fork(self):
        """Copy the state; the forecaster's own request for a copy may replace this one."""

        def copied():
            with suppress(CancelledError):
                return self.worker.fork().result(PATIENCE)

        return wait_until(copied)

    def close(self):
        assert self.forecaster.stop(PATIENCE)
        assert self.worker.stop(PATIENCE)


@pytest.fixture(scope='module')
def running():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(forecaster, '_RETRY_TIMES', (0.1, 0.2))
        result = Bench()
        yield result
        result.close()


@pytest.fixture
def bench(running):
    running.rules = RULES
    running.forecaster.want(True)
    running.worker.pause(False).result(PATIENCE)
    running.worker.set_scene(scene()).result(PATIENCE)
    running.forecast(lambda _: running.staleness() == '')
    return running


def test_forecasts_follow_the_live_simulation(bench):
    first, before = bench.forecaster.latest, len(bench.started)
    assert first.horizon == RULES.horizon
    assert np.count_nonzero(first.arrival > 0.0) > 5
    assert bench.staleness() == ''
    second = bench.forecast(lambda item: item is not first)
    assert second.time > first.time
    assert second.stamp_ns > first.stamp_ns
    assert len(bench.started) == before
    bench.worker.pause(True).result(PATIENCE)
    fork = bench.fork()
    last = bench.forecast(lambda item: item.time == fork.checkpoint.time)
    expected = ForecastRun(fork.checkpoint, horizon=200.0, threshold=0.01, device='cpu').run()
    np.testing.assert_array_equal(last.arrival, expected.arrival)
    np.testing.assert_array_equal(last.thickness, expected.thickness)
    np.testing.assert_array_equal(last.temperature, expected.temperature)
    # a state at rest is forked only once
    count = bench.forecaster.status.count
    time.sleep(1.5 * MIN_PERIOD)
    assert bench.forecaster.status.count == count
    assert bench.forecaster.age(bench.forecaster.latest) == 0.0
    # an outline reaches the process, which has no members to weight
    ground = bench.worker.view.scene.terrain
    everywhere = np.ones(ground.shape, dtype=bool)
    mask = Mask(everywhere, everywhere, ground.resolution, ground.origin)
    weighting = bench.forecaster.ensembles.observe(mask, time.monotonic())
    with pytest.raises(LavaError, match=r'horizon of an ensemble \(there is none\)'):
        weighting.result(PATIENCE)


def test_new_scene_makes_forecasts_stale_immediately(bench):
    before = len(bench.started)
    bench.begin_a_long_one()
    old = bench.forecaster.latest
    # the current forecast keeps its rules; the next one uses these
    bench.rules = RULES
    bench.reasons.clear()
    bench.worker.set_vents((Vent((155.0, 100.0), 60.0, radius=15.0),)).result(PATIENCE)
    wait_until(lambda: bench.reasons)
    assert bench.reasons[0] == 'the scene or the effects have changed'
    new = bench.forecast(lambda item: item is not old)
    assert bench.staleness() == ''
    assert new.horizon == RULES.horizon
    reached = np.isfinite(new.arrival) & ~np.isfinite(old.arrival)
    assert reached[:, 15:].sum() > 5
    bench.worker.set_effects({'green': True}, horizon=1e4).result(PATIENCE)
    assert bench.staleness() or bench.forecaster.latest is not new
    assert len(bench.started) == before


def test_forecast_is_stale_above_its_maximum_age(bench):
    bench.forecaster.want(False)
    bench.rules = replace(RULES, max_age=2.0)
    assert bench.staleness() == 'the node is not active'
    age, latest = bench.forecaster.age, bench.forecaster.latest
    wait_until(lambda: (bench.worker.request_snapshot(), age(latest) > 2.0)[1])
    assert bench.staleness().endswith('s old, and valid for at most 2 s')


def test_cancelled_forecast_is_repeated_after_activation(bench):
    bench.begin_a_long_one()
    bench.worker.pause(True).result(PATIENCE)
    old = bench.forecaster.latest
    bench.forecaster.want(False)
    wait_until(lambda: bench.forecaster.status.progress is None)
    bench.rules = RULES
    bench.forecaster.want(True)
    new = bench.forecast(lambda item: item is not old)
    assert new.time == bench.worker.latest.time


def test_killed_process_of_low_priority_is_reported_and_replaced(bench):
    before = len(bench.started)
    bench.begin_a_long_one()
    niceness = os.getpriority(os.PRIO_PROCESS, bench.started[-1])
    assert niceness == min(19, os.getpriority(os.PRIO_PROCESS, 0) + NICENESS)
    old, bench.rules = bench.forecaster.latest, RULES
    os.kill(bench.started[-1], signal.SIGKILL)
    error = wait_until(lambda: bench.forecaster.status.error)
    assert error == 'the process has ended (killed by signal 9)'
    bench.forecast(lambda item: item is not old)
    assert bench.forecaster.status.error == ''
    assert len(bench.started) == before + 1
    assert bench.worker.status.error == ''


def test_failed_forecast_is_reported_without_affecting_the_simulation(bench):
    bench.rules = replace(RULES, max_particles=3)
    error = wait_until(lambda: (bench.worker.request_snapshot(), bench.forecaster.status.error)[1])
    assert 'at most 3 (max_particles)' in error
    bench.rules, old = RULES, bench.forecaster.latest
    bench.forecast(lambda item: item is not old)
    assert bench.worker.status.error == bench.forecaster.status.error == ''


def test_ensemble_of_a_scene_that_changes_before_the_next_copy_is_cancelled(monkeypatch):
    monkeypatch.setattr(forecaster, 'MIN_PERIOD', 0.0)
    checkpoint, asked, replies = simulation_of(scene()).checkpoint(), [], []
    process = SimpleNamespace(
        request=lambda name, **values: asked.append((name, values)),
        reply=lambda _: replies.pop() if replies else None,
    )
    worker = SimpleNamespace(
        view=SimpleNamespace(changes=1, step=1.0), latest=SimpleNamespace(time=0.0),
        status=WorkerStatus(WorkerState.RUNNING, device='cpu'),
    )

    def fork():
        copied = Future()
        copied.set_result(Fork(checkpoint, worker.view.changes, 0.0, 0.0))
        return copied

    worker.fork = fork
    rules = replace(RULES, members=4)
    made = Forecaster(worker, lambda: rules, make_process=lambda: process)
    made.want(True)
    made._step()
    maps = dict.fromkeys(('arrival', 'inundated', 'thickness', 'temperature'))
    replies.append(('forecast', {
        **maps, 'number': 1, 'time': 0.0, 'horizon': 200.0, 'threshold': 0.01, 'duration': 1.0,
        'particle_count': 0,
    }))
    made._step()
    assert [values['ensemble']['changes'] for name, values in asked if name == 'fork'] == [1]

    def fork_after_a_change():
        worker.view.changes = 2
        return fork()

    # the ensemble is still in progress when the next forecast begins
    worker.fork, worker.latest = fork_after_a_change, SimpleNamespace(time=5.0)
    asked.clear()
    made._step()
    names = [name for name, _ in asked if name in ('cancel', 'fork')]
    assert names == ['cancel', 'fork'] and asked[-1][1]['ensemble']['changes'] == 2


def test_share_of_forecasts_falls_when_the_simulation_is_behind():
    pace = DutyCycle()
    assert pace.share(0.8, 'cuda:0') == 0.8
    pace.note(True, 10.0)
    assert pace.share(0.8, 'cuda:0') == MIN_DUTY_CYCLES['cuda']
    assert pace.share(0.8, 'cpu') == MIN_DUTY_CYCLES['cpu']
    assert pace.share(0.05, 'cpu') == 0.05
    pace.note(False, 13.0)
    assert pace.share(1.0, 'cuda:0') == pytest.approx(3.0 * DUTY_CYCLE_RATE)
    pace.note(False, 100.0)
    assert pace.share(1.0, 'cpu') == 1.0


#: A request for a forecast.
FORK = {'number': 1, 'checkpoint': None, 'is_first': True, 'ensemble': None}


class Slices(queue.SimpleQueue):
    """Requests, a forecast that never ends, and the clock of both: a slice takes 0.02 s."""

    is_done, progress, now, count = False, 0.0, 0.0, 0

    def monotonic(self):
        return self.now

    def advance(self, wall_limit):
        assert wall_limit <= 0.1
        self.now += 0.02
        self.count += 1

    def get(self, *, timeout):
        if self.empty():
            self.now += timeout
        return super().get(block=False)


def test_process_computes_only_for_its_share_of_time(monkeypatch):
    slices = Slices()
    monkeypatch.setattr(forecast_process, 'ForecastRun', lambda *_, **__: slices)
    # the worker of earlier tests still runs: patch only this module
    monkeypatch.setattr(request_loops, 'time', slices)
    forecasting = forecast_process.Forecasting(slices, lambda *_, **__: None)
    slices.put(('share', {'share': 0.1}))
    slices.put(('fork', FORK))
    for share in (0.1, 0.5):
        slices.put(('share', {'share': share}))
        start, before = slices.now, slices.count
        while slices.now - start < 2.0:
            forecasting.turn()
        # the first rest still follows the previous fraction
        most = share * (slices.now - start) + 0.02
        assert 0.8 * most < (slices.count - before) * 0.02 <= most


@pytest.mark.parametrize(('error', 'is_refused'), [
    (OSError(28, 'disk full'), True), (MemoryError('disk full'), True),
    # a process of members has ended: the forecaster starts this one again
    (ChildProcessError('disk full'), False),
])
def test_process_explains_why_a_forecast_fails(monkeypatch, error, is_refused):
    def fail(*_, **__):
        raise error

    monkeypatch.setattr(forecast_process, 'ForecastRun', fail)
    orders, replies = queue.SimpleQueue(), []
    forecasting = forecast_process.Forecasting(
        orders, lambda name, **values: replies.append((name, values['reason']))
    )
    orders.put(('fork', FORK))
    with nullcontext() if is_refused else pytest.raises(ChildProcessError):
        forecasting.turn()
    assert replies == [('refused', f'{type(error).__name__}: {error}')] * is_refused


def test_first_forecast_of_a_scene_has_fewer_observations(monkeypatch):
    samples = []
    monkeypatch.setattr(
        forecast_process, 'ForecastRun', lambda *_, **options: samples.append(options['samples'])
    )
    orders = queue.SimpleQueue()
    forecasting = forecast_process.Forecasting(orders, lambda *_, **__: None)
    for is_first in (True, False):
        orders.put(('fork', FORK | {'is_first': is_first}))
        forecasting.turn()
    assert samples == [N_FIRST_SAMPLES, N_SAMPLES] and 2 * N_FIRST_SAMPLES < N_SAMPLES
