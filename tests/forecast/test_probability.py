# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Maps of members, their scores, and the weights that an outline gives."""

from collections.abc import Sequence
from dataclasses import replace
import math
from typing import Any

import numpy as np
import pytest

from disc_flow import (
    disc_fields,
    disc_members,
    disc_plan,
    exact_probability,
    HORIZON,
    same,
    TERRAIN,
)
from lava_ros.errors import LavaError
from lava_ros.forecast.assimilation import (
    effective_members,
    jaccard,
    Mask,
    Outline,
    outline_on,
    UNIT,
    weigh,
)
from lava_ros.forecast.members import MemberFields, Plan
from lava_ros.forecast.probability import (
    EnsembleAccumulator,
    Footprint,
    footprint_by,
    footprint_of,
    NEVER,
)
from lava_ros.forecast.sampling import draw_members, Member, Posterior
from lava_ros.forecast.scores import brier_parts, brier_score, entropy, reliability
from lava_ros.layers.forecast import (
    HazardMaps,
    occupancy,
    probability_words,
    QUANTILES,
    unseen,
)
from lava_ros.layers.spacing_error import COARSER, EVERY, SpacingError, SpacingPair
from lava_ros.scene import Terrain
from lava_ros.simulation.numerical_error import PARTICLE_ORDER

PLAN = disc_plan()


def discs(count: int, seed: int) -> list[MemberFields]:
    """Return members, or truths drawn like members."""
    return disc_members(PLAN, draw_members(PLAN.scene, count, seed=seed))


def maps_of(members: Sequence[MemberFields], weights: Any = None, plan: Plan = PLAN) -> HazardMaps:
    """Return the maps of members, of equal weight by default."""
    tally = EnsembleAccumulator(plan)
    for fields, weight in zip(members, weights or [1] * len(members), strict=True):
        tally.add(footprint_of(fields, plan), weight)
    return tally.maps()


@pytest.mark.parametrize(('count', 'places'), [(20, (1, 9, 17)), (13, (1, 6, 11)), (1, (0, 0, 0))])
def test_maps_equal_statistics_of_all_members(count: int, places: tuple[int, ...]) -> None:
    random = np.random.default_rng(1)
    members = []
    for index in range(count):
        arrival = random.choice([*((np.arange(60) + 0.5) * PLAN.interval), np.nan], (24, 30))
        arrival[random.random(arrival.shape) < random.random()] = np.nan
        peak = np.where(np.isfinite(arrival), np.rint(5e3 * random.random((24, 30))) * 1e-3, 0.0)
        parts = np.where(np.isfinite(arrival), random.integers(1, 51, (24, 30)) / 50.0, 0.0)
        times = arrival.astype(np.float32)
        members.append(MemberFields(index, times, times, parts, peak.astype(np.float32)))
    maps = maps_of(members)
    arrivals = np.sort(np.stack([item.arrival for item in members]), axis=0)
    parts = -np.sort(-np.stack([item.inundated for item in members]), axis=0)
    np.testing.assert_allclose(
        maps.probability, 100.0 * np.isfinite(arrivals).mean(axis=0), rtol=1e-6
    )
    np.testing.assert_allclose(
        maps.thickness, np.stack([item.peak for item in members]).mean(axis=0), rtol=1e-5
    )
    # 10, 50 and 90 % of 20 are the 2nd, the 10th and the 18th, of 13 the 2nd, 7th and 12th
    for quantile, place in zip(QUANTILES, places, strict=True):
        np.testing.assert_array_equal(maps.arrival[quantile], arrivals[place])
        np.testing.assert_allclose(maps.inundated[quantile], parts[place], rtol=1e-6)
    assert (maps.members, maps.effective_members) == (count, count)


