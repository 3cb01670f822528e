# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava ensemble`: the probability and the time of inundation from many runs of a scene."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
import json
from pathlib import Path
import sys
import time
from typing import Any, TYPE_CHECKING

from lava_ros import validation
from lava_ros.cli.console import made_folder, print_arrivals, Progress, write_json
from lava_ros.cli.ensemble_report import (
    describe_agreement,
    print_report,
    score_against_case,
    summarize,
)
from lava_ros.cli.options import argument, command, device_named, formats, seconds_of
from lava_ros.cli.scene_options import RATE_OPTIONS, SCENE
from lava_ros.errors import LavaError
from lava_ros.files.optional import require

if TYPE_CHECKING:
    from lava_ros.forecast.ensemble import Ensemble
    from lava_ros.forecast.members import Plan
    from lava_ros.forecast.sampling import Member
    from lava_ros.forecast.store import Store
    from lava_ros.hindcast.case import Case
    from lava_ros.layers.forecast import HazardMaps
    from lava_ros.scene import Scene, Terrain
    from lava_ros.scene.reshaping import Barrier
    from lava_ros.simulation.numerical_error import NumericalError

#: Default simulated time of a member.
HORIZON = '6h'

#: Folder of the bag in the output, and folders of the maps that are weighted by an observation
#: and, with its time, of new members near those that agree with it.
BAG, WEIGHTED, POSTERIOR = 'atlas', 'weighted', 'posterior'

