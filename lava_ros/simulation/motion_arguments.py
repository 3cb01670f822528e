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

"""What the motion of particles reads and writes (motion.py), and the emission of more of them."""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.effects.laws import heat_type
from lava_ros.simulation.cells import cell_frame
from lava_ros.simulation.flow import flow_constants_of
from lava_ros.simulation.neighbors import NeighborGrid
from lava_ros.simulation.state import State
from lava_ros.simulation.terrain import StaggeredTerrain, terrain_frame

#: Arrays of ``State`` that a motion reads and writes, those among them that there are.
_ARRAYS = (
    'counts', 'clock', 'top', 'stage', 'ordered', 'ordered_base', 'ordered_drift',
    'ordered_remainder', 'ordered_age', 'particle', 'base', 'drift', 'remainder', 'velocity',
    'age', 'slope', 'cold', 'arrived',
)


@lru_cache
def journey_type(real: Any) -> Any:
    """What a motion reads and writes: arrays of ``State``, the ground, the cells, constants."""
    vec2 = wp.types.vector(2, real)
    vec4 = wp.types.vector(4, real)

    @wp.struct
    class Journey:
        counts: wp.array(dtype=wp.int32)
        clock: wp.array(dtype=wp.float64)
        top: wp.array(dtype=real)
        stage: wp.array(dtype=real)
        elevation: wp.array2d(dtype=real)
        terrain: terrain_frame(real)
        constants: flow_constants_of(real)
        heat: heat_type(real)
        ordered: wp.array(dtype=vec4)
        ordered_base: wp.array(dtype=vec4)
        ordered_drift: wp.array(dtype=vec4)
        ordered_remainder: wp.array(dtype=vec2)
        ordered_age: wp.array(dtype=real)
        particle: wp.array(dtype=vec4)
        base: wp.array(dtype=vec4)
        drift: wp.array(dtype=vec4)
        remainder: wp.array(dtype=vec2)
        velocity: wp.array(dtype=vec2)
        age: wp.array(dtype=real)
        slope: wp.array(dtype=vec2)
        cold: wp.array(dtype=wp.int32)
        arrived: wp.array2d(dtype=wp.float32)
        known: wp.array2d(dtype=wp.uint8)
        cells: cell_frame(real)
        cell: wp.array(dtype=wp.int32)
        rank: wp.array(dtype=wp.int32)
        sizes: wp.array(dtype=wp.int32)
        left: wp.array(dtype=wp.float64)

    return Journey


def journey(
    state: State, neighbors: NeighborGrid, terrain: StaggeredTerrain, constants: Any, heat: Any
) -> Any:
    """Collect what a motion reads and writes.

    Args:
        state: The particles, ordered.
        neighbors: Their neighbour grid.
        terrain: The ground.
        constants: The flow's.
        heat: The heat balance's.
    """
    made = journey_type(state.real)()
    made.elevation, made.terrain = terrain.height, terrain.frame
    made.constants, made.heat = constants, heat
    made.known, _, made.cells, made.cell, made.rank, made.sizes, made.left = neighbors.place_in(
        state
    )
    for name in _ARRAYS:
        if hasattr(state, name):
            setattr(made, name, getattr(state, name))
    return made
