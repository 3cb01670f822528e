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

"""The worker thread: what goes wrong in a simulation is a state, and a reset gets out of it."""

import pytest

from lava_ros.ros.worker_status import WorkerState
from lava_ros.scene import Scene
from worker_bench import TERRAIN, VENT


def test_a_failure_is_reported_and_reset_recovers(bench):
    """An exception in the thread is a state; the last snapshot stays; reset starts again."""
    bench.run(bench.worker.set_scene(Scene(TERRAIN, (VENT,))))
    last = bench.worker.latest
    bench.simulation.failure = RuntimeError('device lost')
    bench.now += 0.5
    bench.wait_for_state(WorkerState.FAILED)
    assert bench.worker.status.error == 'RuntimeError: device lost'
    assert bench.worker.latest is last
    bench.run(bench.worker.set_vents([]))
    assert bench.worker.status.state is WorkerState.FAILED
    bench.run(bench.worker.reset())
    bench.wait_for_state(WorkerState.RUNNING)
    assert bench.worker.status.error == ''
    assert bench.simulation.scene.vents == ()


def test_a_failed_start_is_reported(bench):
    """So is an exception that is not about input when a simulation is made."""
    bench.refusal = MemoryError('too large')
    with pytest.raises(MemoryError):
        bench.run(bench.worker.set_terrain(TERRAIN))
    bench.wait_for_state(WorkerState.FAILED)
    assert 'too large' in bench.worker.status.error


def test_what_is_no_map_is_not_shown(bench):
    """A snapshot with a flaw fails the simulation; the one before it stays."""
    bench.run(bench.worker.set_scene(Scene(TERRAIN, (VENT,))))
    last = bench.worker.latest
    bench.simulation.flawed = True
    bench.now += 0.5
    bench.wait(lambda: bench.simulation.time == pytest.approx(0.5))
    bench.worker.request_snapshot()
    bench.wait_for_state(WorkerState.FAILED)
    assert 'thickness is not a number of metres in 20 cells' in bench.worker.status.error
    assert bench.worker.latest is last
    bench.run(bench.worker.reset())
    bench.wait_for_state(WorkerState.RUNNING)


@pytest.mark.parametrize('bench', [{'max_particles': 10}], indirect=True)
def test_too_many_particles(bench):
    """Beyond the limit the simulation fails and shows what it had; a higher limit helps."""
    bench.run(bench.worker.set_scene(Scene(TERRAIN, (VENT,))))
    bench.simulation.particle_count = 10
    bench.now += 0.5
    bench.wait(lambda: bench.simulation.time == pytest.approx(0.5))
    bench.simulation.particle_count = 11
    bench.now += 0.5
    bench.wait_for_state(WorkerState.FAILED)
    assert bench.worker.status.error.startswith('11 particles, expected at most 10 (max_part')
    assert bench.worker.latest.time == pytest.approx(1.0)
    bench.run(bench.worker.set_max_particles(20))
    bench.run(bench.worker.reset())
    bench.simulation.particle_count = 11
    bench.now += 0.5
    bench.wait(lambda: bench.simulation.time == pytest.approx(0.5))


def test_no_memory_is_told_with_what_helps(bench):
    """What Warp raises becomes a sentence with particles, cells and advice."""
    bench.run(bench.worker.set_scene(Scene(TERRAIN, (VENT,))))
    bench.simulation.failure = RuntimeError("Failed to allocate 64 bytes on device 'cuda:0'")
    bench.now += 0.5
    bench.wait_for_state(WorkerState.FAILED)
    error = bench.worker.status.error
    assert error.startswith('out of memory with 0 particles on 5 x 4 cells: Failed to allocate 64')
    assert 'larger spacing' in error
