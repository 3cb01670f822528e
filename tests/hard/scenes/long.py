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

"""Long runs, late times, large coordinates, cells of any size; terrain and vents that change."""

from dataclasses import replace

import numpy as np

from hard.case import HardScene, material, plane, scene, terrain, vent
from lava_ros.scene import Scene, Terrain
from lava_ros.simulation import Simulation

MONTH = 30 * 86400.0

#: The largest coordinates of projected maps [m].
FAR = 1_000_000.0


def _far_map() -> Terrain:
    return Terrain(terrain(plane(0.05)).elevation, 5.0, (FAR, 4.0 * FAR))


def _raise_a_dam(simulation: Simulation) -> None:
    """A dam of 50 m rises in the middle of the flow."""
    simulation.set_terrain(terrain(lambda x, y: 0.1 * y + np.where(np.abs(y) < 5.0, 50.0, 0.0)))


def _drop_the_ground(simulation: Simulation) -> None:
    """The ground under the flow falls by 100 m, cell by cell at random."""
    drop = np.random.default_rng(4).uniform(0.0, 100.0, (32, 32))
    simulation.set_terrain(terrain(lambda x, y: 0.1 * y - drop))


def _tilt(simulation: Simulation) -> None:
    """The slope turns around."""
    simulation.set_terrain(terrain(plane(0.1, towards=(0.0, 1.0))))


def _tilt_back(simulation: Simulation) -> None:
    simulation.set_terrain(terrain(plane(0.1)))


def _coarser_and_shifted(simulation: Simulation) -> None:
    """Cells twice as large, half of the flow off the new map."""
    simulation.set_terrain(
        terrain(lambda x, y: 0.1 * (y - 40.0), cell=10.0, side=16, origin=(-80.0, -40.0))
    )


def _vents(*places: tuple[float, float, float]):
    return lambda simulation: simulation.set_vents([vent(*place) for place in places])


CHANGES = {
    10.0 * (index + 1): _vents((0.0, 40.0 - 8.0 * index, 2.0 + 3.0 * (index % 3)))
    for index in range(9)
}

SCENES = (
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
