# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Consistency checks of the files of a case.

Physically impossible values are treated as mistakes in a file.
"""

from collections.abc import Sequence
import math

import numpy as np

from lava_ros.errors import LavaError, RefusalError
from lava_ros.scene import Terrain
from lava_ros.scene.terrain_files import HIGHEST

#: Maximum median slope of a terrain (rise over run) with elevations in metres.
STEEPEST = 3.0

#: Minimum and maximum mean thickness of lava of real eruptions [m], with a margin: thin sheets of
#: Kilauea and Nyiragongo have 0.3 m, domes have tens of metres.
THINNEST, THICKEST = 0.1, 100.0

#: Maximum distance of a vent from the mapped outline that needs no check [cells].
NEAR = 10.0

#: Maximum distance of vents from the outline of their eruption, over the outline's size.
FAR = 0.5

#: The outline counts as upside down if flipping brings it closer by this factor.
_NEARER = 3.0

#: Maximum height of lava above all vents, due to its thickness in a pit [m].
_CLIMB = 10.0


def check_elevation(ground: Terrain) -> None:
    """Refuse elevations that do not exist on Earth, or are not in metres."""
    high = float(np.nanmax(ground.elevation))
    if high > HIGHEST:
        expected = f'at most {HIGHEST:g} m; multiply feet by 0.3048'
        raise LavaError('the largest elevation', high, expected)
    rise = np.abs(np.diff(ground.elevation, axis=1)) / ground.resolution
    rise = rise[np.isfinite(rise)]
    slope = float(np.median(rise)) if rise.size else 0.0
    if slope > STEEPEST:
        expected = f'at most {STEEPEST:g}, with heights and cells both in metres'
        raise LavaError("the elevation's median slope", round(slope, 2), expected)


def check_outline(
    cells: Sequence[tuple[int, int]], ground: Terrain, footprint: np.ndarray
) -> None:
    """Refuse grids with reversed rows, and outlines of other eruptions.

    Lava starts at its vents and flows down. If only the flipped outline fits this, it is upside
    down. If the whole outline is above its vents, the elevation is upside down.

    Args:
        cells: Rows and columns of the ends of the vents.
        ground: The terrain.
        footprint: Mapped cells, bool, shape [rows, columns].
    """
    distance, turned = _distance(cells, footprint), _distance(cells, footprint[::-1])
    problem = f'The footprint is {distance * ground.resolution:.0f} m from the nearest vent'
    if distance > NEAR and turned < distance / _NEARER:
        problem += f', and {turned:.0f} cells with reversed rows: its rows seem to be upside down'
        raise RefusalError('the footprint', problem, 'Reverse their order')
    size = math.hypot(*(np.ptp(np.argwhere(footprint), axis=0) + 1))
    if distance > max(NEAR, FAR * size):
        remedy = 'Use vents and a footprint of the same eruption'
        raise RefusalError('the footprint', problem, remedy)
    top = max(ground.elevation[cell] for cell in cells)
    heights = ground.elevation[footprint & ground.has_data]
    if not heights.size:
        problem = 'The elevation has no data under the footprint'
        raise RefusalError('the elevation', problem, 'Use an elevation that covers it')
    above = float((heights > top + _CLIMB).mean())
    if above > 0.5:
        problem = f'{100 * above:.0f} % of the footprint is above all vents: the elevation, with '
        problem += f'the highest vent at {top:.0f} m and the lava at {np.median(heights):.0f} m, '
        problem += 'seems to be upside down'
        raise RefusalError('the elevation', problem, 'Reverse the order of its rows')


def check_discharge(volume: float, area: float) -> None:
    """Refuse a volume [m3] that makes the lava on an area [m2] too thin or too thick."""
    thickness = volume / area
    if not THINNEST <= thickness <= THICKEST:
        too = 'little' if thickness < THINNEST else 'much'
        raise LavaError(
            'the mean thickness of the lava',
            f'{thickness:.3g} m',
            f'{THINNEST:g} to {THICKEST:g} m: effusion_rate.csv gives {volume:.3g} m3, too {too} '
            f'for the {area:.3g} m2 of the footprint; are its rates in m3/s, and its '
            'times (start_s, end_s) in s?',
        )


def _distance(cells: Sequence[tuple[int, int]], footprint: np.ndarray) -> float:
    covered = np.argwhere(footprint)
    return min(float(np.hypot(*(covered - cell).T).min()) for cell in cells)
