# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The error by the particle spacing from pairs of runs, and its correction."""

from dataclasses import replace
import math

import numpy as np
import pytest

from lava_ros.layers.spacing_error import (
    COARSER,
    EVERY,
    has_pair,
    MAX_CORRECTION,
    ORDER_UNCERTAINTY,
    pair_of,
    SpacingError,
    SpacingPair,
)
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.numerical_error import ORDERS

REDUCTION = COARSER['particles']**ORDERS['particles'] - 1.0

#: No error.
NONE = SpacingError('particles', 10.0, 4, 0.0, 0.0, 0.0, 0.0, 0.0)


def test_one_member_in_four_has_a_pair() -> None:
    assert [index for index in range(9) if has_pair(index)] == [0, EVERY, 2 * EVERY]


def test_pair_has_the_delay_and_the_growth_of_its_coarser_run() -> None:
    arrival = np.linspace(100.0, 1000.0, 40).reshape(4, 10)
    arrival[0, :3] = np.nan
    part = np.where(np.isfinite(arrival), 1.0, 0.0)
    later = 1.1 * arrival
    later[3, 8:] = np.nan
    smaller = np.where(np.isfinite(later), 1.0, 0.0)
    pair = pair_of(arrival, part, later, smaller)
    assert pair is not None
    assert pair.delay == pytest.approx(math.log(1.1)) and pair.scatter == pytest.approx(0.0)
    assert pair.growth == pytest.approx(math.log(35.0 / 37.0))
    assert pair.difference == pytest.approx(2.0 / 37.0)
    never = np.full(arrival.shape, np.nan)
    assert pair_of(never, 0.0 * part, arrival, part) is None
    apart = pair_of(arrival, part, never, 0.0 * part)
    assert apart is not None and apart.difference == 1.0
    error = SpacingError.of([apart], Accuracy(spacing=8.0))
    assert error is not None and not error.is_usable and 0.0 < error.usable_spacing < 8.0


#: Arrival times of a member and its coarser run [s], and the expected delay.
EARLY = {
    'vent in both': ([0.0, 0.0, 400.0], [0.0, 0.0, 440.0], math.log(1.1)),
    'vent of the coarser run is wider': ([0.0, 380.0, 400.0], [0.0, 0.0, 440.0], math.log(1.1)),
    'vent of the member is wider': ([0.0, 0.0, 400.0], [0.0, 400.0, 440.0], math.log(1.1)),
    'first steps of one are shorter': ([1e-4, 380.0, 400.0], [1e-4, 1e-4, 440.0], math.log(1.1)),
    'all at the start': ([0.0, 0.0, np.nan], [0.0, 0.0, 30.0], 0.0),
    'member at the start': ([0.0, 0.0, 0.0], [100.0, 200.0, 400.0], 0.0),
    'coarser run at the start': ([100.0, 200.0, 400.0], [0.0, 0.0, 0.0], 0.0),
    'nothing in common': ([0.0, np.nan, np.nan], [np.nan, 0.0, 100.0], 0.0),
}


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('method', COARSER)
@pytest.mark.parametrize('part', [1.0, 0.0])
@pytest.mark.parametrize('name', EARLY)
def test_cells_with_lava_from_the_start_have_no_delay(
    name: str, part: float, method: str
) -> None:
    *runs, delay = EARLY[name]
    times = [np.array(run, dtype=np.float32)[None, :] for run in runs]
    # with a part of 0 lava has touched cells, but does not yet cover any
    parts = [np.where(np.isfinite(time), part, 0.0).astype(np.float32) for time in times]
    pair = pair_of(times[0], parts[0], times[1], parts[1])
    assert pair is not None
    assert pair.delay == pytest.approx(delay if part else 0.0, abs=1e-6)
    assert pair.scatter == pytest.approx(0.0, abs=1e-6)
    assert pair.difference == 1.0 or part
    error = SpacingError.of([pair, pair], Accuracy(method=method, spacing=10.0))
    assert error is not None and error.text()
    assert error.arrival_error(432.0) < 432.0
    for key, value in error.as_dict().items():
        assert isinstance(value, str) or math.isfinite(value), key
    counts = np.array([[0, 2, 1], [3, 0, 0]])
    assert np.isfinite(error.corrected(counts, 3.0, error.end(counts, 3.0))).all()


@pytest.mark.parametrize('method', COARSER)
def test_error_is_that_of_an_exact_run_by_the_order_of_the_method(method: str) -> None:
    spacing, rate = 8.0, 0.004
    accuracy = Accuracy(method=method, spacing=spacing)
    delay, coarser = (rate * d**ORDERS[method] for d in (spacing, COARSER[method] * spacing))
    pair = SpacingPair(coarser - delay, 0.0, delay - coarser, 0.0)
    error = SpacingError.of([pair, pair], accuracy)
    assert error is not None
    assert error.delay == pytest.approx(delay) and error.growth == pytest.approx(-delay)
    assert error.delay_spread == pytest.approx(ORDER_UNCERTAINTY * delay)
    assert SpacingError.of([], accuracy) is None
    scattered = SpacingError.of([replace(pair, scatter=0.1), pair], accuracy)
    assert scattered is not None
    assert scattered.delay_spread > error.delay_spread
    assert SpacingError.from_dict(error.as_dict()) == error


