# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Effect of each uncertain quantity on the inundated area, from the members of an ensemble.

The members themselves are the sample, so that no further run is needed. Two linear regressions
give the effect of a change of one quantity from its 10 % to its 90 % quantile:

    ln A = a + sum b_k u_k      the inundated area A changes by exp(b_k) - 1
    f_c  = m_c + sum d_ck u_k   of the cells c, the parts f_c that lava inundates change by d_ck

u is the value of the quantity in units of the difference between both quantiles. With the mean
part m_c and the size of its change, e_ck, the Jaccard index J of the areas before and after is

    1 - J = sum e_ck / sum (m_c + e_ck / 2)        e_ck^2 = max(d_ck^2 - s_ck^2, 0)

s is the standard error of d; it removes the scatter of a small number of members. The change of
the map is the change of its mean over the other quantities. The variance that the regression of f
does not explain is due to the errors of the terrain, which have no u, and to the interaction of
quantities. Standard errors of A are from least squares, and those of J from the jackknife over
members.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import islice
import math
from statistics import NormalDist
from typing import Any

import numpy as np

from lava_ros.forecast.probability import Footprint
from lava_ros.forecast.sampling import coordinates_of, ERUPTION, Member
from lava_ros.layers.numbers import percent
from lava_ros.scene import Scene
from lava_ros.scene.distributions import Distribution, WITH_LIMITS
from lava_ros.scene.ranges import with_ranges
from lava_ros.simulation.output.inundation import TOUCHED

#: Maximum number of members that are read.
MAX_MEMBERS = 128

#: Minimum number of members for each unknown of a regression: with fewer, the scatter of members
#: looks like an effect.
MEMBERS_PER_UNKNOWN = 2.5

#: Cumulative probability of the lower end of a change.
END = 0.1

#: Maximum number of numbers in an array of cells.
MAX_NUMBERS = 4_000_000

_SCORE = NormalDist()


@dataclass(frozen=True)
class Influence:
    """Effect of a change of one quantity from its 10 % to its 90 % quantile.

    Attributes:
        quantity: Its name.
        area: Relative change of the inundated area.
        area_error: Its standard error.
        mismatch: 1 - J of the inundated areas before and after.
        mismatch_error: Its standard error.
        together: Quantities that change with it.
    """

    quantity: str
    area: float
    area_error: float
    mismatch: float
    mismatch_error: float
    together: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        """Names of the quantity and of those that change with it, for people."""
        names = (self.quantity, *self.together)
        return ' with '.join(name.replace('_', ' ') for name in names)


@dataclass(frozen=True)
class Influences:
    """Effects of all uncertain quantities on the inundated area.

    Attributes:
        rows: Effects, the largest ``mismatch`` first; empty with too few members.
        rest: Fraction of the variance of the inundated cells that is due to the errors of the
            terrain and the interaction of quantities; None with too few members.
        members: Number of members with lava.
        needed: Number of members that the regressions need.
    """

    rows: tuple[Influence, ...]
    rest: float | None
    members: int
    needed: int

    def as_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Influences:
        """Return the influences of plain data, the inverse of ``as_dict``."""
        rows = [
            Influence(**{**row, 'together': tuple(row['together'])}) for row in data['rows']
        ]
        return cls(tuple(rows), data['rest'], data['members'], data['needed'])

    def text(self) -> str:
        """Return a sentence about the quantities and their part in the map."""
        if not self.rows:
            return f'not known from {self.members} members, needs {self.needed}'
        return ', '.join(
            f'{row.title} {percent(row.mismatch)} +- {percent(row.mismatch_error)}'
            for row in self.rows
        )


def influences_of(
    scene: Scene, members: Sequence[Member], footprints: Iterable[Footprint]
) -> Influences:
    """Return the effect of each uncertain quantity of a scene.

    Args:
        scene: The scene of the members.
        members: The members, drawn from the scene.
        footprints: Their results, in any order.
    """
    known, kept = dict(zip([member.index for member in members], members, strict=True)), []
    for footprint in islice(footprints, MAX_MEMBERS):
        if footprint.inundated.any():
            kept.append(footprint)
    columns = _columns(scene, [known[item.index] for item in kept])
    count, unknowns = len(kept), len(columns) + 1
    needed = math.ceil(MEMBERS_PER_UNKNOWN * unknowns)
    if not columns or count < needed:
        return Influences((), None, count, needed)
    table = np.stack([values for _, values in columns], axis=1)
    table = np.column_stack((table - table.mean(axis=0), np.ones(count)))
    areas = [item.inundated.sum(dtype=np.int64) * TOUCHED for item in kept]
    slopes, errors = _least_squares(table, np.log(areas))
    mismatch, mismatch_errors, rest = _changes_of_maps(table, kept, scene.terrain.shape)
    together, rows = _followers(scene), dict[str, Influence]()
    for number, (name, _) in enumerate(columns):
        growth = math.exp(slopes[number])
        row = Influence(
            name, growth - 1.0, growth * float(errors[number]), float(mismatch[number]),
            float(mismatch_errors[number]), together.get(name, ()),
        )
        # a place has two coordinates: keep the larger effect
        if name not in rows or row.mismatch > rows[name].mismatch:
            rows[name] = row
    ordered = sorted(rows.values(), key=lambda row: -row.mismatch)
    return Influences(tuple(ordered), rest, count, needed)


