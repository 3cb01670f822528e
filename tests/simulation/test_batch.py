# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Several simulations at once."""

from functools import partial

import numpy as np
import pytest

from lava_ros.scene import Lava, Vent
from lava_ros.simulation import batch as batch_module
from lava_ros.simulation import Simulation
from lava_ros.simulation.backend.memory import Readback
from lava_ros.simulation.batch import Batch, side_by_side
from lava_ros.verification.benchmarks.effects import effect_sets
from solver import incline, simulated

#: Sets of effects of ``lava check speed effects`` that use different kernels, and map times [s].
SETS = ('everything with green', 'helmholtz', 'inertia', 'merging', 'conduction', 'solidification')
ENDS = (0.25, 0.5)

#: Sets with heat in the pass of the sums over neighbours: on a GPU the temperatures of a batch
#: differ by rounding, also from a single run with as many threads to a particle.
ROUNDED = ('everything with green',)


def simulation_of(flux, device, spacing=1.5):
    ground, vent = incline(0.2, 20, 24, 2.0), Vent((12.0, 20.0), flux, 1400.0)
    return simulated(
        ground, Lava.paper(), vent, device=device, spacing=spacing, deterministic=True
    )


def task_of(flux, device, ends):
    simulation = simulation_of(flux, device)
    yield from simulation.advancing(10.0)
    yield from simulation.advancing(20.0)
    ends[flux] = simulation.sample().position


def run(routes, device):
    Batch(at_once=3).run(routes)


def run_as_ensemble(routes, device):
    """Run tasks as ensembles do: on the CPU one after the other."""
    for _ in side_by_side(routes, device, at_once=3):
        pass


RUNNERS = pytest.mark.parametrize('run', [run, run_as_ensemble])


@RUNNERS
def test_concurrent_members_equal_single_runs(device, run):
    # more than run at once
    fluxes, ends = (1.0, 3.0, 5.0, 8.0), {}
    run((task_of(flux, device, ends) for flux in fluxes), device)
    assert sorted(ends) == sorted(fluxes)
    for flux in fluxes:
        alone = simulation_of(flux, device)
        alone.advance(10.0)
        alone.advance(20.0)
        assert np.array_equal(alone.sample().position, ends[flux]), flux


@RUNNERS
def test_member_with_a_coarser_run_after_it_equals_single_runs(device, run):
    ends = {}

    def route(flux):
        for spacing in (1.5, 2.1):
            simulation = simulation_of(flux, device, spacing)
            yield from simulation.advancing(10.0)
            ends[flux, spacing] = simulation.sample().position

    run(map(route, (1.0, 8.0)), device)
    for (flux, spacing), found in ends.items():
        alone = simulation_of(flux, device, spacing)
        alone.advance(10.0)
        assert np.array_equal(alone.sample().position, found), (flux, spacing)
    assert len(ends) == 4


@pytest.mark.parametrize(
    'name',
    [pytest.param(name, marks=pytest.mark.nightly) for name in ('bare', *SETS)],
)
def test_different_members_are_identical_to_single_runs(device, name, monkeypatch):
    if name != 'inertia':
        # read back as rarely as on a GPU; with inertia the vent would wait for capacity
        monkeypatch.setitem(batch_module._STAGES, False, batch_module._STAGES[True])
        monkeypatch.setitem(batch_module._UNDER_WAY, False, batch_module._UNDER_WAY[True])
    chosen = (effect_sets()[name], effect_sets()['bare'])
    is_rounded = name in ROUNDED and device != 'cpu'
    same = partial(np.testing.assert_allclose, rtol=0.0, atol=1e-5 if is_rounded else 0.0)
    in_order = partial(np.sort, axis=0) if is_rounded else np.asarray

    def begun(number):
        # the third one needs a larger capacity
        vent = Vent((400.0, 400.0), (20.0, 60.0, 4000.0)[number], 1400.0)
        knobs = {'spacing': 1.0, 'thickness': 0.4, 'deterministic': True, 'device': device}
        ground = incline(0.2, 400, 400, 2.0)
        # without parameters for vft it would be as thin as water
        lava = Lava.paper(vft_a=2.0)
        return simulated(ground, lava, vent, effects=chosen[number == 1], **knobs)

    def route(number):
        simulation = begun(number)
        for end in ENDS:
            yield from simulation.advancing(end)
            maps.setdefault(number, []).append(simulation.snapshot())
        ends[number] = simulation

    ends, maps = {}, {}
    Batch().run(route(number) for number in range(3))
    for number in range(3):
        alone = begun(number)
        for end, map_of in zip(ENDS, maps[number], strict=True):
            alone.advance(end)
            expected = alone.snapshot()
            assert map_of.steps == expected.steps
            same(map_of.thickness, expected.thickness)
        same(*(in_order(one.sample().position) for one in (alone, ends[number])))
    assert ends[2].particle_count > 4096 or 'merging' in ends[2].effects


@RUNNERS
def test_tasks_without_a_simulation_end_or_raise(device, run):
    ended = []

    def task(number):
        yield
        if number == 20:
            raise ValueError('here')
        ended.append(number)

    run(map(task, range(20)), device)
    assert sorted(ended) == list(range(20))
    with pytest.raises(ValueError, match='here'):
        run(map(task, (19, 20, 18)), device)


def test_member_that_resumes_reads_the_device_only_after_changes(device, monkeypatch):
    former = simulation_of(20.0, device)
    former.advance(2.0)
    checkpoint = former.checkpoint()
    reads, begin = [], Readback.begin
    monkeypatch.setattr(Readback, 'begin', lambda self: reads.append(self) or begin(self))
    resumed = Simulation.resume(checkpoint, device=device)
    resumed.set_vents([Vent((20.0, 15.0), 10.0, 1400.0, radius=3.0)])
    assert len(reads) <= 3
    # no value of before a change
    before = resumed.time, resumed.steps, resumed.particle_count
    resumed.advance(3.0)
    after = resumed.time, resumed.steps, resumed.particle_count
    assert all(new > old for old, new in zip(before, after, strict=True))
