# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The report of an ensemble: numbers of its maps, scores against mapped lava, and text."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
import sys
from typing import Any

from lava_ros.cli.console import table_lines
from lava_ros.cli.run_barriers import print_comparison
from lava_ros.cli.run_options import RunOptions
from lava_ros.forecast.assimilation import Outline
from lava_ros.forecast.ensemble import Ensemble
from lava_ros.forecast.influence import Influences
from lava_ros.forecast.members import Plan
from lava_ros.forecast.probability import Footprint
from lava_ros.hindcast.case import Case
from lava_ros.hindcast.probabilistic_score import (
    mapped_on,
    outlines_on,
    probability_at,
    score_dates,
    score_probability,
    start_on,
)
from lava_ros.layers.forecast import HazardMaps
from lava_ros.layers.numbers import area_words, percent
from lava_ros.layers.spacing_error import SpacingError
from lava_ros.products.reliability import write_reliability
from lava_ros.scene.erupting_lava import EruptingLava
from lava_ros.simulation.numerical_error import error_text, NOT_MEASURED, NumericalError

#: Reliability of the probabilities at dated outlines, in the folder of the maps.
RELIABILITY = 'reliability.png'


def score_against_case(
    case: Case,
    plan: Plan,
    members: Iterable[Footprint],
    folder: Path,
    *,
    weights: Sequence[float] | None = None,
    outline: Outline | None = None,
) -> dict[str, Any]:
    """Score the probabilities of an ensemble of a case, and draw their reliability.

    Args:
        case: The case.
        plan: Plan of the members.
        members: The members.
        folder: Folder of the picture.
        weights: Weights of the members, equal by default.
        outline: Observed lava; None for that from which the case starts, if it does. Only later
            outlines are then scored as forecasts, and the reference forecast is that this lava
            stays as it is.

    Returns:
        The score at the end, and that at the dated outlines if there are any.
    """
    known = -1.0 if outline is None else outline.time
    later = {
        text: item for text, item in outlines_on(case, plan).items() if item.time > known
    }
    times = [*(item.time for item in later.values()), plan.horizon]
    probability = probability_at(times, members, plan, weights)
    report: dict[str, Any] = {'score': score_probability(probability[-1], mapped_on(case, plan))}
    if later:
        before = start_on(case, plan) if outline is None else outline.lava
        report['dates'] = score_dates(probability[:-1], later, before)
        came = [item.lava for item in later.values()]
        write_reliability(probability[:-1], came, folder / RELIABILITY)
    return report


def summarize(
    options: RunOptions,
    plan: Plan,
    maps: HazardMaps,
    done: Ensemble,
    wall: float,
    where: dict[str, Any],
) -> dict[str, Any]:
    """Return the numbers of the maps of an ensemble that took a wall time [s]."""
    ran = maps.members - done.resumed
    return {
        'members': maps.members,
        'resumed': done.resumed,
        'effective_members': maps.effective_members,
        'sampling_error_percent': maps.sampling_error,
        **maps.limits(),
        'horizon_s': plan.horizon,
        'arrival_error_s': maps.arrival_error,
        'members_beyond': maps.members_beyond,
        'inundation_threshold_m': plan.threshold,
        'preset': options.preset,
        'effects': [{'time': 0.0, 'effects': plan.explain_effects()}],
        'switched_on': [asdict(item) for item in plan.switched_on],
        'seed': options.seed,
        **where,
        'wall_time_s': wall,
        'members_per_s': ran / wall if ran else None,
        'area_m2': {
            'in any member': maps.worst_area(plan.scene.terrain.resolution),
            **{
                f'at least {100.0 * fraction:g} %': area
                for fraction, area in maps.areas(plan.scene.terrain.resolution).items()
            },
        },
    }


def describe_agreement(done: Ensemble, observation: str) -> dict[str, Any]:
    """Return the numbers of the agreement of an ensemble with the observed lava."""
    weights = done.weights
    assert weights is not None
    return {
        'observation': observation,
        'jaccard_mean': float(weights.jaccard.mean()),
        'jaccard_best': float(weights.jaccard.max()),
        'sharpness': weights.sharpness,
    }


