# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Memory that a simulation is expected to need, compared with the arrays that it allocates."""

import gc

import pytest
import warp as wp

from lava_ros.scene import Lava, Scene, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from solver import incline, only


def allocated() -> int:
    """Return the memory of all arrays on the CPU, and of blocks of arrays [bytes]."""
    gc.collect()
    arrays = [item for item in gc.get_objects() if isinstance(item, wp.array)]
    blocks = {id(array.block): array.block.nbytes for array in arrays if hasattr(array, 'block')}
    owned = sum(array.capacity for array in arrays if array.deleter is not None)
    return owned + sum(blocks.values())


@pytest.mark.parametrize(('method', 'spacing', 'effects', 'precision'), [
    ('particles', 20.0, (), 'float32'),
    ('particles', 20.0, ('cooling', 'solidification'), 'float64'),
    ('cells', 5.0, (), 'float32'),
    ('cells', 20.0, (), 'float32'),
])
def test_expected_memory_is_that_of_the_arrays(method, spacing, effects, precision):
    ground = incline(0.1, 150, 250, 10.0)
    scene = Scene(ground, (Vent((200.0, 700.0), 5.0),), Lava.paper())
    chosen = only('steep', *effects)

    def advanced():
        accuracy = Accuracy(
            spacing=spacing, thickness=1.0, method=method, precision=precision, longest_step=20.0
        )
        simulation = Simulation(scene, effects=chosen, accuracy=accuracy, device='cpu')
        peaks = simulation.start_peaks(simulation.accuracy.inundation_threshold)
        simulation.advance(20.0)
        list(simulation.observing(peaks))
        simulation.read_peaks(peaks, where_wet=True)
        return simulation, peaks

    # the second simulation shares the ground with the first one
    runs = [advanced()]
    before = allocated()
    runs.append(advanced())
    used = allocated() - before
    simulation, _ = runs[-1]
    needed = simulation.solver.bytes_for(scene, chosen, simulation.accuracy, 100.0)
    # the rest is the neighbour grid, and arrays of few items
    assert 0.95 * used < needed < 1.01 * used
