# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava hindcast` and `lava calibrate`: mapped eruptions, and the lava that fits them."""

import argparse
from collections.abc import Sequence
from dataclasses import asdict, replace
import json
from pathlib import Path
import shutil
import sys
from typing import Any

import lava_ros
from lava_ros import validation
from lava_ros.cli.options import argument, command, forced_effects
from lava_ros.cli.output import made_folder, Progress, write_json
from lava_ros.cli.scenes import vent_arguments, vents_as_given
from lava_ros.errors import LavaError
from lava_ros.files import file_to_write
from lava_ros.hindcast.calibration import (
    BATCH,
    can_tell,
    evaluating,
    Finding,
    findings,
    leave_one_out,
    LeftOut,
    near_best,
    read_trials,
    search,
    Trial,
    write_trials,
)
from lava_ros.hindcast.case import Case, load_case
from lava_ros.hindcast.expected_error import estimate_error, ExpectedError
from lava_ros.hindcast.page import draw_comparison, facts, warnings, write_maps, write_page
from lava_ros.hindcast.replicates import agreement, MOST, run_replicates
from lava_ros.hindcast.run import Result, Run, Settings, UNFINISHED
from lava_ros.hindcast.score import judge, Score
from lava_ros.hindcast.unknowns import unknowns_of
from lava_ros.maps.plot import duration
from lava_ros.scene import Terrain
from lava_ros.scene.vent_files import VentRow
from lava_ros.simulation.defaults import device_of
from lava_ros.simulation.selection import decision_as_dict

#: What a hindcast leaves in its folder.
RESULT, PICTURE, PAGE, BAG = 'hindcast.json', 'comparison.png', 'hindcast.html', 'bag'

#: What a calibration leaves in its folder.
TABLE, CALIBRATION = 'runs.csv', 'calibration.json'


@command(
    argument('case', 'CASE_DIR', 'folder of the case'),
    '--preset', '--spacing', '--device', '--low-pass', '--on', '--off', '--fresh', '--json',
    argument(
        '-o --output', 'DIR', 'folder for maps, bag and page (default: hindcasts/<case>_<preset>)'
    ),
    *vent_arguments('case'),
    argument(
        '--runs', 'N', 'make N more runs, rotated and mirrored, and report their scatter and the '
        'area that at least half of them cover; from 2 to 8, which are all directions (default: '
        'none)', 1,
    ),
    argument('--maps', 'N', 'number of maps of the run, which does not change the flow', 24),
)
def hindcast(args: argparse.Namespace) -> int:
    """Simulate a mapped eruption, and compare the flow with the map.

    The folder of the case has elevation.asc, vent.csv, effusion_rate.csv, footprint.asc and, if
    needed, case.yaml (docs/VALIDATION.md). The command compares the area that the simulated lava
    covers with the footprint. The same command continues an interrupted run.
    """
    # what the first run does not need had better be known before it
    runs = validation.whole('--runs', args.runs, at_least=1, at_most=MOST)
    case = load_case(
        args.case,
        material=args.material,
        low_pass_width=args.low_pass,
        vents=lambda rows, ground: _vents(args, rows, ground),
    )
    settings = Settings(
        args.preset, args.spacing, args.device, forced_effects(args), args.maps
    )
    output = Path(args.output or Path('hindcasts') / f'{case.name}_{args.preset}')
    _prepare(output)
    unfinished = output / UNFINISHED
    if args.fresh:
        shutil.rmtree(unfinished, ignore_errors=True)
    run = Run(case, settings, folder=unfinished)
    if run.is_resumed:
        print(f'continuing the unfinished run in {output}', file=sys.stderr)
    with Progress() as progress:
        for share, _ in run.snapshots():
            progress.show(duration(share * case.duration), share)
    result = run.result()
    judged = judge(case, result.snapshot.thickness, result.snapshot.inundated)
    several = None
    if runs > 1:
        with Progress() as progress:
            results = run_replicates(
                case,
                settings,
                runs,
                folder=unfinished / 'several',
                progress=lambda share: progress.show(f'{runs} runs', share),
            )
        several = agreement(case, [item.snapshot for item in results])
    expected = estimate_error(case, settings, result, several)
    picture, page = output / PICTURE, output / PAGE
    files = write_maps(case, settings, result, output, several)
    draw_comparison(case, result.snapshot, judged, picture)
    write_page(case, settings, result, judged, picture, page, expected, several)
    files = [*files, picture, page, *_write_bag(case, settings, run, result, output / BAG)]
    shutil.rmtree(unfinished, ignore_errors=True)
    data = _as_dict(case, settings, result, judged, expected)
    if several is not None:
        data['runs'] = several.as_dict()
    write_json(data, output / RESULT, args.json)
    print(case.title)
    rows = [*facts(judged, expected, several).items()]
    rows += [(f'volume {term}', value) for term, value in result.snapshot.budget.rows()]
    for term, value in [*rows, ('wall time', f'{result.wall_time:.1f} s on {result.device}')]:
        print(f'  {term:26} {value}')
    for item in warnings(case, result):
        print(f'lava hindcast: {item}', file=sys.stderr)
    print('\n'.join(f'written to {path}' for path in [*files, output / RESULT]))
    return 0