#: Folders of the same members with barriers, and of the comparison.
WITH_BARRIERS, COMPARISON = 'with_barriers', 'comparison'


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
        '--posterior', 'N', 'number of further members to draw near those that agree with the '
        'observed lava, with their maps in the folder posterior_<time> (default: none)', int,
    ),
    argument(
        '--workers', 'N', 'number of processes (default: one for each GPU, else one for each '
        'core)', int,
    ),
    argument(
        '--scheduler', 'ADDRESS', 'address of a Dask scheduler that runs the members: '
        'tls://host:8786',
    ),
    formats('areas of 10, 50 and 90 %% probability, isochrones', None),
    argument(
        '--barriers', 'FILE', 'vector file of lines along the crests of barriers with their '
        'height [m], width [m] and slope (docs/FORMATS.md): run the members without them and with '
        'them, and compare',
    ),
    argument('--barriers-at', 'TIME', 'time at which the barriers are built (default: the start)'),
    argument(
        '--places', 'FILE', 'named points, lines and areas: print when lava arrives there, and '
        'with which probability; may be repeated', action='append', default=[],
    ),
    preset='draft',
)
def ensemble(args: argparse.Namespace) -> int:
    """Run a scene many times, and map the probability and the time of lava inundation.

    The command draws a value of each uncertain quantity for each member and runs the members on
    all cores or GPUs. It draws the distributions in the section `uncertainty` of a scene, the
    published ranges of the lava, and the usual errors of effusion rates, vents and ground, except
    for the quantities that the section lists as `exact`. It prints what it has drawn, from which
    source, and which quantities decide the inundated area. It writes the probability of
    inundation, the times by which lava has reached a cell in 10, 50 and 90 % of the members, the
    expected thickness, and the earliest arrival and largest thickness of any member, as GeoTIFF
    and as a bag. One member in four runs again with particles farther apart: the maps are
    corrected for the error of the spacing, or called not usable if it is too large. The same
    command continues an interrupted ensemble, and adds members to a finished one. SCENE may also
    be the folder of a mapped eruption, as for lava hindcast: the command then scores the
    probability against the mapped flow, and at the dates of its outlines if it has any. With
    --barriers the members run a second time with barriers; the folder with_barriers has the maps
    of these runs, and the folder comparison what the barriers change.
    """
    import numpy as np

    from lava_ros.forecast.assimilation import Outline
    from lava_ros.forecast.ensemble import run_ensemble
    from lava_ros.forecast.ensemble_error import measure_ensemble_error
    from lava_ros.forecast.influence import Influences, influences_of
    from lava_ros.forecast.member_scenes import check_members
    from lava_ros.forecast.observations import observed_in_file
    from lava_ros.forecast.sampling import (
        draw_members,
        MAX_MEMBERS,
        Posterior,
        Susceptibility,
    )
    from lava_ros.forecast.store import Store
    from lava_ros.products.arrivals import TABLE, write_table
    from lava_ros.products.comparison import compare_ensembles
    from lava_ros.products.ensemble_files import write_atlas
    from lava_ros.products.gis import Provenance, require_formats, usual_formats
    from lava_ros.products.run_warnings import warnings_of_plan
    from lava_ros.scene.erupting_lava import EruptingLava
    from lava_ros.scene.on_terrain import read_raster_on
    from lava_ros.scene.onset import Onset
    from lava_ros.scene.projection import coordinate_system
    from lava_ros.scene.ranges import describe_inputs
    from lava_ros.scene.uncertainty import uncertainty_to_dict
    from lava_ros.simulation.numerical_error import mean_difference, NOT_MEASURED

    if args.observed is None and args.observed_at is not None:
        raise validation.dependence('--observed-at', '--observed')
    if args.observed is not None and args.observed_at is None:
        raise LavaError('--observed-at', None, 'the time of the observation: 6h, 90min')
    if args.posterior is not None:
        validation.whole('--posterior', args.posterior, at_least=1, at_most=MAX_MEMBERS)
        if args.observed is None:
            raise validation.dependence('--posterior', '--observed')
    require('rasterio', 'GeoTIFF', str(args.output))
    plan, case = _planned(args)
    if args.places:
        # raises for an invalid file before the runs
        _check_places(args.places, plan.scene.terrain)
    barriers = _barriers(args, plan)
    scene, output = plan.scene, Path(args.output)
    crs = coordinate_system(scene.terrain.epsg, scene.terrain.wkt)
    require_formats(usual_formats(crs) if args.formats is None else args.formats, output, crs)
    susceptibility = None
    if args.susceptibility is not None:
        likelihood = read_raster_on(
            scene.terrain, args.susceptibility, field='--susceptibility', method='average'
        )
        susceptibility = Susceptibility(scene.terrain, likelihood)
    outline, observation = None, 'none'
    if args.observed is not None:
        seen = seconds_of('--observed-at', args.observed_at)
        outline = Outline(seen, *observed_in_file(args.observed, scene.terrain))
        observation = f'{Path(args.observed).name}, {seen:g} s after the start'
    kept = {'seed': args.seed, 'susceptibility': susceptibility}
    members = draw_members(scene, args.members, **kept)
    check_members(scene, members)
    runner, where = _runner(args)
    name = Path(args.scene or args.terrain or 'demo').name
    onset = Onset.of(scene)
    plan, found = _with_spacing(args, plan)
    store = Store(output, plan, **kept)
    if found:
        print(found)
    error: NumericalError | None = None
    decides: Influences | None = None

    def write_maps(
        maps: HazardMaps, folder: Path = output, seen: str = 'none', *, store: Store = store
    ) -> list[str]:
        plan, tags = store.plan, {
            'seed': str(args.seed),
            'numerical_error': NOT_MEASURED if error is None else error.brief(),
        }
        if decides is not None:
            tags['influence'] = json.dumps(decides.as_dict())
        origin = Provenance(
            name, tuple(plan.effects), args.preset, observation=seen,
            onset=onset,
        )
        return [str(path) for path in write_atlas(folder, maps, plan, origin, tags, args.formats)]

    def run_all(
        store: Store, folder: Path, which: str = 'members',
        members: Sequence[Member] = members,
    ) -> Ensemble:
        try:
            with Progress() as progress:
                progress.show(f'{which} begin', 0.0)
                return run_ensemble(
                    members,
                    store,
                    runner=runner,
                    outline=outline,
                    on_finished=lambda done, resumed: progress.show(
                        f'{done} of {len(members)} {which}',
                        (done - resumed) / (len(members) - resumed),
                    ),
                    on_maps=lambda maps: write_maps(maps, folder, store=store),
                )
        except KeyboardInterrupt:
            print('lava ensemble: interrupted; the same command continues', file=sys.stderr)
            raise

    started = time.monotonic()
    done = run_all(store, output)
    wall = time.monotonic() - started
    plan = store.plan
    if args.scheduler is None:
        error = measure_ensemble_error(plan, done.maps.members, output, device=args.device)
    decides = influences_of(scene, members, store.finished(len(members)))
    report = summarize(args, plan, done.maps, done, wall, where)
    report |= {
        'inputs': describe_inputs(scene),
        'influence': decides.as_dict(),
        'numerical_error': None if error is None else error.as_dict(),
        'erupting_lava': EruptingLava.of(scene).as_dict(),
        'warnings': warnings_of_plan(plan),
    }
    report['difference_of_members'] = mean_difference(
        0.01 * np.nan_to_num(done.maps.probability), done.maps.members
    )
    if scene.uncertainty.eruption:
        lengths = [member.eruption[0] for member in members if member.eruption]
        report['eruptions_cut_off'] = sum(length > plan.horizon for length in lengths)
    if case is not None:
        report |= {'case': case.name, 'uncertainty': uncertainty_to_dict(scene.uncertainty)}
        report |= score_against_case(
            case, plan, store.finished(len(members)), output, outline=outline
        )
    files = [*write_maps(done.maps), *_write_bag(output / BAG, plan, done.maps, report)]
    if done.weighted is not None:
        # in a folder of their own, to keep the maps with equal weights
        folder = made_folder(output / WEIGHTED)
        store.write_manifest(folder)
        store.keep_weights(done.weights, folder)
        report |= summarize(args, plan, done.weighted, done, wall, where)
        report['observed'] = describe_agreement(done, observation)
        assert done.weights is not None
        if case is not None:
            report |= score_against_case(
                case, plan, store.finished(len(members)), folder,
                weights=done.weights.values.tolist(), outline=outline,
            )
        files += write_maps(done.weighted, folder, observation)
        files += _write_bag(folder / BAG, plan, done.weighted, report)
    if args.posterior:
        assert outline is not None and done.weights is not None
        folder = output / f'{POSTERIOR}_{outline.time:.10g}s'
        posterior = Posterior(members, done.weights.values)
        drawn = draw_members(scene, args.posterior, posterior=posterior, **kept)
        check_members(scene, drawn)
        # keep the effects that sentinels have switched on for the first members
        other = Store(folder, replace(plan, switched_on=()), posterior=posterior, **kept)
        started = time.monotonic()
        again = run_all(other, folder, 'new members', drawn)
        assert again.weights is not None
        result = summarize(
            args, other.plan, again.maps, again, time.monotonic() - started, where
        )
        result['effective_parents'] = posterior.effective_members
        result['jaccard_mean'] = float(again.weights.jaccard.mean())
        if case is not None:
            result |= score_against_case(
                case, other.plan, other.finished(len(drawn)), folder, outline=outline
            )
        report['posterior'] = result
        files += write_maps(again.maps, folder, observation, store=other)
        files += _write_bag(folder / BAG, other.plan, again.maps, result)
    if barriers:
        folder, built = output / WITH_BARRIERS, _barriers_at(args)
        # keep the effects that sentinels have switched on for the members without barriers
        dammed = replace(plan, scene=_dammed(plan.scene, barriers, built), switched_on=())
        other = Store(folder, dammed, **kept)
        started = time.monotonic()
        again = run_all(other, folder, 'members with barriers')
        wall = time.monotonic() - started
        files += write_maps(again.maps, folder, store=other)
        result = summarize(args, other.plan, again.maps, again, wall, where)
        files += _write_bag(folder / BAG, other.plan, again.maps, result)
        compared = compare_ensembles(
            output, folder, made_folder(output / COMPARISON), places=args.places,
            lines=[args.barriers] if built else (), built=built,
            origin=Provenance(name, tuple(other.plan.effects), args.preset, onset=onset),
        )
        files += compared.pop('files')
        report['barriers'] = {
            'built_s': built,
            'barriers': [
                {
                    'name': item.name, 'length_m': item.length, 'height_m': item.height,
                    'width_m': item.width, 'volume_m3': item.volume,
                }
                for item in barriers
            ],
            'effects': list(other.plan.effects),
            **compared,
        }
    if args.places:
        folder = output / WEIGHTED if done.weighted is not None else output
        table = write_table(folder, args.places)
        files.append(str(folder / TABLE))
        report['places'] = table.as_dict()['places']
    report['files'] = files
    write_json(report, args.json)
    print_report(report, plan, error)
    if args.places:
        print_arrivals(table)
    return 0


