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

"""Particles in one place, one, none, volumes far apart, off the map; vents of every kind.

Vents are on ridges, in pits, at borders and over each other; weak, strong and flickering ones.
"""

import numpy as np

from hard.case import block, CELL, HardScene, material, plane, scene, terrain, vent
from lava_ros.scene import Scene, Terrain
from lava_ros.simulation import Particles

SLOPE = 0.2

#: Half the radius of 1000 m3 of that lava after 100 s, 31 m (Huppert 1982) [m].
HALFWAY = 15.0


def _in_one_place(count: int, volume: float):
    return lambda spacing: Particles(np.zeros((count, 2)), volume, 1423.0)


def _pairs(spacing: float) -> Particles:
    """A block, each of its particles twice."""
    lava = block(40.0, 40.0, 1.0)(spacing)
    return Particles(np.repeat(lava.position, 2, axis=0), np.repeat(lava.volume, 2), 1423.0)


def _in_a_row(spacing: float) -> Particles:
    """Particles along a line: across it there is no slope to be had."""
    x = np.linspace(-40.0, 40.0, 41)
    return Particles(np.stack([x, np.zeros_like(x)], axis=1), spacing * spacing, 1423.0)


def _far_apart(spacing: float) -> Particles:
    """Volumes from a millionth of the usual one to a hundred times it."""
    lava = block(50.0, 50.0, 1.0)(spacing)
    exponents = np.random.default_rng(2).uniform(-6.0, 2.0, len(lava.volume))
    return Particles(lava.position, lava.volume * 10.0**exponents, 1423.0)


def _hole() -> Terrain:
    ground = terrain().elevation.copy()
    ground[12:20, 12:20] = np.nan
    return Terrain(ground, 5.0, (-80.0, -80.0))


def _around_the_hole(spacing: float) -> Particles:
    lava = block(90.0, 90.0, 3.0)(spacing)
    outside = np.abs(lava.position).max(axis=1) > 20.5
    return Particles(lava.position[outside], lava.volume[outside], 1423.0)


BORDERS = {
    'west': (-1.0, 0.0), 'east': (1.0, 0.0), 'south': (0.0, -1.0), 'north': (0.0, 1.0),
    'corner': (0.7071, 0.7071),
}

PARTICLES = (
    HardScene('coincident', 'a hundred particles in exactly one place', scene(), 100.0,
              lava=_in_one_place(100, 10.0), thickness=1.0, reaches=HALFWAY),
    HardScene('coincident_inertia', 'the same with inertia', scene(), 20.0, 'inertia',
              lava=_in_one_place(100, 10.0), thickness=1.0),
    HardScene('coincident_lateral', 'the same with lateral stress', scene(), 0.2, 'lateral',
              lava=_in_one_place(100, 10.0), thickness=1.0),
    HardScene('piled_up_lateral',
              'a pile fifty times as thick as was expected, with lateral stress', scene(), 10.0,
              'lateral', lava=block(10.0, 10.0, 50.0), thickness=1.0,
              dry=lambda places: np.hypot(*places.T) > 60.0, mirrored=True, mirrored_until=0.4),
    HardScene('piled_higher_lateral', 'a pile a thousand times as thick as was expected, likewise',
              scene(None, (), material(viscosity=1e8)), 3e5, 'lateral',
              lava=block(30.0, 30.0, 100.0), thickness=0.1, mirrored=True, mirrored_until=3e4,
              most_steps={'fine': 90}, longest_step=1e5),
    HardScene('coincident_pairs', 'every particle twice in its place', scene(), 100.0, lava=_pairs,
              thickness=1.0),
    HardScene('one_particle', 'one particle on a slope', scene(plane(0.1)), 1000.0,
              lava=_in_one_place(1, 25.0), thickness=1.0, halved=False),
    HardScene('no_particles', 'no lava at all', scene(), 1e5, halved=False, mirrored=True),
    HardScene('no_discharge', 'vents that give nothing',
              scene(None, (vent(0.0, 0.0, 0.0), vent(0.0, 9.0, ((0.0, 0.0), (10.0, 0.0))))), 1e4,
              halved=False, mirrored=True),
    HardScene('in_a_row', 'particles along a line', scene(), 100.0, lava=_in_a_row, thickness=1.0),
    HardScene('volumes_far_apart',
              'particles of a millionth and of a hundred times the usual volume',
              scene(plane(0.05)), 10.0, lava=_far_apart, thickness=1.0),
    HardScene('two_by_two_cells', 'the smallest terrain there is',
              Scene(Terrain(np.zeros((2, 2)), 40.0, (-40.0, -40.0)), (vent(),), material()), 500.0,
              mirrored=True),
    *(
        HardScene(f'leaving_{name}', f'lava runs over the border: {name}',
                  scene(plane(SLOPE, towards=direction)), 60.0,
                  lava=block(40.0, 40.0, 1.0, centre=(55.0 * direction[0], 55.0 * direction[1])),
                  thickness=1.0, halved=False)
        for name, direction in BORDERS.items()
    ),
    HardScene('leaving_everywhere', 'a layer over the whole map runs off at each border',
              scene(None, (), material(viscosity=100.0)), 5.0, lava=block(160.0, 160.0, 5.0),
              thickness=5.0, mirrored=True, mirrored_until=0.2),
    HardScene('leaving_into_a_hole', 'lava around cells without data runs in',
              Scene(_hole(), (), material()), 60.0, lava=_around_the_hole, thickness=3.0,
              mirrored=True, mirrored_until=15.0),
    HardScene('leaving_inertia', 'lava shoots over the border',
              scene(plane(SLOPE), (), material(viscosity=10.0)), 15.0, 'inertia',
              lava=block(40.0, 40.0, 1.0, centre=(0.0, -40.0)), thickness=1.0, halved=False),
)

