# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Calibration: a search for constants with which hindcasts match mapped flow fields.

The constants are the same for all cases, and the score is the mean of the cases' scores, each the
mean over its dated outlines. The leave-one-out score of a case is the score with the set that is
best for the other cases. Outlines of a case after a date are not fitted: their scores are those
of forecasts.

A mapped outline constrains few constants, and the score jumps when a flow passes an obstacle on
the other side. The result is therefore the set of all runs that are nearly as good as the best,
the spread of each parameter in this set, and the parameters on which the score does not depend.
Intervals of the parameters are computed with the weights of ensemble members.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
import math
from pathlib import Path
import time
from typing import Any

import numpy as np

from lava_ros.errors import LavaError, RefusalError
from lava_ros.files import write_output
from lava_ros.files.csv import format_table, read_table
from lava_ros.forecast.assimilation import effective_members, weigh
from lava_ros.forecast.pool import Pool
from lava_ros.hindcast.case import Case
from lava_ros.hindcast.free_parameters import changed, FreeParameter
from lava_ros.hindcast.replicates import agreement, directions, Orientation, run_together
from lava_ros.hindcast.run import Result, Settings
from lava_ros.hindcast.score import score_outlines

#: Maximum difference from the best score for a near-best run: the effect of the error of the
#: terrain on the score (docs/VALIDATION.md).
NEARLY = 0.03

#: A free parameter is not constrained if near-best runs span at least this fraction of its range.
WIDE = 0.6

#: The score does not depend on a parameter with a rank correlation below this [standard errors].
WEAK = 2.0

#: Rank correlation that a search must be able to detect before its absence counts.
CLEAR = 0.5

#: Probabilities of the quantiles of a parameter.
LEVELS = (0.05, 0.5, 0.95)

#: Binary logarithm of the number of points at which the weights are integrated.
_LOG_POINTS = 14

#: Number of sets per batch on a GPU: with four directions per set they keep it busy.
BATCH = 16

#: Columns of the table of runs in addition to the parameters.
COLUMNS = (
    *('jaccard', 'single', 'recall', 'precision', 'length_error', 'footprint_area_error'),
    *('eruption', 'fitted', 'directions', 'wall_time_s'),
)


@dataclass(frozen=True)
class ParameterSample:
    """A set of values of the parameters, with its results by ``COLUMNS``.

    There are results for each case, or for each outline of a case with dated outlines.
    """

    values: Mapping[str, float]
    numbers: Mapping[str, Mapping[str, float]]

    @property
    def jaccard(self) -> float:
        """Score: the mean Jaccard index over the eruptions that are fitted."""
        return self.mean(self.eruptions)

    @property
    def eruptions(self) -> list[int]:
        """Numbers of the cases, from 0, that are fitted or have an outline that is."""
        found = (self.numbers[name]['eruption'] for name in self.fitted)
        return [int(number) for number in dict.fromkeys(found)]

    @property
    def fitted(self) -> list[str]:
        """Names of the cases and outlines that are fitted."""
        return [name for name, numbers in self.numbers.items() if numbers['fitted']]

    def mean(self, eruptions: Iterable[int]) -> float:
        """Return the mean Jaccard index over eruptions, each the mean of its fitted outlines."""
        fitted = [self.numbers[name] for name in self.fitted]
        return float(np.mean([
            np.mean([numbers['jaccard'] for numbers in fitted if numbers['eruption'] == number])
            for number in eruptions
        ]))


@dataclass(frozen=True)
class Finding:
    """Result of a search for a free parameter: its values in the best run and in near-best runs.

    ``spread`` is the fraction of its range that near-best runs span, ``correlation`` the rank
    correlation of its value with the score over all runs. A parameter is sensitive if near-best
    runs agree on it or the score depends on it. ``quantiles`` are its values at ``LEVELS`` of its
    distribution given the outlines that are fitted.
    """

    unknown: FreeParameter
    best: float
    low: float
    high: float
    spread: float
    correlation: float
    is_sensitive: bool
    quantiles: tuple[float, ...]


Numbers = Mapping[str, Mapping[str, float]]

Evaluate = Callable[[Sequence[Mapping[str, float]]], list[Numbers]]


