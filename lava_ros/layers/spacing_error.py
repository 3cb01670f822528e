# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Error of an ensemble's probabilities by the particle spacing, measured with pairs of runs.

The spacing shifts the lava of all members in the same direction. Every ``EVERY``-th member
therefore runs a second time with particles ``COARSER`` times as far apart, or with cells of twice
the size. With the arrival time t(x) of lava in a cell, and t_c(x) in the coarser run of the same
draw, the time with very close particles is

    t(x) exp(-D),    D = mean of ln(t_c / t) / r,    r = COARSER^p - 1 or 2^p - 1

with the order p of the method (simulation/numerical_error.py, ``ORDERS``). The same holds for the
inundated area. D shifts the arrival times of all members unless it is too large
(``MAX_CORRECTION``); its uncertainty widens them: half of D for the order, and the scatter of
ln(t_c / t) over cells and members.
docs/benchmarks/twins.csv compares the result with truths at a closer spacing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, astuple, dataclass, fields
import math
from statistics import NormalDist
from typing import Any

import numpy as np

from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.numerical_error import (
    difference,
    ORDERS,
    richardson,
    scaled,
)
from lava_ros.simulation.output.inundation import reached_cells

#: Spacing of the second run of a pair over that of the member, by method. Twice the particle
#: spacing of a coarse ensemble no longer resolves the flow; cells can only double.
COARSER = {'particles': 1.4, 'cells': 2.0}

#: One member in so many has a pair. A coarser run takes less time than its member, so that pairs
#: take at most a quarter of the time of the members.
EVERY = 4

#: Standard uncertainty of a correction, as a fraction of it, because the order is not known.
ORDER_UNCERTAINTY = 0.5

#: Largest correction of the logarithm of arrival times or areas for probabilities that are usable.
MAX_CORRECTION = 0.15

#: Largest error of the area of a member, one minus the Jaccard index, for usable probabilities.
MAX_AREA_ERROR = 0.35

#: Cells that lava of either run reaches before this fraction of the latest arrival are as small as
#: the vent, and do not count in a pair.
_MIN_TIME_FRACTION = 0.1

#: Minimum arrival time of cells that count [s]: lava is in all others from the start.
_MIN_TIME = 1e-9

#: Quantiles of a normal distribution at one standard deviation.
_INNER = (0.15866, 0.84134)

#: Parts of an interval that are moved separately.
_PARTS = 4

#: Minimum standard uncertainty of a logarithm of time.
_MIN_SPREAD = 1e-6


@dataclass(frozen=True)
class SpacingPair:
    """Differences of a coarser run and its member.

    Attributes:
        delay: Median over cells of the logarithm of the ratio of arrival times, coarser run over
            member.
        scatter: Its standard deviation over cells, from quantiles.
        growth: Logarithm of the ratio of inundated areas, coarser run over member.
        difference: One minus the Jaccard index of the inundated areas.
    """

    delay: float
    scatter: float
    growth: float
    difference: float

    @property
    def numbers(self) -> tuple[float, ...]:
        """Return the values in the order of the fields."""
        return astuple(self)


def has_pair(index: int) -> bool:
    """Return True if the member with a number has a coarser run."""
    return index % EVERY == 0


def pair_of(
    arrival: np.ndarray, inundated: np.ndarray, coarser: np.ndarray, coarser_part: np.ndarray
) -> SpacingPair | None:
    """Compare a member with its coarser run; None if the member has no lava.

    Args:
        arrival: Arrival times of the member [s], NaN without lava, shape [rows, columns].
        inundated: Fractions of the cells that its lava has covered, same shape.
        coarser: Arrival times of the coarser run, same shape.
        coarser_part: Fractions of the cells that the lava of the coarser run has covered.
    """
    if not reached_cells(arrival).any():
        return None
    earlier = np.minimum(arrival, coarser)
    areas = [float(values.sum(dtype=np.float64)) for values in (coarser_part, inundated)]
    if not (reached_cells(earlier).any() and all(areas)):
        return SpacingPair(delay=0.0, scatter=0.0, growth=0.0, difference=1.0)
    counted = earlier >= max(_MIN_TIME_FRACTION * np.nanmax(earlier), _MIN_TIME)
    # without such cells the lava of both is where it began, which takes no time
    ratio = np.log(coarser[counted] / arrival[counted]) if counted.any() else np.zeros(1)
    low, high = np.quantile(ratio, _INNER)
    return SpacingPair(
        delay=float(np.median(ratio)),
        scatter=0.5 * float(high - low),
        growth=math.log(areas[0] / areas[1]),
        difference=difference(inundated, coarser_part),
    )


