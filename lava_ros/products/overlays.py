# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Points, lines and areas of users' files on a map: reach, style and names."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
import logging
from typing import Any

import numpy as np

from lava_ros.products import labels
from lava_ros.products.plot import halo, Window
from lava_ros.scene.features import Feature

_LOG = logging.getLogger(__name__)

#: Maximum distance of places on the map from the lava, as a multiple of the longer side of the
#: rectangle around lava and vents. The lava then takes at least a fifth of the width of the map.
REACH = 2.0

#: Maximum number of names on a map.
MAX_NAMES = 200

#: Colours, markers and lines; the first 25 files have different combinations.
COLOURS = ('#0b3c8c', '#111111', '#00693c', '#7b1fa2', '#8c510a')
_MARKERS = ('o', 's', 'D', 'P', 'v')
_LINES: tuple[Any, ...] = ('-', '--', '-.', ':', (0, (6, 1.5, 1, 1.5, 1, 1.5)))

#: Size of a marker and of the marker of a vent [points].
_MARKER_SIZE, _VENT_SIZE = 5.5, 7.0

#: Number of sample points along a line per width of the map, and its maximum.
_SAMPLES, _MAX_SAMPLES = 100, 20_000


@dataclass(frozen=True)
class OverlayStyle:
    """Style of the features of one file."""

    colour: str
    marker: str
    line: Any

    @classmethod
    def of(cls, number: int) -> 'OverlayStyle':
        """Return the style of the file with this number, which counts from 0."""
        turn = (number + number // len(COLOURS)) % len(_MARKERS)
        return cls(COLOURS[number % len(COLOURS)], _MARKERS[turn], _LINES[turn])

    @property
    def point(self) -> dict[str, Any]:
        """Properties of a matplotlib line that is a point."""
        return {
            'linestyle': 'none', 'marker': self.marker, 'markersize': _MARKER_SIZE,
            'color': self.colour, 'markeredgecolor': 'white', 'markeredgewidth': 0.7,
        }

    @property
    def path(self) -> dict[str, Any]:
        """Properties of a matplotlib line along a line or around an area."""
        return {'color': self.colour, 'linewidth': 1.4, 'linestyle': self.line}

    def handle(self, features: Sequence[Feature]) -> Any:
        """Return the legend symbol of a file with these features."""
        from matplotlib.lines import Line2D

        kinds = {feature.kind == 'Point' for feature in features}
        path = self.path if False in kinds else {}
        point = self.point if True in kinds else {}
        return Line2D([], [], **{**point, **path})


def bounds_with_places(
    bounds: Window, limits: Window, overlays: Iterable[Sequence[Feature]]
) -> Window:
    """Return a window that contains the lava and all places within its reach.

    Args:
        bounds: Rectangle around lava and vents [m].
        limits: Rectangle of the terrain; places outside it are not shown.
        overlays: Features of each file, in the same coordinates. Each vertex of a line or an area
            counts as a place.
    """
    reach = REACH * max(bounds[2] - bounds[0], bounds[3] - bounds[1])
    low = np.maximum(np.subtract(bounds[:2], reach), limits[:2])
    high = np.minimum(np.add(bounds[2:], reach), limits[2:])
    rings = [ring for features in overlays for feature in features for ring in feature.rings]
    places = np.concatenate([np.reshape(bounds, (2, 2)), *rings])
    near = places[_inside(places, (*low, *high)) | (np.arange(len(places)) < 2)]
    return (*near.min(axis=0).tolist(), *near.max(axis=0).tolist())


def hidden(features: Sequence[Feature], window: Window) -> list[Feature]:
    """Return the features that are completely outside the map."""
    return [
        feature
        for feature in features
        if not any(_inside(_samples(ring, window), window).any() for ring in feature.rings)
        and not _surrounds(feature, window)
    ]


def draw_overlays(
    axes: Any,
    overlays: Iterable[tuple[Sequence[Feature], OverlayStyle]],
    window: Window,
    offset: tuple[float, float],
    vents: np.ndarray,
) -> None:
    """Draw the features of files with their names, and remove labels of lines that they cover.

    Args:
        axes: Axes of the map.
        overlays: Features of each file in projected coordinates [m], and their style.
        window: Extent of the map, in the coordinates of the axes [m].
        offset: Easting and northing [m] of the origin of the axes.
        vents: Positions of vents in the coordinates of the axes [m], shape [count, 2].
    """
    names: list[tuple[str, np.ndarray, OverlayStyle, bool]] = []
    points: list[np.ndarray] = []
    for features, style in overlays:
        most: dict[str, int] = {}
        for feature in features:
            is_point = feature.kind == 'Point'
            look = style.point if is_point else style.path
            parts = [ring - offset for ring in feature.rings]
            for ring in parts:
                axes.plot(
                    *ring.T, path_effects=halo(), zorder=5, scalex=False, scaley=False, **look
                )
            visible = np.concatenate([_samples(ring, window) for ring in parts])
            visible = visible[_inside(visible, window)]
            if is_point and len(visible):
                points.append(visible[0])
            name, place = feature.name, _place_of_name(feature, visible, window, offset)
            if not name or place is None:
                continue
            if not is_point:
                # parts with one name are labelled once, on the most visible part
                if len(visible) < most.get(name, -1):
                    continue
                names = [item for item in names if item[::2] != (name, style) or item[3]]
                most[name] = len(visible)
            names.append((name, place, style, is_point))
    if len(names) > MAX_NAMES:
        _LOG.warning(f'only {MAX_NAMES} of {len(names)} names of overlays are written on the map')
    taken = labels.fixed_boxes(axes, [(np.array(points), _MARKER_SIZE), (vents, _VENT_SIZE)])
    missing = [
        name for name, place, style, is_point in names[:MAX_NAMES]
        if not labels.place_name(axes, name, place, style.colour, taken, is_point=is_point)
    ]
    if missing:
        _LOG.warning(
            f'names that would hide others are not on the map: {", ".join(missing)} '
            '(--extent shows a smaller part)'
        )
    labels.remove_covered(axes, taken)


def _place_of_name(
    feature: Feature, visible: np.ndarray, window: Window, offset: tuple[float, float]
) -> np.ndarray | None:
    """Return the position of a name on a line or in an area; None for a feature off the map."""
    if len(visible):
        is_area = feature.kind == 'Polygon'
        return np.asarray(visible.mean(axis=0) if is_area else visible[len(visible) // 2])
    if _surrounds(feature, (*np.add(window[:2], offset), *np.add(window[2:], offset))):
        return np.asarray(0.5 * np.add(window[:2], window[2:]))
    return None


def _inside(places: np.ndarray, window: Sequence[float]) -> np.ndarray:
    return np.asarray(((places >= window[:2]) & (places <= window[2:])).all(axis=1))


def _samples(ring: np.ndarray, window: Sequence[float]) -> np.ndarray:
    """Return evenly spaced points along a line, or a point itself."""
    steps = np.hypot(*np.diff(ring, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    if along[-1] <= 0.0:
        return ring
    count = _SAMPLES * along[-1] / max(window[2] - window[0], 1e-9)
    wanted = np.linspace(0.0, along[-1], int(min(max(count, _SAMPLES), _MAX_SAMPLES)))
    return np.stack([np.interp(wanted, along, column) for column in ring.T], axis=-1)


def _surrounds(feature: Feature, window: Sequence[float]) -> bool:
    """Return True if the middle of a window lies in an area."""
    from matplotlib.path import Path

    x, y = (0.5 * np.add(window[:2], window[2:])).tolist()
    around = [Path(ring).contains_point((x, y)) for ring in feature.rings]
    return feature.kind == 'Polygon' and sum(around) % 2 == 1
