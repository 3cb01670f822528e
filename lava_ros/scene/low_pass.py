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
import math

import numpy as np

from lava_ros import validation
from lava_ros.files.optional import require
from lava_ros.scene.terrain import Terrain

#: Standard deviations of the filter up to which cells count: what is left out is 1e-4.
_REACH = 4.0

#: Standard deviation below which it changes nothing [cells]: a neighbour weighs exp(-50).
_LEAST = 0.1


def low_pass(terrain: Terrain, width: float) -> Terrain:
    """Filter a terrain with a Gaussian.

    Cells without data stay without, and do not count in the means of their neighbours.

    Args:
        terrain: The terrain.
        width: Standard deviation of the filter [m]; 0 changes nothing. Waves of length L keep
            exp(-2 (pi width / L)^2) of their height: 0.7 % at L = 2 widths, 73 % at 8.

    Raises:
        LavaError: The width is not usable, or scipy is not installed.
    """
    rows, columns = terrain.shape
    most = 0.25 * min(rows, columns) * terrain.resolution
    width = validation.number('low_pass', width, at_least=0.0, at_most=most, unit='m')
    if width < _LEAST * terrain.resolution:
        return terrain
    require('scipy', 'low_pass', width)
    from scipy.ndimage import gaussian_filter

    known = terrain.has_data
    # near zero, lest a float lose the digits of a summit
    level = float(np.mean(terrain.elevation[known], dtype=np.float64))
    cells = width / terrain.resolution
    heights, weights = (
        gaussian_filter(values, cells, mode='constant', radius=math.ceil(_REACH * cells))
        for values in (
            np.where(known, terrain.elevation - level, 0.0).astype(np.float64),
            known.astype(np.float64),
        )
    )
    smooth = np.where(known, level + heights / np.where(known, weights, 1.0), np.nan)
    return replace(terrain, elevation=smooth)
