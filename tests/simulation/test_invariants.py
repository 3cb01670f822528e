# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Symmetry, independence of map coordinates, and lava at rest."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.effects import Effects
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Particles, Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.presets import preset_accuracy
from lava_ros.verification.cases.confined import pond, stillness
from solver import incline, only, simulated

SIDE = 40
BUMPS = np.random.default_rng(8).normal(size=(SIDE, SIDE))


def smooth_hills():
    hills = BUMPS
    for _ in range(6):
        hills = 0.2 * (
            hills + sum(np.roll(hills, shift, axis) for shift in (1, -1) for axis in (0, 1))
        )
    return 20.0 * hills


def flow(elevation, places, effects, *, origin=None, time=120.0, **options):
    """Return a blob of lava on a terrain after a while, and its particles."""
    simulation = simulated(
        Terrain(elevation, 5.0, origin=origin or (-2.5 * SIDE,) * 2), Lava.paper(viscosity=2e3),
        Particles(places, 32.0, 1400.0), effects=effects, spacing=4.0, thickness=2.0, **options,
    )
    simulation.advance(time)
    return simulation.snapshot(), simulation.sample()


def check_symmetry(thickness, elevation):
    """Check that mirrored and rotated scenes give mirrored and rotated maps to rounding noise.

    ``thickness`` returns the map of an elevation and of a function that transforms positions.
    """
    plain = thickness(elevation, lambda places: places)
    mirrored = thickness(elevation[:, ::-1], lambda places: places * [-1.0, 1.0])
    # rows run with y: a quarter turn anticlockwise takes (x, y) to (-y, x)
    turned = thickness(np.rot90(elevation, -1), lambda places: places[..., ::-1] * [-1.0, 1.0])
    for other in (mirrored[:, ::-1], np.rot90(turned)):
        assert np.abs(other - plain).max() < 1e-6 * plain.max()


@pytest.mark.parametrize(
    'kind',
    ['local', *(pytest.param(name, marks=pytest.mark.nightly) for name in ('green', 'helmholtz'))],
)
def test_symmetric_scenes_give_symmetric_grids(device, kind):
    effects = Effects(green=kind == 'green', helmholtz=kind == 'helmholtz')
    places = np.random.default_rng(9).uniform(-20.0, 20.0, (100, 2))

    def thickness(elevation, moved):
        begin = moved(places)
        snapshot, sample = flow(
            elevation, begin, effects, time=40.0, precision='float64', device=device
        )
        assert np.linalg.norm(np.sort(sample.position, axis=0) - np.sort(begin, axis=0)) > 20.0
        assert np.linalg.norm(sample.velocity, axis=1).max() > 1e-3
        return snapshot.thickness

    check_symmetry(thickness, smooth_hills())


@pytest.mark.parametrize('kind', ['fissure', pytest.param('disc', marks=pytest.mark.nightly)])
def test_symmetric_vents_give_symmetric_grids(device, kind):
    def thickness(elevation, moved):
        place, end = moved(np.array([[17.0, -9.0], [38.0, 12.0]])).tolist()
        vent = Vent(tuple(place), 0.3, radius=6.0, end=tuple(end) if kind == 'fissure' else None)
        simulation = Simulation(
            Scene(Terrain(elevation, 5.0, (-2.5 * SIDE,) * 2), (vent,), Lava.paper(viscosity=2e3)),
            accuracy=replace(preset_accuracy('reference'), spacing=3.0, thickness=0.5),
            device=device,
        )
        simulation.advance(900.0)
        assert simulation.particle_count >= 32
        grid = simulation.snapshot().thickness
        assert grid.max() > 0.3
        return grid

    check_symmetry(thickness, smooth_hills())


def test_map_coordinates_do_not_matter():
    hills, shift = smooth_hills(), np.array([500_000.0, 4_100_000.0])
    places = np.random.default_rng(9).integers(-40, 40, (400, 2)) + 0.25
    here, _ = flow(hills, places, Effects())
    there, sample = flow(hills, places + shift, Effects(), origin=tuple(shift - 2.5 * SIDE))
    assert np.array_equal(here.thickness, there.thickness)
    assert np.abs(sample.position.mean(axis=0) - shift).max() < 100.0


@pytest.mark.parametrize('speed', [1e-1, 1e-4])
def test_sheet_far_from_the_centre_keeps_its_speed(speed):
    """10 km from the centre, float32 resolves 1 mm; slow lava still moves correctly."""
    slope = 0.1
    terrain = incline(slope, 60, 2000, 10.0, origin=(-10_000.0, -300.0))
    places = np.stack(np.meshgrid(np.arange(9000.0, 9600.0, 10.0), np.arange(-200.0, 200.0, 10.0)))
    places = places.reshape(2, -1).T
    viscosity = 2500.0 * 9.81 * slope / (3.0 * speed)
    simulation = simulated(
        terrain,
        Lava.paper(viscosity=viscosity, arrhenius=0.0),
        # a different temperature identifies each particle
        Particles(places, 100.0, 1000.0 + np.arange(len(places))),
        effects=only(),
        spacing=10.0,
        thickness=1.0,
        longest_step=1.0,
    )

    def in_first_order():
        sample = simulation.sample()
        return sample.position[np.argsort(sample.temperature)]

    before = in_first_order()
    simulation.advance(100.0)
    moved = in_first_order() - before
    middle = (np.abs(before - [9300.0, 0.0]) < 100.0).all(axis=1)
    assert moved[middle, 0].mean() == pytest.approx(100.0 * speed, rel=0.1)


def test_pond_comes_to_rest_and_stays_flat(device):
    trial = pond(Accuracy(precision='float64'), device)
    means = []
    for time in (60.0, 600.0, 6000.0):
        trial.advance(time)
        sample = trial.simulation.sample()
        means.append(np.linalg.norm(sample.velocity, axis=1).mean())
        speed, flatness = stillness(trial)
        assert speed.measured >= means[-1]
        assert flatness.error < 0.01
    assert means[1] < 0.5 * means[0]
    assert means[2] < 0.2 * means[1]