def test_maps_do_not_depend_on_the_order_of_members() -> None:
    members = discs(16, seed=2)
    weights = [1, 5, 0, 65536, 3, 1, 1, 2, 9, 4, 4, 7, 1, 0, 2, 8]
    one, *others = (
        maps_of([members[index] for index in order], [weights[index] for index in order])
        for order in (range(16), range(15, -1, -1), np.random.default_rng(3).permutation(16))
    )
    assert same(one, others[0]) and same(one, others[1])
    single = maps_of(members[:3], [1, 3, 2])
    copies = [members[number] for number in (0, 1, 1, 1, 2, 2)]
    assert same(maps_of([replace(item, index=k) for k, item in enumerate(copies)]), single)
    assert single.effective_members == pytest.approx(36.0 / 14.0)


def test_arrival_error_is_at_most_half_a_sample() -> None:
    fields = disc_fields(0, 1.3)
    footprint, maps = footprint_of(fields, PLAN), maps_of([fields])
    arrived = np.isfinite(fields.arrival)
    assert np.array_equal(np.isfinite(maps.arrival[0.5]), arrived)
    error = np.abs(maps.arrival[0.5] - fields.arrival)[arrived]
    assert 0.0 < error.max() <= maps.arrival_error * 1.0001
    for time in (0.0, 900.0, HORIZON):
        reached = footprint_by(footprint, PLAN, time)
        assert np.array_equal(reached, np.nan_to_num(maps.arrival[0.5], nan=np.inf) <= time)


def test_lava_that_arrives_exactly_at_a_time_has_arrived() -> None:
    footprint = footprint_of(disc_fields(0, 1.3), PLAN)
    samples = footprint.half_sample[footprint.half_sample != NEVER]
    for sample in np.unique(samples):
        found = footprint_by(footprint, PLAN, (float(sample) + 0.5) * PLAN.interval)
        assert found.sum() == (samples <= sample).sum()


def test_pairs_of_members_correct_their_maps() -> None:
    late = 1.1
    exact, members = discs(200, seed=1), []
    for item in exact:
        # discs that are late by a tenth, at a coarser spacing by so much more
        times = late * item.arrival
        kept = times <= HORIZON
        pair = None
        if item.index % EVERY == 0:
            ratio = math.log(late) * (COARSER['particles'] ** PARTICLE_ORDER - 1.0)
            # the area of a disc is proportional to the time
            pair = SpacingPair(ratio, 0.0, -ratio, 0.0)
        members.append(replace(
            item, arrival=np.where(kept, times, np.nan).astype(np.float32),
            inundated=np.where(kept, item.inundated, 0.0), pair=pair,
        ))
    plan = replace(PLAN, accuracy=replace(PLAN.accuracy, spacing=8.0))
    raw = maps_of([replace(item, pair=None) for item in members], plan=plan)
    right, found = maps_of(exact, plan=plan), maps_of(members, plan=plan)
    assert raw.spacing_error is None and found.spacing_error is not None
    assert found.spacing_error.pairs == 50

    def gap(maps: HazardMaps) -> float:
        return float(np.abs(maps.probability - right.probability).mean())

    assert gap(found) < 0.3 * gap(raw)
    for maps, expected in ((found, 1.0), (raw, late)):
        for share in (0.1, 0.5):
            ratio = np.nanmedian(maps.arrival[share] / right.arrival[share])
            assert ratio == pytest.approx(expected, abs=0.02)
    for share, area in right.areas(20.0).items():
        assert found.areas(20.0)[share] == pytest.approx(area, rel=0.03 if share == 0.5 else 0.1)
    assert found.arrival_error == pytest.approx(
        0.5 * PLAN.interval + HORIZON * math.expm1(math.log(late) * math.hypot(1.0, 0.5))
    )


