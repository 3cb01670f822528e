# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Simulations for tests: terrains, lattices of particles, and a flow in one call."""

from typing import Any

import numpy as np

from lava_ros.effects import EFFECTS, Effects
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Particles, Simulation
from lava_ros.simulation.accuracy import Accuracy

#: Fields of a scene that `simulated` accepts.
AROUND = ('ambient_temperature', 'gravity', *(
    name for effect in EFFECTS.values() for name in effect.environment
))


def only(*names: str) -> Effects:
    """Return effects with these names on and all others off."""
    return Effects(**{name: name in names for name in EFFECTS})


def flat(cells: int, cell: float = 1.0) -> Terrain:
    """Return level ground centred on (0, 0)."""
    return incline(0.0, cells, cells, cell, origin=(-0.5 * cell * cells,) * 2)


def incline(
    slope: float, rows: int, columns: int, cell: float, *, top: float = 0.0, **options: Any
) -> Terrain:
    """Return a plane that falls from ``top`` [m] towards +x."""
    return Terrain(np.tile(top - slope * cell * np.arange(columns), (rows, 1)), cell, **options)


def lattice(half: float, spacing: float = 1.0) -> np.ndarray:
    """Return positions on a square around (0, 0), shape [count, 2]."""
    ticks = np.arange(-half, half, spacing) + 0.5 * spacing
    return np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)


def simulated(
    ground: Terrain, lava: Lava, *on_it: Particles | Vent, effects: Any = None,
    device: str = 'cpu', **knobs: Any,
) -> Simulation:
    """Return a simulation of vents and particles.

    Further keywords are fields of ``Scene`` (``AROUND``) or of ``Accuracy``.
    """
    vents = tuple(item for item in on_it if isinstance(item, Vent))
    around = {name: knobs.pop(name) for name in AROUND if name in knobs}
    return Simulation(
        Scene(ground, vents, lava, **around), effects=effects, accuracy=Accuracy(**knobs),
        device=device,
        particles=next((item for item in on_it if isinstance(item, Particles)), None),
    )