def _check_places(files: Sequence[str], terrain: Terrain) -> None:
    from lava_ros.layers.places import places_on
    from lava_ros.scene.features import read_features

    for file in files:
        places_on(read_features('--places', file, terrain), terrain)


def _barriers(args: argparse.Namespace, plan: Plan) -> list[Barrier]:
    from lava_ros.scene.reshaping import Barrier, read_barriers, with_barriers

    if args.barriers_at and not args.barriers:
        raise validation.dependence('--barriers-at', '--barriers')
    if not args.barriers:
        return []
    if args.observed:
        raise validation.conflict('--barriers', '--observed')
    usual = {'height': None, 'width': None, 'slope': Barrier.slope}
    barriers = read_barriers('--barriers', args.barriers, plan.scene.terrain, usual)
    # raises for an invalid time, or a barrier off the terrain, before the runs
    _barriers_at(args)
    with_barriers(plan.scene.terrain, barriers)
    for item in barriers:
        print(item.text())
    return barriers


def _barriers_at(args: argparse.Namespace) -> float:
    return seconds_of('--barriers-at', args.barriers_at or '0', may_be_zero=True)


def _dammed(scene: Scene, barriers: Sequence[Barrier], built: float) -> Scene:
    """Return the scene with barriers at the start, or with an event that builds them later [s]."""
    from lava_ros.scene.events import TerrainEvent
    from lava_ros.scene.reshaping import with_barriers

    if not built:
        raised = with_barriers(scene.terrain, barriers, is_told=False)
        return replace(scene, terrain=raised)
    event = TerrainEvent(built, f'{len(barriers)} barriers', barriers=tuple(barriers))
    events = sorted((*scene.events, event), key=lambda item: item.time)
    return replace(scene, events=tuple(events))


