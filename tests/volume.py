# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Comparison of a map with the budget of the lava's volume."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from lava_ros.simulation import Snapshot

#: Maximum difference between a map and the budget, as a fraction of the volume on the map: a
#: particle's volume in a cell is rounded to float32 six times by 6e-8, and compensated sums add as
#: much as four more, for any number of cells and particles (docs/MODEL.md).
MAP_TOLERANCE = 1e-6

#: Rounding of the budget, as a fraction of the emitted volume: of volumes of particles, which are
#: float32, and of sums in float64.
SINGLE, DOUBLE = 1e-6, 1e-12


def volume_errors(snapshot: Snapshot, rounding: float) -> list[str]:
    """Return where a snapshot and its budget differ, as text.

    ``rounding`` is the maximum error of the budget, as a fraction of the emitted volume.
    """
    budget, cell = snapshot.budget, snapshot.terrain.resolution**2
    maps = {
        'lava': (snapshot.thickness, budget.flowing + budget.solidified),
        'solidified lava': (snapshot.frozen, budget.solidified),
    }
    # False if the error is not a number
    errors = [] if budget.error <= rounding else [budget.text()]
    for name, (thickness, expected) in maps.items():
        found = 0.0
        if thickness is not None:
            found = float(np.nansum(thickness, dtype=np.float64)) * cell
        # False if a volume is not a number
        if not abs(found - expected) <= MAP_TOLERANCE * abs(expected) + DOUBLE * budget.emitted:
            errors.append(f'{found} m3 of {name} on the map, {expected} m3 in the budget')
    return errors
