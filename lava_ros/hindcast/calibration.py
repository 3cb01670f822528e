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


"""A search for the constants that make a hindcast cover what was mapped, and what it tells.

A footprint does not fix many constants, and a flow that turns at a bump another way makes the
score jump. So what is reported is the set of all runs that are nearly as good as the best, how
far each unknown spreads in it, and which unknowns the score does not depend on.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
import csv
from dataclasses import dataclass, replace
from functools import lru_cache, partial
import multiprocessing
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.hindcast.case import Case, load_case
from lava_ros.hindcast.run import Settings
from lava_ros.hindcast.score import judge
from lava_ros.hindcast.several import agreed, directions, run_together
from lava_ros.hindcast.unknowns import changed, Unknown
from lava_ros.simulation.threads import use_threads

#: Difference to the best score up to which a run is as good: what a change of the ground by its
#: own error does to it (docs/VALIDATION.md).
NEARLY = 0.03

#: Share of an unknown's range that near-best runs spread over, from which on it is not fixed.
WIDE = 0.6

#: Rank correlation with the score, in standard errors, below which nothing depends on an unknown.
WEAK = 2.0

#: Sets that are run before their numbers are told: with four directions a set they fill a GPU.
BATCH = 8

#: Columns of the table of runs beside the unknowns.
COLUMNS = (
    'jaccard', 'recall', 'precision', 'length_error', 'area_error', 'directions', 'wall_time_s',
)


@dataclass(frozen=True)
class Trial:
    """A run.

    Attributes:
        values: The unknowns, by name.
        numbers: What came of it, by the names of ``COLUMNS``.
    """

    values: Mapping[str, float]
    numbers: Mapping[str, float]

    @property
    def jaccard(self) -> float:
        """Its score."""
        return self.numbers['jaccard']


@dataclass(frozen=True)
class Finding:
    """What a search tells about an unknown.

    Attributes:
        unknown: The unknown.
        best: Its value in the best run.
        low: Its smallest value in near-best runs.
        high: Its largest value in near-best runs.
        spread: Share of its range that they spread over.
        correlation: Rank correlation of its value with the score, over all runs.
        is_sensitive: Whether the search fixes it: near-best runs agree, or the score follows it.
    """

    unknown: Unknown
    best: float
    low: float
    high: float
    spread: float
    correlation: float
    is_sensitive: bool


Evaluate = Callable[[Sequence[Mapping[str, float]]], list[Mapping[str, float]]]


def search(
    unknowns: Sequence[Unknown],
    evaluate: Evaluate,
    *,
    runs: int,
    seed: int = 0,
    batch: int = BATCH,
    known: Sequence[Trial] = (),
    progress: Callable[[int, Trial], None] | None = None,
) -> list[Trial]:
    """Search for good values: points spread evenly, then differential evolution from the best.

    Args:
        unknowns: What to change.
        evaluate: Runs many sets of values and gives their numbers.
        runs: How many runs there are.
        seed: Of the random numbers.
        batch: Sets at once.
        known: Runs of an earlier search of the same unknowns, which are not run again.
        progress: Is told of each run.

    Returns:
        All runs, the usual values first.

    Raises:
        LavaError: scipy is not installed.
    """
    try:
        from scipy.stats import qmc
    except ImportError as error:
        raise LavaError('calibrate', None, "scipy: pip install 'lava_ros[hindcast]'") from error
    memory = {_key(trial.values): trial for trial in known}
    trials: list[Trial] = []

    def tried(points: np.ndarray) -> None:
        sets = [
            {u.name: u.value_at(float(x)) for u, x in zip(unknowns, point, strict=True)}
            for point in points
        ]
        for first in range(0, len(sets), batch):
            part = sets[first : first + batch]
            missing = [values for values in part if _key(values) not in memory]
            for values, numbers in zip(missing, evaluate(missing), strict=True):
                memory[_key(values)] = Trial(values, numbers)
            for values in part:
                trials.append(memory[_key(values)])
                if progress is not None:
                    progress(len(trials), trials[-1])

    usual = np.clip([[item.share_of(item.usual) for item in unknowns]], 0.0, 1.0)
    tried(usual)
    even = qmc.Sobol(len(unknowns), seed=seed).random(_power(runs // 2))
    tried(even[: max(runs // 2, 1)])
    rng = np.random.default_rng(seed)
    generation = max(4, 2 * len(unknowns))
    while len(trials) < runs:
        tried(_offspring(unknowns, trials, min(generation, runs - len(trials)), rng))
    return trials[:runs]


def _power(count: int) -> int:
    """The power of two that is at least as large, for Sobol's points."""
    return 1 << max(count - 1, 0).bit_length()


