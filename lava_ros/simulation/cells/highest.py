# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Largest thickness and highest temperature of each cell, which every step raises."""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.simulation.cells.spans import WITHIN
from lava_ros.simulation.cells.state import Cells, Heat
from lava_ros.simulation.cells.threads import shared


@wp.struct
class Highest:
    """Peaks since a time: of flowing and solidified lava [m], and of flowing lava [K]; maps."""

    thickness: wp.array2d(dtype=wp.float32)
    temperature: wp.array2d(dtype=wp.float32)


_RAISE = """{
    const int* box = s.box.data;
    const long top = box[0], bottom = box[1], left = box[2], right = box[3];
    SHARED
    WITHIN
    const long w = s.stride;
    const float* APART y = s.stage.data;
    const double* APART frozen = m.frozen.data;
    const double* APART warmth = m.temperature.data;
    float* APART thickness = highest.thickness.data;
    float* APART temperature = highest.temperature.data;
    for (long i = first_of(top); i <= last_of(bottom); i += lines)
        for (long p = i * w + first_column(i) + lane; p <= i * w + last_column(i); p += lanes) {
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

    @wp.func_native(_RAISE.replace('SHARED', shared(blocks)).replace('WITHIN', WITHIN))
    def raise_peaks(s: Cells, m: Heat, highest: Highest): ...

    return raise_peaks
