# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Maps of an ensemble: probability, arrival times and expected peak thickness.

Members are added as integers, whose sums do not depend on the order: any number of workers gives
bitwise identical maps. The error due to the particle spacing, measured by pairs of runs, shifts
and widens the arrival times (layers/spacing_error.py).
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
import math

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.forecast.members import MemberFields, Plan
from lava_ros.forecast.sentinels import CalledEffect
from lava_ros.layers.forecast import HazardMaps, PlaceForecast, QUANTILES, WorstCase
from lava_ros.layers.places import Places
from lava_ros.layers.spacing_error import SpacingError, SpacingPair
from lava_ros.scene import MAX_ELEVATION
from lava_ros.simulation.output.budget import GONE
from lava_ros.simulation.output.inundation import reached_cells, TOUCHED

#: Rounding error of sums of corrected weights.
_ROUNDING = 1e-6

#: Number of the observation in a cell without lava.
NEVER = np.iinfo(np.uint16).max


@dataclass(frozen=True, eq=False)
class Footprint:
    """The result of a member in integers, on the rectangle that its lava reached.

    Attributes:
        index: The member's number.
        corner: Row and column of the rectangle's first cell.
        first_sample: Number of observations before lava at or above the threshold touches the
            cell, uint16, shape [rows, columns] of the rectangle; ``NEVER`` without lava.
        half_sample: Number of observations before it has covered half of the cell, as
            ``first_sample``.
        inundated: Fraction of the cell that it has covered by the horizon, in units of
            ``TOUCHED``, uint8, same shape.
        millimetres: Peak thickness [mm], uint32, same shape.
        left: Fraction of the emitted volume that has left the map.
        called, pair: As in ``MemberFields``.
    """

    index: int
    corner: tuple[int, int]
    first_sample: np.ndarray
    half_sample: np.ndarray
    inundated: np.ndarray
    millimetres: np.ndarray
    left: float = 0.0
    called: tuple[CalledEffect, ...] = ()
    pair: SpacingPair | None = None


def footprint_of(member: MemberFields, plan: Plan) -> Footprint:
    """Round a member's fields to whole observations and millimetres."""
    peak = np.nan_to_num(np.asarray(member.peak, dtype=np.float64))
    millimetres = np.rint(1000.0 * np.clip(peak, 0.0, MAX_ELEVATION)).astype(np.uint32)
    first, half = (_samples(times, plan) for times in (member.arrival, member.half_inundated))
    parts = first, half, np.rint(member.inundated / TOUCHED).astype(np.uint8), millimetres
    wet = reached_cells(member.arrival) | (millimetres > 0)
    rows, columns = (np.flatnonzero(wet.any(axis=axis)) for axis in (1, 0))
    part, corner = np.s_[:0, :0], (0, 0)
    if rows.size:
        part = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        corner = member.corner[0] + int(rows[0]), member.corner[1] + int(columns[0])
    first, half, inundated, millimetres = (values[part].copy() for values in parts)
    return Footprint(
        member.index, corner, first, half, inundated, millimetres, member.left, member.called,
        member.pair,
    )


def _samples(times: np.ndarray, plan: Plan) -> np.ndarray:
    """Return the number of observations before each time [s], ``NEVER`` for NaN, uint16."""
    known = np.isfinite(times)
    sample = np.full(times.shape, NEVER, dtype=np.uint16)
    before = np.floor(times[known].astype(np.float64) / plan.interval)
    sample[known] = np.clip(before, 0, plan.samples - 1)
    return sample


def footprint_by(
    footprint: Footprint, plan: Plan, time: float, error: SpacingError | None = None
) -> np.ndarray:
    """Return the cells half inundated by a member by a time [s], bool, of the terrain's shape.

    With a usable error of the particle spacing, they are taken at the later time at which the
    member, which is late, has reached the same extent. Times after the horizon are unknown, and
    are replaced by the horizon. Cells of which the ground then has no data are left out.
    """
    has_data = plan.ground_at(time).has_data
    if error is not None and error.is_usable:
        time = min(time * math.exp(error.delay), max(time, plan.horizon))
    inundated = np.zeros(plan.scene.terrain.shape, dtype=bool)
    rows, columns = footprint.half_sample.shape
    row, column = footprint.corner
    by_then = (footprint.half_sample.astype(np.float64) + 0.5) * plan.interval <= time
    by_then &= footprint.half_sample != NEVER
    inundated[row : row + rows, column : column + columns] = by_then
    return inundated & has_data


