# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The ensemble that the arguments of `lava run --members` ask for."""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TYPE_CHECKING

from lava_ros import validation
from lava_ros.cli.options import device_named, forced_effects, seconds_of
from lava_ros.cli.planned import planned, target_of
from lava_ros.cli.scenes import log_resolution, sourced_scene
from lava_ros.errors import LavaError
from lava_ros.files.optional import require
from lava_ros.forecast.assimilation import Outline
from lava_ros.forecast.ensemble import (
    default_workers,
    run_here,
    run_in_processes,
    run_on_cluster,
)
from lava_ros.forecast.member_scenes import median_scene
from lava_ros.forecast.members import make_plan
from lava_ros.forecast.observations import observed_in_file
from lava_ros.forecast.preset_spacing import choose_spacing
from lava_ros.forecast.sampling import MAX_MEMBERS, Susceptibility
from lava_ros.forecast.store import stored_spacing
from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.probabilistic_score import plan_of
from lava_ros.hindcast.run import Settings
from lava_ros.runs.provenance import identity_of
from lava_ros.runs.store import unused_folder
from lava_ros.scene.on_terrain import read_raster_on
from lava_ros.simulation.presets import preset_accuracy

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lava_ros.forecast.members import Plan
    from lava_ros.hindcast.case import Case
    from lava_ros.scene import Terrain

#: Name of the folder of the demonstration.
DEMO = 'st_helens'


def check_observation(args: argparse.Namespace) -> None:
    """Check the options about an observation, before any file is read.

    Raises:
        LavaError: If one of them is not valid.
    """
    if args.observed is None and args.observed_at is not None:
        raise validation.dependence('--observed-at', '--observed')
    if args.observed is not None and args.observed_at is None:
        raise LavaError('--observed-at', None, 'the time of the observation: 6h, 90min')
    if args.posterior is not None:
        validation.whole('--posterior', args.posterior, at_least=1, at_most=MAX_MEMBERS)
        if args.observed is None:
            raise validation.dependence('--posterior', '--observed')


def observation_of(args: argparse.Namespace, terrain: Terrain) -> tuple[Outline | None, str]:
    """Return the observed lava, None for none, and its description."""
    if args.observed is None:
        return None, 'none'
    seen = seconds_of('--observed-at', args.observed_at)
    outline = Outline(seen, *observed_in_file(args.observed, terrain))
    return outline, f'{Path(args.observed).name}, {seen:g} s after the start'


def susceptibility_of(args: argparse.Namespace, terrain: Terrain) -> Susceptibility | None:
    """Return the likelihood that the vent opens in a cell, None for none."""
    if args.susceptibility is None:
        return None
    likelihood = read_raster_on(
        terrain, args.susceptibility, field='--susceptibility', method='average'
    )
    return Susceptibility(terrain, likelihood)


class Wanted(NamedTuple):
    """The ensemble that a user asks for.

    ``inputs`` has path, size and digest of each input file, and ``name`` is for its folder.
    """

    plan: Plan
    case: Case | None
    inputs: Sequence[Mapping[str, Any]]
    name: str


def wanted_ensemble(args: argparse.Namespace) -> Wanted:
    """Return the ensemble of the arguments, with the case if the scene is its folder.

    Raises:
        LavaError: If an argument or a file is not valid.
    """
    forced = forced_effects(args)
    if args.scene is None or not Path(args.scene).is_dir():
        found = sourced_scene(args, as_given=True)
        scene = found.scene
        if args.susceptibility is not None and scene.uncertainty.position is None:
            # the map is the distribution of the place
            fixed = scene.uncertainty.fixing(['position'])
            scene = replace(scene, uncertainty=fixed)
        plan = make_plan(
            scene,
            horizon=seconds_of('--until', args.until),
            accuracy=replace(
                preset_accuracy(args.preset, spacing=args.spacing), method=args.method
            ),
            effects=forced,
            threshold=args.threshold,
        )
        log_resolution(plan.scene, plan.accuracy, forced, plan.horizon, args.threshold)
        return Wanted(plan, None, found.digests(), Path(args.scene or args.terrain or DEMO).stem)
    case = load_case(args.scene, material=args.material)
    settings = Settings(args.preset, args.spacing, args.device, forced)
    plan = plan_of(case, settings, threshold=args.threshold)
    return Wanted(plan, case, case.inputs, case.name)


def folder_of(
    args: argparse.Namespace, wanted: Wanted, susceptibility: Susceptibility | None
) -> tuple[Path, dict[str, Any]]:
    """Return the folder of an ensemble, and what ``run.json`` says about it.

    Without ``--output`` it is the folder in ``runs/`` of the same ensemble, to which the command
    then adds members, or an unused one.
    """
    plan, target = wanted.plan, target_of(args)
    settings = {
        'until_s': plan.horizon, 'method': plan.accuracy.method, 'preset': args.preset,
        'spacing_m': args.spacing, 'within_s': target.get('within'), 'error': target.get('error'),
        'threshold_m': args.threshold, 'forced': plan.forced or {},
    }
    identity = identity_of(plan.scene, {
        **settings, 'seed': args.seed,
        'susceptibility': None if susceptibility is None else susceptibility.digest,
    })
    folder = unused_folder(f'{wanted.name}_ensemble', identity, or_finished=True)
    return Path(args.output or folder), {
        'settings': settings, 'inputs': wanted.inputs, 'identity': identity,
    }


def with_spacing(args: argparse.Namespace, plan: Plan, folder: Path) -> tuple[Plan, str]:
    """Return the plan with the spacing of the preset, and how it was found.

    Members that are already in the folder have their spacing.

    Raises:
        LavaError: If the folder cannot be read, or no spacing can be found.
    """
    if args.spacing is not None or plan.accuracy.method == 'cells':
        return plan, ''
    spacing, text = stored_spacing(folder), ''
    if spacing is None and (target := target_of(args)):
        is_case = args.scene is not None and Path(args.scene).is_dir()
        settings = Settings(args.preset, device=args.device)
        spacing = planned(
            median_scene(plan.scene), target, plan.horizon, plan.forced or {}, args.device,
            members=args.members, **({'adapted': settings.adapted} if is_case else {}),
        ).spacing
    elif spacing is None:
        choice = choose_spacing(
            median_scene(plan.scene), args.preset, plan.accuracy, effects=plan.effects,
            horizon=plan.horizon, runs=args.members, device=args.device,
        )
        spacing, text = choice.spacing, choice.text()
    return replace(plan, accuracy=replace(plan.accuracy, spacing=spacing)), text


def runner_of(args: argparse.Namespace) -> tuple[Any, dict[str, Any]]:
    """Return the function that runs the members, and its description for the report.

    Raises:
        LavaError: If an argument is not valid, or a package is missing.
    """
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
