# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Maps of layers at one moment, with their terrain and vents."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
import math
from typing import Any

import numpy as np

from lava_ros.bag.decoding import (
    Moment,
)
from lava_ros.layers.layer import ARRIVAL, ARRIVED, Layer
from lava_ros.scene import Scene, scene_to_dict, Terrain
from lava_ros.scene.terrain import Cells
from lava_ros.simulation.accuracy import COVERED
from lava_ros.simulation.output.inundation import (
    area_of,
    footprint_cells,
    reached_cells,
    standing_cells,
    standing_part,
)


#: Called with the name of the activity and its completed fraction, 0 to 1.
@dataclass(frozen=True, eq=False)
class LayerFrame:
    """One layer at one moment.

    Attributes:
        layer: Its definition.
        values: Thickness [m], temperature [Celsius] or hazard 0..100, float32, shape
            [rows, columns]; NaN without lava and outside the terrain.
        is_saturated: True if a cell has the maximum value of the grid.
    """

    layer: Layer
    values: np.ndarray
    is_saturated: bool


@dataclass(frozen=True, eq=False)
class Frame(Cells):
    """The maps of a bag at one moment.

    Attributes:
        elevation: Ground elevation [m], float32, shape [rows, columns], NaN without data; row 0
            has the smallest y.
        resolution: Side of a cell [m].
        origin: Map position (x, y) [m] of the lower-left corner of cell [0, 0].
        layers: The newest layer of each source: thickness, temperature, hazard. If a grid and an
            image have the same time, the image is used, because it is not rounded.
        vents: Map positions [m] of the vents with a discharge, shape [vents, 2].
        time: Simulated time [s]; None if the bag does not contain it.
        scene: The scene in the bag, in the form of ``scene_to_dict``.
        arrived: First arrival time [s], float32, shape [rows, columns], NaN in cells without
            arrival; None if the bag does not contain it.
        inundated: Fraction of each cell that lava has covered so far, float32, same shape, NaN
            without data; 1 in cells with arrival if the bag does not contain it, None without
            either.
        threshold: Minimum thickness of lava that counts as inundation [m].
        fissures: Ends of vents that are lines [m], shape [count, 2, 2].
    """

    elevation: np.ndarray
    resolution: float
    origin: tuple[float, float]
    layers: Mapping[str, LayerFrame]
    vents: np.ndarray
    time: float | None
    scene: Mapping[str, Any]
    arrived: np.ndarray | None = None
    inundated: np.ndarray | None = None
    threshold: float = COVERED
    fissures: Any = ()

    @property
    def terrain(self) -> Terrain:
        """The ground in the coordinate system of the scene.

        Raises:
            LavaError: If the scene, which may be that of another program, is not valid.
        """
        known = self.scene.get('terrain') or {}
        return Terrain(
            self.elevation, self.resolution, self.origin, known.get('epsg'),
            known.get('offset', (0.0, 0.0)), wkt=known.get('wkt'),
            sea_level=known.get('sea_level'),
        )

    @property
    def standing(self) -> np.ndarray:
        """Cells with lava now, bool; without a thickness, those with lava in any layer."""
        thickness = self.layers.get('thickness')
        if thickness is not None:
            return standing_cells(thickness.values, self.threshold)
        wet = [np.isfinite(item.values) for item in self.layers.values()]
        return np.logical_or.reduce([np.zeros(self.elevation.shape, dtype=bool), *wet])

    @property
    def standing_area(self) -> float:
        """Area on which lava stands now [m2], within the inundated area."""
        return self.area(standing_part(self.standing, self.inundated))

    @property
    def reached(self) -> np.ndarray | None:
        """Cells that lava has touched so far, bool; None without arrival times."""
        return None if self.arrived is None else reached_cells(self.arrived)

    @property
    def footprint(self) -> np.ndarray | None:
        """Cells of which lava has covered at least half so far, bool; None if unknown."""
        return None if self.inundated is None else footprint_cells(self.inundated)

    @property
    def lava(self) -> np.ndarray:
        """Cells with lava now, and cells that lava has reached if those are known, bool."""
        return self.standing if self.reached is None else self.standing | self.reached

    def area(self, cells: np.ndarray) -> float:
        """Return the area of a mask or of fractions of cells [m2]."""
        return area_of(cells, self.resolution)

    def with_cover(
        self, arrived: np.ndarray | None, inundated: np.ndarray | None, threshold: float
    ) -> 'Frame':
        """Return the frame with arrival times, inundated fractions, and their threshold [m].

        A bag without fractions counts whole cells. If there is lava but no arrival time, the
        simulation did not record arrival times.
        """
        frame = replace(self, arrived=arrived, threshold=threshold)
        if frame.reached is None or (frame.standing.any() and not frame.reached.any()):
            return replace(frame, arrived=None)
        if inundated is None or not np.isfinite(inundated).any():
            inundated = frame.reached.astype(np.float32)
        is_known = np.isfinite(self.elevation)
        inundated = np.where(is_known, np.nan_to_num(inundated), np.float32(np.nan))
        return replace(frame, inundated=inundated)

    @property
    def thickest(self) -> float:
        """Maximum thickness [m]; NaN without lava or without a thickness layer."""
        thickness = self.layers.get('thickness')
        return math.nan if thickness is None else float(np.fmax.reduce(thickness.values, None))


def frame_of(scene: Scene) -> Frame:
    """Return the terrain and the vents of a scene as a frame without layers."""
    terrain = scene.terrain
    fissures = [(vent.position, vent.end) for vent in scene.vents if vent.end is not None]
    return Frame(
        elevation=terrain.elevation,
        resolution=terrain.resolution,
        origin=terrain.origin,
        layers={},
        vents=np.array([vent.position for vent in scene.vents]).reshape(-1, 2),
        time=None,
        scene=scene_to_dict(scene),
        fissures=np.array(fissures).reshape(-1, 2, 2),
    )


def threshold_at(moment: Moment | None) -> float:
    """Return the minimum thickness of lava that counts as inundation [m], from diagnostics."""
    known = math.nan if moment is None else moment.number('inundation_threshold_m')
    return known if known > 0.0 else COVERED


def image_frame(layer: Layer, pixels: np.ndarray) -> LayerFrame:
    """Return a layer from the pixels of its image; 0 is an arrival time, but not a thickness."""
    values = pixels.astype(np.float32)
    is_there = values >= 0.0 if layer.source in (ARRIVAL, ARRIVED) else values > 0.0
    return LayerFrame(layer, np.where(is_there & np.isfinite(values), values, np.nan), False)


def grid_frame(layer: Layer, cells: np.ndarray) -> LayerFrame:
    """Return a layer from the cells of its occupancy grid, int8, unscaled without a range."""
    first, last = layer.scale
    low, high = layer.range or (first, last)
    gain = np.float32((high - low) / (last - first))
    values = np.float32(low) + (cells.astype(np.float32) - np.float32(first)) * gain
    return LayerFrame(layer, np.where(cells > 0, values, np.nan), bool((cells == last).any()))
