# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Verification cases in a worker that follows a clock: their errors are within the same bounds."""

from dataclasses import asdict, replace
from functools import cache, partial
import threading

import pytest

from lava_ros.effects import EFFECTS
from lava_ros.live import worker as live
from lava_ros.live.worker import SimulationWorker
from lava_ros.live.worker_status import WorkerState
from lava_ros.scene import Vent
from lava_ros.simulation.carriers import METHODS
from lava_ros.simulation.presets import PRESETS
from lava_ros.verification.bounds import bound
from lava_ros.verification.cases import case, CASES
from waiting import PATIENCE, wait_until

#: Preset of the cases by method, whose bounds apply.
PRESET = {'particles': 'draft', 'cells': 'standard'}

#: Name of the method of a solver that launches stages or steps, by method.
LAUNCH = {'particles': 'run_stages', 'cells': '_take_steps'}

#: Wall time of a slice [s], in which a step of several stages does not end.
SLICE = 1e-3

HOUR = 3600.0


def accuracy_of(method):
    """Return the accuracy of the cases on a method."""
    return replace(PRESETS[PRESET[method]].accuracy, method=method)


class InThread:
    """Attributes and methods of a worker's simulation, used in the worker's thread."""

    def __init__(self, worker):
        self._worker = worker

    def __getattr__(self, name):
        value = self._run(lambda: getattr(self._worker.session.simulation, name))
        return partial(self._call, value) if callable(value) else value

    def _call(self, method, *arguments, **options):
        return self._run(partial(method, *arguments, **options))

    def _run(self, action):
        return self._worker.commands.submit(action).result(PATIENCE)


class Drive:
    """Runs cases in workers whose clock advances by a tick [s] whenever it is read.

    ``at_tick`` is called in the worker's thread with the drive, the worker and its scene.
    """

    def __init__(self, tick, time_scale=1.0, at_tick=None, method='particles'):
        self.tick, self.time_scale, self.at_tick = tick, time_scale, at_tick
        self.method = method
        self.now, self.ticks, self.launches, self.workers = 100.0, 0, 0, []
        self.paused_at = -1.0

    def run(self, name, device, monkeypatch):
        """Run a case, each of its simulations in a worker of its own."""
        drive = self

        class Followed(case.Trial):
            def start(self, make, scene):
                return drive.start(make, scene)

            def advance(self, until):
                drive.follow(float(until))

        with monkeypatch.context() as patch:
            patch.setattr(live, 'IDLE_WALL_TIME', 0.0)
            patch.setattr(live, 'ROUND_WALL_TIME', 0.0)
            patch.setattr(live, 'SLICE_WALL_TIME', SLICE)
            patch.setattr(case, 'Trial', Followed)
            try:
                return CASES[name].run(accuracy_of(self.method), device)
            finally:
                stopped = [worker.stop(PATIENCE) for worker in self.workers]
                assert all(stopped)

    def start(self, make, scene):
        """Start a worker that is at its end time, and return its simulation."""
        worker = SimulationWorker(
            lambda scene: self.counted(make(scene)), lambda: self.read(worker, scene),
            time_scale=self.time_scale, end_time=0.0,
        )
        self.workers.append(worker)
        worker.start()
        worker.set_scene(scene).result(PATIENCE)
        return InThread(worker)

    def counted(self, simulation):
        """Return a simulation whose launches are counted, idle ones included."""
        launch = getattr(simulation.solver, LAUNCH[self.method])

        def run():
            self.launches += 1
            launch()

        setattr(simulation.solver, LAUNCH[self.method], run)
        return simulation

    def read(self, worker, scene):
        """Return the time of the clock [s], which only readings by the worker advance."""
        if threading.current_thread() is not worker._thread:
            return self.now
        self.now += self.tick
        self.ticks += 1
        if self.at_tick is not None:
            self.at_tick(self, worker, scene)
        return self.now

    def follow(self, until):
        """Let the newest worker follow the clock up to an end time [s]."""
        worker = self.workers[-1]
        worker.set('end_time', until).result(PATIENCE)
        wait_until(
            lambda: worker.view.time >= until or worker.status.state is WorkerState.FAILED
        )
        # the next command is executed after the last snapshot
        worker.commands.submit(lambda: None).result(PATIENCE)
        status = worker.status
        assert status.state is WorkerState.FINISHED and not status.fault, status
        assert worker.view.time == until


@cache
def evaluations(name, device, method):
    """Return the number of evaluations of the velocity in a case without a worker."""
    return CASES[name].run(accuracy_of(method), device).evaluations


