# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Forecasts beside a live simulation, and ensembles that have a deadline."""

from contextlib import suppress
from dataclasses import replace
import os
from pathlib import Path
import queue
import signal
import subprocess
import sys
import time
from unittest.mock import Mock

import numpy as np
import pytest

from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.forecast import planning as affordable
from lava_ros.forecast import process as forecast_process
from lava_ros.forecast.lookahead import FIRST_LOOKS, LookAhead, LOOKS
from lava_ros.forecast.planning import Affordable
from lava_ros.ros import diagnostics, forecaster
from lava_ros.ros.ensemble_forecasts import ForecastRules
from lava_ros.ros.forecaster import (
    Forecaster,
    ForecastProcess,
    LEAST_PERIOD,
    LEAST_SHARES,
    Pace,
    SHARE_RATE,
)
from lava_ros.ros.parameters import Settings
from lava_ros.ros.sources import SimulationMaker
from lava_ros.ros.worker import SimulationWorker
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.presets import preset_accuracy
from ros.graph_publisher import PATIENCE, wait_until

RULES = ForecastRules(
    horizon=200.0, threshold=0.01, max_age=1e9, share=1.0, max_particles=1_000_000
)

#: Simulated seconds in a second, a small part of what the solver can do.
SCALE = 5.0


def scene(discharge=20.0):
    """A slope towards +x with a vent at its top."""
    ground = np.tile(500.0 - 2.0 * np.arange(30), (20, 1))
    vent = Vent((55.0, 100.0), discharge, radius=15.0)
    return Scene(Terrain(ground, 10.0), (vent,), Lava(viscosity=1e4))


def simulation_of(scene):
    """A coarse simulation."""
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
        self.told = []
        self.forecaster = Forecaster(
            self.worker,
            lambda: self.rules,
            on_change=lambda: self.told.append(self.staleness()),
            make_process=self._process,
        )
        self.worker.start()
        self.worker.set_scene(scene()).result(PATIENCE)
        self.forecaster.start()
        self.forecaster.want(True)

    def _process(self):
        process = ForecastProcess()
        self.started.append(process.pid)
        order = process.order

        def noted(name, **values):
            self.horizon = values.get('horizon', self.horizon)
            order(name, **values)

        process.order = noted
        return process

    def forecast(self, condition=lambda _: True):
        """Wait for a forecast that fulfils a condition; snapshots go on meanwhile."""

        def found():
            self.worker.request_snapshot()
            latest = self.forecaster.latest
            return latest if latest is not None and condition(latest) else None

        return wait_until(found, lambda: self.forecaster.status)

    def staleness(self):
        """Why the newest forecast says nothing about what comes."""
        return self.forecaster.staleness(self.forecaster.latest)

    def begin_a_long_one(self):
        """Wait until a forecast is at hand that takes hours."""
        self.rules = replace(RULES, horizon=1e7)

        def is_at_hand():
            self.worker.request_snapshot()
            return self.horizon == 1e7 and self.forecaster.status.progress is not None

        wait_until(is_at_hand)

    def close(self):
        """End both."""
        assert self.forecaster.stop(PATIENCE)
        assert self.worker.stop(PATIENCE)


