# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Kernels and device functions declare the arrays that they write; the code is compared with it.

`conftest.py` checks every kernel that a test builds for undeclared arrays.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest
import warp as wp

from deleted_effects import DELETED
from lava_ros.simulation.backend.compiled import access, quick_kernel, writing
from lava_ros.simulation.particles.layout import arguments_type
from scripts import load_script

ROOT = Path(__file__).parents[2]
SCRIPT = load_script(ROOT / 'docs/kernels.py')
REAL = wp.float32


def declaring() -> Iterator[tuple[str, str]]:
    """Yield file and name of each kernel and device function with a declaration."""
    folder = ROOT / 'lava_ros/simulation'
    for path in sorted(folder.rglob('*.py')):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.FunctionDef) and any(
                ast.unparse(one).startswith(('quick_kernel(', 'writing('))
                for one in node.decorator_list
            ):
                yield str(path.relative_to(folder)), node.name


def stale(found):
    """Return the names that a function declares without writing them in any of its forms."""
    names = set()
    for one in found:
        names |= one.function.writes.difference(*(inner.function.writes for inner in one.called))
    return names.difference(*(one.writes for one in found))


@pytest.mark.skipif(bool(DELETED), reason='some arrays are those of effects')
@pytest.mark.parametrize('place', [*declaring()], ids=' '.join)
def test_function_writes_every_array_that_it_declares(place):
    kernels = [one for part in SCRIPT.forms() for found in part.values() for one in found]
    every = (one for kernel in kernels for one in (kernel, *kernel.called))
    found = [one for one in every if SCRIPT.place_of(one.function) == place]
    assert found, 'docs/kernels.py has no scene that uses it'
    assert not stale(found)


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

    @quick_kernel(writes='flow ordered counts area source cells.sizes')
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
    assert stale([found]) == {'source'}


def test_kernel_that_writes_another_array_is_refused():
    @wp.func
    def inner(i: int, m: arguments_type(REAL)):
        m.rates[i] = REAL(0.0)

    with pytest.raises(AssertionError, match=r"writes \['rates'\] without declaring it"):
        @quick_kernel(writes='flow')
        def outer(i: int, m: arguments_type(REAL)):
            inner(i, m)


def test_function_with_an_incomplete_declaration_is_refused_in_its_kernel():
    @wp.func
    @writing('flow')
    def inner(i: int, m: arguments_type(REAL)):
        m.rates[i] = REAL(0.0)

    with pytest.raises(AssertionError, match=r"inner writes \['rates'\] without declaring it"):
        @quick_kernel(writes=('rates', inner))
        def outer(i: int, m: arguments_type(REAL)):
            inner(i, m)


@pytest.mark.parametrize('code', [
    'values.data[i] = 0;', 'atomicAdd(values.data + i, 1);',
    'int* place = reinterpret_cast<int*>(values.data); place[i] = 0;',
])
def test_c_function_that_changes_an_array_must_declare_it(code):
    @wp.func_native(code)
    def change(values: wp.array(dtype=wp.int32), i: int): ...

    with pytest.raises(AssertionError, match='change'):
        @quick_kernel(writes='counts')
        def outer(i: int, m: arguments_type(REAL)):
            change(m.counts, i)
