# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Definition of a hard scene, and functions that build scenes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
import math
from typing import Any

import numpy as np

from lava_ros.effects import Effects
from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.scene.lava import Lava
from lava_ros.simulation import Particles, Simulation

#: Sets of effects by name: few, because each is compiled separately in two precisions.
PHYSICS: dict[str, Effects] = {
    'plain': Effects(),
    'level': Effects(steep=False),
    'strong': Effects(yielding=True),
    'inertia': Effects(inertia=True),
    'freezing': Effects(
        cooling=False, crust=True, ground=True, latent_heat=True, solidification=True
    ),
    'lateral': Effects(helmholtz=True),
    'heating': Effects(arrhenius=False, cooling=False, viscous_heating=True),
}
PHYSICS['heating_inertia'] = replace(PHYSICS['heating'], inertia=True)

#: Size of a cell in most scenes [m], and cells along a side.
CELL, SIDE = 5.0, 32

#: Lava that keeps its temperature, for scenes that do not test cooling.
STEADY = Lava.paper(viscosity=1e3, emissivity=0.0, convection=0.0)

Surface = Callable[[np.ndarray, np.ndarray], np.ndarray]

#: Initial lava, as a function of the particle spacing [m].
Lot = Callable[[float], Particles]


@dataclass(frozen=True, eq=False)
class HardScene:
    """A scene that challenges the solver, with a short title.

    Attributes:
        until: Time to simulate [s].
        physics: Name of the effects, a key of ``PHYSICS``; if empty, chosen from the scene.
        frames: Number of evenly spaced times at which the invariants are checked.
        lava: Initial lava.
        thickness: Expected thickness, which sets the volume of a particle [m]; None: automatic.
        events: Changes of the running simulation, by the time [s].
        mirrored: True if scene and events are mirror symmetric in x.
        mirrored_until: Time until which the flow has to be mirror symmetric [s]. Lava that is
            compressed, or runs over an edge, doubles a difference again and again until rounding
            shows: measured, and given where it shows before the end.
        dry: Positions where lava must never be.
        still: True if nothing may move at all.
        distinct: True if no two particles may coincide.
        closed: True if no lava may leave the map.
        most_steps: Maximum number of steps by preset: noise in the speeds increases it.
        reaches: Minimum distance from (0, 0) that lava has reached at the end [m].
        solidified: Maximum fraction of the emitted volume that has solidified at the end.
        since: Time at which the clock starts [s].
        longest_step: Longest step instead of the presets' [s], where theirs would take too long.
        halved: True if a run with steps half as long is compared; False where runs are long, or
            where there is no inundated area to compare.
    """

    name: str
    title: str
    scene: Scene
    until: float
    physics: str = 'plain'
    frames: int = 10
    lava: Lot | None = None
    thickness: float | None = None
    events: Mapping[float, Callable[[Simulation], Any]] = field(default_factory=dict)
    mirrored: bool = False
    mirrored_until: float = math.inf
    dry: Callable[[np.ndarray], np.ndarray] | None = None
    still: bool = False
    distinct: bool = False
    closed: bool = False
    most_steps: Mapping[str, int] = field(default_factory=dict)
    reaches: float = 0.0
    solidified: float = 1.0
    since: float = 0.0
    longest_step: float | None = None
    halved: bool = True


def terrain(
    surface: Surface | None = None, *, cell: float = CELL, side: int = SIDE,
    origin: tuple[float, float] | None = None,
) -> Terrain:
    """Return a square terrain of a surface z(x, y), centred at (0, 0) or at an origin."""
    half = 0.5 * cell * side
    axis = (np.arange(side) + 0.5) * cell - half
    x, y = np.meshgrid(axis, axis)
    height = np.zeros_like(x) if surface is None else surface(x, y) + 0.0 * x
    return Terrain(height, cell, origin or (-half, -half))


def plane(slope: float, *, towards: tuple[float, float] = (0.0, -1.0)) -> Surface:
    """Return a plane that falls in a direction."""
    return lambda x, y: -slope * (towards[0] * x + towards[1] * y)


def block(
    width: float, depth: float, thickness: float, *, centre: tuple[float, float] = (0.0, 0.0),
    temperature: float | Callable[[np.ndarray], np.ndarray] = 1423.0,
) -> Lot:
    """Return lava of uniform thickness on a rectangle, on a lattice symmetric in x.

    Lengths are in metres, ``width`` along x. The temperature is one [K], or a function of the
    positions [m], shape [count, 2].
    """

    def lava(spacing: float) -> Particles:
        columns, rows = (max(1, round(side / spacing)) for side in (width, depth))
        x = ((np.arange(columns) + 0.5) / columns - 0.5) * width + centre[0]
        y = ((np.arange(rows) + 0.5) / rows - 0.5) * depth + centre[1]
        places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        volume = width * depth * thickness / len(places)
        heat = temperature(places) if callable(temperature) else temperature
        return Particles(places, volume, heat)

    return lava


def both(one: Lot, other: Lot) -> Lot:
    """Combine two lots of lava."""

    def lava(spacing: float) -> Particles:
        lots = (one(spacing), other(spacing))
        names = ('position', 'volume', 'temperature')
        return Particles(*(np.concatenate([getattr(lot, name) for lot in lots]) for name in names))

    return lava


def vent(x: float = 0.0, y: float = 0.0, discharge: Any = 5.0, **more: Any) -> Vent:
    """Return a vent as large as one cell."""
    return Vent((x, y), discharge, **{'radius': CELL, **more})


def scene(
    ground: Terrain | Surface | None = None, vents: tuple[Vent, ...] = (), lava: Lava = STEADY,
    **more: Any,
) -> Scene:
    """Return a scene on a terrain, or on the default terrain of a surface."""
    if not isinstance(ground, Terrain):
        ground = terrain(ground)
    return Scene(ground, vents, lava, **more)


def material(**constants: Any) -> Lava:
    """Return lava that keeps its temperature, with some constants replaced."""
    return replace(STEADY, **constants)
