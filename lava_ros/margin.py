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

"""The surroundings of marked cells, on a grid."""

import numpy as np


def within(marked: np.ndarray, distance: float) -> np.ndarray:
    """Find the cells near marked ones.

    Args:
        marked: bool, shape [rows, columns].
        distance: Largest distance between the centres of two cells [cells].

    Returns:
        bool, same shape: the marked cells and those no farther from one than that.
    """
    result = marked.copy()
    if distance < 1.0 or not marked.any():
        return result
    reach = int(distance)
    box = tuple(
        slice(max(0, int(indices.min()) - reach), int(indices.max()) + reach + 1)
        for indices in np.nonzero(marked)
    )
    part, grown = marked[box], result[box]
    far = np.int32(sum(part.shape) + reach)
    columns = np.arange(part.shape[1], dtype=np.int32)
    before = np.maximum.accumulate(np.where(part, columns, -far), axis=1)
    after = np.minimum.accumulate(np.where(part, columns, far)[:, ::-1], axis=1)[:, ::-1]
    # How far the nearest marked cell of the same row is.
    gap = np.minimum(columns - before, after - columns)
    for step in range(min(reach, part.shape[0] - 1) + 1):
        near = gap <= np.floor(np.sqrt(distance**2 - step**2))
        grown[step:] |= near[: len(near) - step]
        grown[: len(near) - step] |= near[step:]
    return result