def _planned(args: argparse.Namespace) -> tuple[Plan, Case | None]:
    """Return the plan of the members and, if the scene is the folder of a case, the case."""
    from lava_ros.cli.scenes import log_resolution, scene_as_given
    from lava_ros.forecast.members import make_plan
    from lava_ros.hindcast.case import load_case
    from lava_ros.hindcast.probabilistic_score import plan_of
    from lava_ros.hindcast.run import Settings
    from lava_ros.simulation import presets

    if args.scene is None or not Path(args.scene).is_dir():
        scene = scene_as_given(args)
        if args.susceptibility is not None and scene.uncertainty.position is None:
            # the map is the distribution of the place
            fixed = scene.uncertainty.fixing(['position'])
            scene = replace(scene, uncertainty=fixed)
        plan = make_plan(
            scene,
            horizon=seconds_of('--horizon', args.horizon or HORIZON),
            accuracy=presets.preset_accuracy(args.preset, spacing=args.spacing),
            threshold=args.threshold,
        )
        log_resolution(plan.scene, plan.accuracy, {}, plan.horizon, args.threshold)
        return plan, None
    options = (
        'terrain', 'epsg', 'nodata', 'fill_holes', 'sea_level', 'vent', 'vents', 'discharge',
        'horizon', 'emplaced_flow', 'emplaced_thickness', 'emplaced_as', 'terrain_at',
        *RATE_OPTIONS,
    )
    for name in options:
        # a sea level may be 0
        if (value := getattr(args, name)) is not None and value is not False:
            option = f'--{name.replace("_", "-")}'.replace('discharge', 'effusion-rate')
            raise validation.surplus(option, f'to {args.scene}, a mapped eruption')
    case = load_case(args.scene, material=args.material)
    settings = Settings(args.preset, args.spacing, args.device)
    return plan_of(case, settings, threshold=args.threshold), case


def _with_spacing(args: argparse.Namespace, plan: Plan) -> tuple[Plan, str]:
    """Return the plan with the spacing of the preset, and how it was found.

    Members that are already in the folder have their spacing.
    """
    from lava_ros.forecast.member_scenes import median_scene
    from lava_ros.forecast.preset_spacing import choose_spacing
    from lava_ros.forecast.store import stored_spacing

    if args.spacing is not None:
        return plan, ''
    spacing, text = stored_spacing(Path(args.output)), ''
    if spacing is None:
        choice = choose_spacing(
            median_scene(plan.scene), args.preset, plan.accuracy, effects=plan.effects,
            horizon=plan.horizon, runs=args.members, device=args.device,
        )
        spacing, text = choice.spacing, choice.text()
    return replace(plan, accuracy=replace(plan.accuracy, spacing=spacing)), text


def _runner(args: argparse.Namespace) -> tuple[Any, dict[str, Any]]:
    """Return the function that runs the members, and its description for the report."""
    from lava_ros.forecast.ensemble import (
        default_workers,
        run_here,
        run_in_processes,
        run_on_cluster,
    )

    workers = args.workers
    if workers is not None:
        workers = validation.whole('--workers', workers, at_least=1, at_most=1024)
        if args.scheduler is not None:
            raise validation.conflict('--workers', '--scheduler')
    if args.scheduler is not None:
        require('distributed', '--scheduler', args.scheduler)
        where = {'scheduler': args.scheduler, 'device': args.device}
        return partial(run_on_cluster, **where), where
    if workers is None:
        # one process for a named GPU
        workers = 1 if args.device not in (None, 'cpu') else default_workers()
    where = {'workers': workers, 'device': device_named(args.device)}
    if workers == 1:
        return partial(run_here, device=args.device), where
    return partial(run_in_processes, workers=workers, device=args.device), where


def _write_bag(bag: Path, plan: Plan, maps: HazardMaps, report: dict[str, Any]) -> list[str]:
    from lava_ros.forecast.atlas_bag import write_atlas_bag

    effects = [{'time': 0.0, 'effects': plan.explain_effects()}]
    data = {'ensemble': json.dumps(report), 'effects': json.dumps(effects)}
    write_atlas_bag(bag, maps, plan, stamp_ns=time.time_ns(), custom_data=data)
    return [str(bag)]
