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

"""Effects of a running simulation: chosen, forced, compiled meanwhile, and their table."""

from dataclasses import asdict, replace
import time

import numpy as np
import pytest

from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.ros.session import effect_table, is_on
from lava_ros.ros.worker import SimulationWorker
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.selection import decide, effects_for, HORIZON
from worker_bench import TERRAIN, VENT


def _is_on(bench, effect):
    return bench.worker.eruption.effects[effect].startswith('on:')


def test_effects_follow_the_scene(bench):
    """The table is that of the simulation, and anew with every terrain and vent."""
    assert bench.worker.eruption.effects == {}
    bench.run(bench.worker.set_scene(Scene(TERRAIN, (VENT,), lava=Lava())))
    assert not _is_on(bench, 'steep')
    before = bench.worker.eruption.effects['arrhenius']
    bench.run(bench.worker.set_vents([Vent((25.0, 15.0), 2.0, temperature=1300.0)]))
    assert bench.worker.eruption.effects['arrhenius'] != before
    hill = np.tile(np.arange(5) * 8.0, (4, 1))
    bench.run(bench.worker.set_terrain(Terrain(hill, 10.0)))
    assert bench.worker.eruption.effects['steep'].startswith('on: slope = 0.8 > ')


def test_effects_are_forced_while_it_runs(bench):
    """Forced effects are taken at once; those that do not go together change nothing."""
    bench.run(bench.worker.set_effects({'steep': True}, horizon=60.0))
    bench.run(bench.worker.set_scene(Scene(TERRAIN, (VENT,), lava=Lava())))
    bench.run(bench.worker.set_effects({'steep': True}, horizon=60.0))
    assert bench.worker.eruption.effects['steep'] == 'on: forced'
    with pytest.raises(LavaError, match='vft'):
        bench.run(bench.worker.set_effects({'vft': True}, horizon=HORIZON))
    assert bench.worker.eruption.effects['steep'] == 'on: forced'
    assert bench.simulation.horizon == 60.0
    bench.now += 0.5
    bench.wait(lambda: bench.simulation.time == pytest.approx(0.5))
    assert len(bench.made) == 1


def test_the_last_snapshot_stays_while_effects_are_compiled(bench):
    """Whoever asks for a frame meanwhile is not held up, and has the last one."""
    bench.run(bench.worker.set_scene(Scene(TERRAIN, (VENT,), lava=Lava())))
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


def _scene(slope=0.5, **material):
    x = 10.0 * np.arange(30)
    terrain = Terrain(np.tile(500.0 - slope * x, (20, 1)), 10.0)
    return Scene(terrain, (Vent((50.0, 100.0), 20.0),), Lava(**material))


def _table(scene, **forced):
    return effect_table(effects_for(scene, forced), decide(scene, forced))


def test_every_effect_has_a_text_with_its_number():
    """Each effect is on or off, as the choice says, with the number and the threshold."""
    scene = _scene()
    table = _table(scene)
    assert {name: is_on(text) for name, text in table.items()} == asdict(effects_for(scene))
    assert table['steep'].startswith('on: slope = 0.5 > 0.087')
    assert table['yielding'] == 'off: the material has none'
    assert table['merging'] == 'off: never chosen, only forced'


def test_forced_effects_say_so():
    """Forced on or off, with or without a number of their own."""
    table = _table(_scene(), steep=False, helmholtz=True, merging=True)
    assert table['steep'] == 'off: forced'
    assert table['helmholtz'] == table['merging'] == 'on: forced'


def test_what_is_on_wins_over_the_number():
    """An effect left out beside another says which; ground that has frozen stays."""
    scene = _scene(viscosity=20.0)
    decisions = decide(scene, {'green': True})
    inertia = {item.name: item for item in decisions}['inertia']
    table = effect_table(effects_for(scene, {'green': True}), decisions)
    assert table['inertia'] == f'off: {inertia.reason}'
    assert table['inertia'].endswith(', but not beside green')
    frozen = replace(Effects(), solidification=True)
    table = effect_table(frozen, decide(_scene(solidus=1200.0), horizon=1.0))
    assert table['solidification'].startswith('on: share of the way to the solidus = ')
    assert table['solidification'].endswith(', but what has frozen stays')


def test_frames_keep_coming_while_effects_change():
    """With the solver: while they are compiled and after that, and time goes on."""
    x = 10.0 * np.arange(40)
    scene = Scene(
        Terrain(np.tile(300.0 - 0.3 * x, (30, 1)), 10.0), (Vent((60.0, 150.0), 20.0),), lava=Lava()
    )
    frames = []
    worker = SimulationWorker(
        lambda scene: Simulation(scene, device='cpu'),
        clock=time.monotonic,
        time_scale=60.0,
        on_snapshot=lambda: frames.append(worker.latest),
    )
    worker.start()
    worker.set_scene(scene).result(timeout=60.0)

    def show_frames(count):
        end, first = time.monotonic() + 60.0, len(frames)
        while len(frames) - first < count:
            assert time.monotonic() < end, worker.status
            worker.request_snapshot()
            time.sleep(0.1)

    show_frames(3)
    for forced in ({'helmholtz': True}, {'inertia': True}, {'steep': False}, {}):
        change = worker.set_effects(forced, horizon=HORIZON)
        show_frames(3)
        change.result(timeout=60.0)
        assert {name: worker.eruption.effects[name] for name in forced} == {
            name: f'{"on" if is_on else "off"}: forced' for name, is_on in forced.items()
        }
    assert worker.stop(60.0)
    times = [snapshot.time for snapshot in frames]
    assert times == sorted(times) and times[0] < times[-1]
    assert worker.status.error == ''
    assert frames[-1].budget.error < 1e-5
