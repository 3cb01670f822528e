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

import gc
import weakref

import numpy as np
import pytest
import warp as wp

from lava_ros.bench.effects import effect_sets, lava_field, STEP
from lava_ros.simulation.launches import Launches, MOST


@wp.kernel(module='unique')
def add(by: float, values: wp.array(dtype=float)):
    """Add to the first values."""
    i = wp.tid()
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
        launches(add, dim=dim, inputs=[by], outputs=[array])
    np.testing.assert_array_equal(one.numpy(), [13.0, 3.0, 2.0, 2.0, 2.0, 2.0])
    np.testing.assert_array_equal(other.numpy(), [1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


def test_arrays_are_kept_until_they_are_forgotten():
    """What lies where an array was is no longer found by what was launched with that."""
    launches = Launches(wp.get_device('cpu'))
    array = zeros()
    gone = weakref.ref(array)
    launches(add, dim=6, inputs=[1.0], outputs=[array])
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
        launches(add, dim=6, inputs=[1.0], outputs=[array])
        launches(add, dim=6, inputs=[1.0], outputs=[kept])
    del array
    assert sum(item() is not None for item in gone) <= MOST
    assert (kept.numpy() == 2 * MOST).all()


@pytest.mark.parametrize('name', ['helmholtz', 'everything with green', 'everything with inertia'])
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
        gone = [weakref.ref(simulation._terrain.height), weakref.ref(simulation._neighbors.starts)]
        simulation.set_terrain(simulation.scene.terrain)
        simulation.advance(simulation.time + 5.0 * STEP)
        gc.collect()
        assert [item() for item in gone] == [None, None]
