# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The layers of a simulation that are published, as a file in msg_configs/ describes them."""

from dataclasses import dataclass, replace
import math
from typing import TYPE_CHECKING

import numpy as np

from lava_ros.bag.qos import LATCHED, QosProfile
from lava_ros.errors import LavaError
from lava_ros.maps.forecast import EnsembleForecast, Forecast, occupancy, UNKNOWN
from lava_ros.simulation.inundation import inundated_cells, standing_cells

if TYPE_CHECKING:
    # The solver's package loads Warp, which files and messages do not need.
    from lava_ros.simulation.snapshot import Snapshot

    #: The flow of now, or the largest of what comes.
    Flow = Snapshot | Forecast

    #: What a layer shows: that, or how likely it is.
    Shown = Flow | EnsembleForecast

#: 0 C in kelvin.
ZERO_CELSIUS = 273.15

OCCUPANCY_GRID = 'nav_msgs/msg/OccupancyGrid'
IMAGE = 'sensor_msgs/msg/Image'
POINT_CLOUD = 'sensor_msgs/msg/PointCloud2'
GRID_MAP = 'grid_map_msgs/msg/GridMap'

#: Quantities that a message may show alone.
SOURCES = ('thickness', 'temperature', 'hazard')

#: The source that says when lava has come, in simulated time.
ARRIVED = 'arrived'

#: The source that says when lava comes.
ARRIVAL = 'arrival'

#: What stands before a source of ``SOURCES`` for the worst of it within a forecast's horizon.
PEAK = 'peak_'

#: Quantities of a forecast, each shown alone.
FORECAST_SOURCES = (ARRIVAL, *(PEAK + source for source in SOURCES))

#: The source that says how likely lava comes within the horizon of an ensemble.
PROBABILITY = 'inundation_probability'

#: Share of an ensemble's members that have lava by a time, by the source that says when.
QUANTILE_SOURCES = {'arrival_p10': 0.1, 'arrival_p50': 0.5, 'arrival_p90': 0.9}

#: The source that says how thick lava gets at most, on average over an ensemble.
EXPECTED = 'expected_peak_thickness'

#: Quantities of an ensemble, each shown alone.
ENSEMBLE_SOURCES = (PROBABILITY, *QUANTILE_SOURCES, EXPECTED)

#: The source of messages that show several quantities side by side.
LAVA = 'lava'

#: QoS deadline and liveliness lease of a layer with a heartbeat, in heartbeats.
DEADLINE_HEARTBEATS = 2

#: Hazard index of a cell that lava has reached and left: its ground is hot, and real lava leaves a
#: crust that the model does not have, so nobody may go there; no lava can bury anything in it now.
DRAINED = 50

#: Where classes of depth end that people can picture: a knee, somebody's height, a roof [m].
DEPTHS = (0.5, 2.0, 5.0)


def plain_source(source: str) -> str:
    """What a source is about: ``thickness`` of its peak and its mean, ``arrival`` of quantiles."""
    if source in QUANTILE_SOURCES:
        return ARRIVAL
    return 'thickness' if source == EXPECTED else source.removeprefix(PEAK)


@dataclass(frozen=True)
class HazardLimits:
    """Where burial and heat become dangerous.

    Attributes:
        lethal_thickness: Thickness at which burial alone is lethal [m].
        safe_temperature: Temperature up to which heat does no harm [K]; by default 50 C, the
            limit of most machines.
        lethal_temperature: Temperature from which heat alone is lethal to people and machines [K],
            by default 300 C.
    """

    lethal_thickness: float = 0.5
    safe_temperature: float = 323.15
    lethal_temperature: float = 573.15


