# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Outlines of one eruption that were mapped at several times."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.scene.file_keys import OUTLINE_KEYS
from lava_ros.scene.from_outline import time_of_outline
from lava_ros.scene.onset import Onset


@dataclass(frozen=True, eq=False)
class Outline:
    """A mapped flow field.

    Attributes:
        time: Time of the map since the start of the simulation [s].
        text: Its date, or its time on the clock of the case.
        footprint: Mapped cells, bool, shape [rows, columns], row 0 in the south.
    """

    time: float
    text: str
    footprint: np.ndarray


def read_outlines(
    items: object, folder: Path, read: Callable[[Path], np.ndarray], *, start: float,
    onset: Onset | None, starts_from_outline: bool = False,
) -> tuple[Outline, ...]:
    """Read the outlines that ``case.yaml`` lists.

    Args:
        items: List of mappings with ``time``, in s on the clock of the case or as a date in ISO
            8601, and ``file``, a footprint.
        folder: Folder to which file names are relative.
        read: Function that reads a footprint on the cells of the case.
        start: Start of the simulation on the clock of the case [s].
        onset: Date of the start of the simulation; None without one: dates are then refused.
        starts_from_outline: True to leave out outlines up to the start.

    Raises:
        LavaError: If a value or a file cannot be used, or times do not increase.
    """
    outlines: list[Outline] = []
    expected = 'a list of outlines, at least one'
    for where, item in validation.items('case.outlines', items, expected, least=1):
        data = OUTLINE_KEYS(where, item)
        time = time_of_outline(f'{where}.time', data['time'], start, onset)
        if starts_from_outline and time <= 0.0:
            continue
        least = outlines[-1].time if outlines else 0.0
        if time <= least:
            expected = f'a time after {"the outline before" if outlines else "the start"}'
            raise LavaError(f'{where}.time', data['time'], expected)
        path = folder / data['file']
        if not path.is_file():
            raise LavaError(f'{where}.file', data['file'], f'a file in {folder}')
        text = f'{start + time:.10g} s' if onset is None else onset.utc(time)
        outlines.append(Outline(time, text, read(path)))
    if not outlines:
        raise LavaError('case.outlines', 'no later outline', 'one after that of the start')
    return tuple(outlines)

