# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava hindcast`: simulate a mapped eruption, and compare."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
import shutil
import sys
from typing import Any, TYPE_CHECKING

from lava_ros import validation
from lava_ros.cli.console import made_folder, Progress, write_json
from lava_ros.cli.options import argument, command, forced_effects
from lava_ros.cli.scene_options import vent_arguments
from lava_ros.errors import LavaError
from lava_ros.files import file_to_write

if TYPE_CHECKING:
    from lava_ros.hindcast.case import Case
    from lava_ros.hindcast.run import Result, Settings
    from lava_ros.hindcast.score import Score
    from lava_ros.scene import Terrain
    from lava_ros.scene.vent_files import VentRow
    from lava_ros.simulation.numerical_error import NumericalError

#: Files and folders of a hindcast in its folder.
RESULT, PICTURE, PAGE, BAG = 'hindcast.json', 'comparison.png', 'hindcast.html', 'bag'


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
    argument(
        '--mobility-limit', 'U', 'maximum speed of lava over its slope [m/s]: faster lava moves '
        'as if its viscosity were higher, which shortens runs of fluid lava (default: none)',
        float,
    ),
)
def hindcast(args: argparse.Namespace) -> int:
    """Simulate a mapped eruption, and compare the flow with the map.

    The folder of the case has elevation.asc, vent.csv, effusion_rate.csv, footprint.asc and, if
    needed, case.yaml (docs/VALIDATION.md). The command compares the area that the simulated lava
    covers with the footprint. The same command continues an interrupted run.
    """
    from lava_ros.hindcast.case import load_case
    from lava_ros.hindcast.page import draw_comparison, facts, warnings, write_maps, write_page
    from lava_ros.hindcast.replicates import agreement, MAX_REPLICATES, run_replicates
    from lava_ros.hindcast.run import measure_run_error, Run, Settings, UNFINISHED
    from lava_ros.hindcast.score import score_snapshot
    from lava_ros.hindcast.spacing import choose_case_spacing
    from lava_ros.layers.numbers import duration
    from lava_ros.runs.sinks import ProgressSink
    from lava_ros.scene.erupting_lava import EruptingLava

    # checked before the first run, although only the replicates need it
    runs = validation.whole('--runs', args.runs, at_least=1, at_most=MAX_REPLICATES)
    case = load_case(
        args.case,
        material=args.material,
        low_pass_width=args.low_pass,
        vents=lambda rows, ground: _vents(args, rows, ground),
    )
    settings = Settings(
        args.preset, args.spacing, args.device, forced_effects(args), args.maps,
        mobility_limit=args.mobility_limit,
    )
    output = Path(args.output or Path('hindcasts') / f'{case.name}_{args.preset}')
    _prepare(output)
    unfinished = output / UNFINISHED
    if args.fresh:
        shutil.rmtree(unfinished, ignore_errors=True)
    if settings.spacing is None:
        choice = choose_case_spacing(case, settings, runs=runs)
        settings = replace(settings, spacing=choice.spacing)
        print(choice.text())
    run = Run(case, settings, folder=unfinished)
    if run.is_resumed:
        print(f'continuing the unfinished run in {output}', file=sys.stderr)
    with Progress() as progress:
        shown = ProgressSink(
            lambda time: progress.show(duration(time), time / case.duration), case.duration,
            lambda: progress.is_due,
        )
        for _ in run.parts(shown):
            pass
    result = run.result()
    judged = score_snapshot(case, result.snapshot)
    several, results = None, [result]
    if runs > 1:
        run.keep()
        with Progress() as progress:
            results = run_replicates(
                case,
                settings,
                runs,
                original=result,
                folder=unfinished / 'several',
                progress=lambda done: progress.show(f'{runs} runs', done),
            )
        several = agreement(case, [item.snapshot for item in results])
    outlines, dated = _dated(case, results)
    error = measure_run_error(case, settings, result)
    picture, page = output / PICTURE, output / PAGE
    for suffix in ('.tif', '.qml'):
        # of an earlier hindcast with --runs
        (output / 'runs').with_suffix(suffix).unlink(missing_ok=True)
    files = write_maps(case, settings, result, output, several)
    draw_comparison(case, result.snapshot, judged, picture, error)
    write_page(case, settings, result, judged, picture, page, error, several, dated)
    run.write_bag(result, error, output / BAG)
    files = [*files, picture, page, output / BAG]
    shutil.rmtree(unfinished, ignore_errors=True)
    data = _as_dict(case, settings, result, judged, error)
    if several is not None:
        data['runs'] = several.as_dict()
    if outlines:
        data['outlines'] = outlines
    write_json(data, output / RESULT, args.json)
    print(case.title)
    rows = [('lava', EruptingLava.of(case.scene).text())]
    rows += facts(judged, result, error, several, dated).items()
    rows += [(f'volume {term}', value) for term, value in result.snapshot.budget.rows()]
    for term, value in [*rows, ('wall time', f'{result.wall_time:.1f} s on {result.device}')]:
        print(f'  {term:26} {value}')
    for item in warnings(case, result):
        print(f'lava hindcast: {item}', file=sys.stderr)
    print('\n'.join(f'written to {path}' for path in [*files, output / RESULT]))
    return 0


