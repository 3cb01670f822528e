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

"""The order of the particles by their cells."""

import numpy as np
import pytest
import warp as wp

from lava_ros.simulation.cells import cell_frame
from lava_ros.simulation.motion_arguments import arguments_type
from lava_ros.simulation.neighbors import _kernels
from lava_ros.simulation.state import PARTICLES, REAL, SPARE

#: Cells, the particles in them, and those that have left.
CELLS, COUNT, LEFT = 12, 40, 5


def ordered(device, real, cell, rank, *, again):
    """Volumes of particles 1, 2, ... as they are ordered, and how many there are said to be."""
    *_, order_particles, _, list_members = _kernels(
        real, False, False, False, False, again
    )
    count = len(cell)
    sizes = np.bincount(cell, minlength=CELLS + 1)
    starts = np.concatenate([[0], np.cumsum(sizes)])
    rows = np.ones((count + SPARE, 4))
    rows[:count, 2] = 1 + np.arange(count)
    # what has left may be no number any more
    rows[:count][cell == CELLS] = np.nan
    way, cells = arguments_type(real)(), cell_frame(real)()
    cells.rows, cells.columns = 1, CELLS
    for name, values in (('starts', starts), ('sizes', np.append(sizes, 0))):
        setattr(cells, name, wp.array(values, dtype=wp.int32, device=device))
    way.cells = cells
    for name, values in (
        ('particle', rows),
        ('ordered', np.full((count + SPARE, 4), np.nan)),
        ('cell', np.append(cell, np.zeros(SPARE))),
        ('rank', rank),
        ('members', np.zeros(count)),
        ('counts', [count, *[0] * 10]),
        ('rates', np.zeros(2)),
        ('chosen', np.ones(1)),
        ('remainder', np.zeros((count, 2))),
        ('ordered_remainder', np.zeros((count, 2))),
    ):
        dtype = arguments_type(real).vars[name].type.dtype
        setattr(way, name, wp.array(np.asarray(values), dtype=dtype, device=device))
    launches = [(list_members, count)] if again else []
    for kernel, threads in (*launches, (order_particles, count + SPARE)):
        wp.launch(kernel, threads, inputs=[way, 0], device=device)
    counts, found = way.counts, way.ordered
    return found.numpy()[:, 2], int(counts.numpy()[PARTICLES])


def some_cells(seed):
    """Cells of particles, some of which have left, and ranks in them in any order."""
    random = np.random.default_rng(seed)
    cell = random.integers(0, CELLS, COUNT)
    cell[random.permutation(COUNT)[:LEFT]] = CELLS
    rank = np.zeros(COUNT, int)
    for one in range(CELLS + 1):
        (inside,) = np.nonzero(cell == one)
        rank[inside] = random.permutation(len(inside))
    return cell, rank


@pytest.mark.parametrize('real', REAL.values(), ids=REAL)
def test_particles_rank_by_their_numbers(device, real):
    """However they came into their cells, in a deterministic run on a GPU."""
    for seed in range(10):
        cell, rank = some_cells(seed)
        volumes, count = ordered(device, real, cell, rank, again=True)
        assert count == COUNT - LEFT
        expected = 1 + np.argsort(cell, kind='stable')[:count]
        np.testing.assert_array_equal(volumes[:count], expected)


def test_what_has_left_leaves_no_numbers_behind(device):
    """Sums go on over the end of the last row: there are zeros, whatever was there."""
    for again in (False, True):
        cell, rank = some_cells(3)
        volumes, count = ordered(device, wp.float32, cell, rank, again=again)
        (inside,) = np.nonzero(cell == 4)
        first = int((cell < 4).sum())
        assert set(volumes[first : first + len(inside)]) == set(1.0 + inside)
        np.testing.assert_array_equal(volumes[count:], np.zeros(LEFT + SPARE))
