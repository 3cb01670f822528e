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

"""Cases that run the solver where an exact solution is known."""

from dataclasses import dataclass, replace
import math

import numpy as np

from lava_ros.accuracy import Accuracy
from lava_ros.effects import Effects
from lava_ros.scene import Lava, Scene, Terrain
from lava_ros.simulation import Particles, Simulation
from lava_ros.verification import exact

#: Isothermal lava: nothing but weight and viscosity.
ISOTHERMAL = Lava(density=2600.0, viscosity=1e4, arrhenius=0.0, emissivity=0.0, convection=0.0)

GRAVITY = 9.81


@dataclass(frozen=True)
class Comparison:
    """A measured number beside the exact one, in the same unit."""

    measured: float
    exact: float

    @property
    def error(self) -> float:
        """Relative difference."""
        return abs(self.measured / self.exact - 1.0)


def _lattice(side: float, spacing: float) -> np.ndarray:
    """Points of a square lattice that fill a square around the origin, shape [count, 2]."""
    count = int(side / spacing)
    ticks = (np.arange(count) - 0.5 * (count - 1)) * spacing
    return np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)


def sheet_on_slope(slope: float, *, accuracy: Accuracy, device: str = 'cpu') -> Comparison:
    """Speed along the slope of the middle of a uniform sheet, over its first metres [m/s].

    Args:
        slope: Angle of the slope [rad].
        accuracy: Resolution; its spacing and thickness are set by the case.
        device: Warp device.
    """
    spacing, thickness, side = 2.0, 1.0, 120.0
    ticks = np.linspace(-2.0 * side, 2.0 * side, 97)[:-1] + 2.5
    terrain = Terrain(
        np.tile(-math.tan(slope) * ticks, (96, 1)), 5.0, origin=(-2.0 * side, -2.0 * side)
    )
    places = _lattice(side, spacing)
    simulation = Simulation(
        Scene(terrain, lava=ISOTHERMAL, gravity=GRAVITY),
        effects=Effects(arrhenius=False, cooling=False),
        accuracy=replace(accuracy, spacing=spacing, thickness=thickness),
        particles=Particles(places, thickness * spacing**2, 1400.0),
        device=device,
    )
    before = simulation.sample()
    middle = np.abs(before.position).max(axis=1) < 0.2 * side
    duration = 4.0
    simulation.advance(duration)
    after = simulation.sample()
    moved = np.abs(after.position - [1.0 * duration * 0.0, 0.0]).max(axis=1) < 0.2 * side
    speed = 0.5 * (before.velocity[middle, 0].mean() + after.velocity[moved, 0].mean())
    return Comparison(
        measured=speed / math.cos(slope),
        exact=exact.sheet_velocity(
            thickness * math.cos(slope),
            slope,
            density=ISOTHERMAL.density,
            viscosity=ISOTHERMAL.viscosity,
            gravity=GRAVITY,
        ),
    )


def green_response(
    wavelength: float, *, support: float, accuracy: Accuracy, device: str = 'cpu'
) -> Comparison:
    """Amplitude of the Green velocity over the local one on a terrain A sin(q x).

    Args:
        wavelength: 2 pi / q [m], for a layer 1 m thick.
        support: Radius at which the Green's function is cut off, in units of 1 / k.
        accuracy: Resolution; its spacing and thickness are set by the case.
        device: Warp device.
    """
    thickness = 1.0
    k = math.sqrt(3.0) / thickness
    radius = support / k
    spacing = radius / accuracy.ratio
    side = 2.0 * wavelength + 4.0 * radius
    q = 2.0 * math.pi / wavelength
    cell = min(spacing, wavelength / 40.0)
    count = int(1.2 * side / cell)
    ticks = (np.arange(count) - 0.5 * (count - 1)) * cell
    terrain = Terrain(
        np.tile(0.01 * np.sin(q * ticks), (count, 1)), cell, origin=(-0.5 * count * cell,) * 2
    )
    speeds = []
    for green in (True, False):
        simulation = Simulation(
            Scene(terrain, lava=ISOTHERMAL, gravity=GRAVITY),
            effects=Effects(green=green, arrhenius=False, cooling=False, steep=False),
            accuracy=replace(accuracy, spacing=spacing, thickness=thickness),
            particles=Particles(_lattice(side, spacing), thickness * spacing**2, 1400.0),
            device=device,
        )
        sample = simulation.sample()
        inside = (np.abs(sample.position[:, 0]) <= wavelength) & (
            np.abs(sample.position[:, 1]) < 0.5 * side - 2.0 * radius
        )
        wave = np.cos(q * sample.position[inside, 0])
        speeds.append(float(sample.velocity[inside, 0] @ wave / (wave @ wave)))
    return Comparison(speeds[0] / speeds[1], exact.green_response(q, thickness))


@dataclass(frozen=True)
class Spread:
    """What a spreading fixed volume shows: radius, and the mean error of the profile."""

    radius: Comparison
    profile_error: float
    scatter: float
    steps: int
    evaluations: int


def spread_of_fixed_volume(
    count: int,
    *,
    accuracy: Accuracy,
    effects: Effects | None = None,
    growth: float = 1.3,
    device: str = 'cpu',
) -> Spread:
    """Let a fixed volume on a plane spread until its radius has grown by a factor (Huppert 1982).

    The radius is the volume-weighted root mean square, the profile error the mean of |h - exact|
    over the mean thickness at the particles, and the scatter the relative standard deviation of
    h / exact inside 0.3 R.

    Args:
        count: Number of particles.
        accuracy: Resolution; its spacing and thickness are set by the case.
        effects: Physics; the local balance alone when left out.
        growth: Final radius over first.
        device: Warp device.
    """
    volume, first_radius = 1e5, 100.0
    solution = exact.FixedVolumeSpread(
        volume, ISOTHERMAL.viscosity / ISOTHERMAL.density, GRAVITY
    )
    start = solution.time_of_radius(first_radius)
    end = start * growth**8
    area = math.pi * solution.radius(end) ** 2
    side = 3.0 * solution.radius(end)
    cells = 40
    simulation = Simulation(
        Scene(
            Terrain(np.zeros((cells, cells)), side / cells, origin=(-0.5 * side,) * 2),
            lava=ISOTHERMAL,
            gravity=GRAVITY,
        ),
        effects=effects or Effects(arrhenius=False, cooling=False, steep=False),
        accuracy=replace(accuracy, spacing=math.sqrt(area / count), thickness=volume / area),
        particles=Particles(solution.particles(count, start), volume / count, 1400.0),
        device=device,
    )
    simulation.advance(end - start)
    sample = simulation.sample()
    distance = np.hypot(*sample.position.T)
    expected = solution.thickness(distance, end)
    inner = distance < 0.3 * solution.radius(end)
    return Spread(
        radius=Comparison(
            math.sqrt(np.average(distance**2, weights=sample.volume)), solution.rms_radius(end)
        ),
        profile_error=float(np.abs(sample.thickness - expected).mean() / expected.mean()),
        scatter=float((sample.thickness[inner] / expected[inner]).std()),
        steps=simulation.snapshot().steps.count,
        evaluations=simulation.snapshot().steps.evaluations,
    )
