# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Terrain with cliffs, spikes, pits, canyons, ridges, terraces, walls, holes and noise.

And long runs, late times, large coordinates, cells of any size; terrain and vents that change.
"""

from dataclasses import replace

import numpy as np

from hard.case import block, CELL, HardScene, material, plane, scene, Surface, terrain, vent
from lava_ros.scene import Scene, Terrain
from lava_ros.simulation import Simulation


def _cliff(drop: float) -> Surface:
    """Return a gentle slope that ends in a cliff at y = 0, level below."""
    return lambda x, y: np.where(y > 0.0, drop + 0.1 * y, 0.0)


def caldera(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return a slope that continues 1,000 m lower, as inside a caldera's wall."""
    return 0.1 * y + np.where(y > 0.0, 1000.0, 0.0)


def _single(height: float) -> Surface:
    """Return a slope with one row of cells, two wide, raised or lowered, across the flow."""
    return lambda x, y: 0.1 * y + np.where((np.abs(x) < CELL) & (np.abs(y) < CELL), height, 0.0)


def _deep(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return a pit ten cells wide and 50 m deep."""
    return np.where(np.maximum(np.abs(x), np.abs(y)) < 50.0, 0.0, 50.0)


def _canyon(depth: float) -> Surface:
    """Return a canyon of one cell's width down a slope."""
    return lambda x, y: 0.1 * y - depth * (np.abs(x - 0.5 * CELL) < 0.5 * CELL)


def _knife(height: float) -> Surface:
    """Return a ridge on a slope along x, as sharp as the grid allows."""
    return lambda x, y: 0.02 * y + np.where(np.abs(y + 0.5 * CELL) < 0.5 * CELL, height, 0.0)


def _gorge(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return a level shelf, a gorge 200 m deep at y = 0, and a wall of 500 m beyond it."""
    return np.where(y > 0.0, 200.0 + 0.01 * y, np.where(y > -20.0, 0.0, 500.0))


def _brink(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return a level shelf 200 m above a level floor, with walls all around."""
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
    """Return True beyond the wall and the radius of a sum over neighbours."""
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
              scene(caldera, (vent(0.0, 30.0),), material(viscosity=100.0)), 200.0, mirrored=True,
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

MONTH = 30 * 86400.0

#: The largest coordinates of projected maps [m].
FAR = 1_000_000.0


def _far_map() -> Terrain:
    return Terrain(terrain(plane(0.05)).elevation, 5.0, (FAR, 4.0 * FAR))


def _raise_a_dam(simulation: Simulation) -> None:
    simulation.set_terrain(terrain(lambda x, y: 0.1 * y + np.where(np.abs(y) < 5.0, 50.0, 0.0)))


def _drop_the_ground(simulation: Simulation) -> None:
    drop = np.random.default_rng(4).uniform(0.0, 100.0, (32, 32))
    simulation.set_terrain(terrain(lambda x, y: 0.1 * y - drop))


def _tilt(simulation: Simulation) -> None:
    simulation.set_terrain(terrain(plane(0.1, towards=(0.0, 1.0))))


def _tilt_back(simulation: Simulation) -> None:
    simulation.set_terrain(terrain(plane(0.1)))


def _coarser_and_shifted(simulation: Simulation) -> None:
    simulation.set_terrain(
        terrain(lambda x, y: 0.1 * (y - 40.0), cell=10.0, side=16, origin=(-80.0, -40.0))
    )


def _vents(*places: tuple[float, float, float]):
    return lambda simulation: simulation.set_vents([vent(*place) for place in places])


CHANGES = {
    10.0 * (index + 1): _vents((0.0, 40.0 - 8.0 * index, 2.0 + 3.0 * (index % 3)))
    for index in range(9)
}

LONG = (
    HardScene('month', 'a dome for 30 days',
              scene(None, (vent(0.0, 0.0, 0.004),), material(viscosity=1e9)), MONTH, frames=3,
              mirrored=True, halved=False, longest_step=600.0),
    HardScene('late', 'an eruption that begins after 30 years: a float32 of the time has 64 s',
              scene(plane(0.05), (vent(0.0, 30.0, ((1e9, 5.0),)),)), 1e9 + 60.0, since=1e9,
              mirrored=True),
    HardScene('far_out', 'map coordinates of 1 000 km, where a float32 has 6 cm',
              Scene(_far_map(), (vent(FAR + 80.0, 4.0 * FAR + 130.0),), material()), 200.0,
              mirrored=True),
    HardScene('far_from_middle', 'slow lava 80 km from the middle of its map',
              Scene(terrain(plane(0.05), cell=500.0, side=320), (vent(0.0, -79_000.0, 1e3),),
                    material(viscosity=1e6)), 3000.0, mirrored=True),
    HardScene('high_up', 'ground at 8000 m whose features are centimetres',
              scene(lambda x, y: 8000.0 + 0.05 * np.sin(x / 9.0) * np.sin(y / 11.0),
                    (vent(0.0, 0.0, 0.5),), material(viscosity=10.0)), 60.0),
    HardScene('cells_of_1_cm', 'a flow in the laboratory',
              Scene(terrain(plane(0.1), cell=0.01), (vent(0.0, 0.1, 1e-6, radius=0.01),),
                    material(viscosity=10.0)), 60.0, mirrored=True),
    HardScene('cells_of_1_km', 'cells far larger than the flow',
              Scene(terrain(plane(0.05), cell=1000.0), (vent(0.0, 5000.0, 1e4, radius=1000.0),),
                    material(viscosity=1e4)), 2e4, mirrored=True),
    HardScene('chosen_effects', 'whatever the scene calls for: a fast flow with every constant',
              scene(plane(0.2), (vent(0.0, 60.0, 20.0),), material(viscosity=50.0)), 30.0, '',
              mirrored=True),
    HardScene('dam_rises', 'a dam of 50 m rises under the flow',
              scene(plane(0.1), (vent(0.0, 50.0),)), 200.0, events={100.0: _raise_a_dam},
              mirrored=True),
    HardScene('ground_drops', 'the ground becomes a field of pits of 100 m under the flow',
              scene(plane(0.1), (vent(0.0, 50.0),)), 150.0, events={100.0: _drop_the_ground}),
    HardScene('ground_drops_inertia', 'the same with inertia',
              scene(plane(0.1), (vent(0.0, 50.0),)), 80.0, 'inertia',
              events={40.0: _drop_the_ground}),
    HardScene('slope_turns', 'the slope turns around every 40 s', scene(plane(0.1), (vent(),)),
              200.0, events={40.0: _tilt, 80.0: _tilt_back, 120.0: _tilt}, mirrored=True),
    HardScene('other_map', 'a coarser terrain that covers half of the flow',
              scene(plane(0.1), (vent(0.0, 50.0),)), 200.0,
              events={100.0: _coarser_and_shifted}, mirrored=True),
    HardScene('vents_replaced', 'another vent every ten seconds',
              scene(plane(0.1), (vent(0.0, 50.0),)), 100.0, events=CHANGES, mirrored=True),
    HardScene('terrain_while_freezing', 'the terrain is replaced under lava that freezes',
              scene(plane(0.1), (vent(0.0, 40.0, 0.5, temperature=1240.0),),
                    replace(material(), solidus=1223.0, emissivity=0.9, convection=50.0,
                            conductivity=1.5, ground_conductivity=2.0, crust=True)), 4000.0,
              'freezing', events={2000.0: _tilt}, mirrored=True),
)
