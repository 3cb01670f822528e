# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The expected error of a hindcast's footprint, in parts.

The part of the particles is measured: a pilot of the same case, with particles ``COARSER`` times
as far apart, covers other cells. Errors fall as the ``ORDER``-th power of the distance between
particles (docs/benchmarks/README.md, expected error), so that the run itself is as far from the
limit as it is from the pilot, divided by COARSER^ORDER - 1 (Richardson).
"""

from dataclasses import asdict, dataclass, replace
import math

import numpy as np

from lava_ros.hindcast.case import Case
from lava_ros.hindcast.replicates import Agreement
from lava_ros.hindcast.run import Result, Settings, simulate
from lava_ros.maps.numbers import percent

#: Distance between the particles of a pilot over that of the run: it takes 1/16 of the time.
COARSER = 2.5

#: Power of the distance between particles as which the error of a footprint falls.
ORDER = 1.5


@dataclass(frozen=True)
class ExpectedError:
    """The expected error of a footprint: each part as 1 - Jaccard index.

    Attributes:
        particles: By the distance between particles.
        cells: By the cells of the terrain.
        effects: By the effects that were left out.
        chance: Mean difference between two runs that are rotated or mirrored; NaN if there was
            only one.
    """

    particles: float
    cells: float
    effects: float
    chance: float

    @property
    def total(self) -> float:
        """All known parts together: the root of the sum of their squares."""
        known = (self.particles, self.cells, self.effects, np.nan_to_num(self.chance))
        return min(math.hypot(*known), 1.0)

    def as_dict(self) -> dict[str, float | None]:
        """The parts and the total; None where a part is unknown."""
        parts = {**asdict(self), 'total': self.total}
        return {name: None if math.isnan(value) else value for name, value in parts.items()}

    def text(self) -> str:
        """Say it in a line."""
        parts = {'particles': self.particles, 'terrain': self.cells, 'effects': self.effects}
        if not math.isnan(self.chance):
            parts['chance'] = self.chance
        shown = ', '.join(f'{name} {percent(value)}' for name, value in parts.items())
        return f'{percent(self.total)} ({shown})'


def estimate_error(
    case: Case, settings: Settings, result: Result, several: Agreement | None = None
) -> ExpectedError:
    """Estimate the error of the footprint of a run; this runs a pilot.

    Args:
        case: The case.
        settings: Those of the run.
        result: Its result.
        several: What several runs agree on, if they were made.
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
    """Return the cells of one of two footprints alone over those of either, 0 without any."""
    both = int(np.count_nonzero(one | other))
    return int(np.count_nonzero(one ^ other)) / max(both, 1)


def _scatter(fraction: np.ndarray, runs: int) -> float:
    """Expected difference of two of some runs, by the fraction of them that cover each cell."""
    apart = float((2.0 * fraction * (1.0 - fraction)).sum()) * runs / max(runs - 1, 1)
    return apart / max(float(fraction.sum()) + 0.5 * apart, 1e-9)
