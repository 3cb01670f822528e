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

"""Lava in a rough bowl comes to rest: the scheme has an energy, and it never grows."""

import numpy as np
from scipy.interpolate import RegularGridInterpolator
from scipy.ndimage import gaussian_filter

from lava_ros.accuracy import Accuracy
from lava_ros.effects import Effects
from lava_ros.scene import Lava, Scene, Terrain
from lava_ros.simulation import Particles, Simulation

CELLS, SIDE = 50, 2.0
LEVEL = 3.0


def rough_bowl():
    """A paraboloid with bumps of a few decimetres, and its elevation as a function of (y, x)."""
    x = (np.arange(CELLS) + 0.5 - 0.5 * CELLS) * SIDE
    bumps = gaussian_filter(np.random.default_rng(0).normal(size=(CELLS, CELLS)), 2.0)
    elevation = 0.003 * (x[None, :] ** 2 + x[:, None] ** 2) + bumps
    return elevation, RegularGridInterpolator((x, x), elevation, bounds_error=False)


def pond(device='cpu', precision='float64'):
    """Lava filled into the bowl up to a level, and the elevation under its particles."""
    elevation, height_at = rough_bowl()
    spacing = 2.0
    ticks = np.arange(-40.0, 40.0, spacing) + 0.3
    places = np.stack(np.meshgrid(ticks, ticks), -1).reshape(-1, 2)
    depth = LEVEL - height_at(places[:, ::-1])
    wet = depth > 0.05
    half = 0.5 * CELLS * SIDE
    simulation = Simulation(
        Scene(Terrain(elevation, SIDE, origin=(-half, -half)), lava=Lava(viscosity=1e3)),
        effects=Effects(arrhenius=False, cooling=False, steep=False),
        accuracy=Accuracy(
            spacing=spacing, thickness=float(depth[wet].mean()), precision=precision
        ),
        particles=Particles(places[wet], depth[wet] * spacing**2, 1400.0),
        device=device,
    )
    return simulation, lambda sample: height_at(sample.position[:, ::-1])


def test_pond_comes_to_rest_and_stays_flat(device):
    """The surface stays level within 1 % of the depth while the motion dies away."""
    simulation, ground = pond(device)
    speeds = []
    for time in (10.0, 100.0, 1000.0):
        simulation.advance(time)
        sample = simulation.sample()
        speeds.append(np.linalg.norm(sample.velocity, axis=1).mean())
        surface = sample.thickness + ground(sample)
        deep = sample.thickness > 1.0
        assert surface[deep].std() < 0.01 * sample.thickness.max()
    assert speeds[1] < 0.5 * speeds[0]
    assert speeds[2] < 0.2 * speeds[1]


def test_energy_never_grows():
    """Sum V (h / 2 + H), whose gradient drives the particles, falls from frame to frame."""
    simulation, _ = pond()
    elevation, _ = rough_bowl()
    # the surface whose gradient the solver samples: the quadratic B-spline of the heights
    padded = np.pad(elevation, 2, mode='reflect', reflect_type='odd')

    def ground(position):
        total = np.zeros(len(position))
        place = (position + 0.5 * CELLS * SIDE) / SIDE
        cell = np.floor(place).astype(int)
        t = place - cell - 0.5
        weights = np.stack([0.5 * (0.5 - t) ** 2, 0.75 - t**2, 0.5 * (0.5 + t) ** 2])
        for i in range(3):
            for j in range(3):
                values = padded[cell[:, 1] + 1 + i, cell[:, 0] + 1 + j]
                total += weights[i, :, 1] * weights[j, :, 0] * values
        return total

    def energy():
        sample = simulation.sample()
        offset = sample.position[:, None] - sample.position[None]
        q = np.clip(np.linalg.norm(offset, axis=-1) / simulation.radius, 0.0, 1.0)
        weight = 7.0 / np.pi / simulation.radius**2 * (1.0 - q) ** 4 * (1.0 + 4.0 * q)
        height = weight @ sample.volume
        return float(sample.volume @ (0.5 * height + ground(sample.position)))

    energies = [energy()]
    for time in np.geomspace(1.0, 300.0, 12):
        simulation.advance(float(time))
        energies.append(energy())
    drops = -np.diff(energies)
    assert (drops > -1e-9 * abs(energies[0])).all()
    assert drops.sum() > 0.0
