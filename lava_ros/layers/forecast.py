# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Results of forecasts: arrival times, thickness and temperature, and maps of ensembles."""

from dataclasses import dataclass, replace
import math
from typing import Any

import numpy as np

from lava_ros.layers.spacing_error import SpacingError
from lava_ros.scene import Terrain
from lava_ros.simulation.carriers import METHODS
from lava_ros.simulation.output.inundation import area_of

#: Time to arrival in unknown cells, as returned by ``Layer.raw_values`` [s].
UNKNOWN = -1.0

#: Fractions of the members for which maps show arrival times.
QUANTILES = (0.1, 0.5, 0.9)


@dataclass(frozen=True, eq=False)
class Forecast:
    """A forecast from one moment of a simulation, on the cells of its terrain.

    Attributes:
        time: Simulated time at its start [s].
        horizon: Time span of the forecast [s].
        threshold: Lava has arrived where its thickness is at or above this value [m].
        terrain: The ground.
        arrival: Time to arrival from the start [s], float32, shape [rows, columns]; 0 in cells
            with lava at the start, NaN in cells without arrival within the horizon.
        inundated: Fraction of each cell that lava has covered by the horizon, float32, same shape;
            NaN if unknown.
        thickness: Peak thickness within the horizon [m], float32, same shape; 0 without lava, NaN
            if unknown: outside the terrain, and after a withdrawal.
        temperature: Maximum depth-averaged temperature within the horizon [K], float32, same
            shape; NaN without lava.
        duration: Wall time of the computation [s].
        particle_count: Number of particles, or of cells with lava, at its end.
        method: Carriers of the lava (``Accuracy.method``).
        stamp_ns: ROS time of its start [ns], of a live simulation.
        changes: Number of changes of scene or effects before its start, of a live simulation.
    """

    time: float
    horizon: float
    threshold: float
    terrain: Terrain
    arrival: np.ndarray
    inundated: np.ndarray
    thickness: np.ndarray
    temperature: np.ndarray
    duration: float
    particle_count: int
    method: str = METHODS[0]
    stamp_ns: int = 0
    changes: int = 0

    def withdrawn(self) -> 'Forecast':
        """Return the forecast with all cells unknown."""
        unknown = np.full(self.arrival.shape, np.nan, dtype=np.float32)
        return replace(
            self, arrival=unknown, inundated=unknown, thickness=unknown, temperature=unknown
        )


@dataclass(frozen=True, eq=False)
class PlaceForecast:
    """Arrival of an ensemble's lava at places, in the first cell of each place.

    Attributes:
        probability: Probability of arrival within the horizon, 0 to 100, shape [places].
        arrival: Times [s] by which lava has arrived in a fraction of the members, by the fractions
            in ``QUANTILES``, shape [places]; NaN where it arrives in fewer members.
        earliest: Time [s] of the earliest arrival of any member, shape [places]; NaN where lava
            arrives in none.
    """

    probability: np.ndarray
    arrival: dict[float, np.ndarray]
    earliest: np.ndarray


@dataclass(frozen=True, eq=False)
class WorstCase:
    """The worst of the members in each cell, float32, shape [rows, columns].

    Another eruption drawn like the members is worse in a cell with a probability of up to
    1 / (n + 1), of n members (``HazardMaps.unseen``).

    Attributes:
        arrival: Earliest arrival of any member [s]; NaN where lava arrives in none.
        inundated: Largest fraction of the cell that the lava of any member has covered.
        thickness: Largest thickness of any member [m].
    """

    arrival: np.ndarray
    inundated: np.ndarray
    thickness: np.ndarray