@pytest.fixture(scope='module')
def running():
    """A worker and a forecaster for all tests, which soon try again what has failed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(forecaster, '_RETRY_TIMES', (0.1, 0.2))
        result = Bench()
        yield result
        result.close()


@pytest.fixture
def bench(running):
    """The same, at the start of the scene and with a first forecast of it."""
    running.rules = RULES
    running.forecaster.want(True)
    running.worker.pause(False).result(PATIENCE)
    running.worker.set_scene(scene()).result(PATIENCE)
    running.forecast(lambda _: running.staleness() == '')
    return running


def test_forecasts_follow_the_live_simulation(bench):
    """Each starts later than the one before; it says what the fork would come to by itself."""
    first, before = bench.forecaster.latest, len(bench.started)
    assert first.shown.horizon == RULES.horizon
    assert np.count_nonzero(first.shown.arrival > 0.0) > 5
    assert bench.staleness() == ''
    second = bench.forecast(lambda item: item is not first)
    assert second.shown.time > first.shown.time
    assert second.stamp_ns > first.stamp_ns
    assert len(bench.started) == before
    bench.worker.pause(True).result(PATIENCE)
    fork = bench.worker.fork().result(PATIENCE)
    last = bench.forecast(lambda item: item.shown.time == fork.checkpoint.time).shown
    expected = LookAhead(fork.checkpoint, horizon=200.0, threshold=0.01, device='cpu').run()
    np.testing.assert_array_equal(last.arrival, expected.arrival)
    np.testing.assert_array_equal(last.thickness, expected.thickness)
    np.testing.assert_array_equal(last.temperature, expected.temperature)
    # what stands still is forked once
    count = bench.forecaster.status.count
    time.sleep(1.5 * LEAST_PERIOD)
    assert bench.forecaster.status.count == count
    assert bench.forecaster.age(bench.forecaster.latest) == 0.0


def test_another_scene_makes_a_forecast_stale_at_once(bench):
    """Also one that is at hand is dropped; the next is of the new scene, by the same process."""
    before = len(bench.started)
    bench.begin_a_long_one()
    old = bench.forecaster.latest
    # the one at hand keeps its rules; the next may begin as soon as there is another scene
    bench.rules = RULES
    bench.told.clear()
    bench.worker.set_vents((Vent((155.0, 100.0), 60.0, radius=15.0),)).result(PATIENCE)
    wait_until(lambda: bench.told)
    assert bench.told[0] == 'the scene or the effects have changed'
    new = bench.forecast(lambda item: item is not old)
    assert bench.staleness() == ''
    assert new.shown.horizon == RULES.horizon
    reached = np.isfinite(new.shown.arrival) & ~np.isfinite(old.shown.arrival)
    assert reached[:, 15:].sum() > 5
    bench.worker.set_effects({'green': True}, horizon=1e4).result(PATIENCE)
    assert bench.staleness() or bench.forecaster.latest is not new
    assert len(bench.started) == before


def test_an_old_forecast_is_stale(bench):
    """After the time it may be old."""
    bench.forecaster.want(False)
    bench.rules = replace(RULES, max_age=2.0)
    wait_until(lambda: bench.worker.request_snapshot() or bench.staleness())
    assert bench.staleness().endswith('s old, at most 2 s are good')
    assert bench.forecaster.age(bench.forecaster.latest) > 2.0


def test_what_was_dropped_is_made_up_for(bench):
    """A node that is deactivated and activated again has a forecast, also of a state at rest."""
    bench.begin_a_long_one()
    bench.worker.pause(True).result(PATIENCE)
    old = bench.forecaster.latest
    bench.forecaster.want(False)
    wait_until(lambda: bench.forecaster.status.progress is None)
    bench.rules = RULES
    bench.forecaster.want(True)
    new = bench.forecast(lambda item: item is not old)
    assert new.shown.time == bench.worker.latest.time


def test_the_process_may_die(bench):
    """What killed it is told; another one goes on; the live simulation does not notice."""
    before = len(bench.started)
    bench.begin_a_long_one()
    old, bench.rules = bench.forecaster.latest, RULES
    os.kill(bench.started[-1], signal.SIGKILL)
    error = wait_until(lambda: bench.forecaster.status.error)
    assert error == 'the process of the forecasts has ended (killed by signal 9)'
    bench.forecast(lambda item: item is not old)
    assert bench.forecaster.status.error == ''
    assert len(bench.started) == before + 1
    assert bench.worker.status.error == ''


def test_the_process_gets_no_interrupt():
    """Ctrl+C in a terminal is for the node, even while the process of the forecasts starts."""
    process = ForecastProcess()
    try:
        status = Path(f'/proc/{process.pid}/status').read_text()
    finally:
        process.end()
    (blocked,) = [line.split()[1] for line in status.splitlines() if line.startswith('SigBlk')]
    assert int(blocked, 16) & 1 << signal.SIGINT - 1


def test_what_cannot_be_forecast_is_told(bench):
    """Too many particles within the horizon end a forecast, not the simulation."""
    bench.rules = replace(RULES, max_particles=3)
    error = wait_until(
        lambda: bench.worker.request_snapshot() or bench.forecaster.status.error
    )
    assert 'at most 3 (max_particles)' in error
    bench.rules, old = RULES, bench.forecaster.latest
    bench.forecast(lambda item: item is not old)
    assert bench.worker.status.error == bench.forecaster.status.error == ''


def test_the_live_simulation_keeps_its_pace(bench):
    """It goes on while forecasts are made, by a process that is nice to it."""
    bench.begin_a_long_one()
    niceness = os.getpriority(os.PRIO_PROCESS, bench.started[-1])
    assert niceness == min(19, os.getpriority(os.PRIO_PROCESS, 0) + forecast_process.NICENESS)
    before = bench.worker.fork().result(PATIENCE).checkpoint.time
    wait_until(lambda: bench.worker.fork().result(PATIENCE).checkpoint.time > before)
    assert bench.forecaster.status.progress is not None


def test_the_pace():
    """Forecasts get least while the simulation is behind, and more again bit by bit."""
    pace = Pace()
    assert pace.share(0.8, 'cuda:0') == 0.8
    pace.note(True, 10.0)
    assert pace.share(0.8, 'cuda:0') == LEAST_SHARES['cuda']
    assert pace.share(0.8, 'cpu') == LEAST_SHARES['cpu']
    assert pace.share(0.05, 'cpu') == 0.05
    pace.note(False, 13.0)
    assert pace.share(1.0, 'cuda:0') == pytest.approx(3.0 * SHARE_RATE)
    pace.note(False, 100.0)
    assert pace.share(1.0, 'cpu') == 1.0


#: An order of a forecast.
FORK = {'number': 1, 'checkpoint': None, 'is_first': True, 'ensemble': None}


class Slices(queue.SimpleQueue):
    """Orders, a look ahead that never ends, and the clock of both.

    A slice takes 0.02 s of it, and so long as it may does waiting for an order.
    """

    is_done, progress, now, count = False, 0.0, 0.0, 0

    def monotonic(self):
        """Time on the clock."""
        return self.now

    def advance(self, wall_limit):
        """Work."""
        assert wall_limit <= 0.1
        self.now += 0.02
        self.count += 1

    def get(self, *, timeout):
        """What has been put, or nothing after the wait."""
        if self.empty():
            self.now += timeout
        return super().get(block=False)


def test_the_process_computes_no_more_than_its_share(monkeypatch):
    """It rests between slices, also while orders come; another share holds from then on."""
    slices = Slices()
    monkeypatch.setattr(forecast_process, 'LookAhead', lambda *_, **__: slices)
    # of its module alone: the worker of the tests before still runs
    monkeypatch.setattr(forecast_process, 'time', slices)
    forecasting = forecast_process.Forecasting(slices, lambda *_, **__: None)
    slices.put(('share', {'share': 0.1}))
    slices.put(('fork', FORK))
    for share in (0.1, 0.5):
        slices.put(('share', {'share': share}))
        start, before = slices.now, slices.count
        while slices.now - start < 2.0:
            forecasting.turn()
        # the first rest is still that of the share before
        most = share * (slices.now - start) + 0.02
        assert 0.8 * most < (slices.count - before) * 0.02 <= most


def test_the_first_forecast_of_a_scene_is_there_sooner(monkeypatch):
    """It looks fewer times; those that come after it are more exact."""
    looks = []
    monkeypatch.setattr(
        forecast_process, 'LookAhead', lambda *_, **options: looks.append(options['looks'])
    )
    orders = queue.Queue()
    forecasting = forecast_process.Forecasting(orders, lambda *_, **__: None)
    for is_first in (True, False):
        orders.put(('fork', FORK | {'is_first': is_first}))
        forecasting.turn()
    assert looks == [FIRST_LOOKS, LOOKS] and 2 * FIRST_LOOKS < LOOKS


def test_the_process_ends_with_the_node():
    """Also when the node is killed, in the middle of a forecast."""
    code = (
        'import time\nfrom lava_ros.ros.forecaster import ForecastProcess\n'
        'process = ForecastProcess()\nprint(process.pid, flush=True)\ntime.sleep(100.0)\n'
    )
    with subprocess.Popen([sys.executable, '-c', code], stdout=subprocess.PIPE, text=True) as node:
        status = Path(f'/proc/{int(node.stdout.readline())}/stat')
        assert status.exists()
        node.kill()

    def has_ended():
        with suppress(OSError):
            return status.read_text(encoding='ascii').rpartition(')')[2].split()[0] == 'Z'
        return True

    wait_until(has_ended)


SCENE = Scene(Terrain(np.zeros((10, 10)), 10.0), (Vent((50.0, 50.0), 5.0),), lava=Lava())

SETTINGS = Settings(
    device='cpu', forecast_horizon=600.0, ensemble_members=8, deadline=20.0, preset='draft'
)


@pytest.fixture
def asked(monkeypatch):
    """Members that were planned for; as many as 20 can be had."""
    found = []

    def afford(scene, *, within, horizon, members, device):
        found.append(members)
        assert (scene, within, horizon, device) == (SCENE, 20.0, 600.0, 'cpu')
        if members is not None and members > 20:
            raise LavaError('within', within, 'about 31 s: that is what the coarsest take')
        return Affordable(
            preset='draft', spacing=25.0, refinement=0.4, members=members or 13, wall_time=9.0,
            error=0.02, cell_error=0.0, sampling_error=0.1, is_finest=False, pilots=3, spent=4.0,
        )

    monkeypatch.setattr(affordable, 'afford', afford)
    return found


def test_the_finest_that_is_there_in_time(asked):
    """A forecast, and members that take turns with the next ones; the spacing is the plan's."""
    chooser = SimulationMaker()
    assert chooser.accuracy(SCENE, SETTINGS).spacing == 25.0
    assert asked == [17]
    choice = chooser.choice
    assert (choice.members, choice.is_met, choice.spacing) == (8, True, 25.0)
    assert '8 of 8 members: 17 runs in about 9 s of 20 s' in choice.reason
    assert choice.sampling_error == pytest.approx(0.5 / 8**0.5)
    status = diagnostics.deadline_status(20.0, choice, took=3.0)
    assert status.level == status.OK and status.message == choice.reason
    late = diagnostics.deadline_status(20.0, choice, took=30.0)
    assert late.level == status.WARN and late.message.startswith('late: the newest took 30 s')
    assert {item.key: item.value for item in late.values}['expected_error'] == '0.02'


