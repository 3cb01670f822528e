# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The numerical error of a live simulation, measured in the background."""

from dataclasses import replace
from functools import partial
from itertools import pairwise
import time

import numpy as np
import pytest

from lava_ros.effects import Effects
from lava_ros.forecast.partner_runs import measure_error
from lava_ros.live.error_measurement import ErrorMeasurement, partner_process
from lava_ros.live.worker import SimulationWorker
from lava_ros.live.worker_status import WorkerState
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.carriers import METHODS
from lava_ros.simulation.numerical_error import AreaError, NOT_MEASURED, NumericalError
from solver import only
from waiting import PATIENCE, wait_until

END = 120.0

#: Simulated time per time of the clock [s/s].
SCALE = 100.0


def scene():
    """Return a bumpy slope with a vent at its top."""
    x, y = np.meshgrid(np.arange(40) * 5.0, np.arange(30) * 5.0)
    ground = Terrain(0.1 * x + np.sin(x / 9.0) * np.sin(y / 8.0), 5.0)
    return Scene(ground, (Vent((150.0, 75.0), 20.0, radius=8.0),), Lava.paper(viscosity=1e4))


def simulation_of(scene, method='particles'):
    accuracy = Accuracy(method, spacing=5.0, thickness=1.0)
    effects = Effects() if method == 'particles' else only('steep')
    return Simulation(scene, effects=effects, accuracy=accuracy, device='cpu')


class Clock:
    """A clock that the test moves, so that a change comes before the end on any machine."""

    now = 0.0

    def __call__(self):
        return self.now

    def run_until(self, condition, limit):
        """Move the clock up to a limit [s], and wait until a condition holds."""

        def is_met():
            self.now = min(self.now + 0.02, limit)
            return condition()

        wait_until(is_met)


class FakeProcess:
    """A process that replies at once or never, or that has ended."""

    def __init__(self, error):
        self.error, self.requests, self.ended = error, [], 0

    def request(self, name, **values):
        self.requests.append((name, values))

    def reply(self, timeout):
        time.sleep(0.01)
        if self.error is None or not self.requests:
            return None
        if isinstance(self.error, ChildProcessError):
            raise self.error
        if isinstance(self.error, str):
            return 'refused', {'reason': self.error}
        return 'measured', {'error': replace(self.error, time=self.requests[-1][1]['time'])}

    def end(self):
        self.ended += 1


ERROR = NumericalError(AreaError(0.03, 0.01), AreaError(0.02, 0.01), 5.0, 5.0, 0.0)


class Bench:
    """A worker whose error a fake or a real process measures."""

    def __init__(
        self, process, *, share=0.5, first=0.0, end=END, clock=time.monotonic,
        make=simulation_of,
    ):
        self.process = process
        self.worker = SimulationWorker(make, clock=clock, time_scale=SCALE, end_time=end)
        self.error = ErrorMeasurement(
            self.worker, share=lambda: share, make_process=process, first_wall_time=first
        )
        self.worker.start()
        self.error.start()

    def close(self):
        assert self.error.stop(PATIENCE) and self.worker.stop(PATIENCE)


@pytest.fixture
def bench():
    """Return a function that makes a bench, which is closed at the end."""
    made = []

    def make(process, **options):
        made.append(Bench(process, **options))
        return made[-1]

    yield make
    for item in made:
        item.close()


@pytest.mark.parametrize('method', METHODS)
def test_error_at_the_end_is_that_of_partner_runs(bench, method):
    found = bench(partner_process, first=1e9, make=partial(simulation_of, method=method))
    assert found.error.text() == NOT_MEASURED
    found.worker.set_scene(scene()).result(PATIENCE)
    wait_until(lambda: found.error.latest is not None)
    error = found.error.latest
    assert found.worker.status.state is WorkerState.FINISHED and error.time == END
    fake = FakeProcess(None)
    found.error.make_process = lambda: fake
    found.error._begin()
    (name, request), = fake.requests
    found.error._end_process()
    assert name == 'measure' and request.pop('share') == 1.0
    expected = measure_error(**request)
    assert error.as_dict() == expected.as_dict() and error.method == method
    assert 0.0 < error.inundated.lava < 1.0 and error.inundated.ground > 0.0
    assert found.error.text() == f'{error.text()}, at 2 min'


