# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Weights of ensemble members from their agreement with observed outlines."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError, RefusalError
from lava_ros.scene import Terrain
from lava_ros.scene.terrain import HALF, PARTS

#: Power of the Jaccard index in a member's weight: with 8, an index of 0.8 weighs three times as
#: much as 0.7.
SHARPNESS = 8.0

#: Minimum effective number of members, as a fraction of the members that overlap the outline.
MIN_EFFECTIVE_FRACTION = 0.1

#: Weight of the best member.
UNIT = 1 << 16

_HALVINGS = 40

#: Maximum error of an area, so that its logarithm is finite.
_LARGEST_ERROR = 0.999


@dataclass(frozen=True, eq=False)
class Mask:
    """A map of observed lava on its own grid.

    Attributes:
        lava: Where lava was observed, bool, shape [rows, columns]; row 0 has the smallest y.
        known: Where the ground was observed, bool, same shape.
        resolution: Side of a cell [m].
        origin: Map position (x, y) [m] of the lower-left corner of cell [0, 0].
    """

    lava: np.ndarray
    known: np.ndarray
    resolution: float
    origin: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Outline:
    """A map of lava observed at a simulated time [s], on the cells of the terrain.

    ``lava`` and ``known`` are as in ``Mask``, with the shape of the terrain.
    """

    time: float
    lava: np.ndarray
    known: np.ndarray

    def __post_init__(self) -> None:
        """Validate every field.

        Raises:
            LavaError: If a field is not valid, or there is no lava.
        """
        time = validation.number('observed.time', self.time, above=0.0, unit='s')
        object.__setattr__(self, 'time', time)
        for name in ('lava', 'known'):
            values = np.asarray(getattr(self, name))
            if values.dtype != np.bool_ or values.shape != np.shape(self.lava):
                expected = f'a mask of {np.shape(self.lava)} cells'
                raise LavaError(f'observed.{name}', f'{values.dtype} {values.shape}', expected)
        if not (self.lava & self.known).any():
            raise LavaError('observed.lava', 'no cell', 'an outline with lava on the terrain')


def outline_on(terrain: Terrain, mask: Mask, time: float) -> Outline:
    """Resample a mask for a simulated time [s] to the cells of a terrain.

    A cell counts as lava, or as observed, if at least half of its squares (``PARTS``) do.
    Squares outside the mask count as not observed.

    Raises:
        LavaError: If none of the mask's lava is on the terrain.
    """
    cells = []
    for start, count, corner, size in zip(
        terrain.origin[::-1], terrain.shape, mask.origin[::-1], mask.lava.shape, strict=True
    ):
        middle = start + (np.arange(count * PARTS) + 0.5) * (terrain.resolution / PARTS)
        # the mask may have any size and position
        with np.errstate(over='ignore'):
            index = np.clip(np.floor((middle - corner) / mask.resolution), -1, size)
        cells.append(index.astype(np.int64) + 1)
    rows, columns = terrain.shape
    lava, known = (
        np.count_nonzero(
            np.pad(values, 1)[np.ix_(*cells)].reshape(rows, PARTS, columns, PARTS), axis=(1, 3)
        ) >= HALF
        for values in (mask.lava & mask.known, mask.known)
    )
    known &= terrain.has_data
    return Outline(time, lava & known, known)


@dataclass(frozen=True, eq=False)
class Weights:
    """Weights of the members.

    Attributes:
        values: Weights as whole numbers, int64, one per member; the best member has ``UNIT``.
        jaccard: The members' Jaccard indices, float64.
        effective_members: Number of members of equal weight with the same information.
        sharpness: The power of the Jaccard index, reduced by the numerical error, and if too few
            members would count.
    """

    values: np.ndarray
    jaccard: np.ndarray
    effective_members: float
    sharpness: float


def jaccard(reached: np.ndarray, outline: Outline) -> float:
    """Return the Jaccard index of a member and an outline: area in both over area in either.

    ``reached`` marks the member's lava at the outline's time, bool, of the outline's shape. Cells
    that were not observed do not count.

    Raises:
        LavaError: If the shapes differ.
    """
    if reached.shape != outline.lava.shape:
        raise LavaError('reached', reached.shape, f'a mask of {outline.lava.shape} cells')
    both = (reached & outline.lava & outline.known).sum()
    one = ((reached | outline.lava) & outline.known).sum()
    return float(both / one)


def weigh(
    agreement: Sequence[float] | np.ndarray,
    *,
    sharpness: float = SHARPNESS,
    least_effective: float = MIN_EFFECTIVE_FRACTION,
    area_error: float = 0.0,
) -> Weights:
    """Weight members by a power, ``sharpness``, of their Jaccard indices.

    A power s weights -ln J like an error of size 1 / s. ``area_error``, one minus the Jaccard
    index of a member with and without its numerical error, is added as an independent error: even
    a perfect member would agree no better. The power is also reduced until enough members count
    (``MIN_EFFECTIVE_FRACTION``), because too few members do not represent the uncertainty of a
    forecast.

    Raises:
        LavaError: If an argument is not valid, or no member overlaps the outline.
    """
    sharpness = validation.number('sharpness', sharpness, at_least=0.0, at_most=1e3)
    validation.number('least_effective', least_effective, at_least=0.0, at_most=1.0)
    validation.number('area_error', area_error, at_least=0.0, at_most=1.0)
    numerical = -math.log1p(-min(area_error, _LARGEST_ERROR))
    sharpness /= math.hypot(1.0, sharpness * numerical)
    index = np.asarray(agreement, dtype=np.float64)
    if not index.size or not np.isfinite(index).all() or index.min() < 0.0 or index.max() > 1.0:
        raise LavaError('agreement', index.tolist(), 'Jaccard indices from 0 to 1')
    if not index.any():
        problem = 'No member touches the observed outline'
        raise RefusalError('observed', problem, 'Correct the scene or its uncertainty')
    least = least_effective * np.count_nonzero(index)

    def powers(sharpness: float) -> np.ndarray:
        # a member that does not overlap the outline does not count at any power
        shares = np.where(index > 0.0, (index / index.max()) ** sharpness, 0.0)
        return np.rint(UNIT * shares).astype(np.int64)

    if effective_members(powers(sharpness)) < least:
        high, sharpness = sharpness, 0.0
        for _ in range(_HALVINGS):
            middle = 0.5 * (sharpness + high)
            if effective_members(powers(middle)) < least:
                high = middle
            else:
                sharpness = middle
    values = powers(sharpness)
    return Weights(values, index, effective_members(values), sharpness)


def effective_members(weights: np.ndarray) -> float:
    """Return the effective number of members: (sum w)^2 / sum w^2."""
    weights = np.asarray(weights, dtype=np.float64)
    return float(weights.sum() ** 2 / (weights**2).sum())
