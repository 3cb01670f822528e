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

"""The solver prefers no direction and no place on a large map."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.effects import Effects
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Particles, Simulation
from lava_ros.simulation.presets import preset_accuracy
from solver import incline, only, simulated

SIDE = 40
BUMPS = np.random.default_rng(8).normal(size=(SIDE, SIDE))


def smooth_hills():
    """Gentle bumps on cells of 5 m, shape [SIDE, SIDE]."""
    hills = BUMPS
    for _ in range(6):
        hills = 0.2 * (
            hills + sum(np.roll(hills, shift, axis) for shift in (1, -1) for axis in (0, 1))
        )
    return 20.0 * hills


def flow(elevation, places, effects, *, origin=None, time=120.0, **options):
    """A blob of lava on a terrain after a while, and its particles."""
    simulation = simulated(
        Terrain(elevation, 5.0, origin=origin or (-2.5 * SIDE,) * 2),
        Lava(viscosity=2e3),
        Particles(places, 32.0, 1400.0),
        effects=effects,
        spacing=4.0,
        thickness=2.0,
        **options,
    )
    simulation.advance(time)
    return simulation.snapshot(), simulation.sample()


@pytest.mark.parametrize('kind', ['local', 'green', 'helmholtz'])
def test_mirrored_and_rotated_scenes_give_mirrored_and_rotated_grids(device, kind):
    """At double precision the grids agree to rounding noise, whatever the lateral stress."""
    effects = Effects(green=kind == 'green', helmholtz=kind == 'helmholtz')
    hills = smooth_hills()
    places = np.random.default_rng(9).uniform(-20.0, 20.0, (100, 2))
    options = {'time': 40.0, 'precision': 'float64', 'device': device}
    plain, sample = flow(hills, places, effects, **options)
    assert np.linalg.norm(sample.velocity, axis=1).max() > 1e-3
    mirrored, _ = flow(hills[:, ::-1], places * [-1.0, 1.0], effects, **options)
    # rows run with y: a quarter turn anticlockwise takes (x, y) to (-y, x)
    turned, _ = flow(
        np.rot90(hills, -1),
        np.stack([-places[:, 1], places[:, 0]], axis=1),
        effects,
        **options,
    )
    # it has gone on its way
    assert np.linalg.norm(np.sort(sample.position, axis=0) - np.sort(places, axis=0)) > 20.0
    scale = plain.thickness.max()
    assert np.abs(mirrored.thickness[:, ::-1] - plain.thickness).max() < 1e-6 * scale
    assert np.abs(np.rot90(turned.thickness) - plain.thickness).max() < 1e-6 * scale


@pytest.mark.parametrize('kind', ['disc', 'fissure'])
def test_mirrored_and_rotated_vents_give_mirrored_and_rotated_grids(device, kind):
    """At the reference preset's knobs a vent's particles have the symmetries of the grid."""
    hills = smooth_hills()

    def eruption(elevation, transform):
        place, end = transform(np.array([17.0, -9.0])), transform(np.array([38.0, 12.0]))
        vent = Vent(tuple(place), 0.3, radius=6.0, end=tuple(end) if kind == 'fissure' else None)
        simulation = Simulation(
            Scene(Terrain(elevation, 5.0, (-2.5 * SIDE,) * 2), (vent,), Lava(viscosity=2e3)),
            accuracy=replace(preset_accuracy('reference'), spacing=3.0, thickness=0.5),
            device=device,
        )
        simulation.advance(900.0)
        assert simulation.particle_count >= 32
        return simulation.snapshot().thickness

    plain = eruption(hills, lambda place: place)
    mirrored = eruption(hills[:, ::-1], lambda place: place * [-1.0, 1.0])
    turned = eruption(np.rot90(hills, -1), lambda place: np.array([-place[1], place[0]]))
    assert plain.max() > 0.3
    assert np.abs(mirrored[:, ::-1] - plain).max() < 1e-6 * plain.max()
    assert np.abs(np.rot90(turned) - plain).max() < 1e-6 * plain.max()


def test_map_coordinates_do_not_matter():
    """Far from the map's origin the same flow comes out to the bit of the relative positions."""
    hills = smooth_hills()
    places = np.random.default_rng(9).integers(-40, 40, (400, 2)) + 0.25
    effects = Effects()
    here, _ = flow(hills, places, effects)
    shift = np.array([500_000.0, 4_100_000.0])
    there, sample = flow(hills, places + shift, effects, origin=tuple(shift - 2.5 * SIDE))
    assert np.array_equal(here.thickness, there.thickness)
    assert np.abs(sample.position.mean(axis=0) - shift).max() < 100.0


@pytest.mark.parametrize('speed', [1e-1, 1e-4])
def test_a_sheet_far_out_on_a_20_km_map_keeps_its_speed(speed):
    """10 km from the centre, where a float32 holds millimetres, slow lava still moves right."""
    slope = 0.1
    terrain = incline(slope, 60, 2000, 10.0, origin=(-10_000.0, -300.0))
    places = np.stack(np.meshgrid(np.arange(9000.0, 9600.0, 10.0), np.arange(-200.0, 200.0, 10.0)))
    places = places.reshape(2, -1).T
    viscosity = 2500.0 * 9.81 * slope / (3.0 * speed)
    simulation = simulated(
        terrain,
        Lava(viscosity=viscosity, arrhenius=0.0),
        # a temperature of its own tells each particle from the others
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
