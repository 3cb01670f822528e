# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava plan`: the accuracy that is possible in a given time."""

from __future__ import annotations

import argparse
from dataclasses import asdict, replace
from typing import Any, TYPE_CHECKING

from lava_ros import validation
from lava_ros.cli.console import table_lines, with_units, write_json
from lava_ros.cli.options import argument, command, forced_effects, HORIZON, seconds_of
from lava_ros.cli.scene_options import SCENE, UNTIL
from lava_ros.errors import LavaError

if TYPE_CHECKING:
    from lava_ros.forecast.planning import RunPlan


@command(
    *SCENE,
    '--within', '--error',
    argument(
        '--members', 'N', 'number of members of an ensemble, which run one after the other; auto '
        'takes the number with the smallest error', '1',
    ),
    UNTIL, '--method', '--on', '--off', '--device', '--json',
)
def plan(args: argparse.Namespace) -> int:
    """Find the accuracy that a run, or an ensemble, can have in a given time.

    The command makes coarse pilot runs of a scene on this machine, in at most 15 % of the given
    time. It prints a table of particle spacings, or sizes of cells, with the numerical error and
    its parts, and the time that a run takes, with those of the presets; for comparison, the
    effects of the uncertain quantities; the preset and the spacing of the finest run that fits;
    and the number of members that an ensemble can have, with the sampling error of a probability.
    With --error in place of --within, the command finds the coarsest run with that error, and the
    time that it takes. lava run has the same options. The plan of a mapped eruption is that of
    its run: to the end of the eruption, with the same effects.
    """
    from lava_ros.cli.planned import planned, target_of
    from lava_ros.cli.scenes import (
        case_from_arguments,
        log_late,
        log_resolution,
        scene_from_arguments,
        settle_method,
    )
    from lava_ros.forecast.sampling import MAX_MEMBERS
    from lava_ros.hindcast.run import Settings
    from lava_ros.scene.erupting_lava import EruptingLava
    from lava_ros.simulation.presets import preset_accuracy

    if args.within is not None and args.error is not None:
        raise validation.conflict('--within', '--error')
    target, forced = target_of(args), forced_effects(args)
    case = case_from_arguments(args, plan.arguments)
    until = seconds_of('--until', args.until or HORIZON)
    if not target:
        raise LavaError('--within', None, 'wall time to use: 30s, 10min; or --error: 10%')
    members = None
    if args.members == 'auto' and 'error' in target:
        raise validation.conflict('--members auto', '--error')
    if args.members != 'auto':
        if not args.members.isdecimal():
            raise LavaError('--members', args.members, 'a whole number at or above 1, or auto')
        members = validation.whole('--members', args.members, at_least=1, at_most=MAX_MEMBERS)
    if case is not None:
        scene, until = case.scene, case.duration
        forced = Settings(forced=forced).effects
    else:
        scene = scene_from_arguments(args)
    args.method, args.device = settle_method(args.method, args.device, scene, until, forced)
    settings = Settings(method=args.method)
    found = planned(
        scene, target, until, forced, args.device, method=args.method, members=members,
        with_inputs=True, **({'adapted': settings.adapted} if case is not None else {}),
        on_pilot=lambda pilot: print(
            f'pilot: spacing {pilot.spacing:.3g} m took {pilot.wall_time:.2g} s', flush=True
        ),
    )
    print('\n'.join(table_lines(_table(found), '>>>>>>>')))
    print(f'{found.pilots} pilots took {found.spent:.2g} s')
    of_time = f' of {target["within"]:g} s' if 'within' in target else ''
    print(
        f'{found.members} run{"s" * (found.members > 1)} in about {found.wall_time:.2g} s{of_time}'
    )
    print(f'numerical error: {found.numerical_error.text()}')
    if found.inputs:
        print('\n'.join(table_lines(_changes(found), '<>>')))
        print('by a change of one quantity from its 10 % to its 90 % quantile, in coarse runs')
    if found.members > 1:
        print(
            f'standard error of a probability of 50 %: {100.0 * found.sampling_error:.2g} '
            'percentage points'
        )
    accuracy = preset_accuracy(found.preset, spacing=found.spacing)
    accuracy = replace(accuracy, method=args.method)
    log_resolution(scene, accuracy, forced, until)
    log_late(scene, until)
    lava = EruptingLava.of(scene)
    print(f'lava: {lava.text()}')
    write_json(
        {'until_s': until, **_as_dict(found), 'erupting_lava': lava.as_dict()}, args.json
    )
    return 0


def _changes(found: RunPlan) -> list[list[str]]:
    """Return the rows of the quantities, that with the largest effect first, with a head."""
    from lava_ros.layers.numbers import percent

    ordered = sorted(found.inputs.items(), key=lambda item: -item[1].mismatch)
    return [['what decides', 'inundated area', '1 - J'], *(
        [name.replace('_', ' '), f'{100.0 * item.area:+.0f} %', percent(item.mismatch)]
        for name, item in ordered
    )]


def _table(found: RunPlan) -> list[list[str]]:
    """Return the rows of the runs that could be made, with a head."""
    from lava_ros.layers.numbers import percent, seconds

    cell, are_cells = found.numerical_error.cell, found.numerical_error.method == 'cells'
    head = [
        'cells' if are_cells else 'spacing', 'inundated area',
        'cells of lava' if are_cells else 'particles',
        f'cells of ground of {cell:g} m' if are_cells else f'cells of {cell:g} m',
        'standing area', 'time', '',
    ]
    rows = []
    for item in found.options:
        area = item.error.inundated
        rows.append([
            f'{item.spacing:.3g} m', percent(area.total), percent(area.lava),
            percent(area.ground), percent(item.error.standing.total), seconds(item.wall_time),
            ', '.join(['<- plan'] * (item.refinement == found.refinement) + [
                name for name, refinement in found.presets.items()
                if refinement == item.refinement
            ]),
        ])
    return [head, *rows]


def _as_dict(found: RunPlan) -> dict[str, Any]:
    """Return a plan as plain data."""
    plain = asdict(found) | {'numerical_error': found.numerical_error.as_dict()}
    plain['sampling_error_percent'] = 100.0 * plain.pop('sampling_error')
    plain['options'] = [
        asdict(item) | {'error': item.error.as_dict()} for item in found.options
    ]
    return with_units(plain, m='spacing', s='wall_time spent')  # type: ignore[no-any-return]