def test_worst_case_is_that_of_any_member() -> None:
    members = discs(12, seed=4)
    maps = maps_of(members)
    assert maps.worst is not None
    arrivals = np.stack([item.arrival for item in members])
    earliest = np.where(np.isfinite(arrivals).any(axis=0), np.fmin.reduce(arrivals), np.nan)
    np.testing.assert_allclose(maps.worst.arrival, earliest, atol=0.5001 * PLAN.interval)
    peaks, parts = (
        np.stack([getattr(item, name) for item in members]).max(axis=0)
        for name in ('peak', 'inundated')
    )
    np.testing.assert_allclose(maps.worst.thickness, peaks)
    np.testing.assert_allclose(maps.worst.inundated, parts)
    assert maps.worst_area(20.0) == pytest.approx(400.0 * parts.sum())
    # a member without weight does not count
    weights = [1] * 11 + [0]
    without = maps_of(members[:11])
    weighted = maps_of(members, weights)
    assert without.worst is not None and weighted.worst is not None
    np.testing.assert_array_equal(weighted.worst.arrival, without.worst.arrival)


def test_none_of_n_is_below_one_in_n_plus_one() -> None:
    assert unseen(32.0) == pytest.approx(100.0 / 33.0)
    assert probability_words(0.0, 32.0) == 'below 3 %'
    assert probability_words(100.0, 32.0) == 'above 97 %'
    assert probability_words(3.125, 32.0) == '3 %' and probability_words(50.0, 32.0) == '50 %'
    maps = maps_of(discs(32, seed=1))
    # the 4th, the 16th and the 29th of 32
    assert maps.coverage == pytest.approx({0.1: 400 / 33, 0.5: 1600 / 33, 0.9: 2900 / 33})
    # a cell that none of n members reaches is reached by a truth less often than that
    random = np.random.default_rng(5)
    for chance in (0.002, 0.02, 0.1):
        none = (random.random((20_000, 32)) < chance).sum(axis=1) == 0
        came = random.random(20_000) < chance
        assert 100.0 * (none & came).mean() < unseen(32.0)


def test_member_without_lava_counts_and_is_empty() -> None:
    never, none = np.full((24, 30), np.nan, np.float32), np.zeros((24, 30))
    nothing = MemberFields(0, never, never, none, none)
    assert footprint_of(nothing, PLAN).first_sample.size == 0
    assert maps_of([nothing, disc_fields(1, 1.0)]).probability.max() == 50.0


def test_cells_without_data_stay_unknown() -> None:
    ground = np.zeros((24, 30))
    ground[:3] = np.nan
    plan = replace(PLAN, scene=replace(PLAN.scene, terrain=Terrain(ground, 20.0)))
    maps = maps_of([disc_fields(0, 1.0)], plan=plan)
    for values in (maps.probability, maps.thickness, *maps.arrival.values()):
        assert np.isnan(values[:3]).all()
    assert (occupancy(maps.probability)[:3] == -1).all()


def test_occupancy_is_0_or_100_only_for_exact_values() -> None:
    values = np.array([0.0, 0.001, 0.6, 49.6, 99.3, 99.999, 100.0, np.nan])
    assert occupancy(values).tolist() == [0, 1, 1, 50, 99, 99, 100, -1]
    assert occupancy(values).dtype == np.int8


def test_tally_refuses_repeated_and_misplaced_members() -> None:
    tally = EnsembleAccumulator(PLAN)
    with pytest.raises(LavaError, match='members'):
        tally.maps()
    tally.add(footprint_of(disc_fields(4, 1.0), PLAN))
    with pytest.raises(LavaError, match='member'):
        tally.add(footprint_of(disc_fields(4, 1.0), PLAN))
    cells = np.full((3, 3), NEVER, np.uint16)
    parts = np.zeros((3, 3), np.uint8)
    beyond = Footprint(5, (22, 0), cells, cells, parts, cells.astype(np.uint32))
    for corner in ((22, 0), (-1, 0)):
        with pytest.raises(LavaError, match='member 5'):
            tally.add(replace(beyond, corner=corner))
    assert tally.count == 1


