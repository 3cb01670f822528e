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


"""A case turned by quarters: a flow that depends on the direction of the grid shows it."""

from dataclasses import replace

import numpy as np

from lava_ros.hindcast.case import Case
from lava_ros.scene import Terrain

Place = tuple[float, float]


def turned(case: Case, quarters: int) -> Case:
    """Turn ground, vents and footprint counterclockwise; the map frame's origin stays a corner.

    Args:
        case: The case.
        quarters: How often by 90 degrees.
    """
    for _ in range(quarters % 4):
        case = _once(case)
    return case


def _once(case: Case) -> Case:
    ground = case.scene.terrain
    x0, _, _, y1 = ground.extent

    def place(point: Place) -> Place:
        """(x, y) from the corner becomes (height - y, x)."""
        return (ground.origin[0] + (y1 - point[1]), ground.origin[1] + (point[0] - x0))

    def terrain(grid: Terrain) -> Terrain:
        return replace(grid, elevation=_quarter(grid.elevation))

    vents = tuple(
        replace(
            vent,
            position=place(vent.position),
            end=None if vent.end is None else place(vent.end),
        )
        for vent in case.scene.vents
    )
    return replace(
        case,
        scene=replace(case.scene, terrain=terrain(ground), vents=vents),
        footprint=_quarter(case.footprint),
        events=tuple(replace(event, terrain=terrain(event.terrain)) for event in case.events),
    )


def _quarter(values: np.ndarray) -> np.ndarray:
    """Row 0 is in the south: to numpy the picture is upside down, and turns the other way."""
    return np.ascontiguousarray(np.rot90(values, -1))
