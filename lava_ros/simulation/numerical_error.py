# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The numerical error of a run, measured with pairs of runs that differ in one respect.

The error of an area is one minus the Jaccard index of the area and that of a run with very fine
particles on very fine ground. Two partner runs measure it (forecast/partner_runs.py):

    particles   the run, and one on cells; if particles are better with its effects (method.py),
                one with particles COARSER times as far apart; of a run on cells, one on larger
                cells
    ground      that one, and another one on ground of cells twice as large (coarse_ground.py)

Errors of areas multiply: the Jaccard index of the run and a much finer one is that of the run and
its partner, J, to the power 1 / r. With an error -ln J proportional to h^p and a partner coarser
by c, r = c^p - 1 (Richardson 1911). The errors of particles and of cells add up, so that r is one
plus their ratio. docs/benchmarks/numerical_error.csv compares the numbers that are used here with
actual errors.
"""

from collections.abc import Mapping
from dataclasses import dataclass
import math
from typing import Any, NamedTuple

import numpy as np

from lava_ros.simulation.output.inundation import standing_part
from lava_ros.simulation.output.snapshot import Snapshot

#: Particle spacing of a partner run over that of the run, about 1/16 of the time, or size of the
#: cells over that of the run.
COARSER = {'particles': 2.5, 'cells': 2.0}

#: Statement in place of an error that no pair of runs has measured.
NOT_MEASURED = 'not yet measured'


class Areas(NamedTuple):
    """The area inundated so far and that with standing lava, or a number for each.

    An area is a mask of cells, or the fraction of each cell, shape [rows, columns].
    """

    inundated: Any
    standing: Any

    @classmethod
    def of(cls, snapshot: Snapshot) -> 'Areas':
        """Return the areas of a snapshot."""
        inundated = np.nan_to_num(snapshot.inundated)
        return cls(inundated, standing_part(snapshot.standing, inundated))


#: Power of the particle spacing in the errors of both areas (docs/benchmarks/README.md).
PARTICLE_ORDER = 1.5

#: Power of the particle spacing, or of the size of the cells of lava, by method.
ORDERS = {'particles': PARTICLE_ORDER, 'cells': 1.25}

#: Size of cells over the particle spacing at which their errors add as much to a difference.
EQUAL_CELLS = 2.0

#: Power of the cell size in the errors from the ground: that of the spline on smooth ground. On
#: rough ground elevations converge more slowly, but smaller bumps turn less lava aside.
GROUND_ORDER = 2.0


class Pair(NamedTuple):
    """Areas of two runs that differ in one respect.

    ``reduction`` is r, as in the module's docstring: that of ``richardson`` for a second run that
    is coarser, of ``between_methods`` for one by the other method.
    """

    one: Areas
    other: Areas
    reduction: float

    def errors(self) -> Areas:
        """Return the error of each area, from 0 to 1."""
        return Areas(*(
            scaled(difference(one, other), 1.0 / self.reduction)
            for one, other in zip(self.one, self.other, strict=True)
        ))


@dataclass(frozen=True)
class AreaError:
    """Numerical error of one area, a fraction of it.

    Attributes:
        lava: Part of the particle spacing, or of the size of the cells of lava.
        ground: Part of the ground's cells; NaN if the terrain is too small to coarsen.
    """

    lava: float
    ground: float

    @property
    def total(self) -> float:
        """Root of the sum of the squares of the parts, at most 1."""
        return min(math.hypot(self.lava, np.nan_to_num(self.ground)), 1.0)

    def as_dict(self) -> dict[str, float | None]:
        """Return the parts and the total; None for an unknown part."""
        ground = None if math.isnan(self.ground) else self.ground
        return {'lava': self.lava, 'ground': ground, 'total': self.total}


@dataclass(frozen=True)
class NumericalError:
    """The numerical error of a run, and the conditions of its measurement.

    Attributes:
        inundated: Error of the area inundated so far.
        standing: Error of the area with standing lava.
        spacing: Particle spacing of the run, or size of its cells of lava [m].
        cell: Size of the terrain's cells [m].
        time: Simulated time at which the runs are compared [s].
        cost: Time of the partner runs [s].
        method: Carriers of the lava (``Accuracy.method``).
    """

    inundated: AreaError
    standing: AreaError
    spacing: float
    cell: float
    time: float
    cost: float = math.nan
    method: str = 'particles'

    def as_dict(self) -> dict[str, Any]:
        """Return the error as plain data, fractions of the areas."""
        return {
            **{name: getattr(self, name).as_dict() for name in Areas._fields},
            'method': self.method,
            'spacing_m': self.spacing,
            'cell_m': self.cell,
            'time_s': self.time,
        }

    @classmethod
    def from_dict(cls, plain: Mapping[str, Any]) -> 'NumericalError':
        """Return the error of plain data (``as_dict``); before 0.2 of particles."""
        inundated, standing = (
            AreaError(
                plain[name]['lava'],
                math.nan if plain[name]['ground'] is None else plain[name]['ground'],
            )
            for name in Areas._fields
        )
        return cls(
            inundated, standing, plain['spacing_m'], plain['cell_m'], plain['time_s'],
            method=plain.get('method', 'particles'),
        )

    def text(self) -> str:
        """Format the error as one line."""
        words = [
            f'{_percent(area.total)} of the {name} area ({", ".join(self._parts(area))})'
            for name, area in zip(Areas._fields, (self.inundated, self.standing), strict=True)
        ]
        return '; '.join([*words, *filter(None, [self.advice()])])

    def brief(self) -> str:
        """Format the totals, for a page with little space."""
        return brief_text(self.inundated.total, self.standing.total)

    def _parts(self, area: AreaError) -> list[str]:
        ground = 'unknown' if math.isnan(area.ground) else _percent(area.ground)
        part = _percent(area.lava)
        if self.method == 'cells':
            return [
                f'cells of lava of {self.spacing:g} m {part}',
                f'cells of ground of {self.cell:g} m {ground}',
            ]
        return [f'particles {part}', f'cells of {self.cell:g} m {ground}']

    def advice(self) -> str:
        """Return what limits the accuracy of the inundated area; empty if it is the carriers."""
        area = self.inundated
        finest = area.total - np.nan_to_num(area.ground)
        if not area.ground > area.lava:
            return ''
        finer = 'cells of lava' if self.method == 'cells' else 'particles'
        return (
            f'finer {finer} change the error by less than {_percent(finest, up=True)}: '
            f"the ground's cells make {_percent(area.ground)}"
        )


def error_text(error: NumericalError | None) -> str:
    """Return the text of an error, or that it is not yet measured."""
    return NOT_MEASURED if error is None else error.text()


def brief_text(inundated: float, standing: float) -> str:
    """Return the text of the errors of both areas, NaN if they are not yet measured."""
    if math.isnan(inundated):
        return NOT_MEASURED
    whole = f'{_percent(inundated)} of the inundated area'
    return f'{whole}, {_percent(standing)} of the standing area'


def _percent(value: float, *, up: bool = False) -> str:
    """Format a fraction as a percentage with two digits, rounded or rounded up."""
    shown = 100.0 * value
    if up and shown > 0.0:
        unit = 10.0 ** (math.floor(math.log10(shown)) - 1)
        shown = math.ceil(shown / unit) * unit
    # 37 and not 3.7e+01
    return f'{float(f"{shown:.2g}"):g} %'


def error_of(
    pairs: Mapping[str, Pair], *, spacing: float, cell: float, time: float,
    cost: float = math.nan, method: str = 'particles',
) -> NumericalError:
    """Return the error of a run from its pairs by part, ``lava`` and ``ground``.

    A missing part is unknown. The other arguments are those of ``NumericalError``.
    """
    errors = {name: pair.errors() for name, pair in pairs.items()}
    unknown = Areas(math.nan, math.nan)
    lava, ground = (errors.get(name, unknown) for name in ('lava', 'ground'))
    inundated, standing = map(AreaError, lava, ground)
    return NumericalError(inundated, standing, spacing, cell, time, cost, method)


def difference(one: np.ndarray, other: np.ndarray) -> float:
    """Return one minus the Jaccard index of two areas, masks or fractions of cells; 0 for none."""
    either = float(np.maximum(one, other).sum(dtype=np.float64))
    both = float(np.minimum(one, other).sum(dtype=np.float64))
    return 1.0 - both / either if either else 0.0


def mean_difference(fraction: np.ndarray, runs: float = math.inf) -> float:
    """Return the mean difference of two of some runs, from their fraction in each cell.

    ``runs`` is their number, infinite for a distribution from which they are drawn.
    """
    apart = float((2.0 * fraction * (1.0 - fraction)).sum()) / (1.0 - 1.0 / max(runs, 2.0))
    return apart / max(float(fraction.sum()) + 0.5 * apart, 1e-9)


def scaled(error: float, factor: float) -> float:
    """Return an error, 1 - J, whose logarithm -ln J is larger by a factor."""
    return 1.0 - (1.0 - error) ** factor


def richardson(ratio: float, order: float) -> float:
    """Return the ``reduction`` of a pair whose spacings have a ratio, for errors of an order."""
    return ratio**order - 1.0


def between_methods(size: float, spacing: float) -> float:
    """Return the ``reduction`` of a pair of particles with a spacing and cells of a size [m]."""
    return 1.0 + (size / (EQUAL_CELLS * spacing)) ** PARTICLE_ORDER
