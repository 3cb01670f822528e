# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The worker thread: effects follow the scene, or are forced while it runs."""

import time

import numpy as np
import pytest

from lava_ros.choice import HORIZON
from lava_ros.errors import LavaError
from lava_ros.scene import Scene, Terrain, Vent
from worker_bench import TERRAIN, VENT


def _is_on(bench, effect):
    return bench.worker.effects[effect].startswith('on:')


def test_effects_follow_the_scene(bench):
    """The table is that of the simulation, and anew with every terrain and vent."""
    assert bench.worker.effects == {}
    bench.run(bench.worker.set_scene(Scene(TERRAIN, (VENT,))))
    assert not _is_on(bench, 'steep')
    before = bench.worker.effects['arrhenius']
    bench.run(bench.worker.set_vents([Vent((25.0, 15.0), 2.0, temperature=1300.0)]))
    assert bench.worker.effects['arrhenius'] != before
    hill = np.tile(np.arange(5) * 8.0, (4, 1))
    bench.run(bench.worker.set_terrain(Terrain(hill, 10.0)))
    assert bench.worker.effects['steep'].startswith('on: slope = 0.8 > ')


def test_effects_are_forced_while_it_runs(bench):
    """Forced effects are taken at once; those that do not go together change nothing."""
    bench.run(bench.worker.set_effects({'steep': True}, horizon=60.0))
    bench.run(bench.worker.set_scene(Scene(TERRAIN, (VENT,))))
    bench.run(bench.worker.set_effects({'steep': True}, horizon=60.0))
    assert bench.worker.effects['steep'] == 'on: forced'
    with pytest.raises(LavaError, match='vft'):
        bench.run(bench.worker.set_effects({'vft': True}, horizon=HORIZON))
    assert bench.worker.effects['steep'] == 'on: forced'
    assert bench.simulation.horizon == 60.0
    bench.now += 0.5
    bench.wait(lambda: bench.simulation.time == pytest.approx(0.5))
    assert len(bench.made) == 1


def test_the_last_snapshot_stays_while_effects_are_compiled(bench):
    """Whoever asks for a frame meanwhile is not held up, and has the last one."""
    bench.run(bench.worker.set_scene(Scene(TERRAIN, (VENT,))))
    last = bench.worker.latest
    bench.simulation.is_compiled.clear()
    change = bench.worker.set_effects({'steep': True}, horizon=HORIZON)
    for _ in range(10):
        bench.worker.request_snapshot()
        assert bench.worker.latest is last
        time.sleep(0.05)
    assert not change.done()
    bench.simulation.is_compiled.set()
    bench.run(change)
    assert bench.worker.latest is not last