def test_fewer_members_where_not_even_the_coarsest_fit(asked):
    """As many as err least."""
    chooser = SimulationMaker()
    chooser.accuracy(SCENE, replace(SETTINGS, ensemble_members=100))
    assert asked == [201, None]
    assert chooser.choice.members == 6
    assert '6 of 100 members' in chooser.choice.reason


def test_a_flow_is_never_refused_for_a_deadline(monkeypatch):
    """Late maps are better than none: the preset is that of the parameters, with a warning."""
    chooser = SimulationMaker()
    too_late = LavaError('within', 20.0, 'longer: the coarsest runs take more')
    monkeypatch.setattr(affordable, 'afford', Mock(side_effect=too_late))
    settings = replace(SETTINGS, ensemble_members=0)
    assert chooser.accuracy(SCENE, settings) == preset_accuracy('draft', spacing=None)
    assert not chooser.choice.is_met and 'the coarsest runs take more' in chooser.choice.reason
    status = diagnostics.deadline_status(20.0, chooser.choice, took=0.0)
    assert status.level == status.WARN


def test_nothing_to_choose(asked):
    """Without a deadline, or without lava that comes."""
    chooser = SimulationMaker()
    usual = preset_accuracy('draft', spacing=None)
    assert chooser.accuracy(SCENE, replace(SETTINGS, deadline=0.0)) == usual
    assert chooser.accuracy(replace(SCENE, vents=()), SETTINGS) == usual
    assert chooser.choice is None and asked == []
    status = diagnostics.deadline_status(20.0, None, took=1.0)
    assert status.level == status.OK and status.message.startswith('nothing chosen')
