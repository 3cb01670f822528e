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


"""A case turned by quarters, and mirrored: what depends on the direction of the grid shows it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lava_ros.hindcast.case import Case
from lava_ros.scene import Terrain

Place = tuple[float, float]


def turned(case: Case, quarters: int, *, mirror: bool = False) -> Case:
    """Turn ground, vents and footprint counterclockwise; the map frame's origin stays a corner.

    Args:
        case: The case.
        quarters: How often by 90 degrees.
        mirror: Whether east and west are exchanged before.
    """
    if mirror:
        case = _changed(case, _exchanged, _mirror)
    for _ in range(quarters % 4):
        case = _changed(case, _a_quarter_on, _quarter)
    return case


def restored(values: np.ndarray, quarters: int, *, mirror: bool = False) -> np.ndarray:
    """Put a map of a turned case back, shape [rows, columns] of the case."""
    values = np.rot90(values, quarters)
    return np.ascontiguousarray(_mirror(values) if mirror else values)


def _a_quarter_on(ground: Terrain, point: Place) -> Place:
    """(x, y) from the corner becomes (height - y, x)."""
    x0, y0, _, y1 = ground.extent
    return (x0 + (y1 - point[1]), y0 + (point[0] - x0))


def _exchanged(ground: Terrain, point: Place) -> Place:
    """(x, y) from the corner becomes (width - x, y)."""
    x0, _, x1, _ = ground.extent
    return (x0 + (x1 - point[0]), point[1])


def _changed(
    case: Case,
    place: Callable[[Terrain, Place], Place],
    grid: Callable[[np.ndarray], np.ndarray],
) -> Case:
    before = case.scene.terrain

    def terrain(ground: Terrain) -> Terrain:
        return replace(ground, elevation=grid(ground.elevation))

    vents = tuple(
        replace(
            vent,
            position=place(before, vent.position),
            end=None if vent.end is None else place(before, vent.end),
        )
        for vent in case.scene.vents
    )
    return replace(
        case,
        scene=replace(case.scene, terrain=terrain(before), vents=vents),
        footprint=grid(case.footprint),
        events=tuple(replace(event, terrain=terrain(event.terrain)) for event in case.events),
    )


def _quarter(values: np.ndarray) -> np.ndarray:
    """Row 0 is in the south: to numpy the picture is upside down, and turns the other way."""
    return np.ascontiguousarray(np.rot90(values, -1))


def _mirror(values: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(values[:, ::-1])
