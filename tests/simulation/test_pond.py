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

from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification.cases.confined import ground_at, LEVEL, pond, rough_bowl, stillness


def test_the_ground_is_the_surface_whose_gradient_is_sampled():
    """At a corner of cells it has the four heights' mean, and the slope of equation 3.21."""
    terrain = rough_bowl()
    elevation, cell = terrain.elevation, terrain.resolution
    corner = np.array(terrain.origin) + np.array([20.0, 30.0]) * cell
    quarter = elevation[29:31, 19:21].mean()
    assert np.allclose(ground_at(terrain, corner[None]), quarter)
    step = 1e-4
    rise = ground_at(terrain, corner[None] + [[step, 0.0]]) - ground_at(
        terrain, corner[None] - [[step, 0.0]]
    )
    slope = np.diff(elevation[29:31, 19:21], axis=1).mean() / cell
    assert np.allclose(rise / (2.0 * step), slope, rtol=1e-6)


def test_pond_comes_to_rest_and_stays_flat(device):
    """The surface stays level within 1 % of the depth while the motion dies away."""
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


def test_energy_never_grows():
    """Sum V (h / 2 + H), whose gradient drives the particles, falls from frame to frame."""
    trial = pond(Accuracy(precision='float64'))
    simulation, terrain = trial.simulation, rough_bowl()

    def energy():
        sample = simulation.sample()
        offset = sample.position[:, None] - sample.position[None]
        q = np.clip(np.linalg.norm(offset, axis=-1) / simulation.radius, 0.0, 1.0)
        weight = 7.0 / np.pi / simulation.radius**2 * (1.0 - q) ** 4 * (1.0 + 4.0 * q)
        height = weight @ sample.volume
        return float(sample.volume @ (0.5 * height + ground_at(terrain, sample.position)))

    energies = [energy()]
    for time in np.geomspace(10.0, 3000.0, 12):
        trial.advance(float(time))
        energies.append(energy())
    drops = -np.diff(energies)
    assert (drops > -1e-9 * abs(energies[0])).all()
    assert drops.sum() > 0.0


def test_the_bowl_is_rough_and_holds_the_pond():
    """Bumps of decimetres, the same in every run, and a rim that is above the surface."""
    terrain = rough_bowl()
    x0, y0, x1, y1 = terrain.extent
    rows, columns = terrain.shape
    x = x0 + (np.arange(columns) + 0.5) * (x1 - x0) / columns
    y = y0 + (np.arange(rows) + 0.5) * (y1 - y0) / rows
    bumps = terrain.elevation - 0.003 * (x[None, :] ** 2 + y[:, None] ** 2)
    assert 0.1 < bumps.std() < 0.3
    assert bumps[0, 0] == rough_bowl().elevation[0, 0] - 0.003 * (x[0] ** 2 + y[0] ** 2)
    outside = np.hypot(x[None, :], y[:, None]) > 40.0
    assert terrain.elevation[outside].min() > LEVEL
