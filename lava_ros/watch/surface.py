# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The ground and the lava as triangles, fine around the lava and coarse far from it."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
import math
from typing import Any

import numpy as np
from PIL import Image
from trimesh import Trimesh
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from lava_ros.maps.frames import Frame
from lava_ros.scene import Terrain

#: Rows or columns of blocks along a side if there is no lava, and maximum number of corners.
COARSE, MAX_CORNERS = 128, 500_000

#: Length of the longer side of the ground in the view.
SIDE = 10.0

#: Margin around the lava: a fraction of its size, and at least some cells.
MARGIN, MIN_MARGIN = 0.15, 16


class Ground:
    """The ground of a frame in the view: blocks of cells, which are small at the lava."""

    def __init__(self, frame: Frame, picture: np.ndarray) -> None:
        """Initialize from a frame and the colours of its ground, uint8, shape [y, x, 3]."""
        self.terrain = Terrain(frame.elevation, frame.resolution, frame.origin)
        self._elevation, self._shape = frame.elevation, np.array(self.terrain.shape)
        self.cell = SIDE / float(self._shape.max())
        self._low, self._high = np.nanmin(frame.elevation), np.nanmax(frame.elevation)
        self._picture = Image.fromarray(picture[::-1])
        # trimesh then stores it as JPEG
        self._picture.format = 'JPEG'
        self._window = np.zeros((2, 2), dtype=int)

    def is_of(self, frame: Frame) -> bool:
        """Return True if a frame has the same ground."""
        own = self.terrain
        return (frame.resolution, frame.origin) == (own.resolution, own.origin) and (
            frame.elevation is self._elevation
            or np.array_equal(frame.elevation, self._elevation, equal_nan=True)
        )

    def fit(self, maps: Sequence[np.ndarray], vents: np.ndarray) -> bool:
        """Make the small blocks reach around maps and vents; return True if blocks have changed.

        Args:
            maps: Values of the cells, NaN where there is nothing to show.
            vents: Map positions [m], shape [vents, 2].
        """
        reached = np.zeros(self._shape, dtype=bool)
        for values in maps:
            reached |= np.isfinite(values)
        for place in vents[self.terrain.covered(vents)].tolist():
            reached[self.terrain.cell_at(*place)] = True
        if not reached.any():
            reached[:] = True
        ends = [np.flatnonzero(reached.any(axis=axis))[[0, -1]] for axis in (1, 0)]
        cells = np.add(ends, (0, 1))
        if (self._window[:, 0] <= cells[:, 0]).all() and (cells[:, 1] <= self._window[:, 1]).all():
            return False
        margin = np.maximum(MARGIN * np.diff(cells)[:, 0], MIN_MARGIN).astype(int)
        first = np.maximum(cells[:, 0] - margin, 0)
        last = np.minimum(cells[:, 1] + margin, self._shape)
        self._window, step = np.stack([first, last], axis=1), 1
        while math.prod(map(len, self._edges_with(step))) > MAX_CORNERS:
            step += 1
        self._edges = self._edges_with(step)
        self._inside = tuple(
            slice(*np.searchsorted(edges, (a, b + 1)))
            for edges, (a, b) in zip(self._edges, self._window, strict=True)
        )
        # the cells on both sides of each edge
        around = np.pad(self._elevation, 1, mode='edge')
        rows, columns = self._edges
        self._z = _mean([around[np.ix_(rows + i, columns + j)] for i in (0, 1) for j in (0, 1)])
        return True

    def _edges_with(self, step: int) -> list[np.ndarray]:
        """Return the rows and the columns of edges with small blocks of so many cells a side."""
        far = max(int(self._shape.max()) // COARSE, step)
        return [
            np.unique([*range(0, a, far), *range(a, b, step), b, *range(b, count, far), count])
            for (a, b), count in zip(self._window, self._shape, strict=True)
        ]

    def mesh(self) -> Trimesh:
        """Return the ground with its picture."""
        is_known = np.isfinite(self._z)
        shown = np.logical_and.reduce(_corners(is_known))
        cells, points, faces = self._triangles(shown, self._edges, self._z)
        # the picture has its own light and shade
        material = PBRMaterial(
            emissiveTexture=self._picture, emissiveFactor=[1.0, 1.0, 1.0],
            baseColorFactor=[0, 0, 0, 255], metallicFactor=0.0, roughnessFactor=1.0,
        )
        visual = TextureVisuals(uv=(cells / self._shape)[:, ::-1], material=material)
        return Trimesh(points, faces, visual=visual, process=False)

    def blocks(self, values: np.ndarray) -> np.ndarray:
        """Reduce values of the cells that ``cut`` leaves to the largest of each small block."""
        rows, columns = (
            edges[inside][:-1] - edges[inside][0]
            for edges, inside in zip(self._edges, self._inside, strict=True)
        )
        return np.asarray(np.fmax.reduceat(np.fmax.reduceat(values, rows), columns, axis=1))

    def lava(
        self, numbers: np.ndarray, thickness: np.ndarray
    ) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """Yield the surface of the small blocks with each number.

        Args:
            numbers: Numbers of the blocks, NaN for those not shown.
            thickness: Thickness of the lava on the blocks [m], NaN for none.

        Yields:
            A number, points in the view [points, 3], and the points of triangles [triangles, 3].
        """
        edges = [item[inside] for item, inside in zip(self._edges, self._inside, strict=True)]
        padded = np.pad(thickness, 1, constant_values=np.nan)
        z = self._z[self._inside] + np.nan_to_num(_mean(_corners(padded)))
        for number in np.unique(numbers[np.isfinite(numbers)]).astype(int).tolist():
            yield number, *self._triangles(numbers == number, edges, z)[1:]

    def cut(self, frame: Frame) -> Frame:
        """Return the part of a frame in small blocks."""
        (a, b), (c, d) = self._window.tolist()
        part = np.s_[a:b, c:d]
        layers = {
            key: replace(item, values=item.values[part]) for key, item in frame.layers.items()
        }
        return replace(
            frame, elevation=frame.elevation[part], layers=layers,
            origin=tuple(self._positions(self._window[:, 0]).tolist()),
            arrived=None if frame.arrived is None else frame.arrived[part],
        )

    @property
    def middle(self) -> tuple[np.ndarray, float]:
        """Middle of the small blocks in the view, and their extent there."""
        place = self._positions(self._window.mean(axis=1))
        return self.placed(place[None])[0], float(np.diff(self._window).max()) * self.cell

    def placed(self, places: np.ndarray, z: np.ndarray | None = None) -> np.ndarray:
        """Return map positions [m] in the view, float32, [points, 3]; None: on the ground."""
        z = self.terrain.elevations_at(places) if z is None else z
        off = places - self.terrain.centre
        at = np.column_stack([off, np.nan_to_num(z, nan=self._low) - self._low])
        return (at * (self.cell / self.terrain.resolution)).astype(np.float32)

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
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return rows and columns of the corners of blocks, their points, and the triangles."""
        row, column = np.nonzero(shown)
        first = row * z.shape[1] + column
        above = first + z.shape[1]
        faces = np.stack([first, first + 1, above + 1, first, above + 1, above], -1).reshape(-1, 3)
        is_used = np.zeros(z.size, dtype=bool)
        is_used[faces] = True
        row, column = np.nonzero(is_used.reshape(z.shape))
        cells = np.stack([edges[0][row], edges[1][column]], axis=-1)
        points = self.placed(self._positions(cells), z[row, column])
        return cells, points, (np.cumsum(is_used, dtype=np.uint32) - np.uint32(1))[faces]


def _corners(cells: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the four cells around each inner corner."""
    return cells[:-1, :-1], cells[:-1, 1:], cells[1:, :-1], cells[1:, 1:]


def _mean(parts: Sequence[np.ndarray]) -> Any:
    """Return the mean of those that are known; NaN where none is."""
    count = sum(np.isfinite(part).astype(float) for part in parts)
    with np.errstate(invalid='ignore'):
        return sum(np.nan_to_num(part, nan=0.0) for part in parts) / count
