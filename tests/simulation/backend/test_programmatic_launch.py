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

"""Kernels of a graph that begin before those they come after have ended."""

import ctypes
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

from lava_ros.simulation.backend import graph as launches
from lava_ros.simulation.backend import programmatic_launch as module
from lava_ros.simulation.backend.programmatic_launch import overlap
from lava_ros.verification.benchmarks.effects import effect_sets, lava_field, STEP

KERNEL, COPY = 0, 1

#: What the driver answers to a graph that cannot be changed, and to an edge it does not take.
NOT_SUPPORTED, INVALID = 801, 1


def named(name):
    """A kernel of that name."""
    return SimpleNamespace(get_mangled_name=lambda: name)


class Driver:
    """A driver with one graph, of numbered nodes, that knows as much as is asked of it."""

    def __init__(self, nodes, edges):
        """Take kinds and names of the nodes, and the edges with their types."""
        self.nodes, self.edges = nodes, dict(edges)
        self.refuses_to_remove = self.refuses_to_add = False

    def cuGraphGetEdges_v2(self, graph, before, after, data, count):  # noqa: N802
        """Say how many edges there are, or which."""
        count._obj.value = len(self.edges)
        for n, ((one, other), kind) in enumerate(self.edges.items() if before else ()):
            before[n], after[n], data[n].type = one, other, kind
        return 0

    def cuGraphNodeGetType(self, node, kind):  # noqa: N802
        """Say what a node is."""
        kind._obj.value = self.nodes[node.value][0]
        return 0

    def cuGraphKernelNodeGetParams_v2(self, node, params):  # noqa: N802
        """Say what a node launches: here it is the node itself."""
        params._obj.function = node.value
        return 0

    def cuFuncGetName(self, name, function):  # noqa: N802
        """Say what that is called."""
        name._obj.value = f'{self.nodes[function.value][1]}_cuda_kernel_forward'.encode()
        return 0

    def cuGraphRemoveDependencies_v2(self, graph, before, after, data, count):  # noqa: N802
        """Remove an edge."""
        if self.refuses_to_remove:
            return NOT_SUPPORTED
        assert self.edges.pop((before[0], after[0])) == data._obj.type
        return 0

    def cuGraphAddDependencies_v2(self, graph, before, after, data, count):  # noqa: N802
        """Add an edge."""
        edge = data._obj
        if self.refuses_to_add and edge.type:
            return INVALID
        assert edge.from_port == edge.type
        assert (before[0], after[0]) not in self.edges
        self.edges[before[0], after[0]] = edge.type
        return 0


NODES = {1: (KERNEL, 'first'), 2: (KERNEL, 'second'), 3: (KERNEL, 'sort'), 4: (COPY, '')}
EDGES = {(1, 2): 0, (2, 3): 0, (3, 1): 0, (4, 2): 0, (2, 4): 0}
WAITING = [named('first'), named('second')]


@pytest.fixture
def driver(monkeypatch):
    """A driver in place of CUDA's."""
    driver = Driver(NODES, EDGES)
    monkeypatch.setattr(module, '_driver', lambda: driver)
    return driver


def graph(arch=90):
    """A graph of a GPU."""
    return SimpleNamespace(graph=ctypes.c_void_p(7), device=SimpleNamespace(arch=arch))


def test_kernels_that_wait_may_begin_early(driver):
    """Those that do not wait, and what comes after a copy, wait for the end of all before."""
    assert overlap(graph(), WAITING) == 2
    assert driver.edges == {(1, 2): 1, (3, 1): 1, (2, 3): 0, (4, 2): 0, (2, 4): 0}
    assert overlap(graph(), WAITING) == 0


def test_where_it_is_unknown_the_graph_stays(driver, monkeypatch):
    """An older GPU, an older driver, a graph that cannot be changed, an edge that is refused."""
    assert overlap(graph(arch=80), WAITING) == 0
    driver.refuses_to_remove = True
    assert overlap(graph(), WAITING) == 0
    driver.refuses_to_remove, driver.refuses_to_add = False, True
    assert overlap(graph(), WAITING) == 0
    assert driver.edges == EDGES
    monkeypatch.setattr(module, '_driver', lambda: None)
    assert overlap(graph(), WAITING) == 0


def test_an_edge_that_is_lost_is_said(driver, monkeypatch):
    """A graph without an edge would give wrong results."""
    monkeypatch.setattr(driver, 'cuGraphAddDependencies_v2', lambda *_: INVALID)
    with pytest.raises(RuntimeError, match='an edge of a CUDA graph is lost'):
        overlap(graph(), WAITING)


@pytest.mark.parametrize('name', ['bare', 'green', 'everything with green'])
def test_a_run_with_it_is_one_without(device, name, monkeypatch):
    """What is read early would be what was there a step ago."""
    found = []
    # a CPU has no graph in which a kernel could begin early
    particles, steps = (3000, 400) if wp.get_device(device).is_cuda else (100, 4)
    for is_on in (True, False):
        counts = []
        with monkeypatch.context() as patch:

            def count(*arguments, is_on=is_on, counts=counts):
                counts.append(overlap(*arguments) if is_on else 0)

            patch.setattr(launches, 'overlap', count)
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
