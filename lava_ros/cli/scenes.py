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

"""The scene that a command's arguments name, and the one there is without them."""

from __future__ import annotations

import argparse
from dataclasses import replace
import math

import numpy as np

from lava_ros.finer import finer
from lava_ros.presets import DEFAULT, preset_accuracy
from lava_ros.resolution import resolution_of
from lava_ros.scene import Lava, Scene, scene_from_yaml, Terrain, Vent
from lava_ros.terrain_files import demo_terrain, load_terrain

#: Vents of the demo, (x, y) [m] and discharge [m3/s]: along the crest above a deep valley.
DEMO_VENTS = (
    (4080.0, 5330.0, 25.0),
    (4110.0, 5580.0, 40.0),
    (4010.0, 6150.0, 40.0),
    (4000.0, 6450.0, 25.0),
)

#: Basalt with some crystals in it: it forms tongues of a few metres.
DEMO_LAVA = Lava(viscosity=5e4)

#: Discharge of the single vent on a terrain that comes without [m3/s].
SUMMIT_DISCHARGE = 50.0

#: Largest radius of that vent [m].
SUMMIT_RADIUS = 20.0

#: Side of the cells of maps over the spacing of particles, and most cells after a division.
CELL, MOST_CELLS = 3.0, 1_000_000


def add_scene_arguments(parser: argparse.ArgumentParser, *, positional: bool = False) -> None:
    """Add the arguments that choose a scene, the scene file itself without a flag if asked."""
    text = 'scene file (YAML): terrain, vents and lava'
    if positional:
        parser.add_argument('scene', nargs='?', metavar='SCENE', help=text)
    else:
        parser.add_argument('--scene', metavar='FILE', help=text)
    parser.add_argument(
        '--terrain',
        metavar='FILE',
        help="GeoTIFF, ESRI ASCII grid or npz; with a scene in place of the scene's own "
        '(default: a real mountain ridge, 9 x 8 km)',
    )


def scene_from_arguments(args: argparse.Namespace) -> Scene:
    """Make the scene that the arguments choose.

    A terrain without a scene gets a vent on its highest point away from the borders. Cells that
    are wider than the flow's particles are apart are divided, for the maps to show the flow.

    Raises:
        LavaError: A file cannot be used.
    """
    terrain = load_terrain(args.terrain) if args.terrain else None
    if args.scene:
        return _with_fine_cells(scene_from_yaml(args.scene, terrain=terrain))
    if terrain is not None:
        return _with_fine_cells(Scene(terrain, (_summit_vent(terrain),), DEMO_LAVA))
    vents = tuple(
        Vent((x, y), discharge, radius=20.0, name=f'crest {index}')
        for index, (x, y, discharge) in enumerate(DEMO_VENTS)
    )
    return _with_fine_cells(Scene(demo_terrain(), vents, DEMO_LAVA))


def _with_fine_cells(scene: Scene) -> Scene:
    """Divide the terrain's cells until they are no wider than ``CELL`` particles are apart."""
    usual = preset_accuracy(DEFAULT)
    spacing = resolution_of(scene, usual).spacing
    factor = math.ceil(scene.terrain.resolution / (CELL * spacing))
    most = math.isqrt(MOST_CELLS // scene.terrain.elevation.size)
    return replace(scene, terrain=finer(scene.terrain, max(min(factor, most), 1)))


def _summit_vent(terrain: Terrain) -> Vent:
    rows, columns = terrain.shape
    inner = np.full(terrain.shape, -np.inf)
    here = np.s_[rows // 8 : rows - rows // 8, columns // 8 : columns - columns // 8]
    inner[here] = np.where(terrain.has_data[here], terrain.elevation[here], -np.inf)
    if not np.isfinite(inner).any():
        inner = np.where(terrain.has_data, terrain.elevation, -np.inf)
    row, column = np.unravel_index(int(np.argmax(inner)), terrain.shape)
    x, y = terrain.origin
    place = (x + (column + 0.5) * terrain.resolution, y + (row + 0.5) * terrain.resolution)
    radius = min(2.0 * terrain.resolution, SUMMIT_RADIUS)
    return Vent(place, SUMMIT_DISCHARGE, radius=radius, name='summit')
