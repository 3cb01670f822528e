# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Small scenes that require different effects, for choice.py and plan.py.

Every material has more constants than its scene requires: an effect is omitted by its number, not
because the material lacks it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.scene.lava import Lava

Surface = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class BenchScene:
    """A scene to run.

    Attributes:
        name: Its name.
        scene: Terrain, vents and lava.
        horizon: Assumed horizon for choosing the effects [s].
        duration: Simulated time [s].
    """

    name: str
    scene: Scene
    horizon: float
    duration: float


#: The lava of the paper; the version before, in equal_error.py, has it as the default.
PAPER_LAVA: Lava = getattr(Lava, 'paper', Lava)()


def _lava(usual: Lava | None = None, **constants: Any) -> Lava:
    """Return a lava, or a variant of the ``usual`` one, with those constants that exist."""
    return replace(usual or PAPER_LAVA, **{
        name: value for name, value in constants.items() if hasattr(Lava, name)
    })


#: Table 3.1 of the paper, with heat conduction into the ground and from column to column.
FLUID = _lava(conductivity=1.5, ground_conductivity=2.0)

#: A natural basalt: stiffens tenfold in 58 K, has hardly any strength, solidifies.
BASALT = _lava(
    density=2600.0, viscosity=1000.0, arrhenius=0.04, yield_strength=5.0, solidus=1223.0,
    latent_heat=3.5e5, conductivity=1.5, ground_conductivity=2.0,
)

#: The viscosity of the melt by temperature (2300 Pa s at 1423 K), that of its crystals on top.
MELT = _lava(
    density=2600.0, vft_a=-4.55, vft_b=6500.0, vft_c=600.0, solidus=1223.0,
    crystal_law='einstein-roscoe', crystals=0.5, latent_heat=3.5e5, conductivity=1.5,
    ground_conductivity=2.0,
)


#: Position of most vents, off the lattice of the cells [m].
VENT = (0.3, 0.2)


def scenes(finer: int = 1) -> tuple[BenchScene, ...]:
    """Build the scenes, with the ground sampled on cells smaller by a factor ``finer``."""
    on = partial(ground, finer=finer)
    return (
        # fluid lava on a plain
        bench_scene('plain', 1000.0, on((-200.0, 200.0), (-200.0, 200.0), 4.0, plane(0.0)),
                    FLUID, Vent(VENT, 20.0)),
        # basalt on a slope of 3 degrees that radiates and stiffens
        bench_scene('gentle_slope', 2400.0,
                    on((-300.0, 100.0), (-200.0, 200.0), 3.2, plane(0.052)), BASALT,
                    Vent(VENT, 10.0)),
        # melt with crystals down a valley with sides of 22 degrees
        bench_scene('valley', 1200.0,
                    on((-1200.0, 100.0), (-100.0, 100.0), 3.0, valley(0.14, 0.4)), MELT,
                    Vent(VENT, 20.0)),
        # basalt on the crest of a ridge with flanks of 11 degrees
        bench_scene('ridge', 1200.0,
                    on((-400.0, 400.0), (-200.0, 200.0), 3.0, _ridge(0.2, 30.0)),
                    _lava(BASALT, viscosity=5000.0), Vent(VENT, 20.0)),
        # lava that thins under shear on rough ground
        bench_scene(
            'rough', 1800.0, on((-350.0, 100.0), (-200.0, 200.0), 3.2, _rough(0.08, 1.5)),
            _lava(BASALT, viscosity=4000.0, flow_index=0.8, arrhenius=0.02), Vent(VENT, 15.0),
        ),
        # fluid lava that fills a crater
        bench_scene('crater', 600.0,
                    on((-120.0, 120.0), (-120.0, 120.0), 3.0, crater(100.0, 15.0)), FLUID,
                    Vent((60.3, 0.2), 30.0)),
        # fluid lava down a slope of 8 degrees
        bench_scene('fast', 400.0, on((-900.0, 100.0), (-150.0, 150.0), 2.2, plane(0.14)),
                    FLUID, Vent(VENT, 20.0)),
        # stiff, thick lava above its liquidus, finely resolved
        bench_scene('dome', 600.0, on((-100.0, 60.0), (-80.0, 80.0), 2.0, plane(0.1)),
                    _lava(MELT, vft_b=0.0, viscosity=1e6, liquidus=1400.0), Vent(VENT, 50.0)),
        # lava with a strong crust, and a strength that grows as it cools, on a slope of 6 degrees
        bench_scene('strong', 3600.0, on((-400.0, 100.0), (-200.0, 200.0), 4.0, plane(0.105)),
                    _lava(BASALT, viscosity=1e4, yield_strength=500.0, yield_rate=0.02,
                          crust_strength=1e5),
                    Vent(VENT, 15.0)),
        # a toe with a crust that freezes
        bench_scene('lobe', 45000.0, on((-20.0, 12.0), (-16.0, 16.0), 0.4, plane(0.05)),
                    _lava(BASALT, viscosity=1e4, conductivity=5.0, crust=True),
                    Vent((0.03, 0.02), 0.002, radius=0.4)),
        # a fissure and two vents on rough ground
        bench_scene('fissure', 1200.0,
                    on((-350.0, 100.0), (-250.0, 250.0), 3.0, _rough(0.06, 1.0)),
                    _lava(BASALT, viscosity=3000.0),
                    Vent((0.3, -80.2), 15.0, end=(20.3, 80.2), radius=5.0),
                    Vent((40.3, 120.2), 8.0), Vent((-120.3, -90.2), 5.0, temperature=1400.0)),
        # basalt down 2000 m at 27 degrees
        bench_scene('mountain', 1500.0,
                    on((-4000.0, 200.0), (-200.0, 200.0), 4.5, valley(0.5, 0.1)),
                    _lava(BASALT, viscosity=5000.0, crust_cover=0.9, crust_cover_decay=0.16),
                    Vent(VENT, 60.0)),
        # weak lava down a gully of 0.9 degrees between walls of 35
        bench_scene('gully', 2400.0,
                    on((-500.0, 60.0), (-90.0, 90.0), 5.0, _gully(0.016, 0.7, 16.0)),
                    _lava(BASALT, viscosity=4000.0, arrhenius=0.02, yield_strength=8.0),
                    Vent(VENT, 12.0, radius=10.0)),
        # a discharge that falls, and lava that freezes where it comes to rest
        bench_scene('fading', 14400.0,
                    on((-400.0, 80.0), (-160.0, 160.0), 4.0, plane(0.08)),
                    _lava(BASALT, arrhenius=0.03, solidus=1300.0),
                    Vent(VENT, ((0.0, 10.0), (900.0, 4.0), (2400.0, 1.0), (4800.0, 0.0)))),
        # lava on a slope of 30 degrees in wind
        bench_scene('steep_slope', 240.0,
                    on((-600.0, 60.0), (-80.0, 80.0), 3.0, plane(0.577)),
                    _lava(BASALT, viscosity=8000.0, crust_strength=1e3), Vent(VENT, 10.0),
                    wind_speed=3.0),
        # two streams that flow twelve times longer than was assumed
        bench_scene('longer', 600.0,
                    on((-400.0, 80.0), (-160.0, 160.0), 4.0, _rough(0.05, 0.5)),
                    _lava(BASALT, viscosity=3000.0, arrhenius=0.01, yield_rate=0.01),
                    Vent((0.3, -60.2), 1.5), Vent((20.3, 60.2), 0.8), duration=7200.0),
    )


