# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Colours of maps: a style for each quantity, and a colour scale for the values of a map."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
import math
from typing import Any

import numpy as np

from lava_ros.layers.layer import HAZARD_CLASSES

#: Colours of the ground from low to high: muted, so that the lava stands out.
GROUND = ('#7f8f7a', '#a3a383', '#bfb293', '#cfc4ae', '#e4ded2')


@dataclass(frozen=True)
class Style:
    """Title, unit and colours of a map, the colours from the lowest value to the highest.

    ``classes`` maps the largest value of each class above 0 to its name, lowest first; each class
    has one colour. It is empty for a map of continuous values.
    """

    title: str
    label: str
    colours: Sequence[str]
    classes: Mapping[float, str] = field(default_factory=dict)


#: Styles of maps by quantity. The comparison is readable with red-green colour blindness.
STYLES = {
    'thickness': Style(
        'Lava thickness', 'm',
        ('#2a0a3d', '#6a176e', '#a92e5e', '#e2583b', '#fb9a06', '#fbe66a'),
    ),
    'temperature': Style(
        'Temperature', '°C',
        ('#1c1014', '#5b0f14', '#a11d12', '#dc4a10', '#f79420', '#fee08a', '#fffbe6'),
    ),
    'hazard': Style(
        'Hazard index', '', ('#feb24c', '#a50026'), HAZARD_CLASSES,
    ),
    'arrival': Style(
        'First arrival time', 's',
        # lighter with time, also in grey
        ('#4a0012', '#8a1a2e', '#bd3f35', '#d97741', '#ddae5c', '#bcd49b', '#c9ecf2'),
    ),
    'inundated': Style(
        'Inundated fraction of the cell', '', ('#fff3c4', '#f99a3b', '#a81d1d'),
    ),
    'probability': Style(
        'Inundation probability', '%',
        ('#fff3c4', '#fdd17a', '#f99a3b', '#e2571e', '#a81d1d', '#5a0a2a'),
    ),
    'change': Style(
        'Change of inundation probability', 'percentage points',
        ('#08306b', '#2171b5', '#6baed6', '#c6dbef', '#f7f7f7', '#fdd0a2', '#fd8d3c', '#d94801',
         '#7f2704'),
    ),
    'elevation': Style('Elevation', 'm', GROUND),
    'comparison': Style(
        'Simulated and mapped', '',
        ('#f2b134', '#2166ac', '#b2182b'),
        {1.0: 'hit', 2.0: 'miss', 3.0: 'false alarm'},
    ),
    'barriers': Style(
        'Difference', '', ('#2166ac', '#b2182b'),
        {1.0: 'lava without barriers only', 2.0: 'lava with barriers only'},
    ),
}

#: Labels of colour bars by unit of time.
UNIT_WORDS = {
    'd': 'days after the start',
    'h': 'hours after the start',
    'min': 'minutes after the start',
    's': 'seconds after the start',
}


@dataclass(frozen=True)
class Scale:
    """Colour scale of a map: a matplotlib colour map and its normalisation.

    ``past`` is the side on which values exceed the scale: ``neither`` or ``max``. ``label`` names
    the unit of the scale, and ``unit`` is its size in the unit of the style. ``names`` are the
    names of classes; empty for numeric values.
    """

    colours: Any
    norm: Any
    past: str
    label: str
    unit: float = 1.0
    names: Sequence[str] = ()


def limits_of(source: str, values: np.ndarray) -> tuple[float, float]:
    """Return the values of the first and the last colour of a map, which are round numbers.

    ``source`` is a key of ``STYLES``; ``values`` are the values of the map, NaN where it is empty.
    """
    known = values[np.isfinite(values)]
    most = float(known.max()) if known.size else 1.0
    if STYLES[source].classes:
        return 0.0, max(STYLES[source].classes)
    if source == 'probability':
        return 0.0, 100.0
    if source == 'inundated':
        return 0.0, 1.0
    if source == 'change':
        return -100.0, 100.0
    if source == 'arrival':
        unit = time_unit(most)[1]
        return 0.0, unit * round_up(max(most / unit, 1e-6))
    if source == 'elevation':
        low = float(known.min()) if known.size else 0.0
        return low, most if most > low else low + 1.0
    if source == 'temperature':
        low = math.floor(float(known.min()) / 100.0) * 100.0 if known.size else 0.0
        return low, max(math.ceil(most / 100.0) * 100.0, low + 100.0)
    # a few thick cells must not give all others one colour
    return 0.0, round_up(max(float(np.percentile(known, 99.5)), 1e-6)) if known.size else 1.0


def time_unit(longest: float) -> tuple[str, float]:
    """Return name and length [s] of the unit for times up to a longest one [s]."""
    units = (('d', 86_400.0), ('h', 3600.0), ('min', 60.0))
    return next((item for item in units if longest >= 2.0 * item[1]), ('s', 1.0))


def scale_of(source: str, values: np.ndarray, *, is_saturated: bool = False) -> Scale:
    """Choose the colour scale of a map from its values, NaN where it is empty.

    ``source`` is a key of ``STYLES``. With ``is_saturated``, true values may exceed those given.
    """
    from matplotlib.colors import BoundaryNorm, LinearSegmentedColormap, ListedColormap, Normalize

    style = STYLES[source]
    if style.classes:
        norm = BoundaryNorm(np.array([0.0, *style.classes]) + 0.5, len(style.classes))
        names = tuple(style.classes.values())
        return Scale(ListedColormap(style.colours), norm, 'neither', '', names=names)
    colours = LinearSegmentedColormap.from_list(source, style.colours)
    low, high = limits_of(source, values)
    most = float(np.max(values, where=np.isfinite(values), initial=-math.inf))
    label, unit = time_unit(most) if source == 'arrival' else (style.label, 1.0)
    past = 'max' if is_saturated or most > high else 'neither'
    return Scale(colours, Normalize(low / unit, high / unit), past, label, unit)


def round_up(
    value: float, steps: Sequence[float] = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
) -> float:
    """Return the smallest step times a power of ten that is at or above a value."""
    power = 10.0 ** math.floor(math.log10(value))
    return power * next(step for step in steps if step * power >= value * (1.0 - 1e-9))


def picture_of(values: np.ndarray, ground: np.ndarray, scale: Scale) -> np.ndarray:
    """Draw a map over the ground: RGBA 0..1, shape [rows, columns, 4]; NaN leaves the ground."""
    picture = ground.copy()
    here = np.isfinite(values)
    # only the brightness of the relief shows through the lava
    bright = ground[..., :3].mean(axis=-1)
    shown = scale.colours(scale.norm(values[here] / scale.unit))[..., :3]
    picture[here, :3] = shown * (0.72 + 0.4 * bright[here])[:, None]
    return np.asarray(np.clip(picture, 0.0, 1.0))
