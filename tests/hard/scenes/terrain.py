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

"""Terrain with cliffs, spikes, pits, canyons, ridges, terraces, walls, holes and noise."""

import numpy as np

from hard.case import block, CELL, HardScene, material, plane, scene, Surface, terrain, vent
from lava_ros.scene import Terrain


def _cliff(drop: float) -> Surface:
    """A gentle slope that ends in a cliff at y = 0, level below."""
    return lambda x, y: np.where(y > 0.0, drop + 0.1 * y, 0.0)


def _caldera(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A slope that goes on 1,000 m lower, as inside a caldera's wall."""
    return 0.1 * y + np.where(y > 0.0, 1000.0, 0.0)


def _single(height: float) -> Surface:
    """A slope with one row of cells two wide, raised or dug, in the way of the flow."""
    return lambda x, y: 0.1 * y + np.where((np.abs(x) < CELL) & (np.abs(y) < CELL), height, 0.0)


def _deep(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A pit ten cells wide and 50 m deep."""
    return np.where(np.maximum(np.abs(x), np.abs(y)) < 50.0, 0.0, 50.0)


def _canyon(depth: float) -> Surface:
    """A canyon of one cell's width down a slope."""
    return lambda x, y: 0.1 * y - depth * (np.abs(x - 0.5 * CELL) < 0.5 * CELL)


def _knife(height: float) -> Surface:
    """A ridge as sharp as the grid can show, along x, on a slope."""
    return lambda x, y: 0.02 * y + np.where(np.abs(y + 0.5 * CELL) < 0.5 * CELL, height, 0.0)


def _gorge(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A level shelf, a gorge 200 m deep at y = 0, and a wall of 500 m beyond it."""
    return np.where(y > 0.0, 200.0 + 0.01 * y, np.where(y > -20.0, 0.0, 500.0))


def _brink(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A level shelf 200 m over a level floor, with walls all around."""
    walls = (np.abs(x) > 70.0) | (np.abs(y) > 70.0)
    return np.where(y > 0.0, 200.0 + 0.01 * y, 0.0) + 300.0 * walls


def _with_holes() -> Terrain:
    ground = terrain(plane(0.1)).elevation.copy()
    random = np.random.default_rng(11)
    holes = random.random(ground.shape) < 0.1
    holes[26:, 12:20] = False
    ground[holes] = np.nan
    return Terrain(ground, CELL, (-80.0, -80.0))


def _noise(height: float) -> Surface:
    return lambda x, y: 0.1 * y + height * np.random.default_rng(5).normal(size=x.shape)


def _behind(places: np.ndarray) -> np.ndarray:
    """Beyond the wall and the radius in which a sum over neighbours cannot tell."""
    return places[:, 1] < -CELL


TOP = vent(0.0, 50.0)

SCENES = (
    HardScene('flat', 'perfectly level ground', scene(None, (vent(),)), 200.0, mirrored=True),
    HardScene('cliff', 'a cliff of 200 m from one cell to the next', scene(_cliff(200.0), (TOP,)),
              200.0, mirrored=True),
    HardScene('cliff_level', 'the same, thickness taken in plan: it falls at full speed',
              scene(_cliff(200.0), (TOP,)), 200.0, 'level', mirrored=True),
    HardScene('cliff_inertia', 'the same with inertia', scene(_cliff(200.0), (TOP,)), 120.0,
              'inertia', mirrored=True),
    HardScene('caldera_wall', 'a wall of 1000 m from one cell to the next, with a slope below',
              scene(_caldera, (vent(0.0, 30.0),), material(viscosity=100.0)), 200.0, mirrored=True,
              mirrored_until=50.0, reaches=65.0),
    HardScene('spike', 'a spike of 100 m in the way', scene(_single(100.0), (TOP,)), 300.0,
              mirrored=True, mirrored_until=200.0,
              dry=lambda places: (np.abs(places) < 0.25 * CELL).all(axis=1)),
    HardScene('pit', 'a pit of 100 m in the way', scene(_single(-100.0), (TOP,)), 200.0,
              mirrored=True, mirrored_until=150.0),
    HardScene('pit_level', 'the same, thickness taken in plan', scene(_single(-100.0), (TOP,)),
              120.0, 'level', mirrored=True),
    HardScene('pit_inertia', 'the same with inertia', scene(_single(-100.0), (TOP,)), 150.0,
              'inertia', mirrored=True),
    HardScene('pit_filled', 'thin lava that fills a pit of 50 m from within',
              scene(terrain(_deep, cell=10.0, side=30), (vent(0.0, 0.0, 200.0, radius=10.0),),
                    material(viscosity=100.0)), 150.0, frames=20, mirrored=True,
              mirrored_until=30.0, halved=False,
              dry=lambda places: np.abs(places).max(axis=1) > 60.0),
    HardScene('canyon', 'a canyon as wide as a cell, 50 m deep', scene(_canyon(50.0), (TOP,)),
              150.0),
    HardScene('canyon_level', 'the same, thickness taken in plan', scene(_canyon(50.0), (TOP,)),
              150.0, 'level', most_steps={'standard': 400}),
    HardScene('canyon_film', 'a few drops in the canyon, thickness taken in plan',
              scene(_canyon(50.0), (), material(viscosity=10.0)), 300.0, 'level',
              lava=block(20.0, 20.0, 0.02, centre=(0.5 * CELL, 50.0)), thickness=0.02),
    HardScene('gorge', 'drops that creep to the edge of a gorge of four cells, thickness in plan',
              scene(_gorge), 1000.0, 'level', lava=block(100.0, 5.0, 1.0, centre=(0.0, 7.5)),
              thickness=1.0, mirrored=True, mirrored_until=75.0,
              dry=lambda places: places[:, 1] < -25.0),
    HardScene('brink', 'drops that creep over the edge of a shelf 200 m high, thickness in plan',
              scene(_brink), 1000.0, 'level', lava=block(100.0, 5.0, 1.0, centre=(0.0, 7.5)),
              thickness=1.0, mirrored=True, mirrored_until=100.0, closed=True,
              dry=lambda places: places[:, 1] < -60.0),
    HardScene('knife_ridge', 'a ridge one cell wide and 30 m high across the flow',
              scene(_knife(30.0), (TOP,)), 300.0, mirrored=True, dry=_behind),
    HardScene('terraces', 'steps of 10 m', scene(lambda x, y: 10.0 * np.floor(y / 20.0), (TOP,)),
              200.0, mirrored=True, mirrored_until=120.0),
    HardScene('terraces_level', 'the same, thickness taken in plan',
              scene(lambda x, y: 10.0 * np.floor(y / 20.0), (TOP,)), 200.0, 'level',
              mirrored=True),
    HardScene('wall_89_degrees', 'a wall of 89 degrees that lava must not climb',
              scene(lambda x, y: np.where(y > 0.0, 0.05 * y, 57.29 * np.clip(-y, 0.0, 20.0)),
                    (TOP,)), 300.0, mirrored=True, dry=_behind),
    HardScene('wall_89_degrees_inertia', 'the same with inertia: lava runs against it',
              scene(lambda x, y: np.where(y > 0.0, 0.2 * y, 57.29 * np.clip(-y, 0.0, 20.0)),
                    (TOP,), material(viscosity=100.0)), 60.0, 'inertia', mirrored=True,
              dry=_behind),
    HardScene('film_at_wall', 'a fast film of 10 cm against a wall of 1000 m',
              scene(lambda x, y: 0.01 * y + np.where(y < -20.0, 1000.0, 0.0), (),
                    material(viscosity=1.0)), 30.0, frames=6,
              lava=block(60.0, 40.0, 0.1, centre=(0.0, 20.0)), thickness=0.1, mirrored=True,
              mirrored_until=20.0, dry=lambda places: places[:, 1] < -20.0),
    HardScene('film_at_low_wall', 'the same against a wall of 100 m',
              scene(lambda x, y: 0.01 * y + np.where(y < -20.0, 100.0, 0.0), (),
                    material(viscosity=1.0)), 40.0, frames=16,
              lava=block(100.0, 40.0, 0.1, centre=(0.0, 20.0)), thickness=0.1, mirrored=True,
              mirrored_until=20.0, dry=lambda places: places[:, 1] < -20.0),
    HardScene('pond_between_walls', 'a block of 4 m runs against walls of 50 m all around',
              scene(lambda x, y: 50.0 * (np.maximum(np.abs(x), np.abs(y)) > 30.0), (),
                    material(viscosity=2e3)), 20.0, frames=40, lava=block(38.5, 38.5, 4.0),
              thickness=4.0),
    HardScene('slope_89_degrees', 'a plane of 89 degrees everywhere', scene(plane(57.29), (TOP,)),
              100.0, mirrored=True, mirrored_until=40.0),
    HardScene('slope_89_degrees_level', 'the same, thickness taken in plan',
              scene(plane(57.29), (TOP,)), 10.0, 'level', mirrored=True, mirrored_until=5.0),
    HardScene('holes', 'a tenth of the cells have no data', scene(_with_holes(), (TOP,)), 150.0),
    HardScene('noise', 'noise of 5 m from cell to cell', scene(_noise(5.0), (TOP,)), 150.0),
    HardScene('noise_level', 'the same, thickness taken in plan', scene(_noise(5.0), (TOP,)),
              150.0, 'level', most_steps={'standard': 250}),
    HardScene('noise_film', 'a film on noise of 50 m',
              scene(_noise(50.0), (), material(viscosity=10.0)), 60.0,
              lava=block(50.0, 50.0, 0.05), thickness=0.05),
    HardScene('noise_inertia', 'noise of 5 m, with inertia', scene(_noise(5.0), (TOP,)), 100.0,
              'inertia'),
)
