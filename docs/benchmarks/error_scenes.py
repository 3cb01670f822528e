# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Scenes for numerical_error.py: those of bench_scenes.py, and others with difficult ground."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from bench_scenes import (
    bench_scene,
    BenchScene,
    crater,
    ground,
    PAPER_LAVA,
    plane,
    scenes,
    sum_of_waves,
    Surface,
    VENT,
)
import numpy as np

from lava_ros.scene import Vent
from lava_ros.scene.lava import Lava


def isothermal(viscosity: float, **others: float) -> Lava:
    """Return lava of a constant viscosity [Pa s] that does not cool."""
    return replace(
        PAPER_LAVA, density=2600.0, viscosity=viscosity, arrhenius=0.0, emissivity=0.0,
        convection=0.0, **others,
    )


def error_scenes(finer: int = 1) -> tuple[BenchScene, ...]:
    """Build all scenes, with the ground sampled on cells smaller by a factor ``finer``."""
    on = partial(ground, finer=finer)
    return (
        # fine runs of the gully take hours on a core
        *(item for item in scenes(finer) if item.name != 'gully'),
        # rough ground on cells of three sizes: its shortest waves are 40 m long
        *(
            bench_scene(
                f'rough_{cell:g}m', 2400.0,
                on((-700.0, 100.0), (-300.0, 300.0), cell, _waves(0.08, 2.5, 40.0, 160.0)),
                isothermal(4000.0), Vent(VENT, 15.0, radius=10.0),
            )
            for cell in (5.0, 10.0, 20.0)
        ),
        # ground that is rough at all lengths
        bench_scene(
            'fractal', 2400.0,
            on((-600.0, 100.0), (-250.0, 250.0), 10.0, _fractal(0.1, 1.5)),
            isothermal(4000.0), Vent(VENT, 15.0, radius=10.0),
        ),
        # fluid lava 0.3 m thick
        bench_scene(
            'thin', 900.0, on((-700.0, 100.0), (-200.0, 200.0), 5.0,
                              lambda x, y: 0.1 * x + 0.3 * np.sin(y / 11.0)),
            isothermal(100.0), Vent(VENT, 5.0, radius=8.0),
        ),
        # a stiff dome in a crater
        bench_scene(
            'crater_dome', 25_000.0,
            on((-150.0, 150.0), (-150.0, 150.0), 5.0, crater(110.0, 40.0)),
            isothermal(1e9), Vent((10.3, 5.2), 30.0, radius=10.0),
        ),
        # a slope of 40 degrees
        bench_scene(
            'slope_40', 300.0,
            on((-700.0, 100.0), (-150.0, 150.0), 5.0, plane(0.839)),
            isothermal(8000.0), Vent(VENT, 15.0, radius=10.0),
        ),
        # a V-shaped valley across the cells, about four of them wide
        bench_scene(
            'oblique_valley', 1500.0,
            on((-700.0, 100.0), (-450.0, 150.0), 10.0, _oblique_valley),
            isothermal(3000.0), Vent(VENT, 15.0, radius=8.0),
        ),
    )


def _oblique_valley(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return a valley that falls at 5 degrees, 27 degrees off the rows."""
    along, across = 0.894 * x + 0.447 * y, 0.894 * y - 0.447 * x
    return 0.09 * along + 0.35 * np.abs(across)


def _waves(slope: float, height: float, shortest: float, longest: float) -> Surface:
    """Return a plane that falls towards -x, with waves of a root mean square height [m]."""
    random = np.random.default_rng(7)
    lengths = np.exp(random.uniform(np.log(shortest), np.log(longest), 32))
    return sum_of_waves(slope, lengths, np.full(32, height * np.sqrt(2.0 / 32)), random)


def _fractal(slope: float, height: float) -> Surface:
    """Return a self-affine surface with a Hurst exponent of 0.7, from 6 to 400 m."""
    random = np.random.default_rng(11)
    lengths = np.repeat(np.geomspace(6.0, 400.0, 24), 5)
    heights = lengths**0.7
    heights *= height * np.sqrt(2.0 / (heights**2).sum())
    return sum_of_waves(slope, lengths, heights, random)