@dataclass(frozen=True)
class SpacingError:
    """Error of the members of an ensemble by their particle spacing.

    Attributes:
        method: Carriers of the lava (``Accuracy.method``).
        spacing: Particle spacing of the members, or size of their cells [m].
        pairs: Number of pairs that measured it.
        delay: Logarithm of arrival times over those with very close particles.
        delay_spread: Its standard uncertainty for one member in one cell.
        growth: Logarithm of the inundated area over that with very close particles.
        growth_spread: Its standard uncertainty for one member.
        area_error: One minus the Jaccard index of the area of a member and that with very close
            particles.
    """

    method: str
    spacing: float
    pairs: int
    delay: float
    delay_spread: float
    growth: float
    growth_spread: float
    area_error: float

    @classmethod
    def of(
        cls, pairs: Sequence[SpacingPair], accuracy: Accuracy
    ) -> 'SpacingError | None':
        """Return the error that pairs of members have measured, None without pairs."""
        if not pairs:
            return None
        assert accuracy.spacing is not None
        reduction = richardson(COARSER[accuracy.method], ORDERS[accuracy.method])
        delays, scatters, growths, differences = np.array([pair.numbers for pair in pairs]).T
        delay, growth = (float(values.mean()) / reduction for values in (delays, growths))
        scatter = math.sqrt(float((scatters**2).mean() + delays.var())) / reduction
        return cls(
            method=accuracy.method,
            spacing=accuracy.spacing,
            pairs=len(pairs),
            delay=delay,
            delay_spread=math.hypot(ORDER_UNCERTAINTY * delay, scatter),
            growth=growth,
            growth_spread=math.hypot(ORDER_UNCERTAINTY * growth, growths.std() / reduction),
            area_error=scaled(float(differences.mean()), 1.0 / reduction),
        )

    @property
    def excess(self) -> float:
        """Largest error over the largest that can be corrected."""
        return max(
            abs(self.delay) / MAX_CORRECTION,
            abs(self.growth) / MAX_CORRECTION,
            math.log1p(-min(self.area_error, 0.999999)) / math.log1p(-MAX_AREA_ERROR),
        )

    @property
    def is_usable(self) -> bool:
        """True if the error is small enough to be corrected."""
        return self.excess <= 1.0

    @property
    def usable_spacing(self) -> float:
        """Spacing at which the error can be corrected [m], rounded down to two digits.

        Cells can only be halved: it is then their size.
        """
        spacing = self.spacing * max(self.excess, 1.0) ** (-1.0 / ORDERS[self.method])
        if self.method == 'cells':
            return self.spacing * 0.5 ** math.ceil(math.log2(self.spacing / spacing) - 1e-9)
        unit = 10.0 ** (math.floor(math.log10(spacing)) - 1)
        return float(f'{math.floor(spacing / unit * (1.0 + 1e-9)) * unit:.2g}')

    def end(self, counts: np.ndarray, total: float) -> float:
        """Return the time at which the members have the corrected area of the horizon.

        Members whose area is too small have it after the horizon. Of the lava that arrives then,
        as much is taken to arrive as shortly before the horizon.

        Args:
            counts: Weight of the members that arrive in each interval of equal length up to the
                horizon, shape [cells, intervals].
            total: Weight of all members.

        Returns:
            Logarithm of this time over the horizon.
        """
        number = counts.shape[1]
        sums = np.cumsum(_continued(counts, total).sum(axis=0))
        if not sums[-1:].any():
            return 0.0
        times = np.log(np.arange(1, sums.size + 1) / number)
        return float(np.interp(sums[number - 1] * math.exp(-self.growth), sums, times))

    def corrected(self, counts: np.ndarray, total: float, end: float) -> np.ndarray:
        """Shift and widen arrival times that are counted in intervals of equal length.

        Args:
            counts: As for ``end``; the cells may be others.
            total: Weight of all members.
            end: The time up to which members count, as ``end`` returns it.

        Returns:
            The corrected weights, float64, shape [cells, intervals].
        """
        from scipy.special import ndtr

        number = counts.shape[1]
        times = np.log((np.arange(2 * number * _PARTS) + 0.5) / (number * _PARTS))
        spread = max(ORDER_UNCERTAINTY * abs(end), _MIN_SPREAD)
        is_counted = ndtr((end - times) / spread)
        edges = np.log(np.arange(1, number) / number)
        scores = (edges - times[:, None] + self.delay) / max(self.delay_spread, _MIN_SPREAD)
        # all that count arrive within the horizon
        moved = np.diff(ndtr(scores), axis=1, prepend=0.0, append=1.0)
        kernel = (is_counted[:, None] * moved).reshape(2 * number, _PARTS, number).mean(axis=1)
        weights: np.ndarray = _continued(counts, total) @ kernel
        return weights

    def corrected_areas(self, areas: dict[float, float]) -> dict[float, float]:
        """Shift and widen the areas inundated in at least a fraction of the members, if usable.

        ``areas`` are those of the members by the fraction, among them 0.5, in m2.
        """
        middle = areas[0.5]
        if middle <= 0.0 or not self.is_usable:
            return areas
        result = {}
        for fraction, area in areas.items():
            wide = self.growth_spread * NormalDist().inv_cdf(1.0 - fraction)
            far = math.log(max(area, 1e-6 * middle) / middle)
            far = math.copysign(math.hypot(far, wide), far or wide)
            result[fraction] = middle * math.exp(far - self.growth)
        return result

    def arrival_error(self, time: float) -> float:
        """Return the largest expected error of an arrival time [s], of those up to a time [s].

        It is the correction, whose order is not known, with its standard uncertainty.
        """
        return time * math.expm1(math.hypot(self.delay, self.delay_spread))

    def text(self) -> str:
        """Format the error as one line."""
        def percent(value: float) -> str:
            return f'{float(f"{abs(100.0 * math.expm1(value)):.2g}"):g}'

        late, large = (
            f'{percent(value)} % {words[value < 0.0]}'
            for value, words in (
                (self.delay, ('too late', 'too early')), (self.growth, ('too large', 'too small'))
            )
        )
        are_cells = self.method == 'cells'
        apart = f'{"cells of" if are_cells else "particles"} {self.spacing:.3g} m'
        apart += '' if are_cells else ' apart'
        if self.is_usable:
            return (
                f'corrected for {apart}: arrivals were {late}, areas {large} '
                f'({self.pairs} pair{"s" * (self.pairs > 1)} of runs)'
            )
        return (
            f'the probabilities are not usable: with {apart} arrivals are {late}, areas {large} '
            f'and {100.0 * self.area_error:.0f} % elsewhere; a spacing of '
            f'{self.usable_spacing:g} m would do'
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the error as plain data: logarithms of ratios, with standard uncertainties."""
        return {
            **asdict(self), 'is_usable': self.is_usable, 'usable_spacing': self.usable_spacing,
        }

    @classmethod
    def from_dict(cls, plain: Mapping[str, Any]) -> 'SpacingError':
        """Return the error of plain data (``as_dict``); before 0.2 of particles."""
        plain = {'method': 'particles', **plain}
        return cls(**{item.name: plain[item.name] for item in fields(cls)})


def _continued(counts: np.ndarray, total: float) -> np.ndarray:
    """Continue counts after their last interval with their mirror image, up to a total."""
    beyond = counts[:, ::-1].astype(np.float64)
    sums = counts.sum(axis=1, keepdims=True) + np.cumsum(beyond, axis=1)
    beyond = np.where(sums <= total, beyond, np.maximum(beyond - (sums - total), 0.0))
    return np.hstack([counts, beyond])
