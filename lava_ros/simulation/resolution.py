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

"""Particle spacing from the width of the flow.

The flow follows the steepest descent from the vent with the largest discharge. Across each point
of that path the terrain has a cross-section, and the lava fills it to its normal depth: the level
at which the local balance of weight and drag carries the whole discharge,
Q = K sum (level - ground)^3 dy, K = rho g tan(b) cos^4(b) / (3 mu). A flow that nothing confines
is no wider than the steady flow of a point source down a plane (Smith 1973), on level ground no
wider than the flow of a point source onto a plane (Huppert 1982), and nowhere wider than
``WIDEST`` thicknesses: its edges want particles too.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
import math

import numpy as np

from lava_ros.scene import Scene, Terrain
from lava_ros.simulation.accuracy import Accuracy, mature_thickness, mature_viscosity

#: How far ahead is looked, unless somebody says otherwise [s].
HORIZON = 86400.0

#: Particles across the flow at a refinement of 1 (docs/benchmarks/convergence_h200.csv).
ACROSS = 16.0

#: Largest width over the thickness of the flow: 16 particles of 1.4 thicknesses resolve its edges.
WIDEST = 22.0

#: Particles across the flow below which it is under-resolved: its footprint is another one.
LEAST_ACROSS = 9.0

#: Error of a footprint with as many particles across as ``standard`` has, and the power of them
#: at which it falls, for lava that freezes and lava that does not: the means of the mapped
#: eruptions and of the other scenes in docs/benchmarks/convergence_h200.csv.
_ERRORS = {True: (0.141, 1.5), False: (0.0085, 2.0)}

#: Particles that the horizon may bring at a refinement of 1; the spacing grows with more.
MOST_PARTICLES = 200_000

#: Quantile of the widths along the way: what is narrow is what has to be resolved.
_NARROW = 0.25

#: Points of the path, cells between two of them, directions in which the next is looked for.
_POINTS, _STRIDE, _DIRECTIONS = 256, 4.0, 64

#: Samples of a cross-section, an odd number.
_SAMPLES = 257

#: Bisections of a level: the last is 1e-9 of the first interval.
_BISECTIONS = 30

#: Smallest slope that a cross-section is computed with.
_LEAST_SLOPE = 1e-3

#: Width over (cot(b) x)^(3/7) (Q / K)^(1/7) of the steady flow down a plane at a distance x from
#: its source: 2 (14 / 3)^(3/7) (35 / 32)^(1/7), of h = H (1 - y^2 / Y^2) (Smith 1973).
_SMITH = 3.92

#: Diameter over (g Q^3 / (3 nu))^(1/8) t^(1/2) of a flow onto a plane (Huppert 1982, 2 x 0.715).
_HUPPERT = 1.43


@dataclass(frozen=True)
class Resolution:
    """How a flow is resolved.

    Attributes:
        spacing: Distance between particles where the flow has its expected thickness [m].
        thickness: Expected thickness of the flow [m].
        width: Width of the flow [m], NaN without a discharge.
        across: Particles across it, NaN likewise.
        freezes: Whether the lava has a solidus: footprints then depend more on the resolution.
        limit: What decided: ``flow``, its width; ``particles``, their largest number; ``given``,
            the user; or ``cells``, the terrain's, without a discharge.
    """

    spacing: float
    thickness: float
    width: float
    across: float
    freezes: bool
    limit: str

    @property
    def error(self) -> float:
        """Expected error of the footprint, 1 - Jaccard index with that of a finer run."""
        usual, order = _ERRORS[self.freezes]
        return min(usual * math.pow(ACROSS / self.across, order), 1.0)

    @property
    def is_coarse(self) -> bool:
        """Whether the flow is under-resolved."""
        return self.across < LEAST_ACROSS

    def text(self) -> str:
        """Say it in a line."""
        if math.isnan(self.width):
            return f'spacing {self.spacing:.3g} m; the width of the flow is unknown: no discharge'
        # 180 and not 1.8e+02
        width, error = (float(f'{value:.2g}') for value in (self.width, 100.0 * self.error))
        text = f'{self.across:.2g} particles across a flow about {width:g} m wide'
        text += f' (spacing {self.spacing:.3g} m): expected error of the footprint {error:g} %'
        if self.is_coarse:
            text += f'; the flow is under-resolved, below {LEAST_ACROSS:g} particles across'
        if self.limit == 'particles':
            text += '; the largest number of particles limits the spacing'
        return text


def resolution_of(scene: Scene, accuracy: Accuracy, *, horizon: float = HORIZON) -> Resolution:
    """Find the spacing that an accuracy means in a scene; what it has of its own is kept.

    Lava that comes after the ``horizon`` [s] does not count.
    """
    thickness = accuracy.thickness or mature_thickness(scene)
    width = flow_width(scene, horizon=horizon)
    freezes = scene.lava.solidus > 0.0
    if accuracy.spacing is not None:
        spacing = accuracy.spacing
        return Resolution(spacing, thickness, width, width / spacing, freezes, 'given')
    if math.isnan(width):
        spacing = scene.terrain.resolution / accuracy.refinement
        return Resolution(spacing, thickness, width, width, freezes, 'cells')
    wanted = width / (ACROSS * accuracy.refinement)
    most = MOST_PARTICLES * accuracy.refinement**2
    emitted = sum(vent.volume_between(0.0, horizon) for vent in scene.vents)
    least = math.sqrt(emitted / (thickness * most))
    limit = 'flow' if wanted >= least else 'particles'
    # digits that rounding decides would make another flow of a scene that is turned
    spacing = float(f'{max(wanted, least):.3g}')
    return Resolution(spacing, thickness, width, width / spacing, freezes, limit)


def resolved_accuracy(accuracy: Accuracy, scene: Scene, *, horizon: float = HORIZON) -> Accuracy:
    """Fill in the automatic values: a spacing and a thickness of the scene's own scales."""
    if accuracy.spacing is not None and accuracy.thickness is not None:
        return accuracy
    found = resolution_of(scene, accuracy, horizon=horizon)
    return replace(accuracy, spacing=found.spacing, thickness=found.thickness)


