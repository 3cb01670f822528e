# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Published layers of a simulation, as configured in msg_configs/."""

from dataclasses import dataclass, replace
import math
from typing import TYPE_CHECKING

import numpy as np

from lava_ros.bag.qos import LATCHED, QosProfile
from lava_ros.errors import LavaError
from lava_ros.layers.forecast import EnsembleForecast, Forecast, occupancy, UNKNOWN
from lava_ros.simulation.output.inundation import reached_cells, standing_cells

if TYPE_CHECKING:
    # importing the solver loads Warp, which is not needed here
    from lava_ros.simulation.output.snapshot import Snapshot

    #: The current flow, or its maxima within the horizon of a forecast.
    Flow = Snapshot | Forecast

    #: Input of a layer.
    Shown = Flow | EnsembleForecast

#: 0 C in kelvin.
ZERO_CELSIUS = 273.15

OCCUPANCY_GRID = 'nav_msgs/msg/OccupancyGrid'
IMAGE = 'sensor_msgs/msg/Image'
POINT_CLOUD = 'sensor_msgs/msg/PointCloud2'
GRID_MAP = 'grid_map_msgs/msg/GridMap'

#: Sources with one quantity of the current flow.
SOURCES = ('thickness', 'temperature', 'hazard')

#: Source of first arrival times (simulated times).
ARRIVED = 'arrived'

#: Source of images of the fraction of each cell that lava has covered.
INUNDATED = 'inundated'

#: Source of times to arrival.
ARRIVAL = 'arrival'

#: Prefix of a source of ``SOURCES`` for its maximum within the horizon of a forecast.
PEAK = 'peak_'

#: Sources with one quantity of a forecast.
FORECAST_SOURCES = (ARRIVAL, *(PEAK + source for source in SOURCES))

#: Source of the inundation probability within the horizon of an ensemble.
PROBABILITY = 'inundation_probability'

#: Fraction of ensemble members with lava by a time, by the source of that time.
QUANTILE_SOURCES = {'arrival_p10': 0.1, 'arrival_p50': 0.5, 'arrival_p90': 0.9}

#: Source of the peak thickness averaged over an ensemble.
EXPECTED = 'expected_peak_thickness'

#: Sources with one quantity of an ensemble.
ENSEMBLE_SOURCES = (PROBABILITY, *QUANTILE_SOURCES, EXPECTED)

#: Source of messages with several quantities.
LAVA = 'lava'

#: Hazard index of a cell that lava has reached and left. The cell must not be entered: its ground
#: is hot, and real lava leaves a crust that is not modelled. Burial is no longer possible there.
DRAINED = 50

#: Names of the classes of the hazard index above 0, by the largest value of each. ``DRAINED`` is
#: the only harmful value, unless a user sets ``HazardLimits`` above the values of the lava.
HAZARD_CLASSES = {99.0: 'harmful: lava has drained away', 100.0: 'lethal lava'}

#: Upper bounds of depth classes: a knee, the height of a person, a roof [m].
DEPTHS = (0.5, 2.0, 5.0)


def plain_source(source: str) -> str:
    """Return the quantity whose peak, mean or quantiles a source contains."""
    if source in QUANTILE_SOURCES:
        return ARRIVAL
    return 'thickness' if source == EXPECTED else source.removeprefix(PEAK)


@dataclass(frozen=True)
class HazardLimits:
    """Limits of dangerous burial and heat.

    Attributes:
        lethal_thickness: Thickness at which burial alone is lethal [m].
        safe_temperature: Maximum temperature at which heat does no harm [K]; by default 50 C, the
            limit of most machines.
        lethal_temperature: Minimum temperature at which heat alone is lethal to people and
            machines [K]; by default 300 C.
    """

    lethal_thickness: float = 0.5
    safe_temperature: float = 323.15
    lethal_temperature: float = 573.15


