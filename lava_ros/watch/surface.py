# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The ground and the lava as triangles, which are small around the lava and large far from it."""

from collections.abc import Iterator, Sequence
from io import BytesIO
import json
import math
import struct
from typing import Any

import numpy as np
from PIL import Image

from lava_ros.layers.frame import Frame
from lava_ros.products.plot import bounds_of, scale_bar_length, scale_bar_words
from lava_ros.scene import Terrain

#: Rows or columns of large blocks along a side, and maximum number of corners of small ones.
COARSE, MAX_CORNERS = 128, 200_000

#: Length of the longer side of the ground in the view.
SIDE = 10.0

#: Margin around the lava: a fraction of its size, and at least some cells.
MARGIN, MIN_MARGIN = 0.15, 16


class Ground:
    """The ground of a frame in the view: blocks of cells, which are small at the lava.

    Attributes:
        terrain: The ground.
        cell: Side of a cell in the view.
        part: Slices of the rows and columns in small blocks.
        middle, extent: Middle of the small blocks in the view, and their longer side there.
        mesh: The blocks with a picture in binary glTF; a new object if the blocks change.
    """

    def __init__(self, frame: Frame, picture: np.ndarray) -> None:
        """Initialize from a frame and the colours of its ground, uint8, shape [y, x, 3]."""
        self.terrain = Terrain(frame.elevation, frame.resolution, frame.origin)
        self._elevation = frame.elevation
        self.cell = SIDE / max(self.terrain.shape)
        self._low, self._high = np.nanmin(frame.elevation), np.nanmax(frame.elevation)
        file = BytesIO()
        Image.fromarray(picture[::-1]).save(file, 'JPEG', quality=90)
        self._picture = file.getvalue()
        self._window = np.zeros((2, 2), dtype=int)

    def is_of(self, frame: Frame) -> bool:
        """Return True if a frame has the same ground."""
        own = (self.terrain.resolution, self.terrain.origin)
        return (frame.resolution, frame.origin) == own and (
            frame.elevation is self._elevation
            or np.array_equal(frame.elevation, self._elevation, equal_nan=True)
        )

    def fit(self, frame: Frame, shown: np.ndarray) -> None:
        """Use small blocks around the vents and the cells in a mask, or all over without any."""
        sides, size = np.transpose([self.terrain.shape]), self.terrain.resolution
        bounds = (np.reshape(bounds_of(frame, shown), (2, 2)) - self.terrain.origin) / size
        cells = np.clip(np.floor(bounds).astype(int).T[::-1], 0, sides - 1) + np.array([0, 1])
        if ((cells - self._window) * (1, -1) >= 0).all():
            return
        margin = np.maximum(MARGIN * np.diff(cells), MIN_MARGIN).astype(int) * (-1, 1)
        far = max(max(self.terrain.shape) // COARSE, 1)
        # small blocks end at an edge of large ones
        self._window = np.clip((cells + margin + (0, far - 1)) // far * far, 0, sides)
        large = [np.array([*range(0, side, far), side]) for side in self.terrain.shape]
        ends = [np.searchsorted(*item) for item in zip(large, self._window, strict=True)]
        for step in range(1, far + 1):
            self._small = small = [
                np.unique(np.minimum(item[a : b + 1, None] + np.arange(0, far, step), item[b]))
                for item, (a, b) in zip(large, ends, strict=True)
            ]
            if math.prod(map(len, small)) <= MAX_CORNERS:
                break
        outer, inner = (_at_corners(self._elevation, *edges) for edges in (large, small))
        is_large = np.ones(np.subtract(outer.shape, 1), dtype=bool)
        is_large[tuple(slice(*item) for item in ends)] = False
        for axis, lines in enumerate(ends):
            # no gaps between small and large blocks
            for side, line in zip((0, -1), lines, strict=True):
                z = np.swapaxes(inner, 0, axis)[side]
                new = np.interp(small[1 - axis], large[1 - axis], np.take(outer, line, axis))
                z[:] = np.where(np.isfinite(new), new, z)
        self._small_z, self.part = inner, tuple(slice(*item) for item in self._window)
        self.middle = self.placed(self._positions(self._window.mean(axis=1))[None])[0]
        self.extent = float(np.diff(self._window).max()) * self.cell
        points, faces = self._triangles(is_large, large, outer)
        is_small = np.ones(np.subtract(inner.shape, 1), dtype=bool)
        near, more = self._triangles(is_small, small, inner)
        points, faces = np.concatenate([points, near]), np.concatenate([faces, more + len(points)])
        # row 0 of a picture is the northernmost
        places = points[:, :2] / (self.cell * np.array(self.terrain.shape[::-1])) * (1, -1) + 0.5
        self.mesh = _gltf(points, places, faces, self._picture)

    def blocks(self, values: np.ndarray) -> np.ndarray:
        """Reduce values of the cells of ``part`` to the largest of each small block."""
        rows, columns = (edges[:-1] - edges[0] for edges in self._small)
        return np.asarray(np.fmax.reduceat(np.fmax.reduceat(values, rows), columns, axis=1))

    def lava(
        self, colours: np.ndarray, thickness: np.ndarray
    ) -> Iterator[tuple[tuple[int, ...], np.ndarray, np.ndarray]]:
        """Yield RGBA, points in the view and triangles of the small blocks with each colour.

        Args:
            colours: RGBA of the blocks, uint8, shape [y, x, 4]; 0 for those not shown.
            thickness: Thickness of the lava on the blocks [m], NaN for none.
        """
        depth = _at_corners(thickness, *map(np.arange, self._small_z.shape))
        z, codes = self._small_z + np.nan_to_num(depth), colours.view(np.uint32)[..., 0]
        for code in np.unique(codes[codes > 0]):
            colour = tuple(code[None].view(np.uint8).tolist())
            yield colour, *self._triangles(codes == code, self._small, z)

    def placed(self, places: np.ndarray, z: np.ndarray | None = None) -> np.ndarray:
        """Return map positions [m] in the view, float32, [points, 3]; None: on the ground."""
        z = self.terrain.elevations_at(places) if z is None else z
        off = places - self.terrain.centre
        at = np.column_stack([off, np.nan_to_num(z, nan=self._low) - self._low])
        return (at * (self.cell / self.terrain.resolution)).astype(np.float32)

    def scale_and_north(self) -> dict[str, tuple[np.ndarray, str]]:
        """Return a scale bar and an arrow to the north, in the south-west of the small blocks.

        Returns:
            Map positions of each line [m], shape [points, 2], which ends at its text, and the
            text.
        """
        (south, north), (west, east) = self._window
        cell = self.terrain.resolution
        length = scale_bar_length(cell * max(north - south, east - west))
        # visible from the south, too
        corner = (south + 0.2 * (north - south), west + 0.05 * (east - west))
        start = self._positions(np.floor(corner) + 0.5)
        limit = self._positions(np.array([north, east]) - 0.5)
        steps = np.linspace(0.0, 1.0, 17)[:, None]
        bar = np.minimum(start + steps * (length, 0.0), limit)
        tip = np.minimum(np.add(start, (0.0, length)), limit)
        left, right = (np.add(tip, (side * 0.1 * length, -0.15 * length)) for side in (-1.0, 1.0))
        arrow = np.concatenate([start + steps * (tip - start), [left, tip, right, tip]])
        return {'scale': (bar, scale_bar_words(length)), 'north': (arrow, 'N')}

    def hit(self, start: np.ndarray, along: np.ndarray) -> np.ndarray | None:
        """Return where a ray of the view, without exaggeration, first meets the ground [m]."""
        if not along[2] < 0.0:
            return None
        scale = self.terrain.resolution / self.cell
        z = np.linspace(min((self._high - self._low) / scale, start[2]), 0.0, 8192)
        places = start[:2] + ((z - start[2]) / along[2])[:, None] * along[:2]
        places = places * scale + self.terrain.centre
        below = np.flatnonzero(z * scale + self._low <= self.terrain.elevations_at(places))
        return places[below[0]] if len(below) else None

    def _positions(self, cells: np.ndarray) -> np.ndarray:
        """Return the map positions x, y [m] of rows and columns of edges."""
        return self.terrain.origin + self.terrain.resolution * cells[..., ::-1]

    def _triangles(
        self, shown: np.ndarray, edges: Sequence[np.ndarray], z: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the points of the corners of blocks, and the points of two triangles a block."""
        width = z.shape[1]
        row, column = np.divmod(np.flatnonzero(shown), shown.shape[1])
        corners = np.array([0, 1, width + 1, 0, width + 1, width])
        faces = ((row * width + column)[:, None] + corners).reshape(-1, 3)
        faces = faces[np.isfinite(z.ravel()[faces]).all(axis=1)]
        # unique() would sort
        is_used, number = np.zeros(z.size, dtype=bool), np.empty(z.size, dtype=np.uint32)
        is_used[faces] = True
        used = np.flatnonzero(is_used)
        number[used] = np.arange(len(used))
        row, column = np.divmod(used, width)
        cells = np.stack([edges[0][row], edges[1][column]], axis=-1)
        return self.placed(self._positions(cells), z[row, column]), number[faces]


def _at_corners(values: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> Any:
    """Return the mean of the known cells around the corners of blocks; NaN where none is."""
    padded = np.pad(values, 1, constant_values=np.nan)
    around = [padded[np.ix_(rows + i, columns + j)] for i in (0, 1) for j in (0, 1)]
    known = np.isfinite(around).sum(axis=0)
    return np.where(known, np.nansum(around, axis=0), np.nan) / np.maximum(known, 1)


def _gltf(points: np.ndarray, places: np.ndarray, faces: np.ndarray, picture: bytes) -> bytes:
    """Return binary glTF of triangles with a JPEG; trimesh would take half a second to load."""
    arrays = [points.astype('<f4'), places.astype('<f4'), faces.astype('<u4').ravel()]
    kinds = [('VEC3', 5126), ('VEC2', 5126), ('SCALAR', 5125)]
    parts = [*(item.tobytes() for item in arrays), picture + bytes(-len(picture) % 4)]
    starts = np.cumsum([0, *map(len, parts)]).tolist()
    accessors: list[dict[str, Any]] = [
        {'bufferView': number, 'type': kind, 'componentType': code, 'count': len(item)}
        for number, ((kind, code), item) in enumerate(zip(kinds, arrays, strict=True))
    ]
    accessors[0] |= {'min': points.min(axis=0).tolist(), 'max': points.max(axis=0).tolist()}
    attributes = {'POSITION': 0, 'TEXCOORD_0': 1}
    colour = {'baseColorTexture': {'index': 0}, 'baseColorFactor': [0.85, 0.85, 0.85, 1.0]}
    # the picture already contains light and shade
    unlit: dict[str, Any] = {'KHR_materials_unlit': {}}
    content = {
        'asset': {'version': '2.0'}, 'extensionsUsed': [*unlit], 'scene': 0,
        'scenes': [{'nodes': [0]}], 'nodes': [{'mesh': 0}], 'accessors': accessors,
        'meshes': [{'primitives': [{'attributes': attributes, 'indices': 2, 'material': 0}]}],
        'materials': [{'pbrMetallicRoughness': colour, 'extensions': unlit}],
        'textures': [{'source': 0}], 'images': [{'bufferView': 3, 'mimeType': 'image/jpeg'}],
        'buffers': [{'byteLength': starts[-1]}], 'bufferViews': [
            {'buffer': 0, 'byteOffset': start, 'byteLength': len(part)}
            for start, part in zip(starts[:-1], parts, strict=True)
        ],
    }
    text = json.dumps(content).encode()
    text += b' ' * (-len(text) % 4)
    head = struct.pack('<4s4I', b'glTF', 2, 28 + len(text) + starts[-1], len(text), 0x4E4F534A)
    return b''.join([head, text, struct.pack('<2I', starts[-1], 0x004E4942), *parts])