@lru_cache(maxsize=2)
def flow_width(scene: Scene, *, horizon: float = HORIZON) -> float:
    """Width [m] of the flow, the lower quartile along the way that it takes up to a horizon [s].

    It is NaN where no vent has a discharge.
    """
    vents = [vent for vent in scene.vents if vent.peak > 0.0]
    if not vents:
        return math.nan
    vent = max(vents, key=lambda item: item.peak)
    discharge, terrain = vent.peak, scene.terrain
    kinematic = mature_viscosity(scene) / scene.lava.density
    x0, y0, x1, y1 = terrain.extent
    level = _HUPPERT * (scene.gravity * discharge**3 / (3.0 * kinematic)) ** 0.125
    level = max(level * math.sqrt(horizon), 2.0 * vent.radius)
    most = float(WIDEST * (3.0 * kinematic * discharge / scene.gravity) ** 0.25)
    level = float(min(level, math.hypot(x1 - x0, y1 - y0)))
    path, height = _descent(terrain, vent.position)
    if len(path) < 3:
        return min(level, most)
    step = float(np.hypot(*(path[1] - path[0])))
    along = path[2:] - path[:-2]
    along /= np.hypot(*along.T)[:, None]
    slope = np.maximum((height[:-2] - height[2:]) / (2.0 * step), _LEAST_SLOPE)
    mobility = scene.gravity * slope / (1.0 + slope**2) ** 2 / (3.0 * kinematic)
    distance = step * np.arange(1, len(path) - 1)
    widest = _SMITH * (distance / slope) ** (3.0 / 7.0) * (discharge / mobility) ** (1.0 / 7.0)
    widest = np.minimum(widest, level)
    width, area = _normal_depth(terrain, path[1:-1], along, widest, discharge / mobility)
    # the front moves on by the volume that its cross-sections take
    reached = np.cumsum(area * step) / discharge <= horizon
    narrow = float(np.quantile(width[: max(int(reached.sum()), 1)], _NARROW))
    return min(narrow, most)