def _columns(scene: Scene, members: Sequence[Member]) -> list[tuple[str, np.ndarray]]:
    """Return the quantities that are drawn independently, with their values in units of a change.

    Places have two columns.
    """
    uncertainty, names = with_ranges(scene).uncertainty, coordinates_of(scene)
    points = [dict(zip(names, member.point, strict=True)) for member in members]

    def column(name: str, measure: Callable[[float], float]) -> tuple[str, np.ndarray]:
        coordinate = 'discharge' if name == 'effusion_rate' else name
        return name, np.array([measure(point[coordinate]) for point in points])

    result = [
        column(name, _score if item.kind in WITH_LIMITS else _share)
        for name, item in uncertainty.drawn.items()
        if isinstance(item, Distribution) and not item.follows
    ]
    if uncertainty.eruption:
        result += [column(name, _share) for name in ERUPTION]
    places = {'position': [member.displacement for member in members]}
    places['place'] = [member.place or (0.0, 0.0) for member in members]
    for name, values in places.items():
        table = np.array(values).reshape(len(values), 2)
        low, high = np.quantile(table, (END, 1.0 - END), axis=0) if len(table) else (0.0, 0.0)
        if np.all(high > low):
            result += [(name, axis) for axis in (table / (high - low)).T]
    return result


def _share(probability: float) -> float:
    """Return a cumulative probability in units of the change."""
    return probability / (1.0 - 2.0 * END)


def _score(probability: float) -> float:
    """Return a standard score in units of the change."""
    return 0.5 * _SCORE.inv_cdf(probability) / _SCORE.inv_cdf(1.0 - END)


def _followers(scene: Scene) -> dict[str, tuple[str, ...]]:
    found: dict[str, tuple[str, ...]] = {}
    for name, item in with_ranges(scene).uncertainty.drawn.items():
        leader = getattr(item, 'follows', '').removeprefix('-')
        if leader:
            found[leader] = (*found.get(leader, ()), name)
    return found


def _least_squares(table: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the coefficients of a regression and their standard errors, [columns]."""
    inverse = np.linalg.pinv(table)
    found = inverse @ values
    rest = values - table @ found
    variance = rest @ rest / (len(values) - table.shape[1])
    return found, np.sqrt(variance * (inverse**2).sum(axis=1))


def _changes_of_maps(
    table: np.ndarray, footprints: Sequence[Footprint], shape: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return 1 - J of each column but the last, its standard error, and the unexplained fraction.

    ``table`` is the matrix of the regression, [members, columns].
    """
    count, unknowns = table.shape
    inverse = np.linalg.pinv(table)
    left = 1.0 - np.einsum('mu,um->m', table, inverse)
    norm = (inverse**2).sum(axis=1)[:-1, None]
    # a row for each left-out member, and a last row with all members
    changes, means = np.zeros((count + 1, unknowns - 1)), np.zeros(count + 1)
    unexplained = variance = 0.0
    for cells in _cells(footprints, shape):
        found = inverse @ cells
        rest = cells - table @ found
        squares = (rest**2).sum(axis=0)
        unexplained += squares.sum() / (count - unknowns)
        variance += cells.var(axis=0, ddof=1).sum()
        for member in range(-1, count):
            slopes, scatter, degrees = found, squares, count - unknowns
            if member >= 0:
                # the regression without a member
                lost = rest[member] / max(left[member], 1e-9)
                slopes = found - inverse[:, member, None] * lost
                scatter, degrees = np.maximum(squares - rest[member] * lost, 0.0), degrees - 1
            error = norm * (scatter / max(degrees, 1))
            changes[member] += np.sqrt(np.maximum(slopes[:-1] ** 2 - error, 0.0)).sum(axis=1)
            means[member] += slopes[-1].sum()
    mismatch = changes / (means[:, None] + 0.5 * changes)
    without = mismatch[:-1] - mismatch[:-1].mean(axis=0)
    errors = np.sqrt((count - 1.0) / count * (without**2).sum(axis=0))
    return mismatch[-1], errors, min(float(unexplained / variance), 1.0) if variance else 0.0


def _cells(footprints: Sequence[Footprint], shape: tuple[int, int]) -> Iterator[np.ndarray]:
    """Yield the inundated parts of the cells, [members, cells], in arrays of bounded size."""
    step = max(MAX_NUMBERS // (shape[1] * len(footprints)), 1)
    for start in range(0, shape[0], step):
        cells = np.zeros((len(footprints), min(step, shape[0] - start), shape[1]), np.float32)
        for number, item in enumerate(footprints):
            row, column = item.corner[0] - start, item.corner[1]
            rows, columns = item.inundated.shape
            low, high = max(row, 0), min(row + rows, cells.shape[1])
            if low < high:
                part = item.inundated[low - row : high - row]
                cells[number, low:high, column : column + columns] = part * TOUCHED
        flat = cells.reshape(len(footprints), -1)
        flat = flat[:, flat.any(axis=0)]
        if flat.size:
            yield flat.astype(np.float64)
