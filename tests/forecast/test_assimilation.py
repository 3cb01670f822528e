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

"""Weights by what was seen: exact in small cases, and they make forecasts better."""

import numpy as np
import pytest

from disc_flow import disc_fields, disc_plan, HORIZON, TERRAIN
from lava_ros.errors import LavaError
from lava_ros.forecast.assimilation import (
    effective_members,
    jaccard,
    Outline,
    UNIT,
    weigh,
)
from lava_ros.forecast.probability import footprint_of, reached_by, Tally
from lava_ros.forecast.sampling import draw_members
from lava_ros.forecast.scores import brier_score

EVERYWHERE = np.ones(TERRAIN.shape, dtype=bool)


def mask(*cells: tuple[int, int]) -> np.ndarray:
    """A mask of 3 x 3 cells that is true in some."""
    result = np.zeros((3, 3), dtype=bool)
    for cell in cells:
        result[cell] = True
    return result


def test_the_index_of_small_cases() -> None:
    """What both have over what one has, of the cells where somebody looked."""
    everywhere = np.ones((3, 3), dtype=bool)
    seen = Outline(60.0, mask((0, 0), (0, 1), (1, 1)), everywhere)
    assert jaccard(mask((0, 0), (0, 1), (1, 1)), seen) == 1.0
    assert jaccard(mask((0, 1), (1, 1), (2, 2)), seen) == 0.5
    assert jaccard(mask((2, 2)), seen) == 0.0
    part = Outline(60.0, mask((0, 0), (0, 1), (1, 1)), ~mask((2, 2), (0, 0)))
    assert jaccard(mask((0, 1), (1, 1), (2, 2)), part) == 1.0


def test_weights_are_powers() -> None:
    """Relative to the best; 0 without anything in common; a power of 0 makes all equal."""
    weights = weigh([0.8, 0.4, 0.0, 0.8], sharpness=2.0, least_effective=0.0)
    assert weights.values.tolist() == [UNIT, UNIT // 4, 0, UNIT]
    assert weights.effective_members == pytest.approx(2.25**2 / 2.0625)
    assert weights.sharpness == 2.0
    assert weigh([0.8, 0.4, 0.0], sharpness=0.0).values.tolist() == [UNIT, UNIT, 0]
    assert effective_members(np.ones(7)) == 7.0


def test_a_forecast_never_hangs_on_a_few_members() -> None:
    """The power is taken down until enough members count."""
    index = np.linspace(0.01, 1.0, 100)
    sharp = weigh(index, sharpness=200.0, least_effective=0.0)
    assert sharp.effective_members < 2.0
    weights = weigh(index, sharpness=200.0, least_effective=0.3)
    assert weights.effective_members == pytest.approx(30.0, rel=0.01)
    assert weights.sharpness < 10.0
    assert weigh(index).effective_members > 10.0


def test_what_cannot_weigh_is_refused() -> None:
    """No member near the outline, no index, no outline."""
    for index in ([0.0, 0.0], [], [0.5, 1.5], [np.nan]):
        with pytest.raises(LavaError):
            weigh(index)
    nothing = np.zeros((3, 3), dtype=bool)
    for time, lava, known in (
        (60.0, nothing, ~nothing),
        (60.0, mask((0, 0)), mask((1, 1))),
        (0.0, mask((0, 0)), ~nothing),
        (60.0, mask((0, 0)).astype(float), ~nothing),
        (60.0, mask((0, 0)), np.ones((2, 3), dtype=bool)),
    ):
        with pytest.raises(LavaError, match='observed'):
            Outline(time, lava, known)
    with pytest.raises(LavaError, match='reached'):
        jaccard(np.ones((2, 2), dtype=bool), Outline(60.0, mask((0, 0)), ~nothing))


def test_an_outline_makes_the_forecast_better() -> None:
    """Seen at a third of the time, a truth is forecast better than without, in almost every case.

    The Brier score over 40 truths falls to less than half, and no more than three get worse.
    """
    plan = disc_plan()
    members = draw_members(plan.scene, 128, seed=1)
    footprints = [footprint_of(disc_fields(m.index, m.discharge), plan) for m in members]
    plain = Tally(plan)
    for footprint in footprints:
        plain.add(footprint)
    prior = plain.maps().probability / 100.0
    seen_at = HORIZON / 3.0
    reached = [reached_by(footprint, plan, seen_at) for footprint in footprints]
    scores = []
    for truth in draw_members(plan.scene, 40, seed=50):
        arrival = np.nan_to_num(disc_fields(0, truth.discharge).arrival, nan=np.inf)
        outline = Outline(seen_at, arrival <= seen_at, EVERYWHERE)
        weights = weigh([jaccard(item, outline) for item in reached])
        tally = Tally(plan)
        for footprint, weight in zip(footprints, weights.values.tolist(), strict=True):
            tally.add(footprint, weight)
        posterior = tally.maps().probability / 100.0
        came = arrival <= HORIZON
        scores.append((brier_score(prior, came), brier_score(posterior, came)))
    before, after = np.array(scores).T
    assert after.mean() < 0.5 * before.mean()
    assert (after > before).sum() <= 3