def _descent(terrain: Terrain, start: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Points of the steepest descent [m], shape [points, 2], and their elevation [m].

    Each is the lowest of a circle around the one before, never back; the path ends at the border,
    at a cell without data, and in a pit that the circle does not reach out of.
    """
    angle = np.linspace(0.0, 2.0 * math.pi, _DIRECTIONS, endpoint=False)
    directions = np.column_stack([np.cos(angle), np.sin(angle)])
    step = _STRIDE * terrain.resolution
    points = [np.array(start)]
    heights = [float(_sampled(terrain, points[0][None])[0])]
    ahead = np.ones(_DIRECTIONS, dtype=bool)
    while len(points) < _POINTS:
        around = points[-1] + step * directions
        height = np.where(ahead, _sampled(terrain, around), np.inf)
        lowest = int(np.argmin(height)) if not np.isnan(height).any() else -1
        if lowest < 0 or height[lowest] >= heights[-1]:
            break
        points.append(around[lowest])
        heights.append(float(height[lowest]))
        ahead = directions @ directions[lowest] > 0.0
    return np.array(points), np.array(heights)


def _normal_depth(
    terrain: Terrain, points: np.ndarray, along: np.ndarray, widest: np.ndarray, flux: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Width [m] and area [m2] of the lava in cross-sections of the terrain.

    They are at ``points`` [m] of the path, which has the direction ``along`` there, both of shape
    [sections, 2], and no wider than ``widest`` [m]. ``flux`` is the discharge over the mobility
    [m4]: the integral of depth cubed.
    """
    share = np.linspace(-0.5, 0.5, _SAMPLES)
    offset = widest[:, None] * share
    across = np.column_stack([-along[:, 1], along[:, 0]])
    places = points[:, None, :] + offset[:, :, None] * across[:, None, :]
    ground = _sampled(terrain, places.reshape(-1, 2)).reshape(offset.shape)
    # beyond the border and on cells without data there is no ground that holds lava
    ground = np.where(np.isnan(ground), np.nanmax(ground), ground)
    middle = _SAMPLES // 2
    # lava is where no higher ground lies between it and the path
    ground[:, middle:] = np.maximum.accumulate(ground[:, middle:], axis=1)
    ground[:, : middle + 1] = np.maximum.accumulate(ground[:, middle::-1], axis=1)[:, ::-1]
    cell = widest / _SAMPLES
    low = ground[:, middle].copy()
    # all of the flux through one sample
    high = low + np.cbrt(flux / cell)
    for _ in range(_BISECTIONS):
        level = 0.5 * (low + high)
        depth = np.maximum(level[:, None] - ground, 0.0)
        is_more = (depth**3).sum(axis=1) * cell > flux
        low, high = np.where(is_more, low, level), np.where(is_more, level, high)
    depth = np.maximum(high[:, None] - ground, 0.0)
    return (depth > 0.0).sum(axis=1) * cell, depth.sum(axis=1) * cell


def _sampled(terrain: Terrain, places: np.ndarray) -> np.ndarray:
    """Elevation [m] at places (x, y), shape [places, 2], bilinear; NaN beyond the outer cells."""
    rows, columns = terrain.shape
    column, row = ((places - terrain.origin) / terrain.resolution - 0.5).T
    inside = (column >= 0.0) & (row >= 0.0) & (column <= columns - 1) & (row <= rows - 1)
    j = np.clip(column.astype(int), 0, max(columns - 2, 0))
    i = np.clip(row.astype(int), 0, max(rows - 2, 0))
    right, upper = np.minimum(j + 1, columns - 1), np.minimum(i + 1, rows - 1)
    s, t = column - j, row - i
    height = terrain.elevation
    low = (1.0 - s) * height[i, j] + s * height[i, right]
    high = (1.0 - s) * height[upper, j] + s * height[upper, right]
    return np.where(inside, (1.0 - t) * low + t * high, np.nan)
