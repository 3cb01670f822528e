# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure the quality of an ensemble's probabilities on mapped eruptions, from published ranges.

python docs/benchmarks/probability.py OUT.csv --case DIR [--case DIR ...] --folder DIR
    [--members N] [--preset P] [--spacing M] [--device D] [--machine NAME]

The members are those of ``lava ensemble DIR``, scored against the map. Then each member is the
truth once, and the other members forecast it, first with equal weights and then weighted by its
outline at a third of the time. The table has rows at 16, 32, 64, ... members; the same command
resumes an interrupted run. OUT.png is the reliability diagram of the last rows.
"""

import argparse
import csv
from dataclasses import dataclass
from functools import partial
from pathlib import Path
import platform
import time

from eruptions import version
import matplotlib
import numpy as np

from lava_ros.forecast.assimilation import jaccard, Outline, weigh
from lava_ros.forecast.ensemble import run_ensemble, run_here
from lava_ros.forecast.members import Plan
from lava_ros.forecast.probability import Footprint, reached_by
from lava_ros.forecast.sampling import draw_members
from lava_ros.forecast.scores import brier_parts
from lava_ros.forecast.store import Store
from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.probabilistic_score import mapped_on, plan_of, score_probability
from lava_ros.hindcast.run import Settings
from lava_ros.verification.rows import write_csv

matplotlib.use('Agg')

#: Number of members of the first row.
FIRST = 16

#: Time of the observed outline, as a fraction of the horizon.
OUTLINE_TIME = 1.0 / 3.0


@dataclass(frozen=True)
class Row:
    """An ensemble of a case: a row of the CSV. Skills, rates, gaps and indices are fractions."""

    case: str
    members: int
    preset: str
    spacing_m: float
    cell_m: float
    brier_score: float
    base_rate: float
    brier_skill: float
    brier_skill_of_terrain: float
    largest_gap: float | None
    single_jaccard: float
    half_jaccard: float
    twin_gap: float
    twin_gap_least: float
    twin_skill: float
    twin_skill_with_outline: float
    twins_better_with_outline: float
    effective_members_with_outline: float
    reliability: str
    seconds: float | None
    device: str
    machine: str
    version: str
    command: str


def twins(plan: Plan, members: list[Footprint]) -> dict[str, float]:
    """Return the scores of forecasts of each member by the others, with and without an outline."""
    at = OUTLINE_TIME * plan.horizon
    early = np.stack([reached_by(item, plan, at) for item in members])
    late = np.stack([reached_by(item, plan, plan.horizon) for item in members])
    forecasts, observed, better, effective, gaps = ([], []), [], [], [], []
    for truth in range(len(members)):
        others = np.arange(len(members)) != truth
        outline = Outline(at, early[truth], plan.scene.terrain.has_data)
        weights = weigh([jaccard(item, outline) for item in early[others]])
        effective.append(weights.effective_members)
        percent = 100.0 * late[others].mean(axis=0)
        gaps.append(score_probability(percent, late[truth])['largest_gap'])
        near = late[others].any(axis=0) | late[truth]
        observed.append(late[truth][near])
        for values, given in zip(forecasts, (None, weights.values), strict=True):
            values.append(np.average(late[others][:, near], axis=0, weights=given))
        scores = [brier_parts(values[-1], observed[-1]).score for values in forecasts]
        better.append(scores[1] < scores[0])
    before, after = (brier_parts(np.concatenate(v), np.concatenate(observed)) for v in forecasts)
    known = [gap for gap in gaps if gap is not None]
    return {
        'twin_gap': float(np.median(known)),
        'twin_gap_least': min(known),
        'twin_skill': before.skill,
        'twin_skill_with_outline': after.skill,
        'twins_better_with_outline': float(np.mean(better)),
        'effective_members_with_outline': float(np.mean(effective)),
    }


def rows_of(folder: str, args: argparse.Namespace, command: str):
    """Run a case, and yield a row for each number of members."""
    case = load_case(folder)
    plan = plan_of(case, Settings(args.preset, args.spacing, args.device))
    mapped = mapped_on(case, plan)
    outline = Outline(plan.horizon, mapped, plan.scene.terrain.has_data)
    store = Store(args.folder / case.name, plan)
    sizes = [FIRST << power for power in range(16) if FIRST << power < args.members]
    seconds, done = 0.0, 0
    for size in (*sizes, args.members):
        started = time.monotonic()
        runner = partial(run_here, device=args.device)
        result = run_ensemble(draw_members(plan.scene, size), store, runner=runner)
        # the time of resumed members is unknown
        seconds = seconds + time.monotonic() - started if result.resumed == done else None
        done = size if seconds is not None else -1
        members = list(store.finished(size))
        found = score_probability(result.maps.probability, mapped)
        bins = found.pop('reliability')
        found.pop('cells')
        alone = [jaccard(reached_by(item, plan, plan.horizon), outline) for item in members]
        yield Row(
            case=case.name,
            members=size,
            preset=args.preset,
            spacing_m=plan.accuracy.spacing,
            cell_m=plan.scene.terrain.resolution,
            **found,
            single_jaccard=float(np.mean(alone)),
            half_jaccard=jaccard(np.nan_to_num(result.maps.probability) >= 50.0, outline),
            **twins(plan, members),
            reliability=' '.join(
                f'{item["forecast"]:.3f}:{item["observed"]:.3f}:{item["count"]}' for item in bins
            ),
            seconds=seconds,
            device=args.device,
            machine=args.machine,
            version=version(),
            command=command,
        )


def draw(rows: list[dict[str, str]], path: Path) -> None:
    """Draw the reliability of the last row of each case; point areas are up to 3000 cells."""
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(5.0, 4.4), layout='constrained')
    axes.plot([0, 100], [0, 100], color='0.7', linewidth=1)
    for row in {row['case']: row for row in rows}.values():
        points = [point.split(':') for point in row['reliability'].split()]
        forecast, observed, count = np.array(points, dtype=float).T
        label = f'{row["case"]}, {row["members"]} members, {float(row["spacing_m"]):.2g} m'
        (line,) = axes.plot(100 * forecast, 100 * observed, label=label)
        size = np.minimum(count / 20.0, 150.0)
        axes.scatter(100 * forecast, 100 * observed, s=size, color=line.get_color(), alpha=0.6)
    axes.set_xlabel('forecast probability [%]')
    axes.set_ylabel('observed frequency [%]')
    axes.legend(frameon=False)
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


def main() -> None:
    """Run the cases of the arguments."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', type=Path)
    parser.add_argument('--case', action='append', required=True, metavar='DIR')
    parser.add_argument('--folder', type=Path, required=True, metavar='DIR')
    parser.add_argument('--members', type=int, default=64)
    parser.add_argument('--preset', default='draft')
    parser.add_argument('--spacing', type=float, metavar='M')
    parser.add_argument('--device', default='cuda:0')
    parser.add_argument('--machine', default=platform.processor() or platform.machine())
    args = parser.parse_args()
    command = f'python docs/benchmarks/probability.py --preset {args.preset}'
    command += f' --members {args.members}'
    command += '' if args.spacing is None else f' --spacing {args.spacing:g}'
    rows: list[dict[str, object]] = []
    if args.output.is_file():
        with args.output.open(newline='', encoding='utf-8') as file:
            rows = list(csv.DictReader(file))
    for folder in args.case:
        for row in rows_of(folder, args, command):
            print(
                f'{row.case}, {row.members} members: skill {row.brier_skill:.2f}, of the terrain '
                f'{row.brier_skill_of_terrain:.2f}; twins {row.twin_skill:.2f}, with an outline '
                f'{row.twin_skill_with_outline:.2f}; gap {row.largest_gap:.2f}',
                flush=True,
            )
            same = {name: str(vars(row)[name]) for name in ('case', 'members')}
            rows = [old for old in rows if {k: str(old[k]) for k in same} != same] + [vars(row)]
            write_csv(rows, args.output)
            with args.output.open(newline='', encoding='utf-8') as file:
                draw(list(csv.DictReader(file)), args.output.with_suffix('.png'))


if __name__ == '__main__':
    main()
