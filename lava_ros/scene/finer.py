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


"""A terrain on finer cells: the surface that the simulation has between the cells, sampled."""

from dataclasses import replace

import numpy as np

from lava_ros.scene.terrain import Terrain


def finer(terrain: Terrain, factor: int) -> Terrain:
    """Sample the quadratic B-spline of a terrain's heights on cells smaller by ``factor``.

    The simulation lets lava flow on this surface (simulation/terrain.py), so maps on the finer
    cells show its shape between the coarse cells' centres. Fine cells within a cell without data
    have none.
    """
    if factor == 1:
        return terrain
    height = terrain.elevation.astype(np.float64)
    for axis in (0, 1):
        height = _along(height, factor, axis)
    fine = replace(terrain, elevation=height, resolution=terrain.resolution / factor)
    known = np.kron(terrain.has_data, np.ones((factor, factor), dtype=bool))
    return replace(fine, elevation=np.where(known, fine.elevation, np.nan))


def _along(height: np.ndarray, factor: int, axis: int) -> np.ndarray:
    """The spline along an axis; a neighbour without data continues the slope of the others."""
    height = np.moveaxis(height, axis, 0)
    padded = np.pad(height, ((1, 1), (0, 0)), mode='reflect', reflect_type='odd')
    before, here, after = padded[:-2], padded[1:-1], padded[2:]
    before, after = (
        np.where(np.isfinite(near), near, np.where(np.isfinite(far), 2.0 * here - far, here))
        for near, far in ((before, after), (after, before))
    )
    fine = np.empty((len(height) * factor, height.shape[1]))
    for number in range(factor):
        place = (number + 0.5) / factor - 0.5
        low, high = 0.5 * (0.5 - place) ** 2, 0.5 * (0.5 + place) ** 2
        fine[number::factor] = low * before + (0.75 - place**2) * here + high * after
    return np.moveaxis(fine, 0, axis)
