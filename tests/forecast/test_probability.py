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

"""Maps of members: exact, whatever their order, and nearer to the truth the more there are."""

from dataclasses import replace

import numpy as np
import pytest

from disc_flow import disc_fields, disc_members, disc_plan, exact_probability, HORIZON, same
from lava_ros.errors import LavaError
from lava_ros.forecast.members import MemberFields, Plan
from lava_ros.forecast.probability import Footprint, footprint_of, NEVER, reached_by, Tally
from lava_ros.forecast.sampling import draw_members
from lava_ros.maps.forecast import HazardMaps, occupancy, QUANTILES
from lava_ros.scene import Terrain

PLAN = disc_plan()


def maps_of(*members: MemberFields, plan: Plan = PLAN) -> HazardMaps:
    """Maps of some members."""
    tally = Tally(plan)
    for fields in members:
        tally.add(footprint_of(fields, plan))
    return tally.maps()


@pytest.mark.parametrize(('count', 'places'), [(20, (1, 9, 17)), (13, (1, 6, 11)), (1, (0, 0, 0))])
def test_maps_are_what_a_count_says(count: int, places: tuple[int, ...]) -> None:
    """Probability, quantiles and mean of random members, against numpy on all of them at once."""
    random = np.random.default_rng(1)
    members = []
    for index in range(count):
        arrival = random.choice([*((np.arange(60) + 0.5) * PLAN.interval), np.nan], (24, 30))
        arrival[random.random(arrival.shape) < random.random()] = np.nan
        peak = np.where(np.isfinite(arrival), np.rint(5e3 * random.random((24, 30))) * 1e-3, 0.0)
        members.append(MemberFields(index, arrival.astype(np.float32), peak.astype(np.float32)))
    maps = maps_of(*members)
    arrivals = np.sort(np.stack([item.arrival for item in members]), axis=0)
    np.testing.assert_allclose(
        maps.probability, 100.0 * np.isfinite(arrivals).mean(axis=0), rtol=1e-6
    )
    np.testing.assert_allclose(
        maps.thickness, np.stack([item.peak for item in members]).mean(axis=0), rtol=1e-5
    )
    # 10, 50 and 90 % of 20 are the 2nd, the 10th and the 18th, of 13 the 2nd, 7th and 12th
    for share, place in zip(QUANTILES, places, strict=True):
        np.testing.assert_array_equal(maps.arrival[share], arrivals[place])
    assert (maps.members, maps.effective_members) == (count, count)


def test_the_order_does_not_matter() -> None:
    """Any order, any weights: the same bits; a weight is as good as so many members."""
    drawn = disc_members(PLAN, draw_members(PLAN.scene, 16, seed=2))
    members = [footprint_of(fields, PLAN) for fields in drawn]
    weights = [1, 5, 0, 65536, 3, 1, 1, 2, 9, 4, 4, 7, 1, 0, 2, 8]
    maps = []
    for order in (range(16), reversed(range(16)), np.random.default_rng(3).permutation(16)):
        tally = Tally(PLAN)
        for index in order:
            tally.add(members[index], weights[index])
        maps.append(tally.maps())
    assert same(maps[0], maps[1]) and same(maps[0], maps[2])
    copies, single = Tally(PLAN), Tally(PLAN)
    for index, number in enumerate((1, 3, 2)):
        single.add(members[index], number)
        for copy in range(number):
            copies.add(replace(members[index], index=10 * index + copy))
    assert same(copies.maps(), single.maps())
    assert single.maps().effective_members == pytest.approx(36.0 / 14.0)


def test_arrival_is_known_to_half_a_look() -> None:
    """A footprint's arrival differs from the member's by no more than it says."""
    fields = disc_fields(0, 1.3)
    footprint, maps = footprint_of(fields, PLAN), maps_of(fields)
    arrived = np.isfinite(fields.arrival)
    assert np.array_equal(np.isfinite(maps.arrival[0.5]), arrived)
    error = np.abs(maps.arrival[0.5] - fields.arrival)[arrived]
    assert 0.0 < error.max() <= maps.arrival_error * 1.0001
    for time in (0.0, 900.0, HORIZON):
        reached = reached_by(footprint, PLAN, time)
        assert np.array_equal(reached, np.nan_to_num(maps.arrival[0.5], nan=np.inf) <= time)


def test_the_footprint_of_nothing_is_small() -> None:
    """A member without lava counts as one, and takes no room."""
    nothing = MemberFields(0, np.full((24, 30), np.nan, np.float32), np.zeros((24, 30)))
    assert footprint_of(nothing, PLAN).look.size == 0
    assert maps_of(nothing, disc_fields(1, 1.0)).probability.max() == 50.0


def test_cells_without_data_stay_unknown() -> None:
    """NaN in every map, -1 in an occupancy grid."""
    ground = np.zeros((24, 30))
    ground[:3] = np.nan
    plan = replace(PLAN, scene=replace(PLAN.scene, terrain=Terrain(ground, 20.0)))
    maps = maps_of(disc_fields(0, 1.0), plan=plan)
    for values in (maps.probability, maps.thickness, *maps.arrival.values()):
        assert np.isnan(values[:3]).all()
    assert (occupancy(maps.probability)[:3] == -1).all()


def test_an_occupancy_grid_rounds_nothing_away() -> None:
    """0 is never and 100 always: one member in a thousand shows, and so does the one without."""
    values = np.array([0.0, 0.001, 0.6, 49.6, 99.3, 99.999, 100.0, np.nan])
    assert occupancy(values).tolist() == [0, 1, 1, 50, 99, 99, 100, -1]
    assert occupancy(values).dtype == np.int8


def test_members_that_do_not_fit_are_refused() -> None:
    """Twice the same, beyond the terrain, none at all."""
    tally = Tally(PLAN)
    with pytest.raises(LavaError, match='members'):
        tally.maps()
    tally.add(footprint_of(disc_fields(4, 1.0), PLAN))
    with pytest.raises(LavaError, match='member'):
        tally.add(footprint_of(disc_fields(4, 1.0), PLAN))
    cells = np.full((3, 3), NEVER, np.uint16)
    beyond = Footprint(5, (22, 0), cells, cells.astype(np.uint32))
    with pytest.raises(LavaError, match='member 5'):
        tally.add(beyond)
    assert tally.count == 1


def test_probability_converges_to_the_truth() -> None:
    """Discs of lognormal discharge: the error falls as 1 / sqrt(members), or faster."""
    truth = exact_probability()
    spread = np.sqrt((truth * (1.0 - truth)).mean())
    counts, errors = (16, 64, 256, 1024), []
    for count in counts:
        ensembles = [draw_members(PLAN.scene, count, seed=seed) for seed in range(4)]
        found = [maps_of(*disc_members(PLAN, members)).probability for members in ensembles]
        errors.append(np.sqrt(((np.stack(found) / 100.0 - truth) ** 2).mean()))
        # binomial sampling would give this
        assert errors[-1] < spread / np.sqrt(count)
    assert np.polyfit(np.log(counts), np.log(errors), 1)[0] < -0.5