def test_correction_without_an_error_changes_nothing() -> None:
    counts = np.random.default_rng(1).integers(0, 3, (5, 20))
    end = NONE.end(counts, 60)
    assert end == 0.0
    np.testing.assert_allclose(NONE.corrected(counts, 60, end), counts, atol=1e-12)


@pytest.mark.parametrize('delay', [0.12, -0.12])
def test_corrected_quantiles_are_those_of_members_without_the_error(delay: float) -> None:
    exact = 1000.0 * np.exp(np.random.default_rng(2).normal(0.0, 0.35, 4000))
    samples, interval = 120, 50.0

    def counts(times: np.ndarray) -> np.ndarray:
        return np.histogram(times, samples, (0.0, samples * interval))[0][None, :]

    def quantiles(weights: np.ndarray) -> np.ndarray:
        sums = np.cumsum(weights[0])
        middles = (np.arange(samples) + 0.5) * interval
        return np.interp(len(exact) * np.array([0.1, 0.5, 0.9]), sums, middles)

    error = replace(NONE, delay=delay)
    wrong, right = counts(exact * math.exp(delay)), counts(exact)
    found = error.corrected(wrong, len(exact), 0.0)
    # to half a sample
    np.testing.assert_allclose(quantiles(found), quantiles(right), rtol=0.0, atol=0.5 * interval)
    assert abs(quantiles(wrong)[1] / quantiles(right)[1] - 1.0) > 0.1
    wide = replace(error, delay_spread=0.2).corrected(wrong, len(exact), 0.0)
    early, _, late = quantiles(wide)
    assert early < 0.97 * quantiles(right)[0] and late > 1.03 * quantiles(right)[2]


@pytest.mark.parametrize('growth', [0.1, -0.1])
def test_probabilities_have_the_corrected_area(growth: float) -> None:
    # lava reaches one cell after the other, some of them after the horizon
    random = np.random.default_rng(3)
    times = np.linspace(5.0, 200.0, 100)[:, None] * np.exp(random.normal(0.0, 0.3, 64))
    counts = np.stack([np.histogram(cell, 100, (0.0, 100.0))[0] for cell in times])
    error = replace(NONE, growth=growth)
    end = error.end(counts, 64)
    assert end * growth < 0.0
    found = error.corrected(counts, 64, end)
    assert found.sum() / counts.sum() == pytest.approx(math.exp(-growth), rel=0.02)
    assert found.sum(axis=1).max() <= 64.0 + 1e-9
    # where no member arrives, none does after the correction
    assert not found[counts.sum(axis=1) == 0].any()


def test_areas_are_shifted_and_widened() -> None:
    error = replace(NONE, growth=math.log(0.9), growth_spread=0.1)
    areas = error.corrected_areas({0.1: 150.0, 0.5: 100.0, 0.9: 60.0})
    assert areas[0.5] == pytest.approx(100.0 / 0.9)
    assert areas[0.1] / areas[0.5] > 1.5 and areas[0.9] / areas[0.5] < 0.6
    same = error.corrected_areas({0.1: 100.0, 0.5: 100.0, 0.9: 100.0})
    assert same[0.1] == pytest.approx(100.0 / 0.9 * math.exp(0.1 * 1.2816), rel=1e-4)
    assert error.corrected_areas({0.1: 1.0, 0.5: 0.0, 0.9: 0.0})[0.1] == 1.0


@pytest.mark.parametrize('method', COARSER)
def test_too_large_an_error_names_a_spacing_that_is_usable(method: str) -> None:
    good, bad = (
        replace(NONE, method=method, delay=part * MAX_CORRECTION) for part in (1.0, 2.0)
    )
    usable = 10.0 * 0.5 ** (1.0 / ORDERS[method])
    assert good.is_usable and not bad.is_usable
    if method == 'cells':
        # others would be rounded to cells of these sizes
        sizes = [10.0, 5.0, 2.5, 1.25]
        assert bad.usable_spacing == max(size for size in sizes if size <= usable)
    else:
        assert bad.usable_spacing == pytest.approx(usable, rel=0.02)
        assert bad.usable_spacing <= usable
    assert 'not usable' in bad.text() and f'{bad.usable_spacing:g} m would do' in bad.text()
    assert 'too late' in good.text() and 'not usable' not in good.text()
    for values in ({'growth': -0.2}, {'area_error': 0.5}, {'area_error': 1.0}):
        assert not replace(NONE, **values).is_usable
    areas = {0.1: 150.0, 0.5: 100.0, 0.9: 60.0}
    assert bad.corrected_areas(areas) == areas