def test_request_has_the_vents_of_the_whole_run(bench):
    fake, clock = FakeProcess(ERROR), Clock()
    found = bench(lambda: fake, first=1e9, clock=clock)
    found.worker.set_scene(scene()).result(PATIENCE)
    clock.run_until(lambda: found.worker.view.time > 20.0, limit=0.5 * END / SCALE)
    found.worker.set_vents((replace(scene().vents[0], discharge=5.0),)).result(PATIENCE)
    clock.run_until(lambda: found.error.latest is not None, limit=2.0 * END / SCALE)
    request = fake.requests[0][1]
    vents = request['scene'].vents
    assert vents == found.worker.view.schedule
    emitted = sum(vent.volume_between(0.0, END) for vent in vents)
    assert emitted == pytest.approx(found.worker.latest.budget.emitted, rel=1e-4)
    assert emitted < 0.95 * 20.0 * END
    assert request['accuracy'] == found.worker.view.accuracy
    assert request['time'] == END and fake.ended == 1


def test_running_simulation_is_measured_again_when_its_time_has_tripled(bench):
    fake, clock = FakeProcess(ERROR), Clock()
    found = bench(lambda: fake, share=0.25, clock=clock)
    found.worker.set_scene(scene()).result(PATIENCE)

    def is_measured_at(time):
        found.worker.request_snapshot()
        return found.error.latest is not None and found.error.latest.time >= time

    clock.run_until(lambda: is_measured_at(0.0), limit=20.0 / SCALE)
    clock.run_until(lambda: is_measured_at(END), limit=2.0 * END / SCALE)
    times = [values['time'] for _, values in fake.requests]
    assert times[-1] == END and len(times) >= 2
    # that of the end may follow earlier
    assert all(later >= 3.0 * time for time, later in pairwise(times[:-1]))
    assert {values['share'] for _, values in fake.requests[:-1]} <= {0.25, 1.0}


def test_new_simulation_has_no_error_yet(bench):
    fake = FakeProcess(ERROR)
    found = bench(lambda: fake, first=1e9)
    found.worker.set_scene(scene()).result(PATIENCE)
    wait_until(lambda: found.error.latest is not None)
    fake.error = None
    found.worker.reset().result(PATIENCE)
    wait_until(lambda: found.error.latest is None)
    assert found.error.text() == NOT_MEASURED


@pytest.mark.parametrize(
    ('share', 'error'),
    [(0.0, 'out of memory'), (0.5, 'out of memory'), (0.5, ChildProcessError('out of memory'))],
)
def test_reason_is_named_when_the_error_cannot_be_measured(bench, share, error):
    fake = FakeProcess(error)
    found = bench(lambda: fake, share=share, first=1e9)
    found.worker.set_scene(scene()).result(PATIENCE)
    wait_until(lambda: found.worker.status.state is WorkerState.FINISHED)
    if share:
        wait_until(lambda: 'out of memory' in found.error.text())
        # the next measurement has another process
        wait_until(lambda: fake.ended == 1)
    else:
        assert found.error.text() == f'{NOT_MEASURED}: error_share is 0' and not fake.requests


def test_changed_ground_under_lava_is_not_measured(bench):
    fake, clock = FakeProcess(ERROR), Clock()
    found = bench(lambda: fake, first=1e9, clock=clock)
    found.worker.set_scene(scene()).result(PATIENCE)
    clock.run_until(lambda: found.worker.view.time > 20.0, limit=0.5 * END / SCALE)
    ground = scene().terrain
    raised = np.array(ground.elevation)
    raised[:, :10] += 5.0
    found.worker.set_terrain(replace(ground, elevation=raised)).result(PATIENCE)
    clock.run_until(
        lambda: found.worker.status.state is WorkerState.FINISHED, limit=2.0 * END / SCALE
    )
    assert found.error.text() == f'{NOT_MEASURED}: the ground has changed under lava'
    assert not fake.requests
