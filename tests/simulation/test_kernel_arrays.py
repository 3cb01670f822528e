# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The page of the arrays that kernels read and write, which is derived from their code.

`conftest.py` compares every kernel that a test builds with it.
"""

from pathlib import Path

import pytest
import warp as wp

from deleted_effects import DELETED
from lava_ros.simulation.backend.compiled import access, quick_kernel
from lava_ros.simulation.particles.layout import arguments_type
from scripts import load_script

SCRIPT = load_script(Path(__file__).parents[2] / 'docs/kernels.py')
REAL = wp.float32


@pytest.mark.skipif(bool(DELETED), reason='some arrays are those of effects')
def test_page_of_kernels_is_up_to_date():
    assert SCRIPT.PAGE.read_text(encoding='utf-8') == SCRIPT.page(), 'run python docs/kernels.py'


def test_accesses_are_found_through_other_names_and_functions():
    load, store = access(REAL, 4)
    is_on = False

    @wp.func
    def inner(i: int, values: wp.array(dtype=wp.types.vector(3, REAL)), m: arguments_type(REAL)):
        values[i][0] = m.ground.elevation[0, i]
        store(m.ordered, i, load(m.particle, m.cells.starts[i]))

    @quick_kernel()
    def outer(i: int, area: wp.array(dtype=REAL), m: arguments_type(REAL)):
        starts = m.cells.starts
        inner(starts[i], m.flow, m)
        area[i] += m.top[0]
        sizes = m.cells.sizes
        sizes[wp.atomic_add(m.counts, 0, m.rank.shape[0])] = 0
        if wp.static(is_on):
            m.velocity[i] = m.slope[i]

    found = SCRIPT.accesses_of(outer)
    assert found.reads == {'cells.starts', 'ground.elevation', 'particle', 'top'}
    assert found.writes == {'flow', 'ordered', 'area', 'cells.sizes', 'counts'}


def test_kernel_that_writes_an_array_beyond_the_page_is_refused():
    @wp.func
    def inner(i: int, m: arguments_type(REAL)):
        m.rates[i] = REAL(0.0)

    def elevate(i: int, m: arguments_type(REAL)):
        inner(i, m)

    elevate.__module__ = 'lava_ros.simulation.step.flow'
    with pytest.raises(AssertionError, match=r"elevate writes \['rates'\]"):
        quick_kernel()(elevate)


@pytest.mark.parametrize(('code', 'is_changed'), [
    ('values.data[i] = 0;', True), ('values.data[box[1]] |= 1;', True),
    ('atomicAdd(values.data + i, 1);', True), ('change(values.data);', True),
    ('int* place = reinterpret_cast<int*>(values.data); place[i] = 0;', True),
    ('int v = values.data[i]; values.data[v] += 1;', True),
    ('int v = values.data[box[1]];', False), ('bool v = values.data[i] == 0;', False),
    ('const int* place = reinterpret_cast<const int*>(values.data) + i;', False),
])
def test_changes_of_an_array_are_found_in_c(code, is_changed):
    @wp.func_native(code)
    def use(values: wp.array(dtype=wp.int32), i: int): ...

    found = SCRIPT.Accesses(use, {'values': ('values', wp.array(dtype=wp.int32))})
    assert (found.writes if is_changed else found.reads) == {'values'}
    assert not (found.reads if is_changed else found.writes)
