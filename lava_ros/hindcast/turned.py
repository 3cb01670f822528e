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

#: Places are multiples of it [m], so that turning back and forth loses no digit: a flow that forks
#: would tell.
_STEP = 2.0**-20


def turned(case: Case, quarters: int, *, mirror: bool = False) -> Case:
    """Turn ground, vents and footprint counterclockwise; the map frame's origin stays a corner.

    Args:
        case: The case.
        quarters: How often by 90 degrees.
        mirror: Whether east and west are exchanged before.
    """
    if mirror:
        case = _changed(case, _exchanged, _mirror)
    else:
        case = _changed(case, _kept, np.ascontiguousarray)
    for _ in range(quarters % 4):
        case = _changed(case, _a_quarter_on, _quarter)
    return case


def restored(values: np.ndarray, quarters: int, *, mirror: bool = False) -> np.ndarray:
    """Put a map of a turned case back, shape [rows, columns] of the case."""
    values = np.rot90(values, quarters)
    return np.ascontiguousarray(_mirror(values) if mirror else values)


def _kept(ground: Terrain, point: Place) -> Place:
    """(x, y) from the corner stays."""
    x, y = _from_corner(ground, point)
    return _from_origin(ground, x, y)


def _a_quarter_on(ground: Terrain, point: Place) -> Place:
    """(x, y) from the corner becomes (height - y, x)."""
    x, y = _from_corner(ground, point)
    _, y0, _, y1 = ground.extent
    return _from_origin(ground, y1 - y0 - y, x)


def _exchanged(ground: Terrain, point: Place) -> Place:
    """(x, y) from the corner becomes (width - x, y)."""
    x, y = _from_corner(ground, point)
    x0, _, x1, _ = ground.extent
    return _from_origin(ground, x1 - x0 - x, y)


def _from_corner(ground: Terrain, point: Place) -> Place:
    x0, y0, _, _ = ground.extent
    return (_rounded(point[0] - x0), _rounded(point[1] - y0))


def _from_origin(ground: Terrain, x: float, y: float) -> Place:
    x0, y0, _, _ = ground.extent
    return (x0 + _rounded(x), y0 + _rounded(y))


def _rounded(length: float) -> float:
    return round(length / _STEP) * _STEP


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
