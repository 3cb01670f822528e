# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure the quality of an ensemble's probabilities on mapped eruptions, from published ranges.

python docs/benchmarks/probability.py OUT.csv --case DIR [--case DIR ...] --folder DIR
    [--members N] [--preset P] [--spacing M] [--device D] [--machine NAME] [--ranges-only]

The members are those of ``lava run DIR --members N``, scored against the map. Then each member is
the truth once, and the other members forecast it, first with equal weights and then weighted by
its outline at a third of the time. The table has rows at 16, 32, 64, ... members; the same command
resumes an interrupted run. OUT.png is the reliability diagram of the last rows.

Of cases with dated outlines the table has a row for each date, and one for all dates: first of the
members from published ranges, then, for the dates after the first outline, of these members, of
these weighted by the first outline, and of new members near the weighted ones. ``--ranges-only``
leaves out the last two. OUT.png is the reliability over all dates.
"""

import argparse
from collections.abc import Iterable, Iterator
import csv
from dataclasses import dataclass, replace
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
from lava_ros.forecast.probability import Footprint, footprint_by
from lava_ros.forecast.sampling import draw_members, parents_digest, Posterior
from lava_ros.forecast.scores import brier_parts
from lava_ros.forecast.store import Store
from lava_ros.hindcast.case import Case, load_case
from lava_ros.hindcast.probabilistic_score import (
    mapped_on,
    outlines_on,
    plan_of,
    probability_at,
    score_dates,
    score_probability,
    start_on,
)
from lava_ros.hindcast.run import Settings
from lava_ros.verification.rows import write_csv

matplotlib.use('Agg')

#: Number of members of the first row.
FIRST = 16

#: Columns that are printed.
PRINTED = (
    'case', 'ensemble', 'date', 'members', 'brier_score', 'brier_skill', 'brier_skill_of_terrain',
    'brier_skill_persistence', 'half_jaccard', 'persistence_jaccard', 'largest_gap', 'twin_skill',
    'twin_skill_with_outline',
)

#: Probabilities above which areas are given [%].
AREAS = (10, 50, 90)

#: Name of the ensemble of a case with dated outlines that the diagram shows.
ALL_DATES = 'published ranges, all dates'

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
    mapped_km2: float
    area_p10_km2: float
    area_p50_km2: float
    area_p90_km2: float
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


@dataclass(frozen=True)
class DatedRow:
    """An ensemble at the date of an outline, or over all dates: a row of the CSV.

    ``terrain`` describes the errors of the ground. The areas of single members are the 10 %
    quantile, mean and 90 % quantile, without weights.
    """

    case: str
    terrain: str
    ensemble: str
    date: str
    members: int
    effective_members: float
    preset: str
    spacing_m: float
    brier_score: float
    base_rate: float
    brier_skill: float
    brier_persistence: float | None
    brier_skill_persistence: float | None
    largest_gap: float | None
    half_jaccard: float | None
    persistence_jaccard: float | None
    mapped_km2: float | None
    area_p10_km2: float | None
    area_p50_km2: float | None
    area_p90_km2: float | None
    member_low_km2: float | None
    member_mean_km2: float | None
    member_high_km2: float | None
    reliability: str
    seconds: float
    device: str
    machine: str
    version: str
    command: str


def dated_rows_of(case: Case, args: argparse.Namespace, command: str) -> Iterator[DatedRow]:
    """Run a case with dated outlines, and yield a row for each ensemble and date."""
    plan = plan_of(case, Settings(args.preset, args.spacing, args.device))
    outlines = outlines_on(case, plan)
    first, *_ = outlines
    later = {text: item for text, item in outlines.items() if text != first}
    runner, started = partial(run_here, device=args.device), time.monotonic()
    store = Store(args.folder / case.name, plan)
    members = draw_members(plan.scene, args.members)
    weights = run_ensemble(members, store, runner=runner, outline=outlines[first]).weights
    ensembles = [(ALL_DATES, outlines, store, None)]
    if not args.ranges_only:
        posterior = Posterior(members, weights.values)
        parents = parents_digest(members, weights.values)
        # with the effects that sentinels have switched on
        same_effects = replace(store.plan, switched_on=())
        new = Store(args.folder / f'{case.name}_posterior', same_effects, parents=parents)
        drawn = draw_members(plan.scene, args.members, posterior=posterior)
        run_ensemble(drawn, new, runner=runner)
        ensembles += [
            ('published ranges', later, store, None),
            (f'weighted by {first}', later, store, weights.values),
            (f'new members after {first}', later, new, None),
        ]
    seconds = time.monotonic() - started
    for name, dated, source, given in ensembles:
        before = outlines[first].lava if dated is later else start_on(case, plan)
        times = [item.time for item in dated.values()]
        likely = probability_at(times, source.finished(args.members), plan, given)
        found = score_dates(likely, dated, before)
        last = before
        for row, values, outline in zip(
            [*found.pop('dates'), {'date': 'all', **found}], [*likely, None],
            [*dated.values(), None], strict=True,
        ):
            is_all = outline is None
            kept = {key: row[key] for key in row if key not in ('cells', 'reliability')}
            kept.pop('brier_skill_of_terrain')
            yield DatedRow(
                case=case.name,
                terrain=plan.scene.uncertainty.drawn['terrain'].text(),
                ensemble=name,
                members=args.members,
                effective_members=args.members if given is None else weights.effective_members,
                preset=args.preset,
                spacing_m=plan.accuracy.spacing,
                **kept,
                half_jaccard=None if is_all else jaccard(np.nan_to_num(values) >= 50.0, outline),
                persistence_jaccard=None if is_all or last is None else jaccard(last, outline),
                **areas_of(values, outline, plan.scene.terrain.resolution),
                **member_areas(source.finished(args.members), outline, plan),
                reliability=bins_text(found['reliability']) if is_all else '',
                seconds=seconds,
                device=args.device,
                machine=args.machine,
                version=version(),
                command=command,
            )
            last = before if before is not None or is_all else outline.lava


def areas_of(
    likely: np.ndarray | None, outline: Outline | None, resolution: float
) -> dict[str, float | None]:
    """Return the mapped area and those above ``AREAS`` [km2], None over all dates."""
    names = ('mapped_km2', *(f'area_p{limit}_km2' for limit in AREAS))
    if likely is None or outline is None:
        return dict.fromkeys(names)
    maps = (outline.lava, *(np.nan_to_num(likely) >= limit for limit in AREAS))
    return {
        name: 1e-6 * float(cells.sum()) * resolution**2
        for name, cells in zip(names, maps, strict=True)
    }


def member_areas(
    members: Iterable[Footprint], outline: Outline | None, plan: Plan
) -> dict[str, float | None]:
    """Return the 10 % quantile, mean and 90 % quantile of the areas of single members [km2]."""
    names = ('member_low_km2', 'member_mean_km2', 'member_high_km2')
    if outline is None:
        return dict.fromkeys(names)
    cell = plan.scene.terrain.resolution
    areas = [
        1e-6 * cell**2 * footprint_by(item, plan, outline.time).sum() for item in members
    ]
    low, high = np.quantile(areas, (0.1, 0.9))
    return dict(zip(names, (float(low), float(np.mean(areas)), float(high)), strict=True))


def bins_text(bins: list[dict[str, float]]) -> str:
    """Return forecast, observed fraction and number of cells of the bins of a diagram."""
    return ' '.join(
        f'{item["forecast"]:.3f}:{item["observed"]:.3f}:{item["count"]}' for item in bins
    )


def twins(plan: Plan, members: list[Footprint]) -> dict[str, float]:
    """Return the scores of forecasts of each member by the others, with and without an outline."""
    at = OUTLINE_TIME * plan.horizon
    early = np.stack([footprint_by(item, plan, at) for item in members])
    late = np.stack([footprint_by(item, plan, plan.horizon) for item in members])
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


def rows_of(case: Case, args: argparse.Namespace, command: str) -> Iterator[Row]:
    """Run a case, and yield a row for each number of members."""
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
        alone = [jaccard(footprint_by(item, plan, plan.horizon), outline) for item in members]
        yield Row(
            case=case.name,
            members=size,
            preset=args.preset,
            spacing_m=plan.accuracy.spacing,
            cell_m=plan.scene.terrain.resolution,
            **found,
            single_jaccard=float(np.mean(alone)),
            half_jaccard=jaccard(np.nan_to_num(result.maps.probability) >= 50.0, outline),
            mapped_km2=1e-6 * mapped.sum() * plan.scene.terrain.resolution**2,
            **{
                f'area_p{100.0 * share:.0f}_km2': 1e-6 * area
                for share, area in result.maps.areas(plan.scene.terrain.resolution).items()
            },
            **twins(plan, members),
            reliability=bins_text(bins),
            seconds=seconds,
            device=args.device,
            machine=args.machine,
            version=version(),
            command=command,
        )


def draw(rows: list[dict[str, str]], path: Path) -> None:
    """Draw the reliability of the last row of each ensemble; point areas are up to 3000 cells."""
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(5.0, 4.4), layout='constrained')
    axes.plot([0, 100], [0, 100], color='0.7', linewidth=1)
    last = {
        (row['case'], row.get('terrain')): row for row in rows
        if row['reliability'] and row.get('ensemble', ALL_DATES) == ALL_DATES
    }
    for (case, terrain), row in last.items():
        points = [point.split(':') for point in row['reliability'].split()]
        forecast, observed, count = np.array(points, dtype=float).T
        label = f'{case}, {row["members"]} members, {float(row["spacing_m"]):.2g} m'
        label += f', ground {terrain.split(",")[0]}' if terrain else ''
        (line,) = axes.plot(100 * forecast, 100 * observed, label=label)
        size = np.minimum(count / 20.0, 150.0)
        axes.scatter(100 * forecast, 100 * observed, s=size, color=line.get_color(), alpha=0.6)
    axes.set_xlabel('forecast probability [%]')
    axes.set_ylabel('observed frequency [%]')
    figure.legend(loc='outside lower center', frameon=False, fontsize=8)
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
    parser.add_argument('--ranges-only', action='store_true')
    parser.add_argument('--device', default='cuda:0')
    parser.add_argument('--machine', default=platform.processor() or platform.machine())
    args = parser.parse_args()
    command = f'python docs/benchmarks/probability.py --preset {args.preset}'
    command += f' --members {args.members}'
    command += '' if args.spacing is None else f' --spacing {args.spacing:g}'
    command += ' --ranges-only' * args.ranges_only
    rows: list[dict[str, object]] = []
    if args.output.is_file():
        with args.output.open(newline='', encoding='utf-8') as file:
            rows = list(csv.DictReader(file))
    for case in map(load_case, args.case):
        for row in (dated_rows_of if case.outlines else rows_of)(case, args, command):
            shown = {name: vars(row)[name] for name in PRINTED if name in vars(row)}
            print(', '.join(f'{name} {value}' for name, value in shown.items()), flush=True)
            keys = ('case', 'terrain', 'members', 'ensemble', 'date')
            same = {name: str(vars(row)[name]) for name in keys if name in vars(row)}
            rows = [old for old in rows if {k: str(old[k]) for k in same} != same] + [vars(row)]
            write_csv(rows, args.output)
            if row.reliability:
                with args.output.open(newline='', encoding='utf-8') as file:
                    draw(list(csv.DictReader(file)), args.output.with_suffix('.png'))


if __name__ == '__main__':
    main()
