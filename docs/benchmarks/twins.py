# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure how often the forecasts of an ensemble hold, in twin experiments on a shipped example.

python docs/benchmarks/twins.py OUT.csv [--members N] [--truths N] [--workers N] [--machine NAME]
    [--scene FILE] [--coarseness C ...] [--horizon S] [--materials NAME ...]

A truth is another run, drawn like a member with another seed, with or without a property that the
members do not have: particles half as far apart (four times as many), or the lava of another
material. The table has a row for each kind of truth and each spacing of the members, without and
with the correction for the spacing, with an outline of the truth at a third of the time, and with
new members after it. Arrival times are compared at five places, at about equal distances in time
along the flow, which nearly all members reach.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
import platform
import shlex
import sys
import tempfile
import time

from eruptions import version
import numpy as np

from lava_ros.forecast.assimilation import jaccard, Outline, weigh
from lava_ros.forecast.ensemble import run_ensemble, run_in_processes
from lava_ros.forecast.members import make_plan, Plan, run_members
from lava_ros.forecast.probability import EnsembleAccumulator, Footprint, footprint_by
from lava_ros.forecast.sampling import draw_members, Member, Posterior
from lava_ros.forecast.scores import brier_score, reliability_error
from lava_ros.forecast.store import Store
from lava_ros.layers.forecast import HazardMaps, QUANTILES
from lava_ros.scene import Scene, scene_from_yaml
from lava_ros.scene.materials import material_named
from lava_ros.simulation.presets import preset_accuracy
from lava_ros.verification.rows import write_csv

#: Example of the package.
SCENE = Path(__file__).parents[2] / 'examples/uncertain.yaml'

#: Number of places, and minimum probability of arrival there [%].
PLACES, MIN_PROBABILITY = 5, 95.0

#: Spacing of truths over that of the members, and time of the outline over the horizon.
FINER, OUTLINE_TIME = 0.5, 1.0 / 3.0

#: Number of truths for which new members are drawn after the outline.
POSTERIORS = 8

#: Number of members, with and without pairs of runs, whose time is compared.
TIMED = 4


@dataclass(frozen=True)
class Row:
    """Forecasts of truths of one kind: a row of the CSV. Frequencies are in percent."""

    truths_are: str
    forecast: str
    members: int
    truths: int
    spacing_m: float
    across: float
    usable: bool
    before_earliest: float
    before_p10: float
    before_p50: float
    before_p90: float
    reliability_points: float
    outside_percent: float
    brier_score: float
    brier_without_outline: float
    area_between_p90_and_p10: float
    arrival_late_percent: float
    area_error_percent: float
    pairs_cost_percent: float
    cpu_s_per_member: float
    scene: str
    machine: str
    version: str
    command: str


@dataclass(frozen=True, eq=False)
class Twins:
    """An ensemble, its maps without and with the correction, and the time of its pairs."""

    plan: Plan
    drawn: Sequence[Member]
    members: Sequence[Footprint]
    maps: HazardMaps
    raw: HazardMaps
    places: Sequence[int]
    pairs_cost: float
    member_time: float


def ensemble_of(
    scene: Scene, args: argparse.Namespace, coarseness: float, folder: Path
) -> Twins:
    """Run the ensemble of a scene as `lava run --members` does."""
    accuracy = preset_accuracy('draft')
    plan = make_plan(scene, horizon=args.horizon, accuracy=accuracy)
    accuracy = replace(accuracy, spacing=coarseness * plan.accuracy.spacing)
    if coarseness != 1.0:
        plan = make_plan(scene, horizon=args.horizon, accuracy=accuracy)
    store, drawn = Store(folder, plan), draw_members(scene, args.members)
    runner = partial(run_in_processes, workers=args.workers, device='cpu')
    maps = run_ensemble(drawn, store, runner=runner).maps
    members = list(store.finished(args.members))
    cost, alone = time_of_pairs(store.plan, drawn)
    raw = maps_of(store.plan, [replace(item, pair=None) for item in members])
    return Twins(store.plan, drawn, members, maps, raw, places_in(maps), cost, alone)


def time_of_pairs(plan: Plan, drawn: Sequence[Member]) -> tuple[float, float]:
    """Return the time of the pairs over that of all members [%], and of one alone [s]."""
    # the first run compiles kernels
    plan = replace(plan, forced=None)
    spent = []
    for offset in (1, 1, 0):
        members = [
            replace(item, index=4 * index + offset) for index, item in enumerate(drawn[:TIMED])
        ]
        begun = time.process_time()
        run_members(plan, members, device='cpu')
        spent.append(time.process_time() - begun)
    pairs = sum(plan.has_pair(item) for item in drawn) / len(drawn)
    return 100.0 * pairs * (spent[2] / spent[1] - 1.0), spent[1] / TIMED


