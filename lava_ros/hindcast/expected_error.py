# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Expected error of a hindcast's inundated area, in parts.

The part of the particle spacing is measured with a pilot run of the same case, whose spacing is
``COARSER`` times larger. Errors are proportional to the spacing to the power ``ORDER``
(docs/benchmarks/README.md, expected error), so the error of the run is its difference to the
pilot divided by COARSER^ORDER - 1 (Richardson extrapolation).
"""

from dataclasses import asdict, dataclass, replace
import math

import numpy as np

from lava_ros.hindcast.case import Case
from lava_ros.hindcast.replicates import Agreement
from lava_ros.hindcast.run import Result, Settings, simulate
from lava_ros.maps.numbers import percent

#: Particle spacing of a pilot over that of the run: a pilot takes 1/16 of the time.
COARSER = 2.5

#: Power of the particle spacing in the error of an inundated area.
ORDER = 1.5


@dataclass(frozen=True)
class ExpectedError:
    """The expected error of an inundated area: each part is 1 - Jaccard index.

    Attributes:
        particles: Error due to the particle spacing.
        cells: Error due to the cells of the terrain.
        effects: Error due to omitted effects.
        chance: Mean difference between two rotated or mirrored runs; NaN for a single run.
    """

    particles: float
    cells: float
    effects: float
    chance: float

    @property
    def total(self) -> float:
        """Total of the known parts: the root of the sum of their squares."""
        known = (self.particles, self.cells, self.effects, np.nan_to_num(self.chance))
        return min(math.hypot(*known), 1.0)

    def as_dict(self) -> dict[str, float | None]:
        """Return the parts and the total; None for an unknown part."""
        parts = {**asdict(self), 'total': self.total}
        return {name: None if math.isnan(value) else value for name, value in parts.items()}

    def text(self) -> str:
        """Format the error as one line."""
        parts = {'particles': self.particles, 'terrain': self.cells, 'effects': self.effects}
        if not math.isnan(self.chance):
            parts['chance'] = self.chance
        shown = ', '.join(f'{name} {percent(value)}' for name, value in parts.items())
        return f'{percent(self.total)} ({shown})'


def estimate_error(
    case: Case, settings: Settings, result: Result, several: Agreement | None = None
) -> ExpectedError:
    """Estimate the error of a run's inundated area with a pilot run.

    Args:
        case: The case.
        settings: Settings of the run.
        result: Result of the run.
        several: Agreement of several runs, if they were made.
    """
    assert result.accuracy.spacing is not None
    coarser = replace(settings, spacing=COARSER * result.accuracy.spacing)
    pilot = simulate(case, coarser)
    apart = difference(pilot.snapshot.inundated, result.snapshot.inundated)
    return ExpectedError(
        particles=min(apart / (COARSER**ORDER - 1.0), 1.0),
        cells=result.resolution.cell_error,
        effects=result.effects_error,
        chance=math.nan if several is None else _scatter(several.share, len(several.scores)),
    )


def difference(one: np.ndarray, other: np.ndarray) -> float:
    """Return the cells in only one of two areas over those in either, 0 without any."""
    both = int(np.count_nonzero(one | other))
    return int(np.count_nonzero(one ^ other)) / max(both, 1)


def _scatter(fraction: np.ndarray, runs: int) -> float:
    """Return the expected difference of two of some runs, from their fraction in each cell."""
    apart = float((2.0 * fraction * (1.0 - fraction)).sum()) * runs / max(runs - 1, 1)
    return apart / max(float(fraction.sum()) + 0.5 * apart, 1e-9)