def test_entropy_in_bits() -> None:
    bits = entropy(np.array([0.0, 1.0, 0.5, 0.25, 0.75, np.nan]))
    expected = [0.0, 0.0, 1.0, 0.811278, 0.811278, np.nan]
    np.testing.assert_allclose(bits, expected, atol=1e-6)


def test_brier_score_of_small_cases() -> None:
    assert brier_score(np.array([1.0, 0.0]), np.array([True, False])) == 0.0
    assert brier_score(np.array([1.0, 0.0]), np.array([False, True])) == 1.0
    assert brier_score(np.full(4, 0.5), np.array([True, False, True, True])) == 0.25
    score = brier_score(np.array([[0.25, np.nan], [0.5, 1.0]]), np.array([[1, 1], [0, 1]]))
    assert score == pytest.approx((0.75**2 + 0.5**2 + 0.0) / 3.0)


def test_brier_parts_of_a_small_case() -> None:
    probability = np.repeat([0.2, 0.8], 5)
    outcome = np.array([1, 0, 0, 0, 0, 1, 1, 1, 0, 0], dtype=bool)
    parts = brier_parts(probability, outcome)
    assert parts.score == pytest.approx((0.64 + 4 * 0.04 + 3 * 0.04 + 2 * 0.64) / 10)
    assert parts.reliability == pytest.approx(0.5 * 0.2**2)
    assert parts.resolution == pytest.approx(0.2**2)
    assert parts.uncertainty == pytest.approx(0.24)
    assert parts.skill == pytest.approx(1.0 - parts.score / 0.24)


def test_brier_parts_add_up_to_the_score() -> None:
    random = np.random.default_rng(2)
    for _ in range(5):
        probability = random.integers(0, 33, (40, 50)) / 32.0
        outcome = random.random((40, 50)) < probability**2
        parts = brier_parts(probability, outcome)
        total = parts.reliability - parts.resolution + parts.uncertainty
        assert parts.score == pytest.approx(total, abs=1e-12)
        assert parts.score == pytest.approx(brier_score(probability, outcome), abs=1e-15)


def test_reliability_bins_of_a_small_case() -> None:
    probability = np.array([0.0, 0.1, 0.25, 0.5, 0.5, 0.75, 1.0])
    outcome = np.array([0, 1, 0, 1, 0, 1, 1], dtype=bool)
    bins = reliability(probability, outcome, bins=4)
    assert [item.count for item in bins] == [2, 1, 2, 2]
    assert [(item.low, item.high) for item in bins][1] == (0.25, 0.5)
    assert bins[0].forecast == pytest.approx(0.05) and bins[0].observed == 0.5
    assert bins[2].forecast == 0.5 and bins[2].observed == 0.5
    assert bins[3].forecast == pytest.approx(0.875) and bins[3].observed == 1.0
    empty = reliability(np.array([0.9]), np.array([True]), bins=2)[0]
    assert empty.count == 0 and np.isnan(empty.forecast) and np.isnan(empty.observed)
    # 0.3 is 3 of 10 members, however it is rounded
    assert reliability(np.array([0.3 - 1e-12]), np.array([True]))[3].count == 1


def test_score_refuses_unusable_arrays() -> None:
    for probability, outcome in (
        (np.zeros(3), np.zeros(4)),
        (np.array([50.0]), np.ones(1)),
        (np.array([np.nan]), np.ones(1)),
    ):
        with pytest.raises(LavaError):
            brier_score(probability, outcome)


def test_ensembles_are_reliable_on_a_synthetic_truth() -> None:
    came = np.stack([np.isfinite(truth.arrival) for truth in discs(512, seed=77)])
    predicted = np.broadcast_to(maps_of(discs(256, seed=1)).probability / 100.0, came.shape)
    for item in reliability(predicted, came):
        assert item.observed == pytest.approx(item.forecast, abs=0.02)
    parts = brier_parts(predicted, came)
    assert parts.reliability < 1e-3
    assert parts.score < 0.5 * parts.uncertainty
    # the exact probabilities are the best forecast
    exact = np.broadcast_to(exact_probability(), came.shape)
    assert parts.score == pytest.approx(brier_score(exact, came), abs=1e-3)


