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


"""Barriers: earth piled up along a line, to turn lava aside."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import dist

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.scene.terrain import MAX_COORDINATE, Terrain

#: Heights and widths that barriers can have [m]: that of 1983 on Etna was 18 m high.
HEIGHT_RANGE = (0.1, 200.0)
WIDTH_RANGE = (0.1, 1000.0)

#: Places nearer to each other than this are one [m].
APART = 1e-3


@dataclass(frozen=True)
class Barrier:
    """A dam of earth.

    Attributes:
        line: Its crest, two or more places (x, y) [m] in projected coordinates.
        height: Its height above the ground along the crest [m].
        width: Width of its crest [m].
        slope: Fall of its sides, rise over run; infinite for walls.
    """

    line: tuple[tuple[float, float], ...]
    height: float
    width: float
    slope: float = 1.0

    def __post_init__(self) -> None:
        """Validate and normalise every field.

        Raises:
            LavaError: A field is not usable.
        """
        if isinstance(self.line, str) or not isinstance(self.line, Sequence):
            raise LavaError('barrier.line', self.line, 'two or more places [x, y] m')
        places = tuple(
            validation.pair(f'barrier.line[{index}]', place, most=MAX_COORDINATE)
            for index, place in enumerate(self.line)
        )
        if len(places) < 2 or any(dist(a, b) < APART for a, b in pairwise(places)):
            raise LavaError('barrier.line', places, 'two or more places that differ')
        object.__setattr__(self, 'line', places)
        for name, (least, most) in (('height', HEIGHT_RANGE), ('width', WIDTH_RANGE)):
            value = validation.number(
                f'barrier.{name}', getattr(self, name), at_least=least, at_most=most, unit='m'
            )
            object.__setattr__(self, name, value)
        slope = validation.number('barrier.slope', self.slope, at_least=0.05, at_most=100.0)
        object.__setattr__(self, 'slope', slope)

    @classmethod
    def from_dict(cls, label: str, data: object) -> 'Barrier':
        """Build a barrier from the plain data of a YAML file.

        Raises:
            LavaError: A key or a value is not usable.
        """
        allowed = ['line', 'height', 'width', 'slope']
        required = ['line', 'height', 'width']
        return cls(**validation.keys(label, data, allowed=allowed, required=required))  # type: ignore[arg-type]


def with_barrier(terrain: Terrain, barrier: Barrier) -> Terrain:
    """Raise a terrain by a barrier.

    The ground is raised by the full height within half the width of the line. Beyond that it is
    raised less and less, to nothing where the barrier's sides reach the ground. If the barrier is
    narrower than a cell, the cells that the line crosses are raised to the full height, so that
    lava finds no gap.

    Raises:
        LavaError: The line does not touch the terrain, or touches only cells without data.
    """
    rows, columns = terrain.shape
    cell = terrain.resolution
    x = terrain.origin[0] + terrain.offset[0] + (np.arange(columns) + 0.5) * cell
    y = terrain.origin[1] + terrain.offset[1] + (np.arange(rows) + 0.5) * cell
    # cells whose centre is nearer than this are crossed, and those cells leave no gap to diagonals
    half = max(0.5 * barrier.width, np.sqrt(0.5) * cell)
    reach = half + barrier.height / barrier.slope
    distance = np.full(terrain.shape, np.inf)
    for start, end in pairwise(barrier.line):
        box = tuple(
            slice(
                *np.searchsorted(
                    axis, (min(start[k], end[k]) - reach, max(start[k], end[k]) + reach)
                )
            )
            for k, axis in ((1, y), (0, x))
        )
        near = _distance(x[box[1]], y[box[0]], start, end)
        distance[box] = np.minimum(distance[box], near)
    added = np.clip(barrier.height - (distance - half) * barrier.slope, 0.0, barrier.height)
    if not (terrain.has_data & (added > 0.0)).any():
        right = f'a line {terrain.bounds(projected=True)}'
        raise LavaError('barrier.line', barrier.line, right)
    return replace(terrain, elevation=(terrain.elevation + added).astype(np.float32))


def _distance(
    x: np.ndarray, y: np.ndarray, start: tuple[float, float], end: tuple[float, float]
) -> np.ndarray:
    """Distance of the places of a grid from a segment [m], shape [len(y), len(x)]."""
    along = np.subtract(end, start)
    dx, dy = x[None, :] - start[0], y[:, None] - start[1]
    share = np.clip((dx * along[0] + dy * along[1]) / (along @ along), 0.0, 1.0)
    return np.hypot(dx - share * along[0], dy - share * along[1])
