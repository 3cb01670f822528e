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

"""Vents on ridges, in pits, at borders, over each other; weak, strong and flickering ones."""

import numpy as np

from hard.case import CELL, HardScene, material, plane, scene, vent

#: On and off, each for a second.
FLICKER = tuple((float(second), 10.0 if second % 2 == 0 else 0.0) for second in range(40))

SCENES = (
    HardScene(
        'vent_on_ridge', 'a vent on a knife ridge: half goes either way',
        scene(lambda x, y: -2.0 * np.abs(x), (vent(),)), 60.0, mirrored=True,
    ),
    HardScene(
        'fissure_on_ridge', 'a fissure along a knife ridge',
        scene(lambda x, y: -2.0 * np.abs(x), (vent(0.0, -30.0, 20.0, end=(0.0, 30.0)),)),
        60.0, mirrored=True,
    ),
    HardScene(
        'vent_in_pit', 'a vent in a pit of two cells, 30 m deep',
        scene(lambda x, y: np.where((np.abs(x) < CELL) & (np.abs(y) < CELL), -30.0, 0.0),
              (vent(),)),
        40.0, mirrored=True,
    ),
    HardScene(
        'vent_at_border', 'a vent half off the map',
        scene(plane(0.05), (vent(0.0, 79.9),)), 200.0, mirrored=True,
    ),
    HardScene(
        'vent_in_corner', 'a vent on the last corner, lava runs off the map',
        scene(plane(0.1, towards=(0.7, 0.7)), (vent(79.99, 79.99),)), 100.0, halved=False,
    ),
    HardScene(
        'vents_over_each_other', 'twelve vents in one place',
        scene(None, (vent(0.0, 0.0, 1.0),) * 12), 100.0, mirrored=True,
        distinct=True,
    ),
    HardScene(
        'vent_1e-3', 'a litre a second',
        scene(plane(0.05), (vent(0.0, 20.0, 1e-3, radius=0.5),)), 2e4, mirrored=True,
    ),
    HardScene(
        'vent_1e5', 'a hundred thousand cubic metres a second',
        scene(plane(0.05), (vent(0.0, 20.0, 1e5),)), 0.3, mirrored=True,
    ),
    HardScene(
        'vent_1e5_inertia', 'the same with inertia',
        scene(plane(0.05), (vent(0.0, 20.0, 1e5),)), 0.5, 'inertia', mirrored=True,
    ),
    HardScene(
        'vent_1e5_narrow', 'the same out of a hole of 10 cm, stiff',
        scene(None, (vent(0.0, 0.0, 1e5, radius=0.1),), material(viscosity=1e7)), 1.0,
        mirrored=True,
    ),
    HardScene(
        'vent_flickers', 'a vent that is on each other second',
        scene(plane(0.05), (vent(0.0, 30.0, FLICKER),)), 40.0, mirrored=True,
    ),
    HardScene(
        'vents_strong_and_weak', '1e-3 beside 1e3 m3/s',
        scene(plane(0.05), (vent(0.0, 40.0, 1e-3), vent(0.0, 0.0, 1e3))), 10.0, mirrored=True,
    ),
    HardScene(
        'fissure_from_border_to_border', 'a fissure across the whole map',
        scene(plane(0.05), (vent(-79.9, 40.0, 50.0, end=(79.9, 40.0)),)), 100.0, mirrored=True,
    ),
    HardScene(
        'vents_everywhere', 'a vent in every third cell',
        scene(None, tuple(vent(x, y, 0.05) for x in np.arange(-67.5, 75.0, 15.0)
                          for y in np.arange(-67.5, 75.0, 15.0))),
        600.0, mirrored=True,
    ),
)
