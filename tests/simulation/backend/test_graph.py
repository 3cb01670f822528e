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

"""Launches that are made again: packed once, and never with what they were not given."""

from dataclasses import replace
import gc
import weakref

import numpy as np
import pytest
import warp as wp

from lava_ros.simulation import Simulation
from lava_ros.simulation import simulation as simulation_module
from lava_ros.simulation.backend import graph as launches_module
from lava_ros.simulation.backend.compiled import quick_kernel
from lava_ros.simulation.backend.graph import Launches, MOST
from lava_ros.verification.benchmarks.effects import effect_sets, lava_field, STEP


@quick_kernel
def add(i: int, by: float, values: wp.array(dtype=float)):
    """Add to the first values."""
    values[i] += by


def zeros(count=6):
    """Values that nothing has been added to."""
    return wp.zeros(count, dtype=float, device='cpu')


def test_each_launch_has_its_own_arguments():
    """Other arrays, numbers and sizes are told from those of before, and from each other."""
    launches = Launches(wp.get_device('cpu'))
    one, other = zeros(), zeros()
    for array, by, dim in (
        (one, 1.0, 6), (one, 1.0, 2), (other, 1.0, 3), (one, 10.0, 1), (one, 1.0, 6), (one, 1.0, 0)
    ):
        launches(add, [by, array], dim=dim)
    np.testing.assert_array_equal(one.numpy(), [13.0, 3.0, 2.0, 2.0, 2.0, 2.0])
    np.testing.assert_array_equal(other.numpy(), [1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


def test_arrays_are_kept_until_they_are_forgotten():
    """What lies where an array was is no longer found by what was launched with that."""
    launches = Launches(wp.get_device('cpu'))
    array = zeros()
    gone = weakref.ref(array)
    launches(add, [1.0, array], dim=6)
    del array
    assert gone() is not None
    launches.forget()
    assert gone() is None


def test_launches_that_never_come_again_do_not_pile_up():
    """Their arrays are given back, and those that do come again go on."""
    launches = Launches(wp.get_device('cpu'))
    kept, gone = zeros(), []
    for _ in range(2 * MOST):
        array = zeros()
        gone.append(weakref.ref(array))
        launches(add, [1.0, array], dim=6)
        launches(add, [1.0, kept], dim=6)
    del array
    assert sum(item() is not None for item in gone) <= MOST
    assert (kept.numpy() == 2 * MOST).all()


@pytest.mark.parametrize(
    'name',
    [
        'everything with green',
        *(
            pytest.param(name, marks=pytest.mark.nightly)
            for name in ('helmholtz', 'everything with inertia')
        ),
    ],
)
def test_a_step_packs_nothing_anew(monkeypatch, name):
    """Every argument of a stage is the same object as before, as long as nothing changes."""
    simulation = lava_field(100, effect_sets()[name], 'cpu')
    simulation.advance(20.0 * STEP)
    packed = []

    def launch(kernel, **rest):
        packed.append(kernel.key)
        return usual(kernel, **rest)

    usual = wp.launch
    monkeypatch.setattr(wp, 'launch', launch)
    simulation.advance(simulation.time + 20.0 * STEP)
    assert not packed
    # room for more particles: all arrays are others
    simulation._state.grow(2 * simulation._state.capacity)
    simulation.advance(simulation.time + 5.0 * STEP)
    assert packed
    packed.clear()
    simulation.advance(simulation.time + 5.0 * STEP)
    assert not packed


def test_a_terrain_that_is_replaced_is_given_back():
    """However often that is: a large one would soon fill the memory."""
    simulation = lava_field(100, effect_sets()['solidification'], 'cpu')
    simulation.advance(5.0 * STEP)
    for _ in range(3):
        arrays = simulation._terrain.height, simulation._neighbors.cells.starts
        gone = [weakref.ref(array) for array in arrays]
        del arrays
        simulation.set_terrain(simulation.scene.terrain)
        simulation.advance(simulation.time + 5.0 * STEP)
        gc.collect()
        assert [item() for item in gone] == [None, None]


def test_captured_launches_wait_for_their_replay():
    """They are not made when they are taken down, and all together each time after that."""
    launches = Launches(wp.get_device('cpu'))
    one, other = zeros(), zeros()

    def launch():
        assert launches.is_capturing and launches.extent == 5
        launches(add, [1.0, one], dim=6)
        launches(add, [10.0, one], dim=2)
        launches(add, [100.0, one], dim=0)
        launches(add, [1.0, other], dim=3)

    launches.capture(launch, 5)
    assert launches.can_replay(5) and not launches.can_replay(6) and not launches.is_capturing
    assert not one.numpy().any()
    launches.replay()
    # what is packed for others changes nothing
    launches(add, [1.0, other], dim=1)
    launches.replay()
    np.testing.assert_array_equal(one.numpy(), [22.0, 22.0, 2.0, 2.0, 2.0, 2.0])
    np.testing.assert_array_equal(other.numpy(), [3.0, 2.0, 2.0, 0.0, 0.0, 0.0])


def test_captured_arrays_are_kept_until_they_are_forgotten():
    """Nothing else comes to lie where a captured launch writes."""
    launches = Launches(wp.get_device('cpu'))
    arrays = [zeros()]
    gone = weakref.ref(arrays[0])
    launches.capture(lambda: launches(add, [1.0, *arrays], dim=6), 6)
    arrays.clear()
    launches.replay()
    assert gone() is not None
    launches.forget()
    assert gone() is None and not launches.can_replay(0)


def test_a_capture_that_fails_leaves_nothing():
    """Launches are made again as before."""
    launches, values = Launches(wp.get_device('cpu')), zeros()

    def launch():
        launches(add, [1.0, values], dim=6)
        raise ValueError('no more')

    with pytest.raises(ValueError, match='no more'):
        launches.capture(launch, 6)
    assert not launches.can_replay(0) and not launches.is_capturing
    launches(add, [1.0, values], dim=1)
    assert values.numpy().sum() == 1.0


def test_another_warp_launches_itself(monkeypatch):
    """What a launch has is not public: without it a replay is slower, and the same."""
    launches, values = Launches(wp.get_device('cpu')), zeros()
    monkeypatch.setattr(launches_module.ctypes, 'byref', None)
    launches.capture(lambda: launches(add, [1.0, values], dim=6), 6)
    ((function, arguments, _),) = launches._again.args[0]
    assert function.__name__ == 'launch' and not arguments
    monkeypatch.undo()
    launches.replay()
    launches.replay()
    assert (values.numpy() == 2.0).all()


def test_this_warp_is_called_at_once():
    """The compiled functions themselves are called, or replays would be no faster."""
    launches = Launches(wp.get_device('cpu'))
    launches.capture(lambda: launches(add, [1.0, zeros()], dim=6), 6)
    ((function, arguments, command),) = launches._again.args[0]
    assert function is command.hooks.forward and len(arguments) == 2


@pytest.mark.parametrize('is_deterministic', [False, True])
@pytest.mark.parametrize(
    'name',
    [
        'everything with green',
        *(
            pytest.param(name, marks=pytest.mark.nightly)
            for name in effect_sets()
            if name != 'everything with green'
        ),
    ],
)
def test_a_captured_stage_is_all_of_it(monkeypatch, name, is_deterministic):
    """The same bits as launch by launch: nothing of a stage goes another way."""
    ends = []
    for is_alone in (True, False):
        monkeypatch.setattr(simulation_module, 'is_alone', lambda _, value=is_alone: value)
        simulation = lava_field(200, effect_sets()[name], 'cpu')
        if is_deterministic:
            accuracy = replace(simulation.accuracy, deterministic=True)
            simulation = Simulation.resume(
                replace(simulation.checkpoint(), accuracy=accuracy), device='cpu'
            )
        simulation.advance(20.0 * STEP)
        assert simulation.particle_count > 100
        assert simulation._state.launches.can_replay(0) == is_alone
        ends.append(simulation.checkpoint().to_bytes())
    assert ends[0] == ends[1]
