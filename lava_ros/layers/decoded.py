# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Maps, places of grids and vents of recorded messages."""

from dataclasses import replace
from typing import Any

import numpy as np

from lava_ros.bag.decoding import cloud_columns, Decoder, image_array, read_grid
from lava_ros.bag.reader import BagMessage
from lava_ros.errors import LavaError
from lava_ros.layers.frame import grid_frame, image_frame, LayerFrame
from lava_ros.layers.layer import IMAGE, Layer
from lava_ros.scene import MAX_COORDINATE, Terrain

#: Resolution and origin (x, y) of a grid [m].
GridPlace = tuple[float, float, float]


def image_of(decoder: Decoder, item: BagMessage) -> np.ndarray:
    """Return the pixels of an image, float32, shape [rows, columns]."""
    pixels: np.ndarray = decoder.decode(
        item, lambda image: image_array(image, item.topic).astype(np.float32)
    )
    return pixels


def place_of(decoder: Decoder, item: BagMessage) -> GridPlace:
    """Return resolution and origin of the grid that a nav_msgs/MapMetaData describes."""

    def read(info: Any) -> GridPlace:
        origin = info.origin.position
        return (float(info.resolution), float(origin.x), float(origin.y))

    place: GridPlace = decoder.decode(item, read)
    return place


def map_of(
    layer: Layer, decoder: Decoder, message: BagMessage
) -> tuple[LayerFrame | None, GridPlace | None]:
    """Return a map, None with infinite values, and the position of its grid, None for an image."""
    if layer.message == IMAGE:
        pixels = image_of(decoder, message)
        return None if np.isinf(pixels).any() else image_frame(layer, pixels), None
    grid = read_grid(decoder, message)
    return grid_frame(layer, grid.cells), (grid.resolution, *grid.origin)


def without_border(
    shown: LayerFrame, where: GridPlace | None, terrain: Terrain, place: GridPlace
) -> tuple[LayerFrame, GridPlace | None]:
    """Remove the cells that ``min_cells`` has added around the terrain."""
    border = shown.layer.border(terrain.shape)
    (below, _), (left, _) = border
    whole = tuple(np.add(terrain.shape, np.sum(border, axis=1)))
    resolution, x, y = place
    corner = resolution, x - left * resolution, y - below * resolution
    # the node extends the grid with its resolution in float64
    if where is None or shown.values.shape != whole or not np.allclose(
        where, corner, rtol=0.0, atol=1e-3 * resolution
    ):
        return shown, where
    rows, columns = terrain.shape
    values = shown.values[below : below + rows, left : left + columns]
    return replace(shown, values=values), place


def vent_points(decoder: Decoder, item: BagMessage) -> np.ndarray:
    """Return the map positions of the active vents and ends of fissures, float64, [count, 2]."""
    names, ends = ('x', 'y', 'discharge'), ('x_end', 'y_end')
    columns = decoder.decode(item, lambda cloud: cloud_columns(cloud, item.topic, names, ends))
    points = np.stack([columns[name] for name in names], axis=-1)
    if all(name in columns for name in ends):
        others = np.stack([columns[name] for name in (*ends, 'discharge')], axis=-1)
        points = np.concatenate([points, others[~np.isnan(others[:, :2]).all(axis=1)]])
    # keeps NaN, which the next check rejects
    points = points[~(points[:, 2] <= 0.0)]
    beyond = points[~(np.abs(points) <= MAX_COORDINATE)]
    if beyond.size:
        expected = f'coordinates and discharges, at most {MAX_COORDINATE:g} from 0'
        raise LavaError(f'{item.topic}.data', float(beyond[0]), expected)
    return points[:, :2]
