# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The ensemble that the options of `lava run --members` ask for."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from lava_ros import validation
from lava_ros.cli.console import made_folder
from lava_ros.cli.options import device_named
from lava_ros.cli.planned import planned
from lava_ros.cli.run_options import RunOptions, with_method
from lava_ros.cli.scenes import log_late, log_resolution, sourced_scene
from lava_ros.errors import LavaError
from lava_ros.files.optional import require
from lava_ros.forecast.assimilation import Outline
from lava_ros.forecast.ensemble import (
    check_cluster,
    default_workers,
    run_here,
    run_in_processes,
    run_on_cluster,
)
from lava_ros.forecast.member_scenes import median_scene
from lava_ros.forecast.members import make_plan, Plan
from lava_ros.forecast.observations import observed_in_file
from lava_ros.forecast.preset_spacing import choose_spacing
from lava_ros.forecast.sampling import Susceptibility
from lava_ros.forecast.store import stored_spacing
from lava_ros.hindcast.case import Case, load_case
from lava_ros.hindcast.probabilistic_score import plan_of
from lava_ros.hindcast.run import Settings
from lava_ros.layers.numbers import duration
from lava_ros.runs.provenance import identity_of
from lava_ros.runs.store import known_record, unused_folder
from lava_ros.scene import Scene, Terrain
from lava_ros.scene.on_terrain import read_raster_on
from lava_ros.simulation.presets import preset_accuracy


def observation_of(options: RunOptions, plan: Plan) -> tuple[Outline | None, str]:
    """Return the observed lava during an ensemble, None for none, and a description."""
    if options.observed is None or options.observed_at is None:
        return None, 'none'
    seen = options.observed_at
    if seen > plan.horizon:
        expected = f'a time at or before the end of the run, {duration(plan.horizon)}'
        raise LavaError('--observed-at', seen, expected)
    outline = Outline(seen, *observed_in_file(options.observed, plan.ground_at(seen)))
    return outline, f'{Path(options.observed).name}, {seen:g} s after the start'


def susceptibility_of(options: RunOptions, terrain: Terrain) -> Susceptibility | None:
    """Return the likelihood that the vent opens in a cell, None for none."""
    if options.susceptibility is None:
        return None
    likelihood = read_raster_on(
        terrain, options.susceptibility, field='--susceptibility', method='average'
    )
    return Susceptibility(terrain, likelihood)


class Wanted(NamedTuple):
    """The ensemble that a user asks for.

    ``inputs`` has path, size and digest of each input file, ``name`` is for its folder, and
    ``remarks`` are warnings about the inputs.
    """

    plan: Plan
    case: Case | None
    inputs: Sequence[Mapping[str, Any]]
    name: str
    remarks: Sequence[str]


def wanted_ensemble(options: RunOptions) -> Wanted:
    """Return the ensemble of the options, with the case if the scene is its folder.

    Raises:
        LavaError: If an argument or a file is not valid.
    """
    forced = options.forced
    if not options.is_case:
        found = sourced_scene(options.source, as_given=True)
        scene = _placed_by_map(options, found.scene)
        options = with_method(options, median_scene(scene), options.until)
        plan = make_plan(
            scene,
            horizon=options.until,
            accuracy=replace(
                preset_accuracy(options.preset, spacing=options.spacing), method=options.method
            ),
            effects=forced,
            threshold=options.threshold,
        )
        log_resolution(plan.scene, plan.accuracy, forced, plan.horizon, options.threshold)
        remarks = [*found.remarks, *log_late(plan.scene, plan.horizon)]
        return Wanted(plan, None, found.digests(), options.name, remarks)
    case = load_case(options.source)
    case = replace(case, scene=_placed_by_map(options, case.scene))
    options = with_method(options, case.scene, case.duration)
    settings = Settings(
        options.preset, options.spacing, options.device, forced, method=options.method
    )
    plan = plan_of(case, settings, threshold=options.threshold)
    remarks = [*case.remarks, *log_late(plan.scene, plan.horizon)]
    return Wanted(plan, case, case.inputs, case.name, remarks)


