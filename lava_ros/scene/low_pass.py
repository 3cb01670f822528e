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


"""A smoother terrain: without the waves that are shorter than a width."""

from dataclasses import replace

import numpy as np

from lava_ros import validation
from lava_ros.scene.terrain import Terrain

#: Standard deviations of the filter up to which cells count: what is left out is 1e-4.
_REACH = 4.0

#: Standard deviation below which it changes nothing [cells]: a neighbour weighs exp(-50).
_LEAST = 0.1


def low_pass(terrain: Terrain, width: float) -> Terrain:
    """Filter a terrain with a Gaussian.

    Cells without data stay without, and count nowhere: their neighbours' means are of what is
    known.

    Args:
        terrain: The terrain.
        width: Standard deviation of the filter [m]; 0 changes nothing. Waves of length L are left
            with exp(-2 (pi width / L)^2) of their height: 0.7 % at L = 2 widths, 73 % at 8.

    Raises:
        LavaError: The width is not usable.
    """
    rows, columns = terrain.shape
    most = 0.25 * min(rows, columns) * terrain.resolution
    width = validation.number('low_pass', width, at_least=0.0, at_most=most, unit='m')
    if width < _LEAST * terrain.resolution:
        return terrain
    known = terrain.has_data
    # near zero, lest a float lose the digits of a summit
    level = float(np.mean(terrain.elevation[known], dtype=np.float64))
    heights = np.where(known, terrain.elevation - level, 0.0).astype(np.float64)
    weights = known.astype(np.float64)
    for axis in (0, 1):
        heights = _filtered(heights, width / terrain.resolution, axis)
        weights = _filtered(weights, width / terrain.resolution, axis)
    smooth = np.where(known, level + heights / np.where(known, weights, 1.0), np.nan)
    return replace(terrain, elevation=smooth)


def _filtered(values: np.ndarray, width: float, axis: int) -> np.ndarray:
    """Sums weighted by a Gaussian of a width in cells; outside there is nothing."""
    reach = int(np.ceil(_REACH * width))
    values = np.moveaxis(values, axis, 0)
    padded = np.pad(values, ((reach, reach), (0, 0)))
    offsets = np.arange(-reach, reach + 1)
    # what is beyond the range of floats weighs nothing
    with np.errstate(over='ignore'):
        weights = np.exp(-0.5 * (offsets / width) ** 2)
    total = np.zeros_like(values)
    for offset, weight in zip(offsets, weights / weights.sum(), strict=True):
        total += weight * padded[reach + offset : reach + offset + len(values)]
    return np.moveaxis(total, 0, axis)
