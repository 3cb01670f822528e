# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Several simulations at once."""

import numpy as np
import pytest

from lava_ros.scene import Lava, Vent
from lava_ros.simulation import batch as batch_module
from lava_ros.simulation.batch import Batch, side_by_side
from lava_ros.verification.benchmarks.effects import effect_sets
from solver import incline, simulated

#: Sets of effects of ``lava bench effects`` that go through other kernels, and times of maps [s].
SETS = ('everything with green', 'helmholtz', 'inertia', 'merging', 'conduction', 'solidification')
ENDS = (0.25, 0.5)


def simulation_of(flux, device):
    """Lava on a slope, to the same bits in every run."""
    ground, vent = incline(0.2, 20, 24, 2.0), Vent((12.0, 20.0), flux, 1400.0)
    return simulated(ground, Lava(), vent, device=device, spacing=1.5, deterministic=True)


def route_of(flux, device, ends):
    """Go to 20 s with a stop at 10 s, and leave where the particles are."""
    simulation = simulation_of(flux, device)
    yield from simulation.advancing(10.0)
    yield from simulation.advancing(20.0)
    ends[flux] = simulation.sample().position


def run(routes, device):
    """Take routes to their ends, three of them at a time."""
    Batch(at_once=3).run(routes)


def one_by_one(routes, device):
    """Take routes to their ends as ensembles do: on the CPU one after the other."""
    for _ in side_by_side(routes, device, at_once=3):
        pass


WAYS = pytest.mark.parametrize('run', [run, one_by_one])


@WAYS
def test_together_is_as_one_by_one(device, run):
    """Simulations that run together, some after others, end where each of them ends alone."""
    fluxes, ends = (1.0, 2.0, 3.0, 5.0, 8.0), {}
    run((route_of(flux, device, ends) for flux in fluxes), device)
    assert sorted(ends) == sorted(fluxes)
    for flux in fluxes:
        alone = simulation_of(flux, device)
        alone.advance(10.0)
        alone.advance(20.0)
        assert np.array_equal(alone.sample().position, ends[flux]), flux


@pytest.mark.parametrize(
    'name',
    ['bare', *(pytest.param(name, marks=pytest.mark.nightly) for name in SETS)],
)
def test_members_of_several_kinds_and_sizes(device, name, monkeypatch):
    """A batch keeps a member's bits through maps, growth, a wider grid and other members' ends."""
    if name != 'inertia':
        # as seldom as on a GPU it is looked what is to be done; with inertia, where a step has one
        # stage, the vent would wait for room
        monkeypatch.setitem(batch_module._STAGES, False, batch_module._STAGES[True])
        monkeypatch.setitem(batch_module._UNDER_WAY, False, batch_module._UNDER_WAY[True])
    chosen = (effect_sets()[name], effect_sets()['bare'])

    def begun(number):
        # the third one needs room for more particles
        vent = Vent((400.0, 400.0), (20.0, 60.0, 4000.0)[number], 1400.0)
        knobs = {'spacing': 1.0, 'thickness': 0.4, 'deterministic': True, 'device': device}
        ground = incline(0.2, 400, 400, 2.0)
        # without a number for vft it would be as thin as water
        lava = Lava(vft_a=2.0)
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
            np.testing.assert_array_equal(map_of.thickness, expected.thickness)
        np.testing.assert_array_equal(alone.sample().position, ends[number].sample().position)
    assert ends[2].particle_count > 4096 or 'merging' in ends[2].effects


def test_members_wait_for_each_others_looks(device, monkeypatch):
    """Who waits takes part in stages that change nothing, whatever it has been through before."""
    monkeypatch.setattr(batch_module, '_IDLE', 1.0)
    fluxes, times = (10.0, 15.0, 20.0, 40.0, 60.0), np.linspace(0.5, 6.0, 12)

    def begun(flux):
        knobs = {'spacing': 1.0, 'thickness': 0.4, 'deterministic': True, 'device': device}
        vent = Vent((200.0, 200.0), flux, 1400.0)
        simulation = simulated(incline(0.3, 200, 200, 2.0), Lava(), vent, **knobs)
        return simulation, simulation.looks(0.1, len(times))

    def route(flux):
        simulation, looks = begun(flux)
        for time in times:
            yield from simulation.advancing(time)
            yield from simulation.looking(looks)
        ends[flux] = simulation.budget().held, simulation.seen(looks)

    ends = {}
    Batch().run(map(route, fluxes))
    for flux in fluxes:
        alone, looks = begun(flux)
        for time in times:
            alone.advance(time)
            alone.look(looks)
        held, seen = ends[flux]
        assert held == pytest.approx(alone.budget().held, abs=1e-9)
        for value, expected in zip(seen[1:4], alone.seen(looks)[1:4], strict=True):
            np.testing.assert_allclose(value, expected, rtol=1e-5)


@WAYS
def test_routes_that_simulate_nothing(device, run):
    """Each comes to its end, however many there are."""
    ended = []

    def route(number):
        yield
        ended.append(number)

    run(map(route, range(20)), device)
    assert sorted(ended) == list(range(20))


@WAYS
def test_what_a_route_raises_is_raised(device, run):
    """An error is not lost among the others."""

    def route(error):
        yield
        if error:
            raise ValueError('here')

    with pytest.raises(ValueError, match='here'):
        run((route(error) for error in (False, True, False)), device)