def print_report(
    report: dict[str, Any], plan: Plan, error: NumericalError | None = None
) -> None:
    """Print the report of the command, with the numerical error of the members."""
    ran = report['members'] - report['resumed']
    pace = f', {report["members_per_s"]:.3g} a second' if ran else ''
    took = f'{report["wall_time_s"]:.0f} s{pace}'
    print(f'{ran} members run in {took}, {report["resumed"]} from before')
    print('\n'.join(_input_lines(report['quantities'])))
    print('\n'.join(_influence_lines(report['influence'])))
    if 'observed' in report:
        mean = 100 * report['observed']['jaccard_mean']
        print(
            f'the members agree with the observed lava by {mean:.0f} % on average, and count like '
            f'{report["effective_members"]:.1f} of equal weight'
        )
    print(
        f'standard error of a probability of 50 %: {report["sampling_error_percent"]:.2g} '
        f'percentage points, from {report["members"]} members'
    )
    print(f'lava: {EruptingLava.of(plan.scene).text()}')
    print(
        f'where no member has lava: a probability below {report["unseen_percent"]:.2g} %; lava '
        f'comes before p10 in {report["arrives_before_percent"]["p10"]:.0f} % of eruptions like '
        f'these, and before the earliest arrival in up to {report["unseen_percent"]:.2g} %'
    )
    if report['spacing_error'] is None:
        print(f'error of the spacing: {NOT_MEASURED}, and in no probability')
    else:
        spacing = SpacingError.from_dict(report['spacing_error'])
        print(f'error of the spacing: {spacing.text()}')
    print(f'numerical error of a member: {error_text(error)}')
    print(
        'uncertain inputs: two members differ by '
        f'{percent(report["difference_of_members"])} of the inundated area on average'
    )
    print(f'effects of all members: {", ".join(plan.effects) or "none"}')
    for item in plan.switched_on:
        print(f'{item.effect} was switched on from the start: {item.reason}')
    error = report['arrival_error_s']
    print(f'error of the arrival times: up to {error:.3g} s and a time step of the flow')
    if report['members_beyond']:
        print(f'lava of {report["members_beyond"]} members left the map: no map shows that part')
    if report.get('eruptions_cut_off'):
        print(
            f'{report["eruptions_cut_off"]} of the eruptions last longer than the horizon: no map '
            'shows what comes later'
        )
    for name, area in report['area_m2'].items():
        print(f'{name:>13}: {area_words(area)}')
    if 'score' in report:
        score, gap = report['score'], report['score']['largest_gap']
        print(
            f'against the map: Brier score {score["brier_score"]:.3f}, skill '
            f'{score["brier_skill"]:.2f} over the {score["cells"]} cells with lava in a member or '
            f'on the map ({score["brier_skill_of_terrain"]:.2f} over the terrain)'
            + ('' if gap is None else f'; largest error of reliability {100.0 * gap:.0f} points')
        )
    if 'dates' in report:
        _print_dates(report['dates'])
    if 'posterior' in report:
        new = report['posterior']
        print(
            f'{new["members"]} members drawn near {new["effective_parents"]:.1f} of these agree '
            f'with the observed lava by {100 * new["jaccard_mean"]:.0f} % on average'
        )
        if 'dates' in new:
            _print_dates(new['dates'])
    if 'barriers' in report:
        print_comparison(report['barriers'])
        if report['barriers']['effects'] != list(plan.effects):
            print(
                'lava run: the runs with barriers have other effects, '
                f'{", ".join(report["barriers"]["effects"])}: delete both folders to run all with '
                'these',
                file=sys.stderr,
            )
    print('\n'.join(f'written to {path}' for path in report['files']))


def _input_lines(inputs: dict[str, Any]) -> list[str]:
    """Describe the drawn quantities with their sources, and the exact ones."""
    sources: dict[str, int] = {}
    rows = [
        [
            name.replace('_', ' '), item['distribution'],
            f'[{sources.setdefault(item["source"], len(sources) + 1)}]',
        ]
        for name, item in inputs['drawn'].items()
    ]
    lines = ['drawn:', *table_lines(rows, '<<<')]
    if not rows:
        lines = ['drawn: only the place of the vent']
    reasons: dict[str, list[str]] = {}
    for name, reason in inputs['exact'].items():
        reasons.setdefault(reason, []).append(name.replace('_', ' '))
    lines += [
        f'taken as exact: {", ".join(names)} ({reason})' for reason, names in reasons.items()
    ]
    return lines + [f'[{number}] {source}' for source, number in sources.items()]


def _influence_lines(data: dict[str, Any]) -> list[str]:
    """Describe which quantities decide the inundated area."""
    found = Influences.from_dict(data)
    if not found.rows:
        return [f'what decides: {found.text()}']
    rows = [['what decides', 'inundated area', '', '1 - J', '']]
    rows += [
        [
            row.title, f'{100.0 * row.area:+.0f} %', f'+- {percent(row.area_error)}',
            percent(row.mismatch), f'+- {percent(row.mismatch_error)}',
        ]
        for row in found.rows
    ]
    return [
        *table_lines(rows, '<>>>>'),
        'by a change of one quantity from its 10 % to its 90 % quantile, with standard errors, '
        f'from {found.members} members; terrain and interaction are {percent(found.rest or 0.0)} '
        'of the variance of the map',
    ]


def _print_dates(dates: dict[str, Any]) -> None:
    """Print the scores at dated outlines and the reliability over all of them."""
    def text(value: float | None) -> str:
        return '-' if value is None else f'{value:.3f}'

    columns = ('brier_score', 'brier_skill', 'brier_persistence', 'brier_skill_persistence')
    head = ['date', 'Brier score', 'skill', 'of persistence', 'skill against it']
    rows = [[row['date'], *(text(row[name]) for name in columns)] for row in dates['dates']]
    rows.append(['all dates', *(text(dates[name]) for name in columns)])
    print('\n'.join(table_lines([head, *rows], '<>>>>')))
    head = ['forecast', 'observed', 'cells']
    bins = [
        [f'{100.0 * item["forecast"]:.0f} %', f'{100.0 * item["observed"]:.0f} %',
         str(item['count'])]
        for item in dates['reliability']
    ]
    print('\n'.join(table_lines([head, *bins], '>>>')))