def truths_of(
    scene: Scene, plan: Plan, args: argparse.Namespace, finer: float
) -> list[Footprint]:
    """Run truths with the effects of the members, and particles ``finer`` times as far apart."""
    accuracy = replace(plan.accuracy, spacing=finer * plan.accuracy.spacing)
    # no sentinel reviews them
    plan = replace(plan, scene=make_plan(scene, horizon=plan.horizon, accuracy=accuracy).scene,
                   accuracy=accuracy, forced=None)
    drawn = draw_members(scene, args.truths, seed=1)
    runs = run_in_processes(plan, drawn, workers=args.workers, device='cpu')
    return sorted(runs, key=lambda item: item.index)


def maps_of(
    plan: Plan, members: Sequence[Footprint], weights: Sequence[int] | None = None
) -> HazardMaps:
    """Return the maps of members."""
    tally = EnsembleAccumulator(plan)
    for place, footprint in enumerate(members):
        tally.add(footprint, 1 if weights is None else int(weights[place]))
    return tally.maps()


def places_in(maps: HazardMaps) -> list[int]:
    """Return cells which nearly all members reach, at about equal intervals of time."""
    likely = np.flatnonzero(maps.probability.ravel() >= MIN_PROBABILITY)
    times = maps.arrival[0.5].ravel()[likely]
    wanted = np.linspace(times.min(), times.max(), PLACES + 1)[1:]
    return [int(likely[np.abs(times - time).argmin()]) for time in wanted]


def arrivals_of(footprint: Footprint, plan: Plan) -> np.ndarray:
    """Return the arrival times [s] of a truth, infinite without lava, of the terrain's shape."""
    times = np.full(plan.scene.terrain.shape, np.inf)
    rows, columns = (
        slice(first, first + size)
        for first, size in zip(footprint.corner, footprint.first_sample.shape, strict=True)
    )
    sample = footprint.first_sample.astype(np.float64)
    times[rows, columns] = np.where(
        sample < plan.samples, (sample + 0.5) * plan.interval, np.inf
    )
    return times


def scores_of(
    forecasts: Sequence[HazardMaps], truths: np.ndarray, twins: Twins
) -> dict[str, float]:
    """Score the forecast of each truth by its arrival times, shape [truths, rows, columns]."""
    places, resolution = twins.places, twins.plan.scene.terrain.resolution
    came = np.isfinite(truths)
    likely = np.stack([np.nan_to_num(maps.probability) for maps in forecasts]) / 100.0

    def before(times: Sequence[np.ndarray]) -> float:
        early = np.stack([np.nan_to_num(item.ravel()[places], nan=np.inf) for item in times])
        return 100.0 * float((truths.reshape(len(truths), -1)[:, places] < early).mean())

    prior = np.broadcast_to(np.nan_to_num(twins.maps.probability) / 100.0, came.shape)
    near = (prior[0] > 0.0) | (likely > 0.0).any(axis=0) | came.any(axis=0)
    none = likely[:, near] == 0.0
    areas = np.array([list(maps.areas(resolution).values()) for maps in forecasts])
    found = came.sum(axis=(1, 2)) * resolution**2
    return {
        'before_earliest': before([maps.worst.arrival for maps in forecasts]),
        **{
            f'before_p{100.0 * share:.0f}': before([maps.arrival[share] for maps in forecasts])
            for share in QUANTILES
        },
        'reliability_points': 100.0 * reliability_error(likely[:, near], came[:, near]),
        'outside_percent': 100.0 * float(came[:, near][none].sum() / came.sum()),
        'brier_score': brier_score(likely[:, near], came[:, near]),
        'brier_without_outline': brier_score(prior[:, near], came[:, near]),
        'area_between_p90_and_p10': 100.0 * float(
            ((areas[:, 2] <= found) & (found <= areas[:, 0])).mean()
        ),
    }


def weights_of(twins: Twins, truth: Footprint) -> np.ndarray:
    """Return the weights of the members by the outline of a truth."""
    plan, error = twins.plan, twins.maps.spacing_error
    at = OUTLINE_TIME * plan.horizon
    outline = Outline(at, footprint_by(truth, plan, at), plan.scene.terrain.has_data)
    index = [jaccard(footprint_by(item, plan, at, error), outline) for item in twins.members]
    return weigh(index, area_error=0.0 if error is None else error.area_error).values


