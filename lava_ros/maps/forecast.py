# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""What comes: arrival, thickness and heat that a look ahead or an ensemble forecasts."""

from dataclasses import dataclass, replace

import numpy as np

from lava_ros.scene import Terrain

#: What ``Layer.raw_values`` gives for the arrival in cells of which nothing is known [s].
UNKNOWN = -1.0

#: Shares of the members whose arrival times are shown.
QUANTILES = (0.1, 0.5, 0.9)

#: Smallest share of an occupancy grid's cell with some probability, and largest below certainty.
_LEAST, _MOST = 1, 99


@dataclass(frozen=True, eq=False)
class Forecast:
    """A look ahead from one moment of a simulation, on the cells of its terrain.

    Attributes:
        time: Simulated time at its start [s].
        horizon: How far ahead it looks [s].
        threshold: Thickness from which on lava has arrived [m].
        terrain: The ground, which the arrays belong to.
        arrival: Simulated time from the start until lava is that thick [s], float32, shape [rows,
            columns]; 0 where it was at the start, NaN where it will not be within the horizon.
        thickness: Largest thickness within the horizon [m], float32, same shape; 0 where there
            is no lava, NaN where nothing is known: outside the terrain, and after a withdrawal.
        temperature: Highest depth-averaged temperature within the horizon [K], float32, same
            shape; NaN without lava.
        duration: Wall time it took [s].
        particle_count: Particles at its end.
    """

    time: float
    horizon: float
    threshold: float
    terrain: Terrain
    arrival: np.ndarray
    thickness: np.ndarray
    temperature: np.ndarray
    duration: float
    particle_count: int

    def withdrawn(self) -> 'Forecast':
        """The same forecast, in which nothing is known of any cell."""
        unknown = np.full(self.arrival.shape, np.nan, dtype=np.float32)
        return replace(self, arrival=unknown, thickness=unknown, temperature=unknown)


@dataclass(frozen=True, eq=False)
class PlaceForecast:
    """When lava of an ensemble first comes to places, whichever of their cells it reaches.

    Attributes:
        probability: Probability that lava comes up to the horizon, 0 to 100, shape [places].
        arrival: Times [s] by which a fraction of the members had lava there, by the fractions in
            ``QUANTILES``, shape [places]; NaN where fewer members had any.
    """

    probability: np.ndarray
    arrival: dict[float, np.ndarray]


@dataclass(frozen=True, eq=False)
class HazardMaps:
    """The maps of an ensemble on the cells of the terrain.

    All arrays are float32, have the terrain's shape, and are NaN where the terrain has no data.

    Attributes:
        probability: Probability that lava comes up to the horizon, 0 to 100.
        arrival: Times [s] by which a share of the members had lava in a cell, by the shares in
            ``QUANTILES``, 10, 50 and 90 %; NaN where fewer members had any up to the horizon.
        thickness: Mean over all members of the largest thickness [m].
        members: Number of members in the maps.
        effective_members: Number of members of equal weight with the same information,
            (sum w)^2 / sum w^2.
        arrival_error: Error of arrival times [s]: half the time between two looks; that of a time
            step comes on top.
        members_beyond: Number of members of which some lava has left the map; nothing is known of
            where it went.
        places: Arrival at the places that were named; None without any.
    """

    probability: np.ndarray
    arrival: dict[float, np.ndarray]
    thickness: np.ndarray
    members: int
    effective_members: float
    arrival_error: float
    members_beyond: int = 0
    places: PlaceForecast | None = None

    @property
    def sampling_error(self) -> float:
        """Largest standard error of the probability that is due to few members, 0 to 100.

        It is the binomial one at even odds; points of a sequence do better, not worse.
        """
        return 50.0 / float(self.effective_members**0.5)


@dataclass(frozen=True, eq=False)
class EnsembleForecast:
    """An ensemble that went on from one moment, on the cells of its terrain.

    Attributes:
        time, horizon, threshold, terrain: As in ``Forecast``.
        maps: Probability, arrival times and thickness.
        asked: Members that were asked for; ``maps.members`` are in it.
        is_done: Whether no more are to come.
        outlines: Outlines that the members have been weighed by.
        duration: Wall time from the fork until the maps were there [s].
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

    def forecast(self, share: float) -> Forecast:
        """A forecast with mean thickness, and arrival times by ``share``, one of ``QUANTILES``."""
        thickness = self.maps.thickness
        return Forecast(
            self.time, self.horizon, self.threshold, self.terrain,
            arrival=self.maps.arrival[share],
            thickness=thickness,
            temperature=np.full_like(thickness, np.nan),
            duration=self.duration,
            particle_count=0,
        )

    def withdrawn(self) -> 'EnsembleForecast':
        """The same, in which nothing is known of any cell."""
        unknown = np.full_like(self.maps.thickness, np.nan)
        arrival = dict.fromkeys(self.maps.arrival, unknown)
        maps = replace(self.maps, probability=unknown, arrival=arrival, thickness=unknown)
        return replace(self, maps=maps)


def occupancy(probability: np.ndarray) -> np.ndarray:
    """Probability [0 to 100, NaN: unknown] as cells of an occupancy grid.

    Returns:
        int8, same shape: 0 only where no member had lava, 100 only where all had, -1 unknown.
    """
    cells = np.clip(np.rint(probability), _LEAST, _MOST)
    cells = np.where(probability <= 0.0, 0, np.where(probability >= 100.0, 100, cells))
    return np.where(np.isnan(probability), -1, cells).astype(np.int8)
