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
from lava_ros.maps.plot import bounds_of
from lava_ros.scene import Terrain

#: Rows or columns of blocks along a side if there is no lava, and maximum number of corners.
COARSE, MAX_CORNERS = 128, 250_000

#: Length of the longer side of the ground in the view.
SIDE = 10.0

#: Margin around the lava: a fraction of its size, and at least some cells.
MARGIN, MIN_MARGIN = 0.15, 16


class Ground:
    """The ground of a frame in the view: blocks of cells, which are small at the lava."""

    def __init__(self, frame: Frame, picture: np.ndarray) -> None:
        """Initialize from a frame and the colours of its ground, uint8, shape [y, x, 3]."""
        self.terrain = Terrain(frame.elevation, frame.resolution, frame.origin)
        self._elevation = frame.elevation
        self.cell = SIDE / max(self.terrain.shape)
        self._low, self._high = np.nanmin(frame.elevation), np.nanmax(frame.elevation)
        self._picture = Image.fromarray(picture[::-1])
        # trimesh then stores it as JPEG
        self._picture.format = 'JPEG'
        self._window = np.zeros((2, 2), dtype=int)

    def is_of(self, frame: Frame) -> bool:
        """Return True if a frame has the same ground."""
        own = (self.terrain.resolution, self.terrain.origin)
        return (frame.resolution, frame.origin) == own and np.array_equal(
            frame.elevation, self._elevation, equal_nan=True
        )

    def fit(self, frame: Frame, shown: np.ndarray) -> bool:
        """Make the small blocks reach around cells and vents; return True if blocks have changed.

        Args:
            frame: A frame with the same ground.
            shown: The cells, bool; with neither cells nor vents, small blocks cover the ground.
        """
        bounds = np.reshape(bounds_of(frame, shown), (2, 2)) - self.terrain.origin
        sides = np.transpose([self.terrain.shape])
        cells = np.floor(bounds / self.terrain.resolution).astype(int).T[::-1]
        cells = np.clip(cells, 0, sides - 1) + np.array([0, 1])
        if ((cells - self._window) * (1, -1) >= 0).all():
            return False
        margin = np.maximum(MARGIN * np.diff(cells), MIN_MARGIN).astype(int)
        self._window, step = np.clip(cells + margin * np.array([-1, 1]), 0, sides), 1
        while math.prod(map(len, edges := self._edges_with(step))) > MAX_CORNERS:
            step += 1
        self._edges, self._z = edges, _at_corners(self._elevation, *edges)
        inside = [
            (first <= item) & (item <= last)
            for item, (first, last) in zip(edges, self._window, strict=True)
        ]
        self._small = [item[here] for item, here in zip(edges, inside, strict=True)]
        self._small_z = self._z[np.ix_(*inside)]
        return True

    def _edges_with(self, step: int) -> list[np.ndarray]:
        """Return the rows and the columns of edges with small blocks of so many cells a side."""
        far = max(max(self.terrain.shape) // COARSE, step)
        return [
            np.unique([*range(0, a, far), *range(a, b, step), b, *range(b, count, far), count])
            for (a, b), count in zip(self._window, self.terrain.shape, strict=True)
        ]

    def mesh(self) -> Trimesh:
        """Return the ground with its picture."""
        shown = np.ones(np.subtract(self._z.shape, 1), dtype=bool)
        cells, points, faces = self._triangles(shown, self._edges, self._z)
        # the picture has its own light and shade
        material = PBRMaterial(
            emissiveTexture=self._picture, emissiveFactor=[0.85, 0.85, 0.85],
            baseColorFactor=[0, 0, 0, 255], metallicFactor=0.0, roughnessFactor=1.0,
        )
        visual = TextureVisuals(uv=(cells / self.terrain.shape)[:, ::-1], material=material)
        return Trimesh(points, faces, visual=visual, process=False)

    def blocks(self, values: np.ndarray) -> np.ndarray:
        """Reduce values of the cells that ``cut`` leaves to the largest of each small block."""
        rows, columns = (edges[:-1] - edges[0] for edges in self._small)
        return np.asarray(np.fmax.reduceat(np.fmax.reduceat(values, rows), columns, axis=1))

    def lava(
        self, colours: np.ndarray, thickness: np.ndarray
    ) -> Iterator[tuple[tuple[int, ...], np.ndarray, np.ndarray]]:
        """Yield the surface of the small blocks with each colour.

        Args:
            colours: RGBA of the blocks, uint8, shape [y, x, 4]; 0 for those not shown.
            thickness: Thickness of the lava on the blocks [m], NaN for none.

        Yields:
            RGBA, points in the view [points, 3], and the points of triangles [triangles, 3].
        """
        depth = _at_corners(thickness, *map(np.arange, self._small_z.shape))
        z, codes = self._small_z + np.nan_to_num(depth), colours.view(np.uint32)[..., 0]
        for code in np.unique(codes[codes > 0]):
            points, faces = self._triangles(codes == code, self._small, z)[1:]
            yield tuple(code[None].view(np.uint8).tolist()), points, faces

    def cut(self, frame: Frame) -> Frame:
        """Return the part of a frame in small blocks."""
        part = tuple(slice(*ends) for ends in self._window.tolist())
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
        row, column = np.divmod(np.flatnonzero(shown), shown.shape[1])
        first = row * z.shape[1] + column
        above = first + z.shape[1]
        faces = np.stack([first, first + 1, above + 1, first, above + 1, above], -1).reshape(-1, 3)
        faces = faces[np.isfinite(z.ravel()[faces]).all(axis=1)]
        is_used = np.zeros(z.size, dtype=bool)
        is_used[faces] = True
        row, column = np.divmod(np.flatnonzero(is_used), z.shape[1])
        cells = np.stack([edges[0][row], edges[1][column]], axis=-1)
        points = self.placed(self._positions(cells), z[row, column])
        return cells, points, (np.cumsum(is_used) - 1)[faces]


def _at_corners(values: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> Any:
    """Return the mean of the known cells around the corners of blocks; NaN where none is."""
    padded = np.pad(values, 1, constant_values=np.nan)
    around = [padded[np.ix_(rows + i, columns + j)] for i in (0, 1) for j in (0, 1)]
    return np.ma.masked_invalid(around).mean(axis=0).filled(np.nan)