def _dated(
    case: Case, results: Sequence[Result]
) -> tuple[list[dict[str, Any]], dict[str, str]]:
    """Return the scores of the dated outlines as plain data, and as text by label."""
    from lava_ros.hindcast.score import refer, score_outlines

    if not case.outlines:
        return [], {}
    scores = score_outlines(case, [item.snapshot for item in results])
    references = refer(case, {item.outline: item.area_error for item in scores})
    plain = [asdict(item) | asdict(references[item.outline]) for item in scores]
    return plain, {
        f'Jaccard on {item.outline}': f'{item.jaccard:.3f} (area {100 * item.area_error:+.0f} %; '
        f'{references[item.outline].words})'
        for item in scores
    }


def _vents(
    args: argparse.Namespace, rows: tuple[VentRow, ...], ground: Terrain
) -> tuple[VentRow, ...]:
    from lava_ros.cli.scenes import vents_as_given

    if isinstance(args.discharge, str):
        expected = 'one number [m3/s]: the effusion rates of a case are those of its table'
        raise LavaError('--effusion-rate', args.discharge, expected)
    given = vents_as_given(args, ground)
    if not given:
        rate = args.discharge
        return rows if rate is None else tuple(
            replace(row, discharge=rate * row.part) for row in rows
        )
    is_own = [vent.discharge is not None for vent in given]
    if any(is_own) and not all(is_own):
        expected = 'one for every vent, or for none'
        raise LavaError(f'effusion rate of {given[is_own.index(False)].name!r}', None, expected)
    return tuple(given)


def _prepare(output: Path) -> None:
    from lava_ros.hindcast.run import UNFINISHED

    names = {item.name for item in output.iterdir()} if output.is_dir() else set()
    if names and not {RESULT, UNFINISHED} & names:
        raise LavaError('--output', str(output), 'a folder that is new, empty or of a hindcast')
    file_to_write('--output', made_folder(output) / PICTURE)


def _as_dict(
    case: Case, settings: Settings, result: Result, judged: Score, error: NumericalError
) -> dict[str, Any]:
    from lava_ros.hindcast.page import warnings
    from lava_ros.scene.erupting_lava import EruptingLava
    from lava_ros.simulation.selection import decision_as_dict

    snapshot, budget = result.snapshot, result.snapshot.budget
    return {
        'case': case.name,
        'title': case.title,
        'material': case.material.name,
        'erupting_lava': EruptingLava.of(case.scene).as_dict(),
        'warnings': warnings(case, result),
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
        'numerical_error': error.as_dict(),
        'effects_error': result.effects_error,
        'cell_m': case.scene.terrain.resolution * settings.coarseness(case),
        'composition': {name: one.value for name, one in case.material.composition.items()},
        'lava': asdict(case.scene.lava),
        'vents': [asdict(vent) for vent in case.scene.vents],
        'low_pass_m': case.low_pass,
    }
