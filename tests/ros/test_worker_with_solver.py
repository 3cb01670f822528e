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

"""The worker thread with the solver itself."""

import time

import numpy as np

from lava_ros.choice import HORIZON
from lava_ros.ros.worker import SimulationWorker
from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.simulation import Simulation


def test_frames_keep_coming_while_effects_change():
    """With the solver: no frame is missing for longer than compiling takes, and time goes on."""
    x = 10.0 * np.arange(40)
    scene = Scene(Terrain(np.tile(300.0 - 0.3 * x, (30, 1)), 10.0), (Vent((60.0, 150.0), 20.0),))
    frames = []
    worker = SimulationWorker(
        lambda scene: Simulation(scene, device='cpu'),
        clock=time.monotonic,
        time_scale=60.0,
        on_snapshot=lambda: frames.append((time.monotonic(), worker.latest)),
    )
    worker.start()
    worker.set_scene(scene).result(timeout=60.0)

    def show_frames(count):
        end, first = time.monotonic() + 60.0, len(frames)
        while len(frames) - first < count:
            assert time.monotonic() < end, worker.status
            worker.request_snapshot()
            time.sleep(0.1)

    show_frames(10)
    for forced in ({'helmholtz': True}, {'inertia': True}, {'steep': False}, {}):
        change = worker.set_effects(forced, horizon=HORIZON)
        show_frames(10)
        assert change.done()
        assert {name: worker.effects[name] for name in forced} == {
            name: f'{"on" if is_on else "off"}: forced' for name, is_on in forced.items()
        }
    assert worker.stop(10.0)
    gaps = np.diff([moment for moment, _ in frames])
    # 0.1 s and 1.4 s on an idle machine.
    assert np.median(gaps) < 1.0
    assert gaps.max() < 15.0
    times = [snapshot.time for _, snapshot in frames]
    assert times == sorted(times)
    assert worker.status.error == ''
    assert frames[-1][1].budget.error < 1e-5
