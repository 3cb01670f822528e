# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Consistency checks of the files of a case.

Physically impossible values are treated as mistakes in a file.
"""

from collections.abc import Sequence
import math

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.scene import Terrain
from lava_ros.scene.terrain_files import HIGHEST

#: Maximum median slope of a terrain (rise over run) with elevations in metres.
STEEPEST = 3.0

#: Minimum and maximum mean thickness of lava of real eruptions [m], with a margin: thin sheets of
#: Kilauea and Nyiragongo have 0.3 m, domes have tens of metres.
THINNEST, THICKEST = 0.1, 100.0

#: Maximum distance of a vent from the mapped outline that needs no check [cells].
NEAR = 10.0

#: Maximum distance of vents from the outline they belong to, over the outline's size.
FAR = 0.5

#: The outline counts as upside down if flipping brings it closer by this factor.
_NEARER = 3.0

#: Maximum height of lava above all vents, by its thickness in a pit [m].
_CLIMB = 10.0


def check_elevation(ground: Terrain) -> None:
    """Refuse elevations that do not exist on Earth, or are not in metres."""
    high = float(np.nanmax(ground.elevation))
    if high > HIGHEST:
        expected = f'metres, on Earth at most {HIGHEST:g}: feet times 0.3048'
        raise LavaError('a height of the elevation', high, expected)
    rise = np.abs(np.diff(ground.elevation, axis=1)) / ground.resolution
    rise = rise[np.isfinite(rise)]
    slope = float(np.median(rise)) if rise.size else 0.0
    if slope > STEEPEST:
        expected = f'at most {STEEPEST:g}: heights and cells both in metres'
        raise LavaError("the elevation's median slope", round(slope, 2), expected)


def check_outline(
    cells: Sequence[tuple[int, int]], ground: Terrain, footprint: np.ndarray
) -> None:
    """Refuse grids with reversed rows, and outlines of other eruptions.

    Lava starts at its vents and flows down. An outline that does so only when flipped is upside
    down; so is an elevation on which the whole outline is above its vents.

    Args:
        cells: Rows and columns of the ends of the vents.
        ground: The terrain.
        footprint: Mapped cells, bool, shape [rows, columns].
    """
    distance, turned = _distance(cells, footprint), _distance(cells, footprint[::-1])
    shown = f'{distance * ground.resolution:.0f} m from the nearest vent'
    if distance > NEAR and turned < distance / _NEARER:
        expected = f'near it; with its rows in the opposite order it is {turned:.0f} cells away: '
        raise LavaError('the footprint', shown, expected + 'its rows seem to be upside down')
    size = math.hypot(*(np.ptp(np.argwhere(footprint), axis=0) + 1))
    if distance > max(NEAR, FAR * size):
        expected = 'near it: vents and footprint are not of the same eruption'
        raise LavaError('the footprint', shown, expected)
    top = max(ground.elevation[cell] for cell in cells)
    heights = ground.elevation[footprint & ground.has_data]
    if not heights.size:
        raise LavaError('the elevation', 'no data under the footprint', 'data there')
    above = float((heights > top + _CLIMB).mean())
    if above > 0.5:
        expected = 'below them: lava does not flow up; the elevation, on which the highest vent '
        expected += f'is at {top:.0f} m and the lava at {np.median(heights):.0f} m, seems to be '
        shown = f'{100 * above:.0f} % above all vents'
        raise LavaError('the footprint', shown, expected + 'upside down')


def check_discharge(volume: float, area: float) -> None:
    """Refuse a volume in the wrong unit [m3]: lava on an area [m2] too thin or too thick."""
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
