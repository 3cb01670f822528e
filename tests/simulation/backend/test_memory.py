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
from lava_ros.simulation.backend.memory import OutOfMemoryError
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
