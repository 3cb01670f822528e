# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Labels of a map that do not overprint each other."""

from collections.abc import Iterable
from itertools import product
import math
from typing import Any

import numpy as np

from lava_ros.products.plot import CONTOUR_LABEL, halo, ISOCHRONE_LABEL, SCALE_BAR

#: Distances of a name from its point [points]; the farther ones have a line to the point.
_DISTANCES = (5.0, 17.0, 32.0)

#: Directions of a name from its point [degrees], the best first.
_DIRECTIONS = (30.0, 150.0, -30.0, -150.0, 90.0, -90.0, 0.0, 180.0)

#: Free space around a text [points].
_SPACE = 1.0


def place_name(
    axes: Any, name: str, place: np.ndarray, colour: str, taken: list[Any], *, is_point: bool
) -> bool:
    """Write a name at a free place near its position, and add its box to those ``taken``.

    Args:
        axes: Axes of the map.
        name: The name.
        place: Its position in the coordinates of the axes [m], shape [2].
        colour: Colour of the text.
        taken: Boxes that texts must not touch [pixels].
        is_point: True for the name of a point, False for the name of a line or an area.

    Returns:
        False if no place near the position is free; the name is then left out.
    """
    at = (float(place[0]), float(place[1]))
    label = axes.annotate(
        name, at, (0, 0), textcoords='offset points', fontsize=7, color=colour, va='center',
        path_effects=halo(), zorder=8, annotation_clip=True,
        style='normal' if is_point else 'italic',
    )
    edge = axes.get_window_extent()
    for distance, degrees in product(_DISTANCES, _DIRECTIONS):
        angle = math.radians(degrees)
        x, y = distance * math.cos(angle), distance * math.sin(angle)
        side = 'center' if abs(x) < 1.0 else 'left' if x > 0.0 else 'right'
        # above and below, half the height of the text is added
        label.set(position=(x, y + 4.0 * np.sign(round(y, 6)) * (side == 'center')), ha=side)
        box = box_of(label)
        is_in = edge.x0 <= box.x0 and box.x1 <= edge.x1 and edge.y0 <= box.y0 and box.y1 <= edge.y1
        if is_in and not any(map(box.overlaps, taken)):
            taken.append(box)
            if distance > _DISTANCES[0]:
                axes.annotate(
                    '', at, (x, y), textcoords='offset points', zorder=7, annotation_clip=True,
                    arrowprops={
                        'arrowstyle': '-', 'color': colour, 'linewidth': 0.6, 'shrinkA': 0.0,
                        'shrinkB': 2.0,
                    },
                )
            return True
    label.remove()
    return False


def box_of(text: Any) -> Any:
    """Return the box of a text with the space around it [pixels]."""
    return text.get_window_extent().padded(_SPACE * text.figure.dpi / 72.0)


def fixed_boxes(axes: Any, markers: Iterable[tuple[np.ndarray, float]]) -> list[Any]:
    """Return the boxes of the fixed texts of a map, and of markers [pixels].

    ``markers`` are positions in the coordinates of the axes [m], shape [count, 2], and the size of
    each marker [points].
    """
    from matplotlib.transforms import Bbox

    boxes = [
        box_of(item) for item in axes.texts
        if item.get_text() and item.get_gid() not in (ISOCHRONE_LABEL, CONTOUR_LABEL)
    ]
    # the bar of the scale
    boxes += [line.get_window_extent() for line in axes.lines if line.get_gid() == SCALE_BAR]
    for places, size in markers:
        half = 0.5 * size * axes.figure.dpi / 72.0
        middles = axes.transData.transform(np.reshape(places, (-1, 2)))
        boxes += [Bbox([middle - half, middle + half]) for middle in middles]
    return boxes


def remove_covered(axes: Any, taken: list[Any]) -> None:
    """Remove the labels of isochrones and contours that touch boxes, or each other."""
    taken = list(taken)
    for kind in (ISOCHRONE_LABEL, CONTOUR_LABEL):
        for item in [text for text in axes.texts if text.get_gid() == kind]:
            box = box_of(item)
            if any(map(box.overlaps, taken)):
                item.remove()
            else:
                taken.append(box)