def bench_scene(
    name: str, horizon: float, terrain: Terrain, lava: Lava, *vents: Vent,
    duration: float | None = None, wind_speed: float = 0.0,
) -> BenchScene:
    """Build a scene; it is simulated for its horizon [s] or another ``duration`` [s]."""
    scene = Scene(terrain, vents, lava, wind_speed=wind_speed)
    return BenchScene(name, scene, horizon, horizon if duration is None else duration)


def ground(
    x_range: tuple[float, float], y_range: tuple[float, float], resolution: float,
    surface: Surface, *, finer: int = 1,
) -> Terrain:
    """Return the terrain of a surface z(x, y) over a rectangle [m].

    Args:
        x_range: Extent along x [m].
        y_range: Extent along y [m].
        resolution: Side of a cell [m].
        surface: The surface.
        finer: Number of smaller cells, along a side, in place of each cell.
    """
    x, y = (
        first + (np.arange(finer * len(np.arange(first + 0.5 * resolution, last, resolution)))
                 + 0.5) * resolution / finer
        for first, last in (x_range, y_range)
    )
    height = surface(*np.meshgrid(x, y))
    return Terrain(height, resolution / finer, (x_range[0], y_range[0]))


def plane(slope: float) -> Surface:
    """Return a plane that falls towards -x."""
    return lambda x, y: slope * x + 0.0 * y


def valley(slope: float, sides: float) -> Surface:
    """Return a valley that falls towards -x, with a rounded floor of 10 m."""
    return lambda x, y: slope * x + sides * np.hypot(y, 10.0)


def _gully(slope: float, walls: float, width: float) -> Surface:
    """Return a gully that falls towards -x, level across, with walls that have smooth feet."""

    def surface(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        beyond = np.abs(y) - 0.5 * width
        return slope * x + 0.5 * walls * (np.hypot(beyond, 2.0) + beyond)

    return surface


def _ridge(flanks: float, radius: float) -> Surface:
    """Return a ridge along y with a radius of the crest [m]."""
    return lambda x, y: -flanks * np.hypot(x, radius) + 0.0 * y


def crater(radius: float, depth: float) -> Surface:
    """Return a bowl with a rim, level outside."""
    return lambda x, y: depth * np.minimum((x**2 + y**2) / radius**2, 1.0)


def _rough(slope: float, height: float) -> Surface:
    """Return a plane that falls towards -x, with bumps of a root mean square height [m]."""
    random = np.random.default_rng(1)
    lengths = random.uniform(30.0, 120.0, 24)
    return sum_of_waves(slope, lengths, np.full(24, height * np.sqrt(2.0 / 24)), random)


def sum_of_waves(
    slope: float, lengths: np.ndarray, heights: np.ndarray, random: np.random.Generator
) -> Surface:
    """Return a plane that falls towards -x, with waves of random directions and phases.

    Args:
        slope: Slope of the plane.
        lengths: Length of each wave [m].
        heights: Amplitude of each wave [m].
        random: Source of the directions and phases.
    """
    angles, phases = random.uniform(0.0, 2.0 * np.pi, (2, len(lengths)))

    def surface(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        total = slope * x
        for length, height, angle, phase in zip(lengths, heights, angles, phases, strict=True):
            along = np.cos(angle) * x + np.sin(angle) * y
            total = total + height * np.sin(2.0 * np.pi * along / length + phase)
        return total

    return surface