@dataclass(frozen=True)
class Layer:
    """One output of the node: what is shown and how it becomes a message.

    Attributes:
        name: The layer's key in its file.
        topic: Relative topic name.
        source: ``thickness``, ``temperature`` or ``hazard``; in images ``arrived``; in point
            clouds and grid maps ``lava``, which is all of them. Of a forecast ``arrival`` or
            ``peak_thickness``, ``peak_temperature``, ``peak_hazard``; of an ensemble one of
            ``ENSEMBLE_SOURCES``.
        message: Full name of the message type.
        range: Values that map to the two ends of ``scale`` [m, Celsius, hazard, or s]; None for
            what is not scaled and for masks with a step, and for the arrival, whose range is that
            of its forecast.
        scale: Grid values at the ends of ``range``; the second may be the smaller.
        step: Value from which on a cell is 100, and 0 below it: a mask; for the arrival up to
            which, and 0 beyond it; None for a scale.
        classes: Values at which one class of a quantity ends and the next begins, increasing: a
            cell is 100 k / n in the k-th of n classes, the last one the worst, for an arrival the
            soonest; None for a scale or a mask.
        margin: Clearance [m]. A cell without lava that has a point nearer than this to a cell with
            lava gets the first value of ``scale``, or 100 with a step.
        threshold: Thickness below which a cell counts as dry [m].
        outside: Grid value outside the terrain.
        min_cells: Minimum number of columns and of rows of the message. A smaller grid is
            surrounded by cells of -1.
        heartbeat: Wall time after which the newest message is published again if nothing has
            changed [s]; 0: never.
        enabled: Whether the layer is published at all.
        rate: Messages per second [Hz], at most.
        record: Whether the messages go into a bag that is being recorded.
        qos: Delivery of the messages.
        hazard: Limits of the hazard, where it is shown.
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

    @property
    def is_mask(self) -> bool:
        """Whether it says where not to go now, not what is there."""
        is_wider = self.step is not None or self.margin > 0.0
        return is_wider and self.message == OCCUPANCY_GRID and not self.is_forecast

    @property
    def offered_qos(self) -> QosProfile:
        """QoS of the publisher: with a heartbeat, also a deadline and a liveliness lease."""
        if not self.heartbeat:
            return self.qos
        deadline_ns = round(DEADLINE_HEARTBEATS * self.heartbeat * 1e9)
        return replace(self.qos, deadline=deadline_ns, liveliness_lease_duration=deadline_ns)

    @property
    def is_keepout(self) -> bool:
        """True if the layer is a mask of cells that a robot must not enter."""
        return self.is_mask and self.step is not None

    @property
    def is_forecast(self) -> bool:
        """Whether it shows what comes in place of a snapshot."""
        return self.source in FORECAST_SOURCES or self.is_ensemble

    @property
    def is_ensemble(self) -> bool:
        """Whether it shows an ensemble."""
        return self.source in ENSEMBLE_SOURCES

    def raw_values(self, snapshot: 'Shown') -> np.ndarray:
        """Return the layer's quantity on the terrain's cells; LavaError if it shows several.

        float32, shape [rows, columns]: thickness [m], temperature [Celsius], hazard index
        (``DRAINED`` where lava has been) or probability 0..100, arrival [s], or time [s] of it.
        Dry cells are 0, or NaN for temperature and both of these; cells of which nothing is known,
        as outside the terrain, are NaN, and for the
        arrival ``UNKNOWN``.
        """
        if self.source == ARRIVED:
            times = getattr(snapshot, 'arrived', None)
            return np.full(snapshot.terrain.shape, np.nan, np.float32) if times is None else times
        if self.source == LAVA:
            right = f'one of {", ".join(SOURCES)}; maps and points have them all'
            raise LavaError(f'layers.{self.name}.source', self.source, right)
        if isinstance(snapshot, EnsembleForecast) and self.source == PROBABILITY:
            return snapshot.maps.probability
        return self._raw(plain_source(self.source), self._flow(snapshot))

    def maps(self, snapshot: 'Flow') -> dict[str, np.ndarray]:
        """Return the ground's elevation [m] and each of ``SOURCES`` as ``raw_values`` does."""
        elevation = np.asarray(snapshot.terrain.elevation, dtype=np.float32)
        return {'elevation': elevation} | {name: self._raw(name, snapshot) for name in SOURCES}

    def points(self, snapshot: 'Flow') -> dict[str, np.ndarray]:
        """Return a point on the lava's surface for each wet cell, row by row.

        Columns are ``x``, ``y``, ``z`` [m], ``thickness`` [m] and ``temperature`` [Celsius, NaN
        where it is unknown], float32, one value a point.
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
        terrain. With a step 100 from it on and 0 below, with classes theirs. A wet cell whose
        quantity is unknown is as one at the range's high end, or beyond the step. A probability is
        0 only where no member has lava, and 100 only where all have. LavaError where the layer has
        neither a range, a step nor classes.
        """
        if isinstance(snapshot, EnsembleForecast) and self.source == PROBABILITY:
            return self._probabilities(snapshot)
        flow, source = self._flow(snapshot), plain_source(self.source)
        wet, quantity = self._quantity(source, flow)
        is_time = isinstance(flow, Forecast) and source == ARRIVAL
        distance = self.margin / flow.terrain.resolution
        values = np.zeros(flow.thickness.shape, dtype=np.int8)
        if self.step is not None:
            reached = wet.copy()
            # The comparison is false for what is unknown.
            is_below = quantity < np.float32(self.step)
            reached[wet] = quantity <= np.float32(self.step) if is_time else ~is_below
            values[within(reached, distance)] = 100
        elif self.classes is not None:
            values[wet] = self._classed(quantity, is_time=is_time)
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
            # never 0
            values[wet] = np.clip(scaled, max(1, min(self.scale)), max(self.scale))
        values[np.isnan(flow.thickness)] = self.outside
        return values

    def values(self, snapshot: 'Shown') -> np.ndarray:
        """Return what a grid or an image carries: grid values or raw values by message type."""
        if self.message == OCCUPANCY_GRID:
            return self.grid_values(snapshot)
        return self.raw_values(snapshot)

    def _flow(self, shown: 'Shown') -> 'Flow':
        """What is shown, of an ensemble the forecast by this layer's share of the members."""
        if isinstance(shown, EnsembleForecast):
            return shown.forecast(QUANTILE_SOURCES.get(self.source, 0.5))
        return shown

    def _probabilities(self, ensemble: EnsembleForecast) -> np.ndarray:
        values = occupancy(ensemble.maps.probability)
        if self.step is not None:
            distance = self.margin / ensemble.terrain.resolution
            likely = within(ensemble.maps.probability >= np.float32(self.step), distance)
            values = np.where(likely, np.int8(100), np.int8(0))
        elif self.classes is not None:
            classed = self._classed(ensemble.maps.probability, is_time=False)
            values = np.where(values > 0, classed, values)
        values[np.isnan(ensemble.maps.probability)] = self.outside
        return values

    def _classed(self, quantity: np.ndarray, *, is_time: bool) -> np.ndarray:
        """Grid values of the classes that a quantity is in; what is unknown is in the worst."""
        assert self.classes is not None
        bounds = np.array(self.classes, dtype=np.float32)
        if is_time:
            # up to a bound, and sooner
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
        """Where this layer sees lava, bool, shape [rows, columns], and a quantity there.

        The hazard index is above 0 in all inundated cells as well.
        """
        if isinstance(snapshot, Forecast) and source == ARRIVAL:
            wet = inundated_cells(snapshot.arrival)
            return wet, snapshot.arrival[wet]
        wet = (snapshot.thickness > 0.0) & standing_cells(snapshot.thickness, self.threshold)
        thickness, temperature = snapshot.thickness[wet], snapshot.temperature[wet]
        if source == 'thickness':
            return wet, thickness
        if source == 'temperature':
            return wet, temperature - np.float32(ZERO_CELSIUS)
        index = np.full(wet.shape, np.float32(DRAINED))
        index[wet] = hazard(thickness, temperature, self.hazard)
        came = snapshot.arrival if isinstance(snapshot, Forecast) else snapshot.arrived
        if came is not None:
            wet = wet | (inundated_cells(came) & np.isfinite(snapshot.thickness))
        return wet, index[wet]


def within(marked: np.ndarray, distance: float) -> np.ndarray:
    """Mark every cell that has a point nearer than ``distance`` to a marked cell.

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
    """Combine burial and heat into one index of severity per cell; it is no probability.

    Burial grows linearly from 0 to 1 at the lethal thickness, heat from 0 at the safe to 1 at the
    lethal temperature; the hazard is ``100 (1 - (1 - burial) (1 - heat))``, as if the two struck
    independently. It never decreases when the lava gets thicker or hotter.

    Args:
        thickness: Lava thickness [m], shape [rows, columns], NaN outside the terrain.
        temperature: Lava temperature [K], same shape, NaN where there is no lava. Lava of unknown
            temperature counts as lethally hot.
        limits: Where burial and heat become dangerous.

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
