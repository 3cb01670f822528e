# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Checks whether the files of a case go together, and effusion rates divided among vents.

What nature does not do is a mistake in a file.
"""

from collections.abc import Sequence
from itertools import pairwise
import math

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.scene import Terrain
from lava_ros.scene.effusion_rates import Interval
from lava_ros.scene.projection import is_degrees
from lava_ros.scene.vent_files import VentRow

#: A discharge as (time [s], flux [m3/s]) pairs of increasing time; each holds until the next.
Series = tuple[tuple[float, float], ...]

#: Lowest and highest ground on Earth [m], with room to spare.
LOWEST, HIGHEST = -450.0, 9000.0

#: Median slope of a terrain (rise over run) above which its heights are not in metres.
STEEPEST = 3.0

#: Mean thickness of the lava on what it covered that any eruption has had [m], with room to
#: spare: thin sheets of Kilauea and Nyiragongo have 0.3 m, domes have tens.
THINNEST, THICKEST = 0.1, 100.0

#: Cells that a vent may be from the footprint without anybody being asked about it.
NEAR = 10.0

#: Distance of the vents over the footprint's size from which on they do not belong together.
FAR = 0.5

#: Times nearer that the footprint has to be when it is turned over.
_NEARER = 3.0

#: Height above all vents that lava may reach by its own thickness, out of a pit [m].
_CLIMB = 10.0


def series_of(vents: tuple[VentRow, ...], rates: tuple[Interval, ...]) -> list[Series]:
    """Divide the discharge among the vents that are open; LavaError where none is."""
    spans = [(item.start, item.end) for item in rates]
    spans += [(vent.start, vent.end) for vent in vents]
    for vent in vents:
        if vent.discharge is not None and not isinstance(vent.discharge, float):
            right = 'one number: the effusion rates of a case are those of its table'
            raise LavaError(f'effusion rate of {vent.name}', 'a series', right)
    result: list[list[tuple[float, float]]] = [[] for _ in vents]
    row = 0
    has_shares = any(vent.discharge is None for vent in vents)
    for time in sorted({time for span in spans for time in span if math.isfinite(time)}):
        # rows end one after the other
        while row < len(rates) and rates[row].end <= time:
            row += 1
        is_on = row < len(rates) and rates[row].start <= time
        discharge = rates[row].discharge if is_on else 0.0
        is_erupting = rates[0].start <= time < rates[-1].end
        is_open = [is_erupting and vent.start <= time < vent.end for vent in vents]
        shares = [
            vent.share if vent.discharge is None and now else 0.0
            for vent, now in zip(vents, is_open, strict=True)
        ]
        if discharge > 0.0 and has_shares and not any(shares):
            right = 'at least one row of vent.csv with start_s <= t < end_s: lava comes out then'
            raise LavaError(f'vents open at {time:g} s', 0, right)
        for series, share, vent, now in zip(result, shares, vents, is_open, strict=True):
            flux = discharge * share / sum(shares) if share else 0.0
            if isinstance(vent.discharge, float):
                flux = vent.discharge if now else 0.0
            if not series or flux != series[-1][1]:
                series.append((time, flux))
    return [tuple(series) for series in result]


def check_elevation(ground: Terrain) -> None:
    """Refuse heights that are out of what there is on Earth, or not in metres."""
    low, high = float(np.nanmin(ground.elevation)), float(np.nanmax(ground.elevation))
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


def check_places(vents: Sequence[VentRow], ground: Terrain, footprint: np.ndarray) -> None:
    """Refuse vents off the ground, grids whose rows are in the wrong order, other eruptions.

    Lava begins at its vents and goes down. A footprint that does so only when it is turned over
    is upside down; so is an elevation on which it all lies above its vents.
    """
    found = []
    for name, place in ((vent.name, place) for vent in vents for place in vent.places):
        cell = ground.cell_at(*ground.to_map(*place))
        if cell is None:
            right = f'a place {ground.bounds(projected=True)}'
            raise LavaError(f'{name!r} of vent.csv', place, right + _other_system(place, ground))
        if not ground.has_data[cell]:
            right = 'a place where the elevation has data: this cell has none'
            raise LavaError(f'{name!r} of vent.csv', place, right)
        found.append(cell)
    distance, turned = _distance(found, footprint), _distance(found, footprint[::-1])
    shown = f'{distance * ground.resolution:.0f} m from the nearest vent'
    if distance > NEAR and turned < distance / _NEARER:
        right = f'near it; with its rows in the opposite order it is {turned:.0f} cells away: '
        raise LavaError('the footprint', shown, right + 'its rows seem to be upside down')
    size = math.hypot(*(np.ptp(np.argwhere(footprint), axis=0) + 1))
    if distance > max(NEAR, FAR * size):
        right = 'near it: vents and footprint are not of the same eruption'
        raise LavaError('the footprint', shown, right)
    top = max(ground.elevation[cell] for cell in found)
    heights = ground.elevation[footprint & ground.has_data]
    if not heights.size:
        raise LavaError('the elevation', 'no data under the footprint', 'data there')
    above = float((heights > top + _CLIMB).mean())
    if above > 0.5:
        right = 'below them: lava does not flow up; the elevation, on which the highest vent is '
        right += f'at {top:.0f} m and the lava at {np.median(heights):.0f} m, seems to be '
        shown = f'{100 * above:.0f} % above all vents'
        raise LavaError('the footprint', shown, right + 'upside down')


def check_discharge(vents: Sequence[Series], area: float) -> None:
    """Refuse a discharge in the wrong unit: lava on an area [m2] too thin or too thick.

    ``vents`` is what ``series_of`` gives; each series ends with 0.
    """
    volume = sum(
        flux * (end - start) for series in vents for (start, flux), (end, _) in pairwise(series)
    )
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
    """Distance of the nearest vent from the footprint, in cells."""
    covered = np.argwhere(footprint)
    return min(float(np.hypot(*(covered - cell).T).min()) for cell in cells)


def _other_system(place: tuple[float, float], ground: Terrain) -> str:
    """What may be wrong with a place that is far away."""
    x, y = ground.to_map(*place)
    x0, y0, x1, y1 = ground.extent
    if is_degrees(place) and sum(map(abs, ground.offset)) > 1e3:
        right = ': these are degrees of another place (longitude comes first), or the elevation '
        return right + 'has no coordinate system (epsg in case.yaml)'
    away = math.hypot(x - 0.5 * (x0 + x1), y - 0.5 * (y0 + y1))
    if away > 10.0 * max(x1 - x0, y1 - y0):
        return ': these are coordinates of another system, or another place'
    return ''
