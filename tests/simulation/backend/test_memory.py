# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A device without memory for more lava: a clear error, and an unchanged state."""

from contextlib import contextmanager

import numpy as np
import pytest
import warp as wp

from lava_ros.effects import Effects
from lava_ros.live.failures import failure_text
from lava_ros.scene import Lava, Vent
from lava_ros.simulation.backend.memory import (
    ArrayBlock,
    OutOfMemoryError,
    read,
    read_parts,
    write_part,
)
from solver import incline, simulated

#: More particles than fit on any GPU: each of ten arrays would take up to 34 GB.
TOO_MANY = 2**31 - 1

NO_ROOM = f'room for {TOO_MANY} particles: Failed to allocate'


def flow(device):
    ground, vent = incline(0.2, 30, 40, 10.0, top=500.0), Vent((60.0, 155.0), 20.0)
    knobs = {'effects': Effects(inertia=True), 'spacing': 5.0, 'deterministic': True}
    simulation = simulated(ground, Lava.paper(), vent, device=device, **knobs)
    simulation.advance(60.0)
    return simulation


@contextmanager
def scarce(simulation, blocks=0):
    """Make allocations fail: on a GPU by their size, on the CPU with numpy's error after a number.

    A system may grant memory that it does not have, and kill the process that uses it.
    """
    zeros, given = np.zeros, []

    def refuse(shape, dtype=float, **options):
        # blocks of memory.zeros, and no other array of numpy
        if dtype is np.uint8:
            given.append(shape)
            if len(given) > blocks:
                raise MemoryError(f'Unable to allocate an array with shape {shape}')
        return zeros(shape, dtype, **options)

    with pytest.MonkeyPatch.context() as patch:
        if not simulation.solver.state.device.is_cuda:
            patch.setattr(np, 'zeros', refuse)
        yield


def test_failed_growth_leaves_the_simulation_unchanged(device):
    simulation, other = flow(device), flow(device)
    before, capacity = simulation.checkpoint().to_bytes(), simulation.solver.state.capacity
    with scarce(simulation), pytest.raises(RuntimeError, match=NO_ROOM) as caught:
        simulation.solver.state.grow(TOO_MANY)
    words = failure_text(caught.value, simulation.snapshot())
    assert words.startswith('out of memory with')
    assert 'a larger spacing or a coarser terrain needs less' in words
    assert simulation.solver.state.capacity == capacity
    assert simulation.checkpoint().to_bytes() == before
    for run in (simulation, other):
        run.advance(120.0)
    assert simulation.checkpoint().to_bytes() == other.checkpoint().to_bytes()


def test_new_simulation_runs_after_a_failed_allocation(device):
    simulation = flow(device)
    if simulation.solver.state.device.is_cuda:
        blocks = []
        with pytest.raises(RuntimeError, match='Failed to allocate'):
            while True:
                blocks.append(wp.empty(TOO_MANY, dtype=wp.vec4, device=device))
        blocks.clear()
    else:
        with scarce(simulation, 1), pytest.raises(OutOfMemoryError, match='Failed to allocate'):
            flow(device)
    again = flow(device)
    assert again.checkpoint().to_bytes() == simulation.checkpoint().to_bytes()


def test_arrays_of_a_block_are_apart_and_zero(device):
    items = {'a': (wp.float64, (3, 5)), 'b': (wp.uint8, (7,)), 'c': (wp.vec2, (4,))}
    block = ArrayBlock(items, device)
    for name, (dtype, shape) in items.items():
        array = block[name]
        assert array is block[name]
        assert (array.dtype, array.shape) == (dtype, shape)
        assert not array.numpy().any()
    block['b'].fill_(wp.uint8(255))
    assert not block['a'].numpy().any()
    assert not block['c'].numpy().any()
    copy = block.copy()
    block['b'].zero_()
    assert (copy['b'].numpy() == 255).all()


def test_a_block_describes_its_arrays_as_warp_does(device):
    @wp.struct
    class Pair:
        a: wp.array2d(dtype=wp.float64)
        b: wp.array(dtype=wp.float32)

    block = ArrayBlock({'a': (wp.float64, (3, 5)), 'b': (wp.float32, (7,))}, device)
    pair, described = Pair(), Pair.ctype()
    for name in ('a', 'b'):
        block.describe(name, described)
        setattr(pair, name, block[name])
    assert bytes(described) == bytes(pair.__ctype__())


def test_parts_of_maps_of_several_types_are_read_together(device):
    values = np.arange(60.0).reshape(6, 10)
    maps = [wp.array(values, dtype=kind, device=device) for kind in (wp.float64, wp.float32)]
    for rows, columns in ((slice(1, 4), slice(2, 9)), (slice(0, 0), slice(0, 0))):
        for found in read_parts(maps, (rows, columns)):
            np.testing.assert_array_equal(found, values[rows, columns])
    pairs = wp.array(values[:, :2], dtype=wp.vec2, device=device)
    np.testing.assert_array_equal(read(pairs), values[:, :2])


@pytest.mark.parametrize('part', [
    (slice(1, 3),), (slice(0, 2), slice(1, 4), slice(2, 9)), (slice(3), slice(0, 0), slice(0, 0)),
])
def test_parts_of_maps_are_written(part, device):
    expected = np.zeros((3, 6, 10), dtype=np.float32)
    maps = wp.array(expected, dtype=wp.float32, device=device)
    expected[part] = np.arange(1.0, expected[part].size + 1.0).reshape(expected[part].shape)
    write_part(maps, part, expected[part])
    np.testing.assert_array_equal(read(maps), expected)