def _offspring(
    unknowns: Sequence[Unknown], trials: Sequence[Trial], count: int, rng: np.random.Generator
) -> np.ndarray:
    """New points by differential evolution, current-to-best, from the better half of all runs."""
    ranked = sorted(trials, key=lambda trial: -trial.jaccard)
    parents = np.array(
        [[u.share_of(trial.values[u.name]) for u in unknowns] for trial in ranked]
    )[: max(4, len(ranked) // 2)]
    points = np.empty((count, len(unknowns)))
    for point in points:
        one, two, three = parents[rng.integers(len(parents), size=3)]
        scale = rng.uniform(0.4, 0.9)
        mutant = one + scale * (parents[0] - one) + scale * (two - three)
        keeps = rng.random(len(unknowns)) < 0.2
        # what leaves the range comes back in from its end
        mutant = np.abs(mutant)
        point[:] = np.where(keeps, one, np.clip(1.0 - np.abs(1.0 - mutant), 0.0, 1.0))
    return points


def findings(unknowns: Sequence[Unknown], trials: Sequence[Trial]) -> list[Finding]:
    """Say what a search tells about each unknown."""
    from scipy.stats import spearmanr

    scores = np.array([trial.jaccard for trial in trials])
    best = int(scores.argmax())
    near = scores >= scores[best] - NEARLY
    result = []
    for unknown in unknowns:
        values = np.array([trial.values[unknown.name] for trial in trials])
        low, high = float(values[near].min()), float(values[near].max())
        spread = unknown.share_of(high) - unknown.share_of(low)
        varies = np.ptp(values) > 0.0 and np.ptp(scores) > 0.0
        rank = float(spearmanr(values, scores).statistic) if varies else 0.0
        significant = abs(rank) * np.sqrt(max(len(values) - 1, 0)) > WEAK
        fixed = bool(spread < WIDE and near.sum() > 1)
        result.append(
            Finding(
                unknown, float(values[best]), low, high, spread, rank, bool(significant or fixed)
            )
        )
    return result


def near_best(trials: Sequence[Trial]) -> list[Trial]:
    """The runs that are nearly as good as the best, the best first."""
    ranked = sorted(trials, key=lambda trial: -trial.jaccard)
    return [trial for trial in ranked if trial.jaccard >= ranked[0].jaccard - NEARLY]


class Evaluator:
    """Runs sets of values: on a GPU in turns, on the CPU in processes of their own."""

    def __init__(
        self,
        directory: Path,
        settings: Settings,
        *,
        workers: int = 1,
        runs: int = 1,
        **options: Any,
    ) -> None:
        """Start no process yet.

        Args:
            directory: The case.
            settings: How it is run.
            workers: Processes; more than one share a GPU, too.
            runs: Runs of each set, turned and mirrored; what half of them cover is compared.
            options: What ``load_case`` takes beside the folder.
        """
        self._job = (str(directory), tuple(sorted(options.items())), settings, runs)
        self._pool: ProcessPoolExecutor | None = None
        if workers > 1:
            context = multiprocessing.get_context('spawn')
            # a process is as much as a core does
            self._pool = ProcessPoolExecutor(
                workers, mp_context=context, initializer=use_threads, initargs=(1,)
            )

    def __call__(self, sets: Sequence[Mapping[str, float]]) -> list[Mapping[str, float]]:
        """Run sets of values."""
        if self._pool is None:
            return _evaluate(self._job, sets)
        parts = self._pool.map(partial(_evaluate, self._job), [[values] for values in sets])
        return [numbers for part in parts for numbers in part]

    def close(self) -> None:
        """End the processes."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)


@lru_cache(maxsize=1)
def _case(directory: str, options: tuple[tuple[str, Any], ...]) -> Case:
    return load_case(directory, **dict(options))


_Job = tuple[str, tuple[tuple[str, Any], ...], Settings, int]


def _evaluate(job: _Job, sets: Sequence[Mapping[str, float]]) -> list[Mapping[str, float]]:
    """Run sets of values; what cannot flow covers nothing."""
    directory, options, settings, runs = job
    settings = replace(settings, maps=1)
    case = _case(directory, options)
    ways = directions(runs)
    try:
        jobs = [(changed(case, values), way) for values in sets for way in ways]
        results = run_together(jobs, settings)
    except LavaError as error:
        said = '; '.join(map(str, sets))
        raise LavaError('calibrate', said, f'values that can be run ({error})') from error
    found: list[Mapping[str, float]] = []
    for first in range(0, len(results), runs):
        own = results[first : first + runs]
        maps = [result.snapshot.thickness for result in own]
        judged = judge(case, maps[0] if runs == 1 else agreed(maps)[1]).as_dict()
        numbers = {name: float(judged[name]) for name in COLUMNS if name in judged}
        wall_time = sum(result.wall_time for result in own)
        found.append({**numbers, 'directions': float(runs), 'wall_time_s': wall_time})
    return found


def write_trials(path: Path, unknowns: Sequence[Unknown], trials: Sequence[Trial]) -> None:
    """Write the table of runs.

    Raises:
        LavaError: It cannot be written.
    """
    names = [item.name for item in unknowns]
    try:
        with path.open('w', newline='', encoding='utf-8') as file:
            writer = csv.writer(file, lineterminator='\n')
            writer.writerow([*names, *COLUMNS])
            for trial in trials:
                numbers = [trial.numbers.get(name, float('nan')) for name in COLUMNS]
                writer.writerow([*(repr(trial.values[n]) for n in names), *map(repr, numbers)])
    except OSError as error:
        raise LavaError('output', str(path), f'a file to write ({error})') from error


def read_trials(path: Path, unknowns: Sequence[Unknown]) -> list[Trial]:
    """Read a table of runs; none where there is none.

    Raises:
        LavaError: It is not one of these unknowns.
    """
    if not path.is_file():
        return []
    names = [item.name for item in unknowns]
    try:
        with path.open(newline='', encoding='utf-8') as file:
            return [
                Trial(
                    {name: float(row[name]) for name in names},
                    {name: float(row[name]) for name in COLUMNS},
                )
                for row in csv.DictReader(file)
            ]
    except (OSError, KeyError, TypeError, ValueError) as error:
        right = f'a table of runs with {", ".join(names)}, or --fresh ({error!r})'
        raise LavaError('output', str(path), right) from error


def _key(values: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    return tuple(sorted(values.items()))