def _placed_by_map(options: RunOptions, scene: Scene) -> Scene:
    """Return the scene without a usual error of the position if a map is its distribution."""
    if options.susceptibility is None or scene.uncertainty.position is not None:
        return scene
    return replace(scene, uncertainty=scene.uncertainty.fixing(['position']))


def folder_of(
    options: RunOptions, wanted: Wanted, susceptibility: Susceptibility | None
) -> tuple[Path, dict[str, Any]]:
    """Return the folder of an ensemble, and its description for ``run.json``.

    Without ``--output`` it is the folder in ``runs/`` of the same ensemble, to which the command
    then adds members, or an unused one.
    """
    plan, target = wanted.plan, options.target
    settings = {
        'until_s': plan.horizon, 'method': plan.accuracy.method, 'preset': options.preset,
        'spacing_m': options.spacing, 'within_s': target.get('within'),
        'error': target.get('error'), 'threshold_m': options.threshold,
        'forced': plan.forced or {},
    }
    identity = identity_of(plan.scene, {
        **settings, 'seed': options.seed,
        'susceptibility': None if susceptibility is None else susceptibility.digest,
    })
    folder = unused_folder(f'{wanted.name}_ensemble', identity, or_finished=True)
    return options.output or folder, {
        'settings': settings, 'inputs': wanted.inputs, 'identity': identity,
    }


def with_spacing(options: RunOptions, plan: Plan, folder: Path) -> tuple[Plan, str, str]:
    """Return the plan with the spacing of the preset, the preset, and how they were found.

    Members that are already in the folder have their spacing and their preset.

    Raises:
        LavaError: If the folder or the scheduler cannot be used, or no spacing can be found.
    """
    method, preset = plan.accuracy.method, options.preset
    if options.spacing is not None or (method == 'cells' and not options.target):
        return plan, preset, ''
    spacing, text = stored_spacing(folder), ''
    if spacing is None:
        # the pilot runs would be lost if the members could not run
        made_folder(folder)
        if options.scheduler is not None:
            check_cluster(options.scheduler)
    if spacing is not None:
        if options.target:
            preset = known_record(folder).get('preset', preset)
    elif options.target:
        settings = Settings(options.preset, device=options.device, method=method)
        found = planned(
            median_scene(plan.scene), options.target, plan.horizon, plan.forced or {},
            options.device, method=method, members=options.members,
            **({'adapted': settings.adapted} if options.is_case else {}),
        )
        preset, spacing = found.preset, found.spacing
    else:
        choice = choose_spacing(
            median_scene(plan.scene), options.preset, plan.accuracy, effects=plan.effects,
            horizon=plan.horizon, runs=options.members, device=options.device,
        )
        spacing, text = choice.spacing, choice.text()
    refinement = preset_accuracy(preset).refinement
    accuracy = replace(plan.accuracy, spacing=spacing, refinement=refinement)
    return replace(plan, accuracy=accuracy), preset, text


def runner_of(options: RunOptions, plan: Plan) -> tuple[Any, dict[str, Any]]:
    """Return the function that runs the members of a plan, and its description for the report.

    Raises:
        LavaError: If an argument is not valid, or a package is missing.
    """
    workers = options.workers
    if workers is not None:
        workers = validation.whole('--workers', workers, at_least=1, at_most=1024)
        if options.scheduler is not None:
            raise validation.conflict('--workers', '--scheduler')
    if options.scheduler is not None:
        require('distributed', '--scheduler', options.scheduler)
        there = {'scheduler': options.scheduler, 'device': options.device}
        return partial(
            run_on_cluster, scheduler=options.scheduler, device=options.device
        ), there
    device = device_named(options.device, plan.accuracy.method)
    if workers is None:
        workers = default_workers(plan, options.members, options.device)
    where = {'workers': workers, 'device': device}
    if workers == 1:
        return partial(run_here, device=options.device), where
    return partial(run_in_processes, workers=workers, device=options.device), where
