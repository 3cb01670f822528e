# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Simulations of a mapped eruption that start from one of its outlines.

The lava that erupted before the time of the outline lies in the outline at the start, and vents
continue with their effusion rates after this time.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.files.keys import Key, Keys
from lava_ros.scene.emplaced import emplace, EmplacedFlow, profile_of, SOLIDIFIED_CHECK
from lava_ros.scene.features import ENDINGS
from lava_ros.scene.on_terrain import read_cover_on, read_polygons_on
from lava_ros.scene.onset import Onset
from lava_ros.scene.terrain import Terrain
from lava_ros.scene.vent_files import Series

#: Keys of ``from_outline`` in ``case.yaml``.
FROM_OUTLINE_KEYS = Keys({
    'time': Key(
        {'type': ['number', 'string']}, 'Time of one of the outlines [s], or its date', True
    ),
    'solidified': Key(
        SOLIDIFIED_CHECK, 'Lower fraction of its lava that is solid, and ground; 0 if left out'
    ),
})


@dataclass(frozen=True, eq=False)
class InitialFlow:
    """The flow at the start of a simulation that starts from an outline.

    Attributes:
        time: Time of the outline on the clock of the case [s].
        covered: Cells in the outline, bool, shape [rows, columns], row 0 in the south.
        ground: Terrain raised by the solidified lava.
        flow: The lava that can flow.
    """

    time: float
    covered: np.ndarray
    ground: Terrain
    flow: EmplacedFlow


def initial_flow(
    given: Mapping[str, Any], outlines: Sequence[Mapping[str, Any]], folder: Path,
    ground: Terrain, series: Sequence[Series], *, first: float, origin: datetime | None,
    label: str,
) -> InitialFlow:
    """Return the lava that erupted before the time of an outline, spread over the outline.

    Args:
        given: Plain data with ``FROM_OUTLINE_KEYS``.
        outlines: Outlines of the case, as in its file.
        folder: Folder to which file names are relative.
        ground: Terrain before the eruption.
        series: Effusion rates of the vents, (time [s], rate [m3/s]) on the clock of the case.
        first: Start of the eruption on this clock [s].
        origin: Date of time 0 of this clock; None if unknown.
        label: Name of ``given`` in errors.

    Raises:
        LavaError: If the case has no outline of this time, or no lava erupted before it.
    """
    data = FROM_OUTLINE_KEYS(label, given)
    onset = None if origin is None else Onset(origin)
    time = time_of_outline(f'{label}.time', data['time'], 0.0, onset)
    known = [time_of_outline('case.outlines.time', item['time'], 0.0, onset) for item in outlines]
    if time not in known:
        expected = f'the time of an outline: {", ".join(str(item["time"]) for item in outlines)}'
        raise LavaError(f'{label}.time', data['time'], expected)
    volume = sum(_emitted(item, first, time) for item in series)
    if volume <= 0.0:
        raise LavaError(f'{label}.time', data['time'], 'a time at which lava has erupted')
    name = outlines[known.index(time)]['file']
    covered = read_outline(folder / name, ground)
    thickness = profile_of(covered, volume, ground.resolution)
    ground, flow = emplace(thickness, ground, name, solidified=data.get('solidified', 0.0))
    return InitialFlow(time, covered, ground, flow)


def with_outline(inundated: np.ndarray, outlined: np.ndarray) -> np.ndarray:
    """Return the fraction of each cell that lava has covered, with the outline of the start.

    It is the larger fraction, because the lava in the outline is a part of the simulated flow,
    which shows less of it where it is solid or thinner than the threshold.

    Args:
        inundated: Fraction of each cell that the simulated flow has covered, NaN without data, any
            shape.
        outlined: Fraction of each cell that is in the outline, same shape.
    """
    return np.maximum(inundated, outlined)


def read_outline(path: Path, ground: Terrain) -> np.ndarray:
    """Return the cells of a terrain in a mapped outline, of areas or of a grid of 0 and 1."""
    read = read_polygons_on if path.suffix.lower() in ENDINGS else read_cover_on
    return read(ground, path, field='the footprint')


def time_of_outline(where: str, value: object, start: float, onset: Onset | None) -> float:
    """Return a time since the start of the simulation [s].

    Args:
        where: Name of the value in errors.
        value: Time on the clock of the case [s], or a date in ISO 8601.
        start: Start of the simulation on the clock of the case [s].
        onset: Date of the start of the simulation; None without one.

    Raises:
        LavaError: If the value is neither, or is a date and there is no onset.
    """
    if not isinstance(value, str):
        return validation.number(where, value, unit='s') - start
    date = validation.date(where, value, 'a time [s], or ')
    if onset is None:
        expected = 'a time [s]; a date also needs the date of time 0, effusion_rate: {start: DATE}'
        raise LavaError(where, value, expected)
    return (date - onset.start).total_seconds()


def _emitted(series: Series, first: float, last: float) -> float:
    """Return the volume [m3] that a vent emits between two times [s]."""
    times = np.clip([*(time for time, _ in series), np.inf], first, last)
    return float(np.diff(times) @ [rate for _, rate in series])
