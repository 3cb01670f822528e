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

"""Lava from 1 mm to 200 m thick, and walls of it."""

import numpy as np

from hard.case import block, HardScene, material, plane, scene
from lava_ros.simulation import Particles


def _dam_and_film(spacing: float) -> Particles:
    """50 m thick behind the dam, 1 mm before it."""
    dam = block(60.0, 40.0, 50.0, centre=(0.0, 30.0))(spacing)
    film = block(60.0, 60.0, 0.001, centre=(0.0, -30.0))(spacing)
    return Particles(
        np.concatenate([dam.position, film.position]),
        np.concatenate([dam.volume, film.volume]),
        1423.0,
    )


SCENES = (
    HardScene(
        'film_1_mm', 'a film of a millimetre down a slope',
        scene(plane(0.1), (), material(viscosity=1.0)), 2e4,
        lava=block(60.0, 60.0, 0.001, centre=(0.0, 30.0)), thickness=0.001, mirrored=True,
    ),
    HardScene(
        'film_1_mm_inertia', 'the same with inertia',
        scene(plane(0.1), (), material(viscosity=1.0)), 500.0, 'inertia',
        lava=block(60.0, 60.0, 0.001, centre=(0.0, 30.0)), thickness=0.001, mirrored=True,
    ),
    HardScene(
        'thick_200_m', 'a block of 200 m on cells of 5 m',
        scene(None, (), material(viscosity=1e8)), 60.0,
        lava=block(60.0, 60.0, 200.0), thickness=200.0, mirrored=True,
    ),
    HardScene(
        'thick_200_m_fluid', 'the same, fluid: it levels out at kilometres in a second',
        scene(None, (), material(viscosity=100.0)), 1e-4,
        lava=block(60.0, 60.0, 200.0), thickness=200.0, mirrored=True,
    ),
    HardScene(
        'thick_200_m_lateral', 'the same block, held by lateral stress',
        scene(None, (), material(viscosity=1e8)), 0.4, 'lateral',
        lava=block(20.0, 20.0, 200.0), thickness=200.0, mirrored=True,
    ),
    HardScene(
        'dam_wall', 'a dam of 50 m breaks',
        scene(None, (), material(viscosity=1e5)), 5.0,
        lava=block(60.0, 50.0, 50.0, centre=(0.0, 40.0)), thickness=50.0, mirrored=True,
        mirrored_until=2.5,
    ),
    HardScene(
        'dam_wall_inertia', 'a dam of 50 m breaks, with inertia',
        scene(None, (), material(viscosity=1e3)), 5.0, 'inertia',
        lava=block(60.0, 50.0, 50.0, centre=(0.0, 40.0)), thickness=50.0, mirrored=True,
    ),
    HardScene(
        'dam_onto_film', 'a dam of 50 m breaks onto a film of a millimetre',
        scene(None, (), material(viscosity=1e5)), 5.0,
        lava=_dam_and_film, thickness=50.0, mirrored=True, mirrored_until=1.0,
    ),
    HardScene(
        'column_200_m', 'a column as wide as a cell, 200 m high',
        scene(None, (), material(viscosity=1e9)), 2e4,
        lava=block(5.0, 5.0, 200.0), thickness=50.0, mirrored=True, longest_step=2e4,
    ),
)