def spacing_error_of(members: Iterable[Footprint], plan: Plan) -> SpacingError | None:
    """Return the error due to the particle spacing from pairs of members, None without pairs."""
    return _error_of({item.index: item.pair for item in members if item.pair is not None}, plan)


def _error_of(pairs: Mapping[int, SpacingPair], plan: Plan) -> SpacingError | None:
    """Return the error of pairs by the number of the member, independent of their order."""
    return SpacingError.of([pairs[index] for index in sorted(pairs)], plan.accuracy)


def first_samples(footprint: Footprint, places: Places) -> np.ndarray:
    """Find the first observation with lava at each place, ``NEVER`` without: [places]."""
    rows, columns = (
        cells - first
        for cells, first in zip((places.rows, places.columns), footprint.corner, strict=True)
    )
    height, width = footprint.first_sample.shape
    inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    result = np.full(len(places), NEVER, dtype=footprint.first_sample.dtype)
    samples = footprint.first_sample[rows[inside], columns[inside]]
    np.minimum.at(result, places.owner[inside], samples)
    return result


class EnsembleAccumulator:
    """Accumulator of members, each added once, in any order."""

    def __init__(self, plan: Plan, places: Places | None = None) -> None:
        """Initialize without members; the maps include arrival times at ``places``, if any."""
        self._plan, self._places = plan, places
        self._place_arrivals = np.zeros((len(places or ()), plan.samples), dtype=np.int64)
        shape = plan.scene.terrain.shape
        self._depth = np.zeros(shape, dtype=np.int64)
        self._largest_depth = np.zeros(shape, dtype=np.int64)
        # only cells that a member has reached have a row in the table of arrivals
        self._row = np.full(shape, -1, dtype=np.int64)
        self._arrivals = np.zeros((1024, plan.samples), dtype=np.int64)
        # weights of the members by the part of the cell that they have inundated
        self._parts = np.zeros((1024, round(1.0 / TOUCHED) + 1), dtype=np.int64)
        self._rows = 0
        self._added: set[int] = set()
        self._pairs: dict[int, SpacingPair] = {}
        self._total = self._squares = self._beyond = 0

    @property
    def count(self) -> int:
        """Number of members."""
        return len(self._added)

    def add(self, footprint: Footprint, weight: int = 1) -> None:
        """Add a member with a relative weight.

        Raises:
            LavaError: If the member has been added already, or extends beyond the terrain.
        """
        if footprint.index in self._added:
            raise LavaError('member', footprint.index, 'a member that has not been added yet')
        rows, columns = footprint.first_sample.shape
        row, column = footprint.corner
        shape = self._plan.scene.terrain.shape
        if min(row, column) < 0 or row + rows > shape[0] or column + columns > shape[1]:
            expected = f'a member on a terrain of {shape} cells'
            found = f'{rows} x {columns} cells, starting at {footprint.corner}'
            raise LavaError(f'member {footprint.index}', found, expected)
        self._added.add(footprint.index)
        if footprint.pair is not None:
            self._pairs[footprint.index] = footprint.pair
        self._beyond += footprint.left > GONE
        self._total += weight
        self._squares += weight * weight
        part = np.s_[row : row + rows, column : column + columns]
        depth = footprint.millimetres.astype(np.int64)
        self._depth[part] += weight * depth
        if weight:
            np.maximum(self._largest_depth[part], depth, out=self._largest_depth[part])
        arrived, row_of = footprint.first_sample != NEVER, self._row[part]
        new = arrived & (row_of < 0)
        row_of[new] = self._rows + np.arange(np.count_nonzero(new))
        self._rows += np.count_nonzero(new)
        if self._rows > len(self._arrivals):
            more = max(self._rows - len(self._arrivals), len(self._arrivals))
            self._arrivals = np.pad(self._arrivals, ((0, more), (0, 0)))
            self._parts = np.pad(self._parts, ((0, more), (0, 0)))
        # a footprint contains each cell once, so that no sum is lost
        self._arrivals[row_of[arrived], footprint.first_sample[arrived]] += weight
        self._parts[row_of[arrived], footprint.inundated[arrived]] += weight
        if self._places is not None:
            first = first_samples(footprint, self._places)
            reached = first != NEVER
            self._place_arrivals[np.flatnonzero(reached), first[reached]] += weight

    def maps(self) -> HazardMaps:
        """Return the maps of all members.

        Raises:
            LavaError: If there are no members, or all have a weight of 0.
        """
        if not self._total:
            raise LavaError('members', self.count, 'at least one with a weight above 0')
        terrain = self._plan.ground_at(self._plan.horizon)

        def on_terrain(reached_values: np.ndarray, elsewhere: float) -> np.ndarray:
            values = np.full(terrain.shape, elsewhere)
            values[reached] = reached_values
            return np.where(terrain.has_data, values, np.nan).astype(np.float32)

        reached = self._row >= 0
        rows = self._row[reached]
        error, counts = self.spacing_error, self._arrivals[: self._rows][rows]
        corrected = error if error is not None and error.is_usable else None
        end = 0.0 if corrected is None else corrected.end(counts, self._total)
        cells = self._when(counts, corrected, end)
        interval = 0.5 * self._plan.interval
        return HazardMaps(
            probability=on_terrain(cells.probability, 0.0),
            arrival={
                share: on_terrain(times, np.nan) for share, times in cells.arrival.items()
            },
            thickness=np.where(
                terrain.has_data, 1e-3 * self._depth / self._total, np.nan
            ).astype(np.float32),
            inundated={
                share: on_terrain(self._least_part(self._needed(share))[rows], 0.0)
                for share in QUANTILES
            },
            members=self.count,
            effective_members=self._total**2 / self._squares,
            arrival_error=interval
            + (0.0 if error is None else error.arrival_error(self._plan.horizon)),
            members_beyond=self._beyond,
            places=None if self._places is None else self._when(
                self._place_arrivals, corrected, end
            ),
            worst=WorstCase(
                arrival=on_terrain(cells.earliest, np.nan),
                inundated=on_terrain(self._least_part(self._needed(0.0))[rows], 0.0),
                thickness=np.where(
                    terrain.has_data, 1e-3 * self._largest_depth, np.nan
                ).astype(np.float32),
            ),
            spacing_error=error,
        )

    @property
    def spacing_error(self) -> SpacingError | None:
        """Error due to the particle spacing from the pairs of the members, None without pairs."""
        return _error_of(self._pairs, self._plan)

    def _least_part(self, needed: int) -> np.ndarray:
        """Return the part of each cell that members with a sum of weights inundate, [rows]."""
        # the members that inundate at least each part
        sums = np.cumsum(self._parts[: self._rows, ::-1], axis=1)[:, ::-1]
        return (np.count_nonzero(sums[:, 1:] >= needed, axis=1) * TOUCHED).astype(np.float32)

    def _needed(self, share: float) -> int:
        """Return the smallest sum of weights above 0 that is at least a fraction of the total."""
        # exact integers, because 0.1 is not a binary fraction
        return max(int(-(-self._total * Fraction(str(share)) // 1)), 1)

    def _when(
        self, arrivals: np.ndarray, error: SpacingError | None, end: float
    ) -> PlaceForecast:
        """Convert the weights arriving at each sample, [places, samples], to a forecast."""
        sums = np.cumsum(arrivals, axis=1)
        is_reached, first = sums[:, -1] > 0, np.ones(len(sums))
        if error is not None:
            # the correction spreads a member over several samples
            earliest = np.take_along_axis(arrivals, (arrivals > 0).argmax(axis=1)[:, None], 1)
            sums = np.cumsum(error.corrected(arrivals, self._total, end), axis=1)
            first = np.minimum(0.5 * earliest[:, 0], sums[:, -1])

        def time_of(needed: np.ndarray | float) -> np.ndarray:
            enough = sums >= np.reshape(needed, (-1, 1)) - _ROUNDING
            times = (enough.argmax(axis=1) + 0.5) * self._plan.interval
            return np.where(enough[:, -1], times, np.nan).astype(np.float32)

        return PlaceForecast(
            (100.0 * np.minimum(sums[:, -1] / self._total, 1.0)).astype(np.float32),
            {share: time_of(self._needed(share)) for share in QUANTILES},
            np.where(is_reached, time_of(first), np.float32(np.nan)),
        )