def check_bounds(name, run, method):
    assert run.measurements
    for item in run.measurements:
        assert item.error <= bound(PRESET[method], name, item.quantity), item


#: Ticks of the clock for each case [s]: at real time there are several in a step.
TICKS = {
    'radiating_sheet': 10.0, 'slope_flux': 0.1, 'freezing_lens': 5.0, 'inertial_sheet': 0.02,
    'latent_heat': 50.0, 'steep_sheet': 50.0, 'conduction': 1.0, 'viscous_heating': 0.02,
    'ridge': 2.0, 'bingham_dome': 2.0, 'fixed_volume': 0.1, 'constant_flux': 0.2,
    'slope_fixed_area': 0.1, 'ritter': 0.02, 'stoker': 0.02,
}

#: Cases of heat, of a vent on a slope, of solidification, and of inertia, computed in every run.
EVERY_RUN = {
    'particles': ('radiating_sheet', 'slope_flux', 'freezing_lens', 'inertial_sheet', 'ritter'),
    'cells': ('latent_heat', 'slope_flux'),
}


def followed_cases():
    """Yield the cases that follow a clock, each on the methods that have its effects."""
    for name in [name for name in TICKS if name in CASES]:
        lacking = any(EFFECTS[effect].needs_particles for effect in CASES[name].effects)
        for method in METHODS[:1] if lacking else METHODS:
            for time_scale in (1.0, 10.0):
                is_short = method == 'particles' or time_scale == 10.0
                is_quick = is_short and name in EVERY_RUN[method]
                marks = () if is_quick else pytest.mark.nightly
                yield pytest.param(name, method, time_scale, marks=marks)


@pytest.mark.parametrize(('name', 'method', 'time_scale'), list(followed_cases()))
def test_case_that_follows_a_clock_is_within_its_bounds(
    name, method, time_scale, device, monkeypatch
):
    drive = Drive(TICKS[name], time_scale, method=method)
    run = drive.run(name, device, monkeypatch)
    check_bounds(name, run, method)
    assert drive.launches <= 3 * evaluations(name, device, method)
    # never ahead of the clock
    assert run.simulated_time <= drive.ticks * drive.tick * time_scale


def repeat(drive, worker, scene):
    """Send the vents and the terrain in use."""
    worker.set_vents([replace(vent) for vent in scene.vents])
    worker.set_terrain(replace(scene.terrain, elevation=scene.terrain.elevation.copy()))


@pytest.mark.parametrize(('name', 'method'), [
    ('radiating_sheet', 'particles'), ('slope_flux', 'particles'),
    pytest.param('slope_flux', 'cells', marks=pytest.mark.nightly),
])
def test_commands_that_change_nothing_cost_no_steps(name, method, device, monkeypatch):
    drive = Drive(TICKS[name], at_tick=repeat, method=method)
    check_bounds(name, drive.run(name, device, monkeypatch), method)
    assert drive.launches <= 3 * evaluations(name, device, method)


def pause_briefly(drive, worker, scene):
    # the end of a pause reads the clock, too
    if worker.view.time > drive.paused_at:
        drive.paused_at = worker.view.time
        worker.pause(True).add_done_callback(lambda _: worker.pause(False))


def change_vents(drive, worker, scene):
    worker.set_vents([Vent((0.0, 0.0), 0.0, name=str(drive.ticks))])


def change_horizon(drive, worker, scene):
    worker.set_effects(asdict(worker.session.simulation.effects), horizon=HOUR + drive.ticks)


@pytest.mark.parametrize(('change', 'method'), [
    (pause_briefly, 'particles'),
    pytest.param(pause_briefly, 'cells', marks=pytest.mark.nightly),
    pytest.param(change_vents, 'particles', marks=pytest.mark.nightly),
    pytest.param(change_horizon, 'particles', marks=pytest.mark.nightly),
])
def test_commands_that_shorten_steps_keep_the_heat(change, method, device, monkeypatch):
    """In steps of about a second lava that crystallises cools by few units of a float32.

    In the first hour each step ends within a slice, so that their number does not depend on the
    speed of the device; later commands also come within steps.
    """

    def at_tick(drive, worker, scene):
        live.SLICE_WALL_TIME = PATIENCE if worker.view.time < HOUR else SLICE
        is_often = worker.view.time < 1.1 * HOUR
        drive.tick = 1.0 if is_often else 50.0
        if is_often or drive.ticks % 50 == 0:
            change(drive, worker, scene)

    drive, name = Drive(1.0, at_tick=at_tick, method=method), 'latent_heat'
    run = drive.run(name, device, monkeypatch)
    check_bounds(name, run, method)
    assert run.evaluations > 3 * evaluations(name, device, method)
