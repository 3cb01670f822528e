# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Calibration with scores that are known in advance."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.hindcast.calibration import (
    COLUMNS,
    findings,
    has_enough_samples,
    leave_one_out,
    near_optimal,
    Numbers,
    ParameterSample,
    posterior_quantiles,
    read_samples,
    search,
    write_samples,
)
from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.free_parameters import changed, free_parameters_of, FreeParameter

UNKNOWNS = (
    FreeParameter('viscosity', 'Pa s', 1e2, 1e6, 1e5, 'made up', is_log=True),
    FreeParameter('emissivity', '', 0.0, 1.0, 0.9, 'made up'),
    FreeParameter('discharge', '', 0.5, 1.5, 1.0, 'made up'),
)


def _score(values: Mapping[str, float]) -> float:
    """Return a score that is best at 1e3 Pa s and an emissivity of 0.3, for any discharge."""
    viscosity = (np.log10(values['viscosity']) - 3.0) / 4.0
    return float(0.7 - viscosity**2 - (values['emissivity'] - 0.3) ** 2)


#: Scores of two cases with the mean ``_score``; the second is best at an emissivity of 0.2.
CASES = {
    'one': lambda values: _score(values) + 0.2 * values['emissivity'],
    'two': lambda values: _score(values) - 0.2 * values['emissivity'],
}


def _evaluated(sets: Sequence[Mapping[str, float]]) -> list[Numbers]:
    return [
        {case: {**dict.fromkeys(COLUMNS, 0.0), 'eruption': number, 'fitted': 1.0,
                'jaccard': max(score(values), 0.0)}
         for number, (case, score) in enumerate(CASES.items())}
        for values in sets
    ]


@pytest.fixture(scope='module')
def trials() -> list[ParameterSample]:
    """Return the trials of a search with 80 runs."""
    return search(UNKNOWNS, _evaluated, runs=80, seed=1)


def test_search_finds_the_best_inside_the_ranges(trials):
    assert len(trials) == 80
    assert trials[0].values == pytest.approx(
        {'viscosity': 1e5, 'emissivity': 0.9, 'discharge': 1.0}
    )
    best = near_optimal(trials)[0]
    assert best.jaccard > 0.69
    assert 3e2 < best.values['viscosity'] < 3e3
    assert 0.2 < best.values['emissivity'] < 0.4
    for unknown in UNKNOWNS:
        values = [trial.values[unknown.name] for trial in trials]
        assert unknown.low * (1 - 1e-12) <= min(values) < max(values) <= unknown.high * (1 + 1e-12)


def test_findings_distinguish_sensitive_unknowns(trials):
    found = {item.unknown.name: item for item in findings(UNKNOWNS, trials)}
    assert found['viscosity'].is_sensitive and found['emissivity'].is_sensitive
    assert not found['discharge'].is_sensitive and found['discharge'].spread > 0.6
    # half of a rank correlation is two standard errors of 17 runs
    assert has_enough_samples(trials[:18]) and not has_enough_samples(trials[:17])
    assert found['viscosity'].low <= 1e3 <= found['viscosity'].high
    near = near_optimal(trials)
    assert len(near) > 5
    assert all(trial.jaccard >= near[0].jaccard - 0.03 for trial in near)


def test_intervals_contain_the_best_values(trials):
    found = {item.unknown.name: item.quantiles for item in findings(UNKNOWNS, trials)}
    low, middle, high = found['viscosity']
    assert 1e2 < low < 5e2 < middle < 2e3 < high < 1e5
    low, middle, high = found['emissivity']
    assert 0.0 < low < 0.2 < middle < 0.4 < high < 0.9
    # the score does not depend on it
    assert found['discharge'] == pytest.approx((0.55, 1.0, 1.45), abs=0.1)
    _, effective = posterior_quantiles(UNKNOWNS, trials)
    assert 8.0 < effective < 60.0


@pytest.mark.parametrize('jaccard', [0.0, 0.5])
def test_intervals_do_not_depend_on_where_the_search_looked(jaccard):
    numbers = {'one': {'eruption': 0.0, 'fitted': 1.0, 'jaccard': jaccard}}
    emissivity = UNKNOWNS[1]
    samples = [
        ParameterSample({'emissivity': value}, numbers)
        for value in np.linspace(0.2, 1.0, 30)[::-1] ** 4
    ]
    found, _ = posterior_quantiles([emissivity], samples)
    assert found['emissivity'] == pytest.approx((0.05, 0.5, 0.95), abs=1e-3)
    # equal scores do not depend on any value
    (finding,) = findings([emissivity], samples)
    assert (finding.correlation, finding.is_sensitive) == (0.0, False)


def test_cases_are_scored_with_the_constants_of_others(trials):
    one, two = leave_one_out(trials, list(CASES))
    assert (one.case, two.case) == ('one', 'two')
    assert one.values['emissivity'] < 0.3 < two.values['emissivity']
    for item in (one, two):
        assert item.jaccard == pytest.approx(CASES[item.case](item.values))
        assert item.jaccard < item.best
    alone = [ParameterSample(trial.values, {'one': trial.numbers['one']}) for trial in trials]
    assert leave_one_out(alone, ['one']) == []


