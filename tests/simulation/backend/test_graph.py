# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Repeated launches, which are packed once; on a GPU, graphs whose kernels may start early."""

from dataclasses import replace
import gc
from types import SimpleNamespace
import weakref

import numpy as np
import pytest
import warp as wp

from lava_ros.simulation.backend import graph as launches_module
from lava_ros.simulation.backend.compiled import quick_kernel
from lava_ros.simulation.backend.graph import Launches, MAX_CACHED, overlap
from lava_ros.verification.benchmarks.effects import effect_sets, lava_field, STEP

#: The set of effects that uses the most kernels.
ALL = 'everything with green'


@quick_kernel()
def add(i: int, by: float, values: wp.array(dtype=float)):
    values[i] += by


def zeros(count=6):
    return wp.zeros(count, dtype=float, device='cpu')


def and_nightly(*names):
    """Parametrize `name` over one set of effects in every run, and others nightly."""
    nightly = (pytest.param(name, marks=pytest.mark.nightly) for name in names if name != ALL)
    return pytest.mark.parametrize('name', [ALL, *nightly])


@pytest.fixture
def launches():
    return Launches(wp.get_device('cpu'))


def test_launches_are_distinguished_by_their_arguments(launches):
    one, other = zeros(), zeros()
    for array, by, dim in (
        (one, 1.0, 6), (one, 1.0, 2), (other, 1.0, 3), (one, 10.0, 1), (one, 1.0, 6), (one, 1.0, 0)
    ):
        launches(add, [by, array], dim=dim)
    np.testing.assert_array_equal(one.numpy(), [13.0, 3.0, 2.0, 2.0, 2.0, 2.0])
    np.testing.assert_array_equal(other.numpy(), [1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize('captures', [False, True])
def test_launches_keep_their_arrays_until_forgotten(launches, captures):
    arrays = [zeros()]
    gone = weakref.ref(arrays[0])

    def launch():
        launches(add, [1.0, *arrays], dim=6)

    if captures:
        launches.capture(launch, 6)
        arrays.clear()
        launches.replay()
    else:
        launch()
        arrays.clear()
    assert gone() is not None
    launches.forget()
    assert gone() is None and not launches.can_replay(0)


def test_launches_that_do_not_repeat_are_freed(launches):
    kept, gone = zeros(), []
    for _ in range(2 * MAX_CACHED):
        array = zeros()
        gone.append(weakref.ref(array))
        launches(add, [1.0, array], dim=6)
        launches(add, [1.0, kept], dim=6)
    del array
    assert sum(item() is not None for item in gone) <= MAX_CACHED
    assert (kept.numpy() == 2 * MAX_CACHED).all()


@and_nightly('helmholtz', 'everything with inertia')
def test_unchanged_step_packs_no_arguments(monkeypatch, name):
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
    # more capacity: all arrays are replaced
    simulation.solver.state.grow(2 * simulation.solver.state.capacity)
    simulation.advance(simulation.time + 5.0 * STEP)
    assert packed
    packed.clear()
    simulation.advance(simulation.time + 5.0 * STEP)
    assert not packed


def test_replaced_terrain_is_freed():
    simulation = lava_field(100, effect_sets()['solidification'], 'cpu')
    simulation.advance(5.0 * STEP)
    for _ in range(3):
        arrays = simulation.solver.terrain.height, simulation.solver.neighbors.cells.starts
        gone = [weakref.ref(array) for array in arrays]
        del arrays
        former = simulation.scene.terrain
        simulation.set_terrain(replace(former, elevation=former.elevation + 1.0))
        simulation.advance(simulation.time + 5.0 * STEP)
        gc.collect()
        assert [item() for item in gone] == [None, None]


def test_captured_launches_wait_for_their_replay(launches):
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
    # packing for other launches changes nothing
    launches(add, [1.0, other], dim=1)
    launches.replay()
    np.testing.assert_array_equal(one.numpy(), [22.0, 22.0, 2.0, 2.0, 2.0, 2.0])
    np.testing.assert_array_equal(other.numpy(), [3.0, 2.0, 2.0, 0.0, 0.0, 0.0])


def test_launches_are_direct_after_a_failed_capture(launches):
    values = zeros()

    def launch():
        launches(add, [1.0, values], dim=6)
        raise ValueError('no more')

    with pytest.raises(ValueError, match='no more'):
        launches.capture(launch, 6)
    assert not launches.can_replay(0) and not launches.is_capturing
    launches(add, [1.0, values], dim=1)
    assert values.numpy().sum() == 1.0


def test_graph_is_unchanged_without_support_by_gpu_or_driver(monkeypatch):
    old = SimpleNamespace(graph=None, device=SimpleNamespace(arch=80))
    assert overlap(old, [add]) == 0
    monkeypatch.setattr(launches_module, '_driver', lambda: None)
    assert overlap(SimpleNamespace(graph=None, device=SimpleNamespace(arch=90)), [add]) == 0


@pytest.mark.parametrize('name', ['bare', 'green', 'everything with green'])
def test_early_kernels_do_not_change_the_run(device, name, monkeypatch):
    """A kernel that reads too early gets the values of the previous step."""
    found = []
    # a CPU has no graph in which a kernel could start early
    particles, steps = (3000, 400) if wp.get_device(device).is_cuda else (100, 4)
    for is_on in (True, False):
        counts = []
        with monkeypatch.context() as patch:

            def count(*arguments, is_on=is_on, counts=counts):
                counts.append(overlap(*arguments) if is_on else 0)

            patch.setattr(launches_module, 'overlap', count)
            simulation = lava_field(particles, effect_sets()[name], device)
            simulation.advance(steps * STEP)
            found.append(simulation.snapshot())
        is_new = wp.get_device(device).is_cuda and wp.get_device(device).arch >= 90
        assert bool(sum(counts)) == (is_on and is_new)
    one, other = found
    assert one.steps.count == other.steps.count
    assert one.particle_count == other.particle_count
    assert float(np.abs(one.thickness - other.thickness).max()) < 1e-3
    assert one.budget.error == pytest.approx(other.budget.error, abs=1e-6)
