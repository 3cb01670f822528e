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

"""Where a vent may open: a map of relative likelihoods on the cells of a terrain."""

import hashlib

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.scene import Terrain

#: Share of a cell's side that places keep from its border, so that rounding does not cross it.
_MARGIN = 1e-3


class Susceptibility:
    """Places by their likelihood: two shares between 0 and 1 stand for a place."""

    def __init__(self, terrain: Terrain, likelihood: np.ndarray) -> None:
        """Take the likelihoods.

        Args:
            terrain: The ground; cells without data have no vent.
            likelihood: Relative likelihood of each cell, at least 0, NaN as 0, float, shape
                [rows, columns].

        Raises:
            LavaError: The shapes differ, a value is negative, or nowhere is one above 0.
        """
        values = np.asarray(likelihood, dtype=np.float64)
        if values.shape != terrain.shape:
            raise LavaError('susceptibility', values.shape, f'a map of {terrain.shape} cells')
        values = np.where(np.isnan(values) | ~terrain.has_data, 0.0, values)
        if not np.isfinite(values).all() or (values < 0.0).any():
            worst = float(values[~(values >= 0.0) | np.isinf(values)][0])
            raise LavaError('susceptibility', worst, 'finite likelihoods of at least 0')
        if not values.any():
            raise LavaError('susceptibility', 0.0, 'a cell of the terrain with a likelihood')
        self._terrain = terrain
        self._rows = np.cumsum(values.sum(axis=1))
        self._values = values

    @property
    def digest(self) -> str:
        """What tells one map from another, in hexadecimal digits."""
        return hashlib.blake2b(self._values.tobytes(), digest_size=16).hexdigest()

    def place(self, first: float, second: float) -> tuple[float, float]:
        """The place (x, y) [m] that two shares between 0 and 1 stand for.

        ``second`` chooses the row and the place within it, ``first`` the same along the row.
        """
        row, up = _cell(self._rows, second)
        column, along = _cell(np.cumsum(self._values[row]), first)
        x, y = self._terrain.origin
        cell = self._terrain.resolution
        return (x + (column + along) * cell, y + (row + up) * cell)


def _cell(sums: np.ndarray, share: float) -> tuple[int, float]:
    """The interval of cumulative sums that a share falls into, and where in it."""
    target = share * sums[-1]
    index = int(np.searchsorted(sums, target, side='right'))
    # the last of them with a likelihood
    index = min(index, int(np.searchsorted(sums, sums[-1])))
    before = float(sums[index - 1]) if index else 0.0
    inside = (target - before) / (float(sums[index]) - before)
    return index, min(max(inside, _MARGIN), 1.0 - _MARGIN)
