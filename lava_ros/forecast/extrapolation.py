# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What coarse runs say about finer ones: their cost and their error.

Cost: the wall time of a run is s + E (a + b r^k). E, its evaluations, grow as a power of the
refinement r, that of the last two runs: powers grow with r. One evaluation has a part that does
not depend on the particles and one that goes as their number, r^2; the solve for the lateral
stress takes iterations as well, as many as particles lie across its reach, so that k is 3 with it
and 2 without. The last run is the nearest to what is asked for: all is in proportion to it.

Error: of what two runs cover, the share that only one of them does. An edge is off by a bias that
all runs have, C r^-p, and by where particles happen to lie, q C r^-p, which differs from run to
run. Two runs then differ by

    d_ij = C sqrt((r_i^-p - r_j^-p)^2 + q^2 (r_i^-2p + r_j^-2p))

and each from the limit by C r^-p sqrt(1 + q^2). Neither p nor q can be told from few runs alone:
those of a grid are weighed by how well they explain what was seen and by what is usual.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
import math

import numpy as np

from lava_ros.effects import Effects

#: What a run errs at least as a share of what it covers: twice the error of the edge that the
#: finest preset has in docs/accuracy, since an area goes as the square of its radius.
FLOOR = 0.004

#: How much finer a run is than another to tell how evaluations grow.
APART = 1.15

#: Powers p at which errors fall, and how usual each is: docs/accuracy has 1 on slopes.
ORDERS = {0.6: 0.5, 0.8: 1.0, 1.0: 1.5, 1.2: 1.0, 1.5: 0.5}

#: Scatter q over bias.
SCATTERS = (0.0, 0.3, 0.6, 1.0, 2.0)

#: How far what is seen of two runs is from the law, as a factor's logarithm.
_SPREAD = 0.3


@dataclass(frozen=True, eq=False)
class Pilot:
    """A coarse run.

    Attributes:
        refinement: Its refinement.
        wall_time: How long it took, kernels compiled before [s].
        evaluations: Velocity evaluations.
        particles: Particles at the end.
        effects: The physics that was chosen.
        covered: Cells with lava at the end, bool, shape [rows, columns].
        setup: Part of the wall time before the first step [s].
    """

    refinement: float
    wall_time: float
    evaluations: int
    particles: int
    effects: Effects
    covered: np.ndarray
    setup: float = 0.0


def cost_at(pilots: Sequence[Pilot], refinement: float) -> float:
    """Wall time [s] of a run with the physics of the last pilot.

    Args:
        pilots: From the coarsest to the finest; those with other physics say nothing of it.
        refinement: Refinement of the run.
    """
    last = pilots[-1]
    alike = [pilot for pilot in pilots if pilot.effects == last.effects][-4:]
    scale = refinement / last.refinement
    power = 3.0 if last.effects.helmholtz else 2.0
    each = (last.wall_time - last.setup) / max(last.evaluations, 1)
    if len(alike) == 1:
        # nothing to compare with: all of the time is that of the particles
        return last.setup + last.evaluations * each * scale ** (power + 1.0)
    evaluations = last.evaluations * scale ** _growth(alike)
    sizes = np.array([(pilot.refinement / last.refinement) ** power for pilot in alike])
    times = np.array([
        (pilot.wall_time - pilot.setup) / max(pilot.evaluations, 1) for pilot in alike
    ])
    constant, slope = _line(sizes, times)
    return last.setup + evaluations * each * (constant + slope * scale**power) / (constant + slope)


def _growth(pilots: Sequence[Pilot]) -> float:
    """Power of the refinement at which evaluations grow."""
    last = pilots[-1]
    # those too near say more of chance
    far = [pilot for pilot in pilots[:-1] if pilot.refinement * APART < last.refinement]
    before = far[-1] if far else pilots[0]
    if before.refinement == last.refinement:
        return 1.0
    more = max(last.evaluations, 1) / max(before.evaluations, 1)
    growth = math.log(more) / math.log(last.refinement / before.refinement)
    return min(max(growth, 0.0), 2.0)


def _line(sizes: np.ndarray, times: np.ndarray) -> tuple[float, float]:
    """Constant and slope, neither negative, of the line with the least relative errors."""
    # a run that is twice as long is half as uncertain, that is four times the weight
    weights = np.sqrt(sizes) / np.maximum(times, 1e-12)
    rows = np.stack([weights, weights * sizes], axis=1)
    (constant, slope), *_ = np.linalg.lstsq(rows, weights * times, rcond=None)
    if slope < 0.0:
        return float(np.average(times, weights=weights**2)), 0.0
    if constant < 0.0:
        return 0.0, float(np.average(times / sizes, weights=(weights * sizes) ** 2))
    return float(constant), float(slope)


def error_law(pilots: Sequence[Pilot]) -> ErrorLaw:
    """The law of errors that the last four pilots give; at least two."""
    pilots = pilots[-4:]
    pairs = []
    for place, one in enumerate(pilots):
        for other in pilots[place + 1 :]:
            both = int(np.count_nonzero(one.covered | other.covered))
            wrong = int(np.count_nonzero(one.covered ^ other.covered))
            # half a cell, lest runs that agree would be without error
            pairs.append((one.refinement, other.refinement, max(wrong, 0.5) / max(both, 1)))
    coarse, fine, seen = np.array(pairs).T
    terms = []
    for (order, usual), scatter in product(ORDERS.items(), SCATTERS):
        x, y = coarse**-order, fine**-order
        law = np.sqrt((x - y) ** 2 + scatter**2 * (x**2 + y**2))
        logarithm = np.log(seen / law)
        constant = float(logarithm.mean())
        misfit = float(((logarithm - constant) ** 2).sum()) / (2.0 * _SPREAD**2)
        size = math.exp(constant) * math.hypot(1.0, scatter)
        terms.append((usual * math.exp(-misfit), size, order))
    weights, sizes, orders = np.array(terms).T
    return ErrorLaw(weights / weights.sum(), sizes, orders)


@dataclass(frozen=True, eq=False)
class ErrorLaw:
    """Laws C r^-p and how likely each is.

    Attributes:
        weights: How likely, their sum is one, shape [n].
        sizes: C as a share of the covered area, shape [n].
        orders: p, shape [n].
    """

    weights: np.ndarray
    sizes: np.ndarray
    orders: np.ndarray

    def at(self, refinement: float) -> float:
        """Share of the covered area that is wrong: the mean of the laws' logarithms, at most 1."""
        logarithms = np.log(self.sizes) - self.orders * math.log(refinement)
        return min(max(math.exp(float(self.weights @ logarithms)), FLOOR), 1.0)