def test_eruption_counts_once_however_many_outlines_it_has():
    def numbers(eruption: float, jaccard: float, fitted: float = 1.0) -> dict[str, float]:
        return {'eruption': eruption, 'fitted': fitted, 'jaccard': jaccard}

    dated = {
        'two 1': numbers(1.0, 0.3), 'two 2': numbers(1.0, 0.5), 'two 3': numbers(1.0, 0.9, 0.0),
    }
    samples = [
        ParameterSample({'viscosity': 1.0}, {'one': numbers(0.0, 0.8), **dated}),
        ParameterSample({'viscosity': 2.0}, {'one': numbers(0.0, 0.7), **dated}),
    ]
    assert samples[0].jaccard == pytest.approx(0.5 * (0.8 + 0.4))
    one, two = leave_one_out(samples, ['one', 'two'])
    assert (one.case, two.case) == ('one', 'two')
    assert two.values == {'viscosity': 1.0} and two.jaccard == pytest.approx(0.4)


def test_search_is_repeatable_and_resumes(trials, tmp_path):
    write_samples(tmp_path / 'runs.csv', UNKNOWNS, trials[:50])
    known = read_samples(tmp_path / 'runs.csv', UNKNOWNS, list(CASES))
    assert [trial.values for trial in known] == [trial.values for trial in trials[:50]]
    evaluate = Mock(side_effect=_evaluated)
    again = search(UNKNOWNS, evaluate, runs=80, seed=1, known=known)
    assert [trial.values for trial in again] == [trial.values for trial in trials]
    assert sum(len(call.args[0]) for call in evaluate.mock_calls) <= 30 + 2 * len(UNKNOWNS)
    # a table without a column for an unknown is refused
    write_samples(tmp_path / 'runs.csv', UNKNOWNS[:1], trials[:3])
    with pytest.raises(LavaError, match='a table of runs'):
        read_samples(tmp_path / 'runs.csv', UNKNOWNS, list(CASES))
    assert read_samples(tmp_path / 'none.csv', UNKNOWNS, list(CASES)) == []


def test_unknowns_have_the_published_ranges(etna):
    unknowns = {item.name: item for item in free_parameters_of(etna)}
    assert 'discharge' not in unknowns
    viscosity, known = unknowns['viscosity'], etna.material.constants['viscosity']
    assert known.range == (viscosity.low, viscosity.high)
    assert viscosity.is_log and viscosity.source == known.range_source
    (given,) = free_parameters_of(etna, ('discharge',), {'discharge': (0.9, 1.1)})
    assert (given.low, given.high, given.usual) == (0.9, 1.1, 1.0)
    assert given.source == 'given by the user'
    (melt,) = free_parameters_of(etna, ('vft_a',), {'vft_a': (-6.0, -4.0)})
    assert (melt.low, melt.high) == (-6.0, -4.0)
    # a material without yield strength, where its logarithm is searched
    weak, ranges = etna.with_lava({'yield_strength': 0.0}), {'yield_strength': (1.0, 1e3)}
    (strength,) = free_parameters_of(weak, tuple(ranges), ranges)
    assert (strength.share_of(strength.usual), strength.share_of(1e4)) == (0.0, 1.0)


def test_changed_sets_only_the_unknowns(etna, tmp_path):
    values = {'viscosity': 3e3, 'emissivity': 0.5, 'vent_temperature': 1340.0, 'discharge': 1.1}
    case = changed(etna, values)
    assert case.scene.lava.viscosity_at(1360.0) == pytest.approx(3e3)
    assert case.scene.lava.emissivity == 0.5
    assert case.scene.vents[0].temperature == 1340.0
    assert case.volume == pytest.approx(1.1 * etna.volume)
    assert case.scene.vents[0].series[0] == (0.0, pytest.approx(22.0))
    assert case.scene.lava == replace(etna.scene.lava, emissivity=0.5, viscosity=3e3)
    assert case.scene.terrain is etna.scene.terrain
    reunion = load_case(tmp_path / 'valley', material='reunion_basalt')
    before, after = reunion.scene.lava, changed(reunion, {'viscosity': 3e3}).scene.lava
    hot = reunion.scene.vents[0].temperature
    assert before.is_vft and after.viscosity_at(hot) == pytest.approx(3e3)
    ratio = 3e3 / before.viscosity_at(hot)
    assert after.viscosity_at(1300.0) == pytest.approx(ratio * before.viscosity_at(1300.0))


def test_raises_for_invalid_unknowns(etna, tmp_path):
    bare = load_case(tmp_path / 'valley', material='kedadry2023')
    for case, names, ranges, words in (
        (etna, ('colour',), {}, '--unknown'),
        (etna, ('emissivity',), {'emissivity': (0.9, 0.3)}, '--unknown emissivity, highest'),
        (etna, ('viscosity',), {'viscosity': (0.0, 1e3)}, '--unknown viscosity, lowest'),
        (bare, (), {}, 'no published ranges'),
        (bare, ('emissivity',), {}, 'none has been published'),
    ):
        with pytest.raises(LavaError, match=words):
            free_parameters_of(case, names, ranges)