@dataclass(frozen=True)
class Layer:
    """One output of the node: a quantity and its message.

    Attributes:
        name: The layer's key in its file.
        topic: Relative topic name.
        source: ``thickness``, ``temperature`` or ``hazard``; in images ``arrived`` or
            ``inundated``; in point clouds and grid maps ``lava``, which stands for all of them.
            For a forecast, ``arrival`` or ``peak_thickness``, ``peak_temperature``,
            ``peak_hazard``; for an ensemble, one of ``ENSEMBLE_SOURCES``.
        message: Full name of the message type.
        range: Values at the two ends of ``scale`` [m, Celsius, hazard, or s]. None for layers
            without a scale, and for times to arrival from 0 to the horizon.
        scale: Grid values at the ends of ``range``; the second may be the smaller one.
        step: Threshold of a mask: cells are 100 at or above it (times to arrival: at or below),
            otherwise 0. None for a scale.
        classes: Increasing bounds between the classes of a quantity. A cell in the k-th of n
            classes is 100 k / n; the last class is the worst, for times to arrival the soonest.
            None for a scale or a mask.
        margin: Clearance [m]. A cell without lava gets the first value of ``scale``, or 100 with a
            step, if any of its points is nearer to a cell with lava than this.
        threshold: Thickness below which a cell counts as dry [m].
        outside: Grid value outside the terrain.
        min_cells: Minimum number of columns and of rows of the message. A smaller grid is
            surrounded by cells of -1.
        heartbeat: Wall time after which the newest message is published again if nothing has
            changed [s]; 0: never.
        enabled: True if the layer is published.
        rate: Maximum message rate [Hz].
        record: True if the messages are recorded in bags.
        qos: QoS of the messages.
        hazard: Limits of the hazard, for layers that show it.
    """

    name: str
    topic: str
    source: str
    message: str
    range: tuple[float, float] | None = None
    scale: tuple[int, int] = (0, 100)
    step: float | None = None
    classes: tuple[float, ...] | None = None
    margin: float = 0.0
    threshold: float = 0.1
    outside: int = -1
    min_cells: int = 0
    heartbeat: float = 0.0
    enabled: bool = True
    rate: float = 1.0
    record: bool = True
    qos: QosProfile = LATCHED
    hazard: HazardLimits = HazardLimits()

    def border(self, shape: tuple[int, ...]) -> list[tuple[int, int]]:
        """Return the cells before and after each axis of a grid that ``min_cells`` adds to it."""
        added = [max(0, self.min_cells - count) for count in shape]
        return [(count // 2, count - count // 2) for count in added]

    @property
    def is_mask(self) -> bool:
        """True if the layer marks cells to avoid now instead of showing a quantity."""
        is_wider = self.step is not None or self.margin > 0.0
        return is_wider and self.message == OCCUPANCY_GRID and not self.is_forecast

    @property
    def offered_qos(self) -> QosProfile:
        """QoS of the publisher; with a heartbeat, deadline and lease are two heartbeats."""
        if not self.heartbeat:
            return self.qos
        deadline_ns = round(2.0 * self.heartbeat * 1e9)
        return replace(self.qos, deadline=deadline_ns, liveliness_lease_duration=deadline_ns)

    @property
    def is_keepout(self) -> bool:
        """True if the layer is a mask of cells that a robot must not enter."""
        return self.is_mask and self.step is not None

    @property
    def is_forecast(self) -> bool:
        """True if the layer shows a forecast."""
        return self.source in FORECAST_SOURCES or self.is_ensemble

    @property
    def is_ensemble(self) -> bool:
        """True if the layer shows an ensemble."""
        return self.source in ENSEMBLE_SOURCES

    def raw_values(self, snapshot: 'Shown') -> np.ndarray:
        """Return the layer's quantity on the terrain's cells; LavaError if it shows several.

        float32, shape [rows, columns]: thickness [m], temperature [Celsius], hazard index
        (``DRAINED`` where lava has been), probability 0..100, or time to or of arrival [s].
        Dry cells are 0, or NaN for temperature and times. Unknown cells, including those outside
        the terrain, are NaN, or ``UNKNOWN`` for times to arrival.
        """
        if self.source in (ARRIVED, INUNDATED):
            values = getattr(snapshot, self.source, None)
            unknown = np.full(snapshot.terrain.shape, np.nan, np.float32)
            return unknown if values is None else values
        if self.source == LAVA:
            expected = f'one of {", ".join(SOURCES)}; grid maps and points have all of them'
            raise LavaError(f'layers.{self.name}.source', self.source, expected)
        if isinstance(snapshot, EnsembleForecast) and self.source == PROBABILITY:
            return snapshot.maps.probability
        return self._raw(plain_source(self.source), self._flow(snapshot))

    def maps(self, snapshot: 'Flow') -> dict[str, np.ndarray]:
        """Return the ground's elevation [m] and, like ``raw_values``, each of ``SOURCES``."""
        elevation = np.asarray(snapshot.terrain.elevation, dtype=np.float32)
        return {'elevation': elevation} | {name: self._raw(name, snapshot) for name in SOURCES}

    def points(self, snapshot: 'Flow') -> dict[str, np.ndarray]:
        """Return a point on the lava's surface for each wet cell, row by row.

        Columns are ``x``, ``y``, ``z`` [m], ``thickness`` [m] and ``temperature`` [Celsius, NaN
        where it is unknown], float32, one value per point.
        """
        wet, thickness = self._quantity('thickness', snapshot)
        rows, columns = np.nonzero(wet)
        terrain = snapshot.terrain
        values = {
            'x': terrain.origin[0] + (columns + 0.5) * terrain.resolution,
            'y': terrain.origin[1] + (rows + 0.5) * terrain.resolution,
            'z': terrain.elevation[wet] + thickness,
            'thickness': thickness,
            'temperature': snapshot.temperature[wet] - np.float32(ZERO_CELSIUS),
        }
        return {name: np.asarray(column, dtype=np.float32) for name, column in values.items()}

    def grid_values(self, snapshot: 'Shown') -> np.ndarray:
        """Return the layer's quantity on the scale of an occupancy grid.

        int8, shape [rows, columns]: 0 without lava, 1 to 100 with lava, ``outside`` outside the
        terrain; with a step or classes, as in the attributes. Wet cells of unknown quantity have
        the value at the high end of the range, or beyond the step. A probability is 0 only if no
        member has lava, and 100 only if all have.

        Raises:
            LavaError: If the layer has no range, step or classes.
        """
        flow, source = self._flow(snapshot), plain_source(self.source)
        is_probability = isinstance(snapshot, EnsembleForecast) and self.source == PROBABILITY
        if is_probability:
            # a step of 0 also marks cells that no member reaches
            percent = self.raw_values(snapshot)
            wet = np.isfinite(percent) if self.step is not None else percent > 0.0
            quantity = percent[wet]
        else:
            wet, quantity = self._quantity(source, flow)
        is_time = isinstance(flow, Forecast) and source == ARRIVAL
        distance = self.margin / flow.terrain.resolution
        values = np.zeros(flow.thickness.shape, dtype=np.int8)
        if self.step is not None:
            reached = wet.copy()
            # false for NaN: unknown values are above the step
            is_below = quantity < np.float32(self.step)
            reached[wet] = quantity <= np.float32(self.step) if is_time else ~is_below
            values[within(reached, distance)] = 100
        elif self.classes is not None:
            values[wet] = self._classed(quantity, is_time=is_time)
        elif is_probability:
            values = occupancy(percent)
        else:
            ends = self.range
            if ends is None and isinstance(flow, Forecast) and is_time:
                ends = (0.0, flow.horizon)
            if ends is None:
                raise LavaError(f'layers.{self.name}.range', None, 'two numbers [low, high]')
            first, last = self.scale
            gain = np.float32((last - first) / (ends[1] - ends[0]))
            scaled = np.rint(np.float32(first) + (quantity - np.float32(ends[0])) * gain)
            scaled = np.where(np.isnan(scaled), last, scaled)
            values[within(wet, distance)] = max(1, first)
            # wet cells are never 0
            values[wet] = np.clip(scaled, max(1, min(self.scale)), max(self.scale))
        values[np.isnan(flow.thickness)] = self.outside
        return values

    def values(self, snapshot: 'Shown') -> np.ndarray:
        """Return grid values for an occupancy grid, or raw values for an image."""
        if self.message == OCCUPANCY_GRID:
            return self.grid_values(snapshot)
        return self.raw_values(snapshot)

    def _flow(self, shown: 'Shown') -> 'Flow':
        """Return the flow; for an ensemble, its forecast by this layer's fraction of members."""
        if isinstance(shown, EnsembleForecast):
            return shown.forecast(QUANTILE_SOURCES.get(self.source, 0.5))
        return shown

    def _classed(self, quantity: np.ndarray, *, is_time: bool) -> np.ndarray:
        """Return the grid values of classes; unknown values are in the worst class."""
        assert self.classes is not None
        bounds = np.array(self.classes, dtype=np.float32)
        if is_time:
            # a class includes its upper bound
            place = len(bounds) - np.searchsorted(bounds, quantity, side='left')
        else:
            place = np.searchsorted(bounds, quantity, side='right')
        return np.rint(100.0 * (place + 1) / (len(bounds) + 1)).astype(np.int8)

    def _raw(self, source: str, snapshot: 'Flow') -> np.ndarray:
        wet, quantity = self._quantity(source, snapshot)
        dry_value = np.nan if source in ('temperature', ARRIVAL) else 0.0
        values = np.full(snapshot.thickness.shape, dry_value, dtype=np.float32)
        values[wet] = quantity
        values[np.isnan(snapshot.thickness)] = UNKNOWN if source == ARRIVAL else np.nan
        return values

    def _quantity(self, source: str, snapshot: 'Flow') -> tuple[np.ndarray, np.ndarray]:
        """Return the cells with lava, bool, shape [rows, columns], and a quantity in them.

        For the hazard index, all cells that lava has reached are among them.
        """
        if isinstance(snapshot, Forecast) and source == ARRIVAL:
            wet = reached_cells(snapshot.arrival)
            return wet, snapshot.arrival[wet]
        wet = (snapshot.thickness > 0.0) & standing_cells(snapshot.thickness, self.threshold)
        thickness, temperature = snapshot.thickness[wet], snapshot.temperature[wet]
        if source == 'thickness':
            return wet, thickness
        if source == 'temperature':
            return wet, temperature - np.float32(ZERO_CELSIUS)
        index = np.full(wet.shape, np.float32(DRAINED))
        index[wet] = hazard(thickness, temperature, self.hazard)
        times = snapshot.arrival if isinstance(snapshot, Forecast) else snapshot.arrived
        if times is not None:
            wet = wet | (reached_cells(times) & np.isfinite(snapshot.thickness))
        return wet, index[wet]


def within(marked: np.ndarray, distance: float) -> np.ndarray:
    """Mark every cell with a point nearer than ``distance`` to a marked cell.

    Args:
        marked: Marked cells, bool, shape [rows, columns].
        distance: Distance between the nearest edges of two cells [cells].

    Returns:
        Marked cells and all cells near them, bool, same shape.
    """
    result = marked.copy()
    if distance <= 0.0 or not marked.any():
        return result
    reach = math.ceil(distance)
    box = tuple(
        slice(max(0, int(indices.min()) - reach), int(indices.max()) + reach + 1)
        for indices in np.nonzero(marked)
    )
    part, grown = marked[box], result[box]
    far = np.int32(sum(part.shape) + reach)
    columns = np.arange(part.shape[1], dtype=np.int32)
    before = np.maximum.accumulate(np.where(part, columns, -far), axis=1)
    after = np.minimum.accumulate(np.where(part, columns, far)[:, ::-1], axis=1)[:, ::-1]
    # Number of cells between each cell and the nearest marked cell of its row.
    gap = np.maximum(np.minimum(columns - before, after - columns) - 1, 0)
    for step in range(min(reach, part.shape[0] - 1) + 1):
        near = gap < math.sqrt(distance**2 - max(step - 1, 0) ** 2)
        grown[step:] |= near[: len(near) - step]
        grown[: len(near) - step] |= near[step:]
    return result


def hazard(
    thickness: np.ndarray, temperature: np.ndarray, limits: HazardLimits = HazardLimits()
) -> np.ndarray:
    """Combine burial and heat into one hazard index per cell: a severity, not a probability.

    Burial grows linearly from 0 to 1 at the lethal thickness, heat from 0 at the safe to 1 at the
    lethal temperature. The index is ``100 (1 - (1 - burial) (1 - heat))``, the formula for
    independent events. It never decreases when the lava becomes thicker or hotter.

    Args:
        thickness: Lava thickness [m], shape [rows, columns], NaN outside the terrain.
        temperature: Lava temperature [K], same shape, NaN without lava. Lava of unknown
            temperature counts as lethally hot.
        limits: Limits of dangerous burial and heat.

    Returns:
        Hazard, float32, same shape: 0 without lava, 1 to 100 with lava, NaN outside the terrain.
    """
    thickness = np.asarray(thickness, dtype=np.float32)
    temperature = np.asarray(temperature, dtype=np.float32)
    wet = thickness > 0.0
    burial = np.clip(thickness / np.float32(limits.lethal_thickness), 0.0, 1.0)
    span = np.float32(limits.lethal_temperature - limits.safe_temperature)
    heat = np.clip((temperature - np.float32(limits.safe_temperature)) / span, 0.0, 1.0)
    heat = np.where(np.isnan(temperature), np.float32(1.0), heat)
    combined = 100.0 * (1.0 - (1.0 - burial) * (1.0 - heat))
    result = np.where(wet, np.maximum(combined, 1.0), 0.0)
    return np.where(np.isnan(thickness), np.nan, result).astype(np.float32)
