# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Scores of probability forecasts against outcomes: Brier score and reliability."""

from dataclasses import dataclass
import math

import numpy as np

from lava_ros.errors import LavaError


@dataclass(frozen=True)
class ReliabilityBin:
    """A point of a reliability diagram: cells with a probability in an interval.

    Attributes:
        low: Lower limit of the probability, 0 to 1, inclusive.
        high: Upper limit of the probability; inclusive only in the last bin.
        forecast: Mean probability in the bin; NaN without cells.
        observed: Fraction of the cells that lava inundated; NaN without cells.
        count: Number of cells.
    """

    low: float
    high: float
    forecast: float
    observed: float
    count: int


@dataclass(frozen=True)
class BrierParts:
    """A Brier score and its parts: reliability - resolution + uncertainty (Murphy 1973).

    Attributes:
        score: Mean squared difference of probability and outcome; 0 is perfect.
        reliability: Mean squared difference of probability and frequency; 0 is perfect.
        resolution: Variance of the frequencies at the probabilities; larger is better.
        uncertainty: Variance of the outcome, the score of always forecasting its mean.
    """

    score: float
    reliability: float
    resolution: float
    uncertainty: float

    @property
    def skill(self) -> float:
        """Skill, 1 - score / uncertainty: 1 is perfect, 0 equals always forecasting the mean."""
        return 1.0 - self.score / self.uncertainty if self.uncertainty else 0.0


def brier_score(probability: np.ndarray, outcome: np.ndarray) -> float:
    """Return the Brier score: the mean squared difference of probability and outcome.

    ``probability`` is from 0 to 1, and NaN does not count; ``outcome`` is bool, of the same shape.

    Raises:
        LavaError: If the shapes differ, a probability is not from 0 to 1, or all are NaN.
    """
    probability, outcome = _pairs(probability, outcome)
    return float(np.mean((probability - outcome) ** 2))


def brier_parts(probability: np.ndarray, outcome: np.ndarray) -> BrierParts:
    """Return the Brier score and its parts; arguments and errors as in ``brier_score``."""
    probability, outcome = _pairs(probability, outcome)
    values, place = np.unique(probability, return_inverse=True)
    count = np.bincount(place)
    came = np.bincount(place, outcome) / count
    mean = outcome.mean()
    share = count / count.sum()
    return BrierParts(
        score=float(np.mean((probability - outcome) ** 2)),
        reliability=float((share * (values - came) ** 2).sum()),
        resolution=float((share * (came - mean) ** 2).sum()),
        uncertainty=float(mean * (1.0 - mean)),
    )


def reliability(
    probability: np.ndarray, outcome: np.ndarray, *, bins: int = 10
) -> list[ReliabilityBin]:
    """Return the points of a reliability diagram with ``bins`` bins of equal width.

    Empty bins have NaN. Other arguments and errors as for ``brier_score``.
    """
    probability, outcome = _pairs(probability, outcome)
    # a fraction of members of 0.3 may be stored as 0.299999999
    place = np.minimum(np.floor(probability * bins + 1e-9), bins - 1).astype(int)
    count = np.bincount(place, minlength=bins)
    with np.errstate(invalid='ignore'):
        forecast = np.bincount(place, probability, minlength=bins) / count
        observed = np.bincount(place, outcome, minlength=bins) / count
    rows = zip(forecast.tolist(), observed.tolist(), count.tolist(), strict=True)
    return [ReliabilityBin(k / bins, (k + 1) / bins, *row) for k, row in enumerate(rows)]


def reliability_error(
    probability: np.ndarray, outcome: np.ndarray, *, bins: int = 10
) -> float:
    """Return the root mean square gap of forecast and frequency over the cells of a diagram.

    Arguments and errors are those of ``reliability``.
    """
    known = [item for item in reliability(probability, outcome, bins=bins) if item.count]
    gaps = sum(item.count * (item.forecast - item.observed) ** 2 for item in known)
    return math.sqrt(gaps / sum(item.count for item in known))


def entropy(probability: np.ndarray) -> np.ndarray:
    """Return the Shannon entropy [bit] of probabilities from 0 to 1, float64; NaN for NaN."""
    sure = np.asarray(probability, dtype=np.float64)
    shares = np.stack([sure, 1.0 - sure])
    with np.errstate(divide='ignore', invalid='ignore'):
        bits = np.where(shares == 0.0, 0.0, -shares * np.log2(shares))
    return np.asarray(bits.sum(axis=0))


def _pairs(probability: np.ndarray, outcome: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return flat probabilities and outcomes (0 or 1) of the cells that have both, float64."""
    probability, outcome = np.asarray(probability, dtype=np.float64), np.asarray(outcome)
    if probability.shape != outcome.shape:
        raise LavaError('outcome', outcome.shape, f'an outcome for {probability.shape} cells')
    known = ~np.isnan(probability)
    probability = probability[known]
    if not probability.size:
        raise LavaError('probability', 'NaN', 'a cell with a probability')
    beyond = (probability < 0.0) | (probability > 1.0)
    if beyond.any():
        raise LavaError('probability', float(probability[beyond][0]), 'from 0 to 1')
    return probability, outcome[known].astype(bool).astype(np.float64)
