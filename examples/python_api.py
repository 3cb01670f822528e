# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Simulate one hour of a lava flow in ten lines: python3 python_api.py [TERRAIN]."""

import sys

import numpy as np

from lava_ros.files.resources import share_path
from lava_ros.layers.layer_files import load_layers
from lava_ros.scene import Lava, Scene, Vent
from lava_ros.scene.terrain_files import demo_terrain, load_terrain
from lava_ros.simulation import Simulation

terrain = load_terrain(sys.argv[1]) if len(sys.argv) > 1 else demo_terrain()
row, column = np.unravel_index(np.nanargmax(terrain.elevation), terrain.shape)
summit = np.add(terrain.origin, np.add((column, row), 0.5) * terrain.resolution)
vent = Vent(tuple(summit), discharge=50.0, radius=2.0 * terrain.resolution)
simulation = Simulation(Scene(terrain, (vent,), Lava(viscosity=5e4)))
simulation.advance(3600.0)
snapshot, budget = simulation.snapshot(), simulation.budget()
hazard = load_layers(share_path('msg_configs/default.yaml'))[2].grid_values(snapshot)
print(f'{np.nanmax(snapshot.thickness):.1f} m of lava at most, {budget.flowing:.0f} m3 flow')
print(f'{(hazard == 100).sum() * terrain.resolution**2 / 1e4:.1f} ha are lethal')
