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


"""Whether the files of a case go together: what nature does not do is a mistake in a file."""

from collections.abc import Sequence
import math

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.hindcast.tables import VentRow
from lava_ros.scene import Terrain

#: Lowest and highest ground on Earth [m], with room to spare.
LOWEST, HIGHEST = -450.0, 9000.0

#: Median slope of a terrain (rise over run) above which its heights are not in metres.
STEEPEST = 3.0

#: Mean thickness of the lava on what it covered that any eruption has had [m], with room to
#: spare: thin sheets of Kilauea and Nyiragongo have 0.3 m, domes have tens.
THINNEST, THICKEST = 0.1, 100.0

#: Cells that a vent may be from the footprint without anybody being asked about it.
NEAR = 10.0

#: Times nearer that the footprint has to be when it is turned over.
_NEARER = 3.0

#: Height above all vents that lava may reach by its own thickness, out of a pit [m].
_CLIMB = 10.0

#: Distance of the vents over the footprint's size from which on they do not belong together.
FAR = 0.5


def check_elevation(ground: Terrain) -> None:
    """Refuse heights that are none.

    Raises:
        LavaError: They are out of what there is on Earth, or not in metres.
    """
    known = ground.elevation[ground.has_data]
    low, high = float(known.min()), float(known.max())
    if low < LOWEST or high > HIGHEST:
        wrong = low if low < LOWEST else high
        right = f'{LOWEST:g} to {HIGHEST:g} m; a cell without data has the value that the header '
        raise LavaError('a height of the elevation', wrong, right + 'calls NODATA_value')
    rise = np.abs(np.diff(ground.elevation, axis=1)) / ground.resolution
    rise = rise[np.isfinite(rise)]
    slope = float(np.median(rise)) if rise.size else 0.0
    if slope > STEEPEST:
        right = f'at most {STEEPEST:g}: heights and cells both in metres'
        raise LavaError("the elevation's median slope", round(slope, 2), right)


def check_vent_rows(vents: Sequence[VentRow], ground: Terrain) -> None:
    """Refuse vents that are not on the ground.

    Raises:
        LavaError: A vent is outside the grid, or on a cell without data.
    """
    for vent in vents:
        for place in vent.places:
            cell = ground.cell_at(*ground.to_map(*place))
            name = f'{vent.name!r} of vent.csv'
            if cell is None:
                right = f'a place {ground.bounds(projected=True)}'
                raise LavaError(name, place, right + _other_system(place, ground))
            if not ground.has_data[cell]:
                right = 'a place where the elevation has data: this cell has none'
                raise LavaError(name, place, right)


def check_rows(vents: Sequence[VentRow], ground: Terrain, footprint: np.ndarray) -> None:
    """Refuse grids whose rows are in the wrong order, and vents of another eruption.

    Lava begins at its vents and goes down. A footprint that does so only when it is turned over
    is upside down; so is an elevation on which it all lies above its vents.

    Raises:
        LavaError: Vents and grids do not go together.
    """
    cells = np.array(
        [ground.cell_at(*ground.to_map(*place)) for vent in vents for place in vent.places]
    )
    distance = _distance(cells, footprint)
    turned = _distance(cells, footprint[::-1])
    shown = f'{distance * ground.resolution:.0f} m from the nearest vent'
    if distance > NEAR and turned < distance / _NEARER:
        right = f'near it; with its rows in the opposite order it is {turned:.0f} cells away: '
        raise LavaError('the footprint', shown, right + 'its rows seem to be upside down')
    covered = np.argwhere(footprint)
    size = math.hypot(*(np.ptp(covered, axis=0) + 1))
    if distance > max(NEAR, FAR * size):
        right = 'near it: vents and footprint are not of the same eruption'
        raise LavaError('the footprint', shown, right)
    tops = ground.elevation[cells[:, 0], cells[:, 1]]
    heights = ground.elevation[footprint]
    heights = heights[np.isfinite(heights)]
    if not heights.size:
        raise LavaError('the elevation', 'no data under the footprint', 'data there')
    above = float((heights > tops.max() + _CLIMB).mean())
    if above > 0.5:
        right = 'below them: lava does not flow up; the elevation, on which the highest vent is '
        right += f'at {tops.max():.0f} m and the lava at {np.median(heights):.0f} m, seems to be '
        raise LavaError(
            'the footprint', f'{100 * above:.0f} % above all vents', right + 'upside down'
        )


def check_discharge(volume: float, footprint: np.ndarray, resolution: float) -> None:
    """Refuse a discharge in the wrong unit: the lava would be far too thin or too thick.

    Raises:
        LavaError: No lava is as thick.
    """
    area = float(footprint.sum()) * resolution**2
    thickness = volume / area
    if THINNEST <= thickness <= THICKEST:
        return
    too = 'little' if thickness < THINNEST else 'much'
    raise LavaError(
        'the mean thickness of the lava',
        f'{thickness:.3g} m',
        f'{THINNEST:g} to {THICKEST:g} m: effusion_rate.csv gives {volume:.3g} m3, too {too} for '
        f'the {area:.3g} m2 of the footprint; is discharge_m3_per_s in m3/s, and are start_s and '
        'end_s in s?',
    )


def _distance(cells: np.ndarray, footprint: np.ndarray) -> float:
    """Distance of the nearest vent from the footprint, in cells."""
    covered = np.argwhere(footprint)
    return min(float(np.hypot(*(covered - cell).T).min()) for cell in cells)


def _other_system(place: tuple[float, float], ground: Terrain) -> str:
    """What may be wrong with a place that is far away."""
    x, y = place
    x0, y0, x1, y1 = ground.extent
    east, north = ground.offset
    if abs(x) <= 180.0 and abs(y) <= 90.0 and abs(east) + abs(north) > 1e3:
        right = ': these are degrees of another place (longitude comes first), or the elevation '
        return right + 'has no coordinate system (epsg in case.yaml)'
    size = max(x1 - x0, y1 - y0)
    away = math.hypot(x - east - 0.5 * (x0 + x1), y - north - 0.5 * (y0 + y1))
    if away > 10.0 * size:
        return ': these are coordinates of another system, or another place'
    return ''
