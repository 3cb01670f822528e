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

"""Footprints of flows and their mirror images, compared."""

import numpy as np

from lava_ros.simulation import Snapshot


def footprint(snapshot: Snapshot) -> np.ndarray:
    """Cells with lava, bool, shape [rows, columns]."""
    return np.nan_to_num(snapshot.thickness) > 0.0


def footprint_change(one: np.ndarray, other: np.ndarray) -> float:
    """Distance between two footprints' borders over their radius.

    The area that only one of them covers over twice the mean area: dR / R for discs. 0 where both
    are empty.
    """
    area = one.sum() + other.sum()
    return float((one ^ other).sum() / area) if area else 0.0


def asymmetry(snapshot: Snapshot) -> float:
    """Largest difference of thickness from its mirror image left to right, over the largest."""
    thickness = np.nan_to_num(snapshot.thickness)
    largest = float(thickness.max())
    return float(np.abs(thickness - thickness[:, ::-1]).max()) / largest if largest else 0.0