def search(
    parameters: Sequence[FreeParameter],
    evaluate: Evaluate,
    *,
    runs: int,
    seed: int = 0,
    batch: int = BATCH,
    known: Sequence[ParameterSample] = (),
    progress: Callable[[int, ParameterSample], None] | None = None,
) -> list[ParameterSample]:
    """Search for good values: evenly distributed points, then differential evolution.

    ``evaluate`` returns the numbers of many sets of values, ``batch`` sets at once. ``known`` runs
    of an earlier search of the same parameters are not repeated. ``progress`` is called with the
    number and the result of each run. Returns all runs, starting with the usual values.
    """
    from scipy.stats import qmc

    memory = {_key(sample.values): sample for sample in known}
    samples: list[ParameterSample] = []

    def sets_of(points: np.ndarray) -> list[dict[str, float]]:
        return [
            {u.name: u.value_at(float(x)) for u, x in zip(parameters, point, strict=True)}
            for point in points
        ]

    def tried(sets: Sequence[Mapping[str, float]]) -> None:
        for first in range(0, len(sets), batch):
            part = sets[first : first + batch]
            missing = [values for values in part if _key(values) not in memory]
            for values, numbers in zip(missing, evaluate(missing), strict=True):
                memory[_key(values)] = ParameterSample(values, numbers)
            for values in part:
                samples.append(memory[_key(values)])
                if progress is not None:
                    progress(len(samples), samples[-1])

    # even a value outside its range
    usual = {item.name: item.usual for item in parameters}
    # the sequence is balanced for powers of two
    even = qmc.Sobol(len(parameters), seed=seed).random_base2(max(runs // 2 - 1, 0).bit_length())
    tried([usual, *sets_of(even[: max(runs // 2, 1)])])
    rng = np.random.default_rng(seed)
    generation = max(4, 2 * len(parameters))
    while len(samples) < runs:
        count = min(generation, runs - len(samples))
        tried(sets_of(_offspring(parameters, samples, count, rng)))
    return samples[:runs]


def _offspring(
    parameters: Sequence[FreeParameter],
    samples: Sequence[ParameterSample],
    count: int,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return new points by current-to-best differential evolution of the better half of runs."""
    ranked = sorted(samples, key=lambda sample: -sample.jaccard)
    better = ranked[: max(4, len(ranked) // 2)]
    parents = np.array([[u.share_of(one.values[u.name]) for u in parameters] for one in better])
    points = np.empty((count, len(parameters)))
    for point in points:
        one, two, three = parents[rng.integers(len(parents), size=3)]
        scale = rng.uniform(0.4, 0.9)
        mutant = one + scale * (parents[0] - one) + scale * (two - three)
        keeps = rng.random(len(parameters)) < 0.2
        # reflect values outside the range at its limits
        mutant = np.abs(mutant)
        point[:] = np.where(keeps, one, np.clip(1.0 - np.abs(1.0 - mutant), 0.0, 1.0))
    return points


def findings(
    parameters: Sequence[FreeParameter], samples: Sequence[ParameterSample]
) -> list[Finding]:
    """Summarise a search for each parameter."""
    from scipy.stats import spearmanr

    scores = np.array([sample.jaccard for sample in samples])
    near = scores >= scores.max() - NEARLY
    quantiles, _ = posterior_quantiles(parameters, samples)
    result = []
    for parameter in parameters:
        values = np.array([sample.values[parameter.name] for sample in samples])
        best = float(values[scores.argmax()])
        low, high = float(values[near].min()), float(values[near].max())
        spread = parameter.share_of(high) - parameter.share_of(low)
        varies = np.ptp(values) > 0.0 and np.ptp(scores) > 0.0
        rank = float(spearmanr(values, scores).statistic) if varies else 0.0
        is_followed = abs(rank) * math.sqrt(len(values) - 1) > WEAK
        is_sensitive = is_followed or (spread < WIDE and near.sum() > 1)
        result.append(Finding(
            parameter, best, low, high, spread, rank, bool(is_sensitive),
            quantiles[parameter.name],
        ))
    return result


def posterior_quantiles(
    parameters: Sequence[FreeParameter], samples: Sequence[ParameterSample]
) -> tuple[dict[str, tuple[float, ...]], float]:
    """Return the values of each parameter at ``LEVELS``, given the outlines that are fitted.

    Before the fit all values of a range, or their logarithms, are equally likely. A set has the
    weight of an ensemble member (``weigh``), with the Jaccard indices of all fitted outlines
    multiplied. A search prefers good sets, so each set represents the part of the ranges that is
    nearest to it (Sambridge 1999, Geophysical Journal International 138, 727-746).

    Returns:
        The values by the name of the parameter, and the effective number of sets.
    """
    from scipy.spatial import KDTree
    from scipy.stats import qmc

    agreement = np.array([
        math.prod(sample.numbers[name]['jaccard'] for name in sample.fitted) for sample in samples
    ])
    weights = weigh(agreement).values if agreement.any() else np.ones(len(samples))
    sets = [[item.share_of(sample.values[item.name]) for item in parameters] for sample in samples]
    points = qmc.Sobol(len(parameters), seed=0).random_base2(_LOG_POINTS)
    _, nearest = KDTree(np.array(sets)).query(points)
    mass, found = weights[nearest], {}
    for item, column in zip(parameters, points.T, strict=True):
        order = np.argsort(column)
        below = np.cumsum(mass[order]) / mass.sum()
        shares = np.interp(LEVELS, below, column[order])
        found[item.name] = tuple(item.value_at(share) for share in shares.tolist())
    return found, effective_members(np.bincount(nearest, mass))


def near_optimal(samples: Sequence[ParameterSample]) -> list[ParameterSample]:
    """Return the runs that are nearly as good as the best, best first."""
    ranked = sorted(samples, key=lambda sample: -sample.jaccard)
    return [sample for sample in ranked if sample.jaccard >= ranked[0].jaccard - NEARLY]


def has_enough_samples(samples: Sequence[ParameterSample]) -> bool:
    """Return True if there are enough runs to detect a rank correlation of ``CLEAR``."""
    return CLEAR * math.sqrt(len(samples) - 1) > WEAK


@dataclass(frozen=True)
class CrossValidation:
    """Score of constants on a case to which they were not fitted.

    ``values`` is the best set for the other cases, ``jaccard`` its score on this case, ``best``
    the best score of any set on this case, and ``eruption`` the number of the case, from 0.
    """

    case: str
    values: Mapping[str, float]
    jaccard: float
    best: float
    eruption: int


def leave_one_out(
    samples: Sequence[ParameterSample], cases: Sequence[str]
) -> list[CrossValidation]:
    """Score each of the ``cases`` with the set that is best for the others; empty for one case."""
    known, result = samples[0].eruptions, []
    for case in known if len(known) > 1 else []:
        others = [other for other in known if other != case]
        chosen = max(samples, key=lambda sample: sample.mean(others))
        best = max(sample.mean([case]) for sample in samples)
        result.append(
            CrossValidation(cases[case], chosen.values, chosen.mean([case]), best, case)
        )
    return result


def result_names(case: Case) -> list[str]:
    """Return the names of the results of a case: its name, or the names of its dated outlines."""
    return [f'{case.name} {item.text}' for item in case.outlines] or [case.name]


@contextmanager
def evaluating(
    cases: Sequence[Case], settings: Settings, *, workers: int = 1, runs: int = 1,
    until: Mapping[str, float] | None = None,
) -> Iterator[Evaluate]:
    """Provide a function that runs sets of values on a GPU or in CPU processes.

    Several ``workers`` (processes) share one GPU. With more than one of ``runs`` per set of
    constants, rotated and mirrored, the cells that at least half of them cover are compared.
    ``until`` is the time [s] since its start after which outlines of a case are not fitted.
    """
    evaluate = partial(
        _evaluate, cases, replace(settings, maps=1), directions(runs), dict(until or {})
    )
    if workers == 1:
        yield evaluate
        return
    with closing(Pool(evaluate, workers)) as pool:

        def in_processes(sets: Sequence[Mapping[str, float]]) -> list[Numbers]:
            parts = dict(pool([[values] for values in sets]))
            return [numbers for index in range(len(sets)) for numbers in parts[index]]

        yield in_processes


def _evaluate(
    cases: Sequence[Case],
    settings: Settings,
    ways: Sequence[Orientation],
    until: Mapping[str, float],
    sets: Sequence[Mapping[str, float]],
) -> list[Numbers]:
    try:
        # all at once, because a few runs do not keep a GPU busy
        jobs = [
            (changed(case, values), way) for values in sets for case in cases for way in ways
        ]
        begun = time.perf_counter()
        results = run_together(jobs, settings)
        taken = time.perf_counter() - begun
    except LavaError as error:
        problem = f'A run failed with one of {"; ".join(map(str, sets))}: {error}'.rstrip('.')
        raise RefusalError('--unknown', problem, 'Change the ranges') from error
    # concurrent runs on a GPU each count an equal part of the wall time
    parts, count = iter(results), len(sets) * len(cases)
    return [
        {
            name: numbers
            for number, case in enumerate(cases)
            for name, numbers in _numbers(
                case, [next(parts) for _ in ways], taken / count,
                until.get(case.name, math.inf), number,
            )
        }
        for _ in sets
    ]


def _numbers(
    case: Case, results: Sequence[Result], wall_time: float, until: float, eruption: int
) -> Iterator[tuple[str, Mapping[str, float]]]:
    """Yield the names and the results of a set of values, by ``COLUMNS``."""
    rows: list[tuple[float, Any, list[float]]] = []
    if case.outlines:
        snapshots = [result.snapshot for result in results]
        alone = [score_outlines(case, [snapshot]) for snapshot in snapshots]
        for index, judged in enumerate(score_outlines(case, snapshots)):
            rows.append((judged.time, judged, [scores[index].jaccard for scores in alone]))
    else:
        found = agreement(case, [result.snapshot for result in results])
        rows.append((0.0, found.majority, [score.jaccard for score in found.scores]))
    for name, (time_mapped, judged, singles) in zip(result_names(case), rows, strict=True):
        plain = asdict(judged)
        yield name, {
            **{column: float(plain[column]) for column in COLUMNS if column in plain},
            'single': float(np.mean(singles)),
            'eruption': float(eruption),
            'fitted': float(time_mapped <= until),
            'directions': float(len(results)),
            'wall_time_s': wall_time,
        }


def write_samples(
    path: Path, parameters: Sequence[FreeParameter], samples: Sequence[ParameterSample]
) -> None:
    """Write the table of runs; raise LavaError if that fails."""
    names = [item.name for item in parameters]
    rows = (
        {name: sample.values[name] for name in names} | {'case': case, **numbers}
        for sample in samples for case, numbers in sample.numbers.items()
    )
    write_output('output', path, format_table([*names, 'case', *COLUMNS], rows))


def with_known(
    samples: Sequence[ParameterSample], known: Sequence[ParameterSample]
) -> list[ParameterSample]:
    """Return samples, and the known ones of other values, which a later search may need."""
    found = {_key(sample.values) for sample in samples}
    return [*samples, *(item for item in known if _key(item.values) not in found)]


def read_samples(
    path: Path, parameters: Sequence[FreeParameter], cases: Sequence[str]
) -> list[ParameterSample]:
    """Read a table of runs, empty without a file; LavaError for other parameters or cases."""
    if not path.is_file():
        return []
    names = [item.name for item in parameters]
    try:
        rows = [row for _, row in read_table('output', path, [*names, 'case', *COLUMNS])]
        samples = []
        for first in range(0, len(rows), len(cases)):
            part = rows[first : first + len(cases)]
            numbers = {row['case']: {key: float(row[key]) for key in COLUMNS} for row in part}
            if list(numbers) != list(cases):
                raise ValueError(f'cases {", ".join(numbers)}')
            values = {name: float(part[0][name]) for name in names}
            samples.append(ParameterSample(values, numbers))
        return samples
    except ValueError as error:
        expected = f'a table of runs with {", ".join(names)} of {", ".join(cases)}, or --fresh'
        expected += f' ({error})'
        raise LavaError('output', str(path), expected) from error


def _key(values: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    return tuple(sorted(values.items()))