def _vents(
    args: argparse.Namespace, rows: tuple[VentRow, ...], ground: Terrain
) -> tuple[VentRow, ...]:
    if isinstance(args.discharge, str):
        right = 'one number [m3/s]: the effusion rates of a case are those of its table'
        raise LavaError('--effusion-rate', args.discharge, right)
    given = vents_as_given(args, ground)
    if not given:
        return tuple(replace(row, discharge=args.discharge) for row in rows)
    is_own = [vent.discharge is not None for vent in given]
    if any(is_own) and not all(is_own):
        right = 'one for every vent, or for none'
        raise LavaError(f'effusion rate of {given[is_own.index(False)].name!r}', None, right)
    return tuple(given)


def _prepare(output: Path) -> None:
    """Make the folder, and refuse one that holds something else."""
    names = {item.name for item in output.iterdir()} if output.is_dir() else set()
    if names and not {RESULT, UNFINISHED} & names:
        raise LavaError('--output', str(output), 'a folder that is new, empty or of a hindcast')
    file_to_write('--output', made_folder(output) / PICTURE)


def _write_bag(
    case: Case, settings: Settings, run: Run, result: Result, bag: Path
) -> list[Path]:
    try:
        from lava_ros.ros.offline_bags import write_snapshots
    except ImportError:
        print('lava hindcast: wrote no bag, which needs ROS 2', file=sys.stderr)
        return []
    shutil.rmtree(bag, ignore_errors=True)
    effects = {
        item.name: f'{"on" if item.is_on else "off"}: {item.reason}' for item in result.decisions
    }
    try:
        write_snapshots(
            bag,
            case.scene,
            run.kept(),
            custom_data={
                'device': result.device,
                'case': case.name,
                'version': lava_ros.__version__,
                'parameters': json.dumps({'preset': settings.preset}),
                'effects': json.dumps([{'time': 0.0, 'effects': effects}]),
            },
            terrains=[(event.time - case.start, event.terrain) for event in case.events],
        )
    except OSError as error:
        raise LavaError('output', str(bag), f'a folder to write to ({error})') from error
    return [bag]


def _as_dict(
    case: Case, settings: Settings, result: Result, judged: Score, expected: ExpectedError
) -> dict[str, Any]:
    """A hindcast as plain data."""
    snapshot, budget = result.snapshot, result.snapshot.budget
    return {
        'case': case.name,
        'title': case.title,
        'material': case.material.name if case.material is not None else None,
        'preset': settings.preset,
        'device': result.device,
        'simulated_s': snapshot.time,
        'score': asdict(judged),
        'volume': {**asdict(budget), 'error': budget.error},
        'wall_time_s': round(result.wall_time, 3),
        'steps': snapshot.steps.count,
        'evaluations': snapshot.steps.evaluations,
        'particles_at_most': result.most_particles,
        'particles_emitted': round(
            budget.emitted / (result.accuracy.spacing**2 * result.accuracy.thickness)  # type: ignore[operator]
        ),
        'effects': list(result.effects),
        'decisions': [decision_as_dict(item) for item in result.decisions],
        'accuracy': asdict(result.accuracy),
        'resolution': asdict(result.resolution),
        'expected_error': expected.as_dict(),
        'cell_m': case.scene.terrain.resolution * settings.coarseness(case),
        'lava': asdict(case.scene.lava),
        'vents': [asdict(vent) for vent in case.scene.vents],
        'low_pass_m': case.low_pass,
    }


