# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Largest thickness and highest temperature of each cell, kept by the steps themselves."""

from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from lava_ros.scene import Terrain
from lava_ros.simulation.cells.grid import on_terrain
from lava_ros.simulation.cells.state import Cells, Heat
from lava_ros.simulation.cells.threads import shared
from lava_ros.simulation.particles.terrain import averaged


@wp.struct
class Highest:
    """Peaks since a time: of flowing and solidified lava [m], and of flowing lava [K]; maps."""

    thickness: wp.array2d(dtype=wp.float32)
    temperature: wp.array2d(dtype=wp.float32)


_RAISE = """{
    const int* box = s.box.data;
    const long top = box[0], bottom = box[1], left = box[2], right = box[3];
    SHARED
    const long w = s.stride;
    const float* APART y = s.stage.data;
    const double* APART frozen = m.frozen.data;
    const double* APART warmth = m.temperature.data;
    float* APART thickness = k.thickness.data;
    float* APART temperature = k.temperature.data;
    for (long i = first_of(top); i <= last_of(bottom); i += lines)
        for (long p = i * w + left + lane; p <= i * w + right; p += lanes) {
            const float total = y[p] + (float)frozen[p];
            const float warm = y[p] > 0.0f ? (float)warmth[p] : 0.0f;
            thickness[p] = total > thickness[p] ? total : thickness[p];
            temperature[p] = warm > temperature[p] ? warm : temperature[p];
        }
}"""


@lru_cache
def raise_function(blocks: int = 1) -> Any:
    """Return the device function that raises the peaks to the current lava.

    ``blocks`` is the number of blocks of a world on a GPU.
    """

    @wp.func_native(_RAISE.replace('SHARED', shared(blocks)))
    def raise_peaks(s: Cells, m: Heat, k: Highest): ...

    return raise_peaks


class CellPeaks:
    """Peaks of the lava on cells since a time.

    Attributes:
        highest: The arrays that steps update.
    """

    def __init__(self, shape: tuple[int, ...], device: Any) -> None:
        """Allocate for maps of a shape with their ring, without lava."""
        self.highest = Highest()
        self.highest.thickness = wp.zeros(shape, dtype=wp.float32, device=device)
        self.highest.temperature = wp.zeros(shape, dtype=wp.float32, device=device)

    def restart(self, thickness: np.ndarray, temperature: np.ndarray) -> None:
        """Begin again with lava of a thickness [m] and a temperature [K], maps with their ring."""
        self.highest.thickness.assign(thickness.astype(np.float32))
        self.highest.temperature.assign(temperature.astype(np.float32))

    def move(self, former: 'CellPeaks', before: Terrain, after: Terrain) -> None:
        """Continue the peaks of another grid."""
        for name in ('thickness', 'temperature'):
            values = getattr(former.highest, name).numpy()[1:-1, 1:-1]
            own = getattr(self.highest, name)
            moved = np.pad(averaged(values, before, after), 1).astype(np.float32)
            own.assign(np.fmax(own.numpy(), moved))

    def on_terrain(
        self, grid: Terrain, terrain: Terrain, part: tuple[slice, slice]
    ) -> np.ndarray:
        """Return thickness and temperature on some of the terrain's cells: [2, rows, columns].

        In a cell of several smaller ones it is the mean of their peaks, and the temperature by
        thickness.
        """
        thickness, temperature = (
            getattr(self.highest, name).numpy()[1:-1, 1:-1]
            for name in ('thickness', 'temperature')
        )
        mean = on_terrain(thickness, grid, terrain, part)
        with np.errstate(invalid='ignore', divide='ignore'):
            warm = on_terrain(thickness * temperature, grid, terrain, part) / mean
        return np.stack([mean, warm])
