# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Keys of a vent in a file, and the checks of its values."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.files.keys import any_of, either, Key, Keys, list_of, number, schema_of
from lava_ros.scene.terrain import MAX_COORDINATE

#: Maximum discharge of a vent [m3/s]: a hundred times that of the largest flood basalts.
MAX_DISCHARGE = 1e8

#: Minimum and maximum eruption temperature [K]: from carbonatite to komatiite.
VENT_TEMPERATURE_RANGE = (700.0, 2000.0)

#: Check of the temperature of erupting lava.
TEMPERATURE_CHECK = partial(
    validation.number,
    at_least=VENT_TEMPERATURE_RANGE[0], at_most=VENT_TEMPERATURE_RANGE[1], unit='K',
)

#: Check of the radius of a vent.
RADIUS_CHECK = partial(validation.number, above=0.0, at_most=1e5, unit='m')

#: Check of an effusion rate.
RATE_CHECK = partial(validation.number, at_least=0.0, at_most=MAX_DISCHARGE, unit='m3/s')

Discharge = float | Sequence[tuple[float, float]]


def check_discharge(label: str, value: object) -> float | tuple[tuple[float, float], ...]:
    """Return a valid effusion rate [m3/s], or a series of (time [s], rate [m3/s]) pairs.

    Raises:
        LavaError: If the value is neither, or times do not increase.
    """
    if not isinstance(value, (list, tuple, np.ndarray)):
        return RATE_CHECK(label, value)
    pairs: list[tuple[float, float]] = []
    for index, item in enumerate(value):
        time, flux = validation.pair(f'{label}[{index}]', item, unit='(s, m3/s)')
        RATE_CHECK(f'{label}[{index}][1]', item[1])
        if pairs and time <= pairs[-1][0]:
            raise LavaError(f'{label}[{index}][0]', item[0], f'a time after {pairs[-1][0]:g} s')
        pairs.append((time, flux))
    if not pairs:
        raise LavaError(label, value, 'an effusion rate [m3/s] or at least one (s, m3/s) pair')
    return tuple(pairs)


_PAIR = {'type': 'array', 'items': [number(), schema_of(RATE_CHECK)], 'minItems': 2, 'maxItems': 2}

#: Schemas of an effusion rate: a number, and a series of (time [s], rate [m3/s]) pairs.
RATE_SCHEMAS = (schema_of(RATE_CHECK), list_of(_PAIR, 1))

_IN_MAP = partial(validation.pair, most=MAX_COORDINATE)

#: Keys of a vent in a file, of which those with the name of a field check the fields of ``Vent``.
VENT_KEYS = Keys({
    'position': Key(_IN_MAP, 'Position [x, y] in the map frame [m]'),
    'discharge': Key(
        check_discharge, 'Effusion rate [m3/s]: a number, or a series of [time [s], rate] pairs',
        schema=any_of(*RATE_SCHEMAS),
    ),
    'temperature': Key(TEMPERATURE_CHECK, 'Temperature of the erupting lava [K]'),
    'radius': Key(RADIUS_CHECK, 'Radius of the disc, or half the width of the fissure [m]'),
    'end': Key(_IN_MAP, 'The other end of a fissure [x, y] in the map frame [m]'),
    'name': Key(validation.text, 'Name in logs, messages and tables'),
    'velocity': Key(
        partial(validation.pair, unit='m/s', most=1e3),
        'Velocity [vx, vy] of the emitted lava [m/s]',
    ),
    'projected': Key(
        validation.pair,
        'Position [easting, northing] in the coordinate system of the terrain [m]',
    ),
    'projected_end': Key(validation.pair, 'The other end of a fissure [easting, northing] [m]'),
    'effusion_rate': Key(
        check_discharge, 'Effusion rate [m3/s]: a number, [time [s], rate] pairs, or a table',
        schema=any_of(*RATE_SCHEMAS),
    ),
}, (
    either('discharge', 'effusion_rate'),
    either('position', 'projected'),
    either('end', 'projected_end', optional=True),
))