#: On and off, each for a second.
FLICKER = tuple((float(second), 10.0 if second % 2 == 0 else 0.0) for second in range(40))

VENTS = (
    HardScene('vent_on_ridge', 'a vent on a knife ridge: half goes either way',
              scene(lambda x, y: -2.0 * np.abs(x), (vent(),)), 60.0, mirrored=True),
    HardScene('fissure_on_ridge', 'a fissure along a knife ridge',
              scene(lambda x, y: -2.0 * np.abs(x), (vent(0.0, -30.0, 20.0, end=(0.0, 30.0)),)),
              60.0, mirrored=True),
    HardScene('vent_in_pit', 'a vent in a pit of two cells, 30 m deep',
              scene(lambda x, y: np.where((np.abs(x) < CELL) & (np.abs(y) < CELL), -30.0, 0.0),
                    (vent(),)), 40.0, mirrored=True),
    HardScene('vent_at_border', 'a vent half off the map', scene(plane(0.05), (vent(0.0, 79.9),)),
              200.0, mirrored=True),
    HardScene('vent_in_corner', 'a vent on the last corner, lava runs off the map',
              scene(plane(0.1, towards=(0.7, 0.7)), (vent(79.99, 79.99),)), 100.0, halved=False),
    HardScene('vents_over_each_other', 'twelve vents in one place',
              scene(None, (vent(0.0, 0.0, 1.0),) * 12), 100.0, mirrored=True, distinct=True),
    HardScene('vent_1e-3', 'a litre a second',
              scene(plane(0.05), (vent(0.0, 20.0, 1e-3, radius=0.5),)), 2e4, mirrored=True),
    HardScene('vent_1e5', 'a hundred thousand cubic metres a second',
              scene(plane(0.05), (vent(0.0, 20.0, 1e5),)), 0.3, mirrored=True),
    HardScene('vent_1e5_inertia', 'the same with inertia',
              scene(plane(0.05), (vent(0.0, 20.0, 1e5),)), 0.5, 'inertia', mirrored=True),
    HardScene('vent_1e5_narrow', 'the same out of a hole of 10 cm, stiff',
              scene(None, (vent(0.0, 0.0, 1e5, radius=0.1),), material(viscosity=1e7)), 1.0,
              mirrored=True),
    HardScene('vent_flickers', 'a vent that is on each other second',
              scene(plane(0.05), (vent(0.0, 30.0, FLICKER),)), 40.0, mirrored=True),
    HardScene('vents_strong_and_weak', '1e-3 beside 1e3 m3/s',
              scene(plane(0.05), (vent(0.0, 40.0, 1e-3), vent(0.0, 0.0, 1e3))), 10.0,
              mirrored=True),
    HardScene('fissure_from_border_to_border', 'a fissure across the whole map',
              scene(plane(0.05), (vent(-79.9, 40.0, 50.0, end=(79.9, 40.0)),)), 100.0,
              mirrored=True),
    HardScene(
        'vents_everywhere', 'a vent in every third cell',
        scene(None, tuple(vent(x, y, 0.05) for x in np.arange(-67.5, 75.0, 15.0)
                          for y in np.arange(-67.5, 75.0, 15.0))),
        600.0, mirrored=True,
    ),
)