def new_members(
    twins: Twins, truths: Sequence[Footprint], args: argparse.Namespace
) -> list[HazardMaps]:
    """Forecast truths by new members near those that agree with their outlines."""
    plan = replace(twins.plan, forced=None)
    drawn: list[Member] = []
    for truth in truths:
        posterior = Posterior(tuple(twins.drawn), weights_of(twins, truth))
        for member in draw_members(plan.scene, args.members, posterior=posterior):
            drawn.append(replace(member, index=len(drawn)))
    runs = run_in_processes(plan, drawn, workers=args.workers, device='cpu')
    found = sorted(runs, key=lambda item: item.index)
    return [
        maps_of(plan, found[start : start + args.members])
        for start in range(0, len(found), args.members)
    ]


def rows_of(args: argparse.Namespace, command: str, folder: Path) -> Iterator[Row]:
    """Run all experiments, and yield their rows."""
    example = scene_from_yaml(args.scene)
    as_given = replace(example, uncertainty=example.uncertainty.fixing(('all',)))
    for coarseness in args.coarseness:
        ranges, given = (
            ensemble_of(scene, args, coarseness, folder / f'{name}_{coarseness:g}')
            for scene, name in ((example, 'ranges'), (as_given, 'given'))
        )
        others = {name: with_material(example, name) for name in args.materials}
        for words, twins, scene, finer in (
            ('drawn from the published ranges', ranges, example, 1.0),
            ('at four times the particles', given, as_given, FINER),
            ('from the ranges, at four times the particles', ranges, example, FINER),
            *((f'of {name}', ranges, scene, 1.0) for name, scene in others.items()),
        ):
            truths = truths_of(scene, twins.plan, args, finer)
            came = np.stack([arrivals_of(item, twins.plan) for item in truths])
            error = twins.maps.spacing_error
            forecasts: dict[str, list[HazardMaps]] = {
                'uncorrected': [twins.raw] * len(truths), 'ensemble': [twins.maps] * len(truths),
            }
            forecasts['weighted by an outline'] = [
                maps_of(twins.plan, twins.members, weights_of(twins, truth).tolist())
                for truth in truths
            ]
            if coarseness == args.coarseness[0]:
                found = new_members(twins, truths[: args.posteriors], args)
                forecasts['new members after an outline'] = found
            for name, maps in forecasts.items():
                if not maps:
                    continue
                yield Row(
                    truths_are=words,
                    forecast=name,
                    members=args.members,
                    truths=len(maps),
                    spacing_m=twins.plan.accuracy.spacing,
                    across=preset_accuracy('draft').refinement * 16.0 / coarseness,
                    usable=error is None or error.is_usable,
                    **scores_of(maps, came[: len(maps)], twins),
                    arrival_late_percent=100.0 * np.expm1(error.delay),
                    area_error_percent=100.0 * error.area_error,
                    pairs_cost_percent=twins.pairs_cost,
                    cpu_s_per_member=twins.member_time,
                    scene=Path(args.scene).stem,
                    machine=args.machine,
                    version=version(),
                    command=command,
                )


def with_material(scene: Scene, name: str) -> Scene:
    """Return the scene with the lava and the published ranges of a material."""
    material = material_named(name)
    temperature = float(material.vent_temperature.value)
    return replace(
        scene,
        lava=material.lava,
        vents=tuple(replace(vent, temperature=temperature) for vent in scene.vents),
        uncertainty=replace(scene.uncertainty, material=name),
    )


def main() -> None:
    """Run the experiments of the arguments."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', type=Path)
    parser.add_argument('--scene', default=SCENE, type=Path, metavar='FILE')
    parser.add_argument('--members', type=int, default=64)
    parser.add_argument('--truths', type=int, default=48)
    parser.add_argument('--posteriors', type=int, default=POSTERIORS)
    parser.add_argument('--horizon', type=float, default=10800.0, metavar='S')
    parser.add_argument('--coarseness', type=float, nargs='+', default=[1.0, 1.4, 2.0])
    parser.add_argument('--materials', nargs='*', default=['kilauea_tholeiite', 'reunion_basalt'])
    parser.add_argument('--workers', type=int, default=2)
    parser.add_argument('--machine', default=platform.processor() or platform.machine())
    args = parser.parse_args()
    command = f'python docs/benchmarks/twins.py {shlex.join(sys.argv[2:])}'
    rows: list[Row] = []
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        for row in rows_of(args, command, Path(folder)):
            rows.append(row)
            print(
                f'{time.monotonic() - begun:4.0f} s, {row.across:.1f} across, truths '
                f'{row.truths_are}, {row.forecast}: before P10 {row.before_p10:.0f}, P50 '
                f'{row.before_p50:.0f}, P90 {row.before_p90:.0f} %; reliability '
                f'{row.reliability_points:.1f}, outside {row.outside_percent:.1f} %, Brier '
                f'{row.brier_score:.3f}, usable {row.usable}, '
                f'pairs {row.pairs_cost_percent:.0f} %',
                flush=True,
            )
            write_csv([vars(item) for item in rows], args.output)


if __name__ == '__main__':
    main()
