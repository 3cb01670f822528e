# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Cells on a GPU: the same flow as on a CPU, alone and as members of a batch."""

from dataclasses import replace
import math

import numpy as np
import pytest
import warp as wp

from lava_ros.effects import EFFECTS
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.events import TerrainEvent
from lava_ros.simulation import Particles, Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.batch import side_by_side

pytestmark = pytest.mark.skipif(not wp.is_cuda_available(), reason='needs a GPU')

LAVA = Lava(viscosity=1e4, density=2600.0, yield_strength=200.0)

#: Effects by name: isothermal, and those of a flow that cools, stiffens and freezes.
SETS = {
    'isothermal': ['steep'],
    'yielding': ['steep', 'yielding'],
    'cooling': ['steep', 'yielding', 'arrhenius', 'cooling', 'viscous_heating', 'solidification'],
    'crust': ['steep', 'arrhenius', 'cooling', 'crust_strength', 'conduction'],
    'insulated': ['steep', 'arrhenius', 'insulation'],
    'stressed': ['steep', 'helmholtz'],
}


def slope(cells=80, cell=5.0, step=0.0):
    """Return a rough plane around (0, 0), with a sea at its foot."""
    half = 0.5 * cells * cell
    line = np.arange(-half + 0.5 * cell, half, cell)
    x, y = np.meshgrid(line, line)
    ground = 40.0 - 0.15 * x + np.sin(x / 17.0) * np.cos(y / 13.0) + step * (x > 60.0)
    return Terrain(ground, cell, origin=(-half, -half), sea_level=15.0)


def simulated(device, names, *, lava=LAVA, discharge=10.0, particles=None, events=()):
    """Return a simulation on cells."""
    scene = Scene(slope(), (Vent((-120.0, 3.0), discharge),), lava, events=events)
    effects = {name: name in names for name in EFFECTS}
    return Simulation(
        scene, effects=effects, particles=particles, accuracy=Accuracy(method='cells'),
        device=device, horizon=3600.0,
    )


def check_equal(found, expected, *, tolerance=2e-3):
    """Check that two snapshots agree within the rounding of float32 in many steps."""
    assert found.time == expected.time
    volume = np.nansum(expected.thickness)
    assert np.nansum(np.abs(found.thickness - expected.thickness)) < tolerance * volume
    wet = (expected.thickness > 0.1) & (found.thickness > 0.1)
    assert wet.any()
    difference = np.abs(found.temperature - expected.temperature)[wet]
    assert np.nanmean(difference) < 0.5
    # in a cell that lava has only touched, rounding may decide
    assert (np.isfinite(found.arrived) != np.isfinite(expected.arrived)).sum() <= 4
    np.testing.assert_array_equal(np.isnan(found.thickness), np.isnan(expected.thickness))
    assert found.budget.lost == pytest.approx(expected.budget.lost, rel=0.01, abs=1e-6)
    assert found.budget.solidified == pytest.approx(expected.budget.solidified, rel=0.01, abs=1e-6)


@pytest.mark.parametrize('names', SETS.values(), ids=SETS)
def test_flow_on_a_gpu_is_that_on_a_cpu(names):
    ends = []
    for device in ('cpu', 'cuda:0'):
        simulation = simulated(device, names)
        assert not any(np.isfinite(simulation.snapshot().arrived[:, 60:]).ravel())
        for until in (100.0, 600.0, 1500.0):
            simulation.advance(until)
        sample = simulation.sample()
        assert len(sample.volume) == simulation.particle_count
        ends.append(simulation.snapshot())
    check_equal(ends[1], ends[0])


def test_changes_and_restarts_on_a_gpu_are_those_on_a_cpu(tmp_path):
    raised = TerrainEvent(200.0, 'a wall', terrain=slope(step=3.0))
    places = np.random.default_rng(3).uniform(-50.0, 50.0, (500, 2))
    ends = []
    for device in ('cpu', 'cuda:0'):
        simulation = simulated(
            device, SETS['cooling'], events=(raised,), particles=Particles(places, 7.0, 1250.0)
        )
        simulation.advance(300.0)
        simulation.set_vents([Vent((-100.0, 40.0), 5.0)])
        simulation.advance(500.0)
        smaller = slope()
        part = Terrain(
            smaller.elevation[10:70, 4:] + 1.0, 5.0, origin=(-180.0, -150.0), sea_level=15.0
        )
        simulation.set_terrain(part)
        simulation.advance(700.0)
        resumed = Simulation.resume(simulation.checkpoint(), device=device)
        for one in (simulation, resumed):
            one.advance(1000.0)
        np.testing.assert_array_equal(
            resumed.snapshot().thickness, simulation.snapshot().thickness
        )
        ends.append(resumed.snapshot())
    check_equal(ends[1], ends[0])


def test_members_of_a_batch_are_those_alone():
    def member(index, device='cuda:0'):
        lava = replace(LAVA, viscosity=1e4 * 2.0 ** (index % 3))
        names = SETS['cooling'] if index % 2 else SETS['isothermal']
        return simulated(device, names, lava=lava, discharge=5.0 + index)

    found = {}

    def route(index):
        simulation = member(index)
        peaks = simulation.start_peaks(simulation.accuracy.inundation_threshold)
        for until in (200.0, 500.0 + 10.0 * index):
            yield from simulation.advancing(until)
            if index % 3 == 0:
                # launches of its own, while others are in flight
                assert len(simulation.sample().volume) == simulation.particle_count
                assert simulation.budget().is_conserved
        yield from simulation.observing(peaks)
        found[index] = simulation.snapshot(), simulation.read_peaks(peaks)

    for _ in side_by_side(map(route, range(7)), 'cuda:0', at_once=4):
        pass
    for index, (snapshot, peaks) in found.items():
        alone = member(index)
        own = alone.start_peaks(alone.accuracy.inundation_threshold)
        for until in (200.0, 500.0 + 10.0 * index):
            alone.advance(until)
        # a world alone has more blocks, which changes no sum but those of what has left
        np.testing.assert_array_equal(snapshot.thickness, alone.snapshot().thickness)
        np.testing.assert_array_equal(peaks.arrival, alone.read_peaks(own).arrival)
        assert np.nanmax(peaks.thickness) >= np.nanmax(snapshot.thickness) * (1.0 - 1e-6)


def test_steps_on_a_gpu_wait_for_their_end():
    simulation = simulated('cuda:0', SETS['isothermal'])
    reached = simulation.advance(333.0, whole_steps=True)
    assert reached <= 333.0 < reached + simulation.step
    assert simulation.advance(math.nextafter(333.0, 0.0), wall_limit=1e-3) <= 333.0
