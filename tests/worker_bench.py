# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A worker thread with a simulation that only keeps time, and a clock moved by hand."""

from dataclasses import replace
import threading
import time

import numpy as np

from lava_ros.live.worker import SimulationWorker
from lava_ros.scene import check_vents, Lava, Scene, Terrain, Vent
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.output.budget import VolumeBudget
from lava_ros.simulation.output.snapshot import PendingSnapshot, Snapshot, StepReport
from lava_ros.simulation.resolution import resolution_of
from lava_ros.simulation.selection import decide, effects_for, HORIZON
from waiting import PATIENCE

TERRAIN = Terrain(np.zeros((4, 5)), 10.0)
VENT = Vent((25.0, 15.0), 2.0, 1360.0, name='one')
OUTSIDE = Vent((500.0, 0.0), 2.0, 1360.0, name='far')


class KeepsTime:
    """A simulation that only keeps time and volume, at a given speed."""

    device, failure, flawed = 'paper', None, False
    time = step = slowness = emitted_before = changed_at = 0.0
    particle_count = begun = review_count = 0
    accuracy = Accuracy()
    horizon = HORIZON

    def __init__(self, scene, speed=None):
        self.scene, self.speed = scene, speed
        self.forced, self.advanced_to = {}, []
        self.is_compiled, self.is_copied = threading.Event(), threading.Event()
        self.is_compiled.set()
        self.is_copied.set()

    @property
    def effects(self):
        return effects_for(self.scene, self.forced, horizon=self.horizon)

    @property
    def resolution(self):
        return resolution_of(self.scene, Accuracy())

    def decisions(self):
        return decide(self.scene, self.forced, horizon=self.horizon)

    def set_effects(self, forced, *, horizon):
        effects_for(self.scene, forced, horizon=horizon)
        assert self.is_compiled.wait(PATIENCE)
        self.forced, self.horizon = dict(forced), horizon

    def emitted(self):
        flux = sum(vent.discharge for vent in self.scene.vents)
        return self.emitted_before + flux * (self.time - self.changed_at)

    def advance(self, until, *, limit=None, wall_limit=None, whole_steps=False):
        if self.failure:
            raise self.failure
        time.sleep(self.slowness)
        reached = until
        if self.speed is not None:
            time.sleep(wall_limit)
            reached = min(until, self.time + self.speed * wall_limit)
        self.time = reached
        self.advanced_to.append(reached)
        return reached

    def snapshot(self):
        ground, emitted = self.scene.terrain, self.emitted()
        thickness, temperature = (
            np.full(ground.shape, value, np.float32)
            for value in (np.nan if self.flawed else 0.0, np.nan)
        )
        budget = VolumeBudget(emitted, emitted)
        steps = StepReport(1, 1, 1, 1.0, 'longest')
        return Snapshot(self.time, ground, thickness, temperature, budget, 0, steps)

    def begin_snapshot(self):
        begun, self.begun = self.snapshot(), self.begun + 1

        def finish():
            assert self.is_copied.wait(PATIENCE)
            return begun

        return PendingSnapshot(finish)

    def set_vents(self, vents):
        scene = replace(self.scene, vents=check_vents(vents, self.scene.terrain))
        self.emitted_before, self.changed_at = self.emitted(), self.time
        self.scene = scene

    def set_terrain(self, terrain):
        self.scene = replace(self.scene, terrain=terrain)


class Bench:
    """A worker, the simulations it has made, and a clock that moves by hand."""

    def __init__(self, **options):
        self.now, self.refusal = 100.0, None
        self.made, self.shown = [], []
        self.speed = options.pop('speed', None)
        self.worker = SimulationWorker(
            self.make, clock=lambda: self.now,
            on_snapshot=lambda: self.shown.append(self.worker.latest), **options,
        )
        self.worker.start()

    def make(self, scene):
        if self.refusal:
            raise self.refusal
        self.made.append(KeepsTime(scene, self.speed))
        return self.made[-1]

    @property
    def simulation(self):
        return self.made[-1]

    def wait(self, condition, timeout=PATIENCE):
        end = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < end, self.worker.status
            time.sleep(0.005)

    def wait_for_clock(self):
        """Wait until the worker has read the present time of the clock."""
        self.wait(lambda: self.worker.pace.clock._now == self.now)

    def wait_for_state(self, state):
        self.wait(lambda: self.worker.status.state is state)

    def run(self, future):
        return future.result(timeout=PATIENCE)

    def start(self):
        self.run(self.worker.set_scene(Scene(TERRAIN, (VENT,), lava=Lava.paper())))

    def go_on(self, seconds=0.5, scale=1.0):
        """Move the clock, and let simulated time follow by as much."""
        # a new worker may not have read the clock yet
        self.wait_for_clock()
        until = self.simulation.time + seconds * scale
        self.now += seconds
        self.wait(lambda: abs(self.simulation.time - until) < 1e-6)