def mask(*cells: tuple[int, int]) -> np.ndarray:
    """Return a mask of 3 x 3 cells that is true in some."""
    result = np.zeros((3, 3), dtype=bool)
    for cell in cells:
        result[cell] = True
    return result


def test_jaccard_index_of_small_cases() -> None:
    whole = Outline(60.0, mask((0, 0), (0, 1), (1, 1)), ~mask())
    assert jaccard(mask((0, 0), (0, 1), (1, 1)), whole) == 1.0
    assert jaccard(mask((0, 1), (1, 1), (2, 2)), whole) == 0.5
    assert jaccard(mask((2, 2)), whole) == 0.0
    part = Outline(60.0, mask((0, 0), (0, 1), (1, 1)), ~mask((2, 2), (0, 0)))
    assert jaccard(mask((0, 1), (1, 1), (2, 2)), part) == 1.0


def test_weights_are_powers_of_the_index() -> None:
    weights = weigh([0.8, 0.4, 0.0, 0.8], sharpness=2.0, least_effective=0.0)
    assert weights.values.tolist() == [UNIT, UNIT // 4, 0, UNIT]
    assert weights.effective_members == pytest.approx(2.25**2 / 2.0625)
    assert weights.sharpness == 2.0
    assert weigh([0.8, 0.4, 0.0], sharpness=0.0).values.tolist() == [UNIT, UNIT, 0]
    assert effective_members(np.ones(7)) == 7.0


def test_numerical_error_flattens_the_weights() -> None:
    index = [0.9, 0.7, 0.5]
    exact, rough = weigh(index, least_effective=0.0), weigh(index, area_error=0.3)
    assert rough.sharpness == pytest.approx(1.0 / np.hypot(1.0 / 8.0, -np.log(0.7)))
    assert rough.effective_members > exact.effective_members
    assert weigh(index, area_error=1.0).effective_members > 2.9


def test_late_members_are_compared_with_an_outline_at_a_later_time() -> None:
    footprint = footprint_of(disc_fields(0, 1.0), PLAN)
    error = SpacingError('particles', 8.0, 1, float(np.log(1.15)), 0.0, 0.0, 0.0, 0.0)
    found = footprint_by(footprint, PLAN, 1600.0, error)
    assert np.array_equal(found, footprint_by(footprint, PLAN, 1840.0))
    assert not np.array_equal(found, footprint_by(footprint, PLAN, 1600.0))
    too_late = replace(error, delay=0.2)
    not_moved = footprint_by(footprint, PLAN, 1600.0, too_late)
    assert np.array_equal(not_moved, footprint_by(footprint, PLAN, 1600.0))
    at_end = footprint_by(footprint, PLAN, HORIZON, error)
    assert np.array_equal(at_end, footprint_by(footprint, PLAN, HORIZON))


def test_sharpness_falls_until_enough_members_count() -> None:
    index = np.linspace(0.01, 1.0, 100)
    sharp = weigh(index, sharpness=200.0, least_effective=0.0)
    assert sharp.effective_members < 2.0
    weights = weigh(index, sharpness=200.0, least_effective=0.3)
    assert weights.effective_members == pytest.approx(30.0, rel=0.01)
    assert weights.sharpness < 10.0
    assert weigh(index).effective_members > 10.0


def test_mask_is_resampled_to_the_terrain() -> None:
    mask = Mask(
        np.array([[True, False, False], [True, False, True]]),
        np.array([[True, True, False], [True, True, True]]), 10.0, (100.0, 50.0),
    )
    ground = np.zeros((6, 10))
    # without data: one cell with lava, one without
    ground[2, 3] = ground[2, 4] = np.nan
    # the mask starts in column 2, row 1
    outline = outline_on(Terrain(ground, 5.0, origin=(90.0, 45.0)), mask, 60.0)
    fine = np.kron(mask.lava, np.ones((2, 2))).astype(bool)
    known = np.kron(mask.known, np.ones((2, 2))).astype(bool)
    known[1, 1:3] = False
    np.testing.assert_array_equal(outline.known[1:5, 2:8], known)
    np.testing.assert_array_equal(outline.lava[1:5, 2:8], fine & known)
    assert outline.known.sum() == known.sum() and outline.lava.sum() == (fine & known).sum()
    with pytest.raises(LavaError, match='outline with lava'):
        outline_on(Terrain(ground, 5.0, origin=(900.0, 45.0)), mask, 60.0)


def test_refuses_unusable_outlines_and_indices() -> None:
    for index in ([0.0, 0.0], [], [0.5, 1.5], [np.nan]):
        with pytest.raises(LavaError):
            weigh(index)
    for time, lava, known in (
        (60.0, mask(), ~mask()),
        (60.0, mask((0, 0)), mask((1, 1))),
        (0.0, mask((0, 0)), ~mask()),
        (60.0, mask((0, 0)).astype(float), ~mask()),
        (60.0, mask((0, 0)), ~mask()[:2]),
    ):
        with pytest.raises(LavaError, match='observed'):
            Outline(time, lava, known)
    with pytest.raises(LavaError, match='reached'):
        jaccard(~mask()[:2], Outline(60.0, mask((0, 0)), ~mask()))


def test_outline_improves_the_forecast() -> None:
    members, observed_at = discs(128, seed=1), HORIZON / 3.0
    prior = maps_of(members).probability / 100.0
    reached = [footprint_by(footprint_of(item, PLAN), PLAN, observed_at) for item in members]
    scores = []
    for truth in discs(40, seed=50):
        arrival = np.nan_to_num(truth.arrival, nan=np.inf)
        outline = Outline(observed_at, arrival <= observed_at, np.isfinite(TERRAIN.elevation))
        weights = weigh([jaccard(item, outline) for item in reached])
        posterior = maps_of(members, weights.values.tolist()).probability / 100.0
        came = arrival <= HORIZON
        scores.append((brier_score(prior, came), brier_score(posterior, came)))
    before, after = np.array(scores).T
    assert after.mean() < 0.5 * before.mean()
    assert (after > before).sum() <= 3


def test_members_drawn_after_each_outline_do_not_starve() -> None:
    times, scores, effective = np.arange(1, 6) * HORIZON / 6.0, [], []
    prior = draw_members(PLAN.scene, 8)
    for truth in discs(20, seed=50):
        arrival = np.nan_to_num(truth.arrival, nan=np.inf)
        members, product = prior, np.ones(8)
        for generation, time in enumerate(times, 1):
            outline = Outline(time, arrival <= time, np.isfinite(TERRAIN.elevation))

            def agreement(
                members: Sequence[Member], outline: Outline = outline
            ) -> np.ndarray:
                footprints = [footprint_of(item, PLAN) for item in disc_members(PLAN, members)]
                reached = [footprint_by(item, PLAN, outline.time) for item in footprints]
                return np.array([jaccard(item, outline) for item in reached])

            product *= agreement(prior)
            posterior = Posterior(members, weigh(agreement(members)).values, generation)
            members = draw_members(PLAN.scene, 8, posterior=posterior)
        weights = weigh(product)
        effective.append((weights.effective_members, posterior.effective_members))
        came = arrival <= HORIZON
        scores.append([
            brier_score(maps_of(disc_members(PLAN, sample), given).probability / 100.0, came)
            for sample, given in ((prior, weights.values.tolist()), (members, None))
        ])
    assert np.mean(effective, axis=0)[0] < 2.0 and np.mean(effective, axis=0)[1] > 6.0
    weighted, drawn = np.mean(scores, axis=0)
    assert drawn < 0.7 * weighted