@dataclass(frozen=True, eq=False)
class HazardMaps:
    """The maps of an ensemble on the cells of the terrain.

    All arrays are float32, have the terrain's shape, and are NaN where the terrain has no data at
    the horizon.

    Attributes:
        probability: Inundation probability within the horizon, 0 to 100: the fraction of the
            members whose lava reaches the cell.
        arrival: Times [s] by which lava has arrived in a fraction of the members, by the fractions
            in ``QUANTILES``; NaN where it arrives in fewer members within the horizon.
        inundated: Fractions of the cells that lava has covered within the horizon in a fraction of
            the members, by the fractions in ``QUANTILES``.
        thickness: Mean over all members of the peak thickness [m].
        members: Number of members in the maps.
        effective_members: Number of members of equal weight with the same information,
            (sum w)^2 / sum w^2.
        arrival_error: Error of arrival times [s]: half the time between observations, and the
            error of the particle spacing for lava that arrives at the horizon, if it has been
            measured. The error of a time step is added to it.
        members_beyond: Number of members with lava that has left the map.
        places: Arrival at the named places; None without places.
        worst: The worst of the members in each cell; None if unknown.
        spacing_error: Error due to the particle spacing. Arrival times, probabilities and
            ``areas`` are corrected for it if it is usable; None if no pairs have measured it.
    """

    probability: np.ndarray
    arrival: dict[float, np.ndarray]
    inundated: dict[float, np.ndarray]
    thickness: np.ndarray
    members: int
    effective_members: float
    arrival_error: float
    members_beyond: int = 0
    places: PlaceForecast | None = None
    worst: WorstCase | None = None
    spacing_error: SpacingError | None = None

    def areas(self, resolution: float) -> dict[float, float]:
        """Return the area inundated in at least a fraction of the members [m2], by ``QUANTILES``.

        ``resolution`` is the side of a cell [m]. A part of a cell counts if that fraction of the
        members inundates at least as much of the cell.
        """
        # the area that 10 % of the members inundate is the larger one
        areas = {share: area_of(part, resolution) for share, part in self.inundated.items()}
        error = self.spacing_error
        return areas if error is None else error.corrected_areas(areas)

    def worst_area(self, resolution: float) -> float:
        """Return the area that the lava of any member inundates [m2], corrected like ``areas``."""
        assert self.worst is not None
        area, error = area_of(self.worst.inundated, resolution), self.spacing_error
        if error is None:
            return area
        known = {share: area_of(self.inundated[share], resolution) for share in QUANTILES}
        share = 0.01 * self.unseen
        # a small number of members does not resolve the smallest quantile
        return max(error.corrected_areas({**known, share: area}).values())

    @property
    def unseen(self) -> float:
        """Largest probability of an event that occurs in no member, 0 to 100: 1 / (n + 1).

        Of n + 1 draws in random order, the probability that only the last has the event is at most
        this.
        """
        return unseen(self.effective_members)

    @property
    def coverage(self) -> dict[float, float]:
        """Probability that lava arrives before each arrival time, 0 to 100, by ``QUANTILES``.

        The k-th of n members precedes a new draw with the probability k / (n + 1).
        """
        n = self.effective_members
        return {share: 100.0 * math.ceil(share * n - 1e-9) / (n + 1.0) for share in QUANTILES}

    def limits(self) -> dict[str, Any]:
        """Return the limits of the maps and the error of the particle spacing as plain data."""
        return {
            'unseen_percent': self.unseen,
            'arrives_before_percent': {
                f'p{100.0 * share:.0f}': percent for share, percent in self.coverage.items()
            },
            'spacing_error': None if self.spacing_error is None else self.spacing_error.as_dict(),
        }

    @property
    def sampling_error(self) -> float:
        """Maximum standard error of the probability from the number of members, 0 to 100.

        It is the binomial error at 50 %; the error of low-discrepancy sequences is smaller.
        """
        return 50.0 / float(self.effective_members**0.5)


@dataclass(frozen=True, eq=False)
class EnsembleForecast:
    """An ensemble forecast from one moment of a simulation, on the cells of its terrain.

    Attributes:
        time, horizon, threshold, terrain, stamp_ns, changes: As in ``Forecast``.
        maps: Probability, arrival times and thickness.
        asked: Number of requested members, of which ``maps.members`` are finished.
        is_done: True if no more members will be added.
        outlines: Number of observed outlines by which the members are weighted or drawn.
        duration: Wall time from the fork to the maps [s].
        drawn: Drawn quantities with their distributions, for people.
        exact: Quantities that are not drawn, for people.
    """

    time: float
    horizon: float
    threshold: float
    terrain: Terrain
    maps: HazardMaps
    asked: int
    is_done: bool
    outlines: int
    duration: float
    stamp_ns: int = 0
    changes: int = 0
    drawn: str = ''
    exact: str = ''

    def forecast(self, quantile: float) -> Forecast:
        """Return a forecast with mean thickness, and arrival times of one of ``QUANTILES``."""
        thickness = self.maps.thickness
        return Forecast(
            self.time, self.horizon, self.threshold, self.terrain,
            arrival=self.maps.arrival[quantile],
            inundated=self.maps.inundated[quantile],
            thickness=thickness,
            temperature=np.full_like(thickness, np.nan),
            duration=self.duration,
            particle_count=0,
        )

    def withdrawn(self) -> 'EnsembleForecast':
        """Return the ensemble forecast with all cells unknown."""
        unknown = np.full_like(self.maps.thickness, np.nan)
        arrival = dict.fromkeys(self.maps.arrival, unknown)
        maps = replace(
            self.maps, probability=unknown, arrival=arrival, inundated=arrival, thickness=unknown
        )
        return replace(self, maps=maps)


def unseen(members: float) -> float:
    """Return the largest probability of an event that occurs in no member, 0 to 100."""
    return 100.0 / (members + 1.0)


def probability_words(percent: float, members: float) -> str:
    """Format a probability, 0 to 100, of an effective number of members.

    0 of n members is below 1 / (n + 1), and n of n is above n / (n + 1).
    """
    limit = unseen(members)
    if percent < limit * (1.0 - 1e-6):
        return f'below {limit:.2g} %'
    if percent > (100.0 - limit) * (1.0 + 1e-6):
        return f'above {100.0 - limit:.3g} %'
    return f'{percent:.0f} %'


def occupancy(probability: np.ndarray) -> np.ndarray:
    """Convert probabilities [0 to 100, NaN if unknown] to cells of an occupancy grid.

    Returns:
        int8, same shape: 0 only if no member has lava, 100 only if all have, -1 if unknown.
    """
    cells = np.clip(np.rint(probability), 1, 99)
    cells = np.where(probability <= 0.0, 0, np.where(probability >= 100.0, 100, cells))
    return np.where(np.isnan(probability), -1, cells).astype(np.int8)
