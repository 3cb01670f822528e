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


"""Ground no finer than the particles: a coarser terrain for them, and maps back on the finer one.

What is smaller than the distance of particles they do not feel, and a step may not lead further
than a cell: cells of half that distance cost four times as much and change nothing.
"""

from dataclasses import replace

import numpy as np

from lava_ros.scene import Terrain
from lava_ros.simulation.snapshot import Snapshot


def coarsened(terrain: Terrain, factor: int) -> Terrain:
    """Average a terrain over blocks of cells.

    Args:
        terrain: The terrain.
        factor: Cells to a side of a block; blocks start at the lower-left corner, those at the
            other borders may be cut. A block has data where any of its cells has.
    """
    if factor == 1:
        return terrain
    rows, columns = (-(-side // factor) for side in terrain.shape)
    padded = np.full((rows * factor, columns * factor), np.nan)
    padded[: terrain.shape[0], : terrain.shape[1]] = terrain.elevation
    blocks = padded.reshape(rows, factor, columns, factor)
    known = np.isfinite(blocks)
    count = known.sum(axis=(1, 3))
    total = np.where(known, blocks, 0.0).sum(axis=(1, 3))
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return replace(terrain, elevation=mean, resolution=terrain.resolution * factor)


def refined(snapshot: Snapshot, terrain: Terrain, factor: int) -> Snapshot:
    """Put the maps of a coarsened terrain back on the cells of the terrain itself."""
    if factor == 1:
        return snapshot
    rows, columns = terrain.shape

    def spread(values: np.ndarray) -> np.ndarray:
        fine = np.repeat(np.repeat(values, factor, axis=0), factor, axis=1)[:rows, :columns]
        return np.where(terrain.has_data, fine, np.nan).astype(np.float32)

    return replace(
        snapshot,
        terrain=terrain,
        thickness=spread(snapshot.thickness),
        temperature=spread(snapshot.temperature),
        frozen=None if snapshot.frozen is None else spread(snapshot.frozen),
    )