@command(
    argument('case', 'CASE_DIR', 'folder of a case', nargs='+'),
    argument('--runs', 'N', 'number of sets of values', 48),
    argument(
        '--directions', 'N', 'number of runs of each set, rotated and mirrored, up to 8; the '
        'area that half of them cover depends less on chance', 1,
    ),
    argument(
        '--unknown', 'NAME[=LOW:HIGH]', 'constant to search, and its range: one of the lava '
        "('lava materials NAME' lists them), vent_temperature [K], or effusion_rate, a factor; "
        'may be repeated (default: those with a published range)', [], action='append',
    ),
    argument('--workers', 'N', 'number of simultaneous runs, which share the GPU', 1),
    argument('--material', 'NAME', 'lava by name; replaces the lava of the cases'),
    argument(
        '-o --output', 'DIR', 'folder for the table and the result (default: '
        'calibrations/<cases>_<preset>)',
    ),
    '--preset', '--spacing', '--device', '--low-pass', '--seed', '--fresh', '--json',
    preset='draft',
)
def calibrate(args: argparse.Namespace) -> int:
    """Search for the constants of the lava that fit mapped eruptions.

    The command runs one or more cases (docs/VALIDATION.md) with many sets of values of a few
    constants inside their published ranges, the same set for all cases. The score of a set is the
    mean over the cases. The command reports the sets that score nearly as well as the best, the
    spread of each constant among them, the constants that do not affect the score, and how well
    constants fitted to the other cases score on each case. The same command continues an
    interrupted search.
    """
    runs = validation.whole('--runs', args.runs, at_least=4, at_most=10**6)
    workers = validation.whole('--workers', args.workers, at_least=1, at_most=64)
    directions = validation.whole('--directions', args.directions, at_least=1, at_most=MOST)
    seed = validation.whole('--seed', args.seed, at_least=0, at_most=2**32 - 1)
    cases = [
        load_case(folder, material=args.material, low_pass_width=args.low_pass)
        for folder in args.case
    ]
    names = _names(cases)
    unknowns = unknowns_of(cases[0], *_chosen(args.unknown))
    settings = Settings(args.preset, args.spacing, args.device)
    output = made_folder(args.output or Path('calibrations') / '_'.join([*names, args.preset]))
    table = output / TABLE
    file_to_write('--output', table)
    known = [] if args.fresh else read_trials(table, unknowns, names)
    others = {
        numbers['directions'] for trial in known for numbers in trial.numbers.values()
    } - {directions}
    if others:
        right = f'{min(others):g} as in {table}, or --fresh'
        raise LavaError('--directions', directions, right)
    so_far: list[Trial] = []

    def told(count: int, trial: Trial) -> None:
        so_far.append(trial)
        write_trials(table, unknowns, [*so_far, *known[len(so_far) :]])
        progress.show(f'set {count}: Jaccard {trial.jaccard:.3f}', count / runs)

    begun = evaluating(cases, settings, workers=workers, runs=directions)
    with begun as evaluate, Progress() as progress:
        trials = search(
            unknowns,
            evaluate,
            runs=runs,
            seed=seed,
            batch=max(BATCH, workers) if device_of(args.device).is_cuda else workers,
            known=known,
            progress=told,
        )
    found, near = findings(unknowns, trials), near_best(trials)
    left_out = leave_one_out(trials)
    data = {
        'cases': names,
        'preset': settings.preset,
        'runs': len(trials),
        'usual': asdict(trials[0]),
        'best': asdict(near[0]),
        'near_best': [asdict(trial) for trial in near],
        'leave_one_out': [asdict(item) for item in left_out],
        'unknowns': [asdict(item) for item in found],
    }
    write_json(data, output / CALIBRATION, args.json)
    _print_findings(found, near, trials, left_out)
    print(f'written to {table}\nwritten to {output / CALIBRATION}')
    return 0


def _chosen(texts: Sequence[str]) -> tuple[tuple[str, ...], dict[str, tuple[float, float]]]:
    """Names of unknowns, and the ranges of those that have one."""
    names, ranges = [], {}
    for text in texts:
        name, has_range, span = text.partition('=')
        name = {'effusion_rate': 'discharge'}.get(name, name)
        names.append(name)
        if has_range:
            try:
                low, high = (float(part) for part in span.split(':'))
            except ValueError:
                raise LavaError('--unknown', text, 'NAME or NAME=LOW:HIGH') from None
            ranges[name] = (low, high)
    return tuple(names), ranges


def _names(cases: Sequence[Case]) -> list[str]:
    """Names of the cases, which have to be distinct and of one material."""
    names = [case.name for case in cases]
    if len(set(names)) < len(names):
        raise LavaError('CASE_DIR', ' '.join(names), 'folders with different names')
    materials = sorted({case.material.name for case in cases if case.material})
    if len(materials) > 1:
        raise LavaError('CASE_DIR', ' '.join(materials), 'cases of one material, or --material')
    return names


def _print_findings(
    found: Sequence[Finding],
    near: Sequence[Trial],
    trials: Sequence[Trial],
    left_out: Sequence[LeftOut],
) -> None:
    usual, best = trials[0].jaccard, near[0].jaccard
    print(f'Jaccard {usual:.3f} with the default values, {best:.3f} with the best of '
          f'{len(trials)} sets')
    for case in left_out:
        print(
            f'{case.case}: {near[0].mean([case.case]):.3f} with the best set, {case.jaccard:.3f} '
            f'with the set that is best for the others, {case.best:.3f} with its own best set'
        )
    print(f'{len(near)} sets are within {best - near[-1].jaccard:.3f} of the best; in them')
    print(f'{"":17} {"default":>9} {"best":>9} {"from":>9} {"to":>9}  of its range  correlation')
    absent = '  the fit does not depend on it' if can_tell(trials) else '  too few sets to tell'
    for item in found:
        numbers = (item.unknown.usual, item.best, item.low, item.high)
        shown = ' '.join(f'{value:9.4g}' for value in numbers)
        print(
            f'{item.unknown.name:17} {shown}  {100.0 * item.spread:9.0f} %  '
            f'{item.correlation:+11.2f}{"" if item.is_sensitive else absent}'
        )
    for unknown in (item.unknown for item in found):
        print(f'{unknown.name}: {unknown.low:g} to {unknown.high:g} {unknown.unit}'.rstrip()
              + f', {unknown.source}')
