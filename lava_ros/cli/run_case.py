# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""One run of a mapped eruption, or several, for `lava run`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
import shutil
import sys
from typing import Any, TYPE_CHECKING

from lava_ros import validation
from lava_ros.cli.arrivals import arrivals_at, print_arrivals
from lava_ros.cli.console import (
    accuracy_as_dict,
    made_folder,
    Progress,
    with_units,
    write_json,
)
from lava_ros.cli.options import forced_effects
from lava_ros.errors import LavaError
from lava_ros.files import file_to_write

if TYPE_CHECKING:
    from lava_ros.hindcast.case import Case
    from lava_ros.hindcast.run import Result, Settings
    from lava_ros.hindcast.score import Score
    from lava_ros.simulation.numerical_error import NumericalError

#: Files and folders of a hindcast in its folder.
RESULT, PICTURE, PAGE, BAG = 'hindcast.json', 'comparison.png', 'hindcast.html', 'bag'


def run_case(args: argparse.Namespace) -> int:
    """Simulate a mapped eruption, compare it with the map, and return the exit status."""
    from lava_ros.cli.scenes import WORDS
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
    if isinstance(args.discharge, str):
        expected = 'one number [m3/s]: the effusion rates of a case are those of its table'
        raise LavaError('--effusion-rate', args.discharge, expected)
    case = load_case(
        args.scene,
        material=args.material,
        low_pass=args.low_pass,
        vent=args.vent or (),
        vents=args.vents,
        effusion_rate=args.discharge,
        words=WORDS,
    )
    settings = Settings(
        args.preset, args.spacing, args.device, forced_effects(args), args.maps,
        mobility_limit=args.mobility_limit, method=args.method,
    )
    output = Path(args.output or Path('runs') / f'{case.name}_{args.preset}')
    _prepare(output)
    unfinished = output / UNFINISHED
    if args.fresh:
        shutil.rmtree(unfinished, ignore_errors=True)
    if settings.spacing is None and settings.method == 'particles':
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
        data['runs']['majority'] = _score_as_dict(several.majority)
    if outlines:
        data['outlines'] = outlines
    table = arrivals_at(args, output / BAG)
    if table is not None:
        data['places'] = table.as_dict()['places']
    write_json(data, output / RESULT, args.json)
    print(case.title)
    rows = [('lava', EruptingLava.of(case.scene).text())]
    rows += facts(judged, result, error, several, dated).items()
    rows += [(f'volume {term}', value) for term, value in result.snapshot.budget.rows()]
    for term, value in [*rows, ('wall time', f'{result.wall_time:.1f} s on {result.device}')]:
        print(f'  {term:26} {value}')
    print_arrivals(table)
    for item in warnings(case, result):
        print(f'lava run: {item}', file=sys.stderr)
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
    plain = [
        with_units(asdict(item), s='time') | asdict(references[item.outline]) for item in scores
    ]
    return plain, {
        f'Jaccard on {item.outline}': f'{item.jaccard:.3f} (area {100 * item.area_error:+.0f} %; '
        f'{references[item.outline].words})'
        for item in scores
    }


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
    from lava_ros.scene.lava import constant_units
    from lava_ros.simulation.selection import decision_as_dict

    snapshot, budget = result.snapshot, result.snapshot.budget
    resolution = result.resolution
    return {
        'kind': 'case',
        'case': case.name,
        'title': case.title,
        'material': case.material.name,
        'erupting_lava': EruptingLava.of(case.scene).as_dict(),
        'warnings': warnings(case, result),
        'preset': settings.preset,
        'device': result.device,
        'simulated_time_s': snapshot.time,
        'score': _score_as_dict(judged),
        **{name: float(text) for name, text in budget.texts().items()},
        'wall_time_s': round(result.wall_time, 3),
        'steps': snapshot.steps.count,
        'evaluations': snapshot.steps.evaluations,
        'particles_at_most': result.most_particles,
        'particles_emitted': round(
            budget.emitted / (result.accuracy.spacing**2 * result.accuracy.thickness)  # type: ignore[operator]
        ),
        'effects': list(result.effects),
        'decisions': [decision_as_dict(item) for item in result.decisions],
        'accuracy': accuracy_as_dict(result.accuracy),
        'resolution': {
            'spacing_m': resolution.spacing, 'flow_width_m': resolution.width,
            'particles_across': resolution.across,
        },
        'flow_kind': None if resolution.kind is None else resolution.kind.text(),
        'numerical_error': error.as_dict(),
        'effects_error': result.effects_error,
        'cell_m': case.scene.terrain.resolution * settings.coarseness(case),
        'composition_percent': {
            name: one.value for name, one in case.material.composition.items()
        },
        'lava': [
            {'name': name, 'value': value, 'unit': constant_units()[name]}
            for name, value in asdict(case.scene.lava).items()
        ],
        'vents': with_units(
            [asdict(vent) for vent in case.scene.vents], m='position end radius', k='temperature',
            m3_per_s='discharge', m_per_s='velocity',
        ),
        'low_pass_m': case.low_pass,
    }


def _score_as_dict(judged: Score) -> dict[str, Any]:
    lengths = 'length mapped_length mean_thickness median_thickness thickest mapped_thickness'
    plain = with_units(
        asdict(judged), m=lengths, m2='area standing_area mapped_area', m3='volume'
    )
    return dict(plain)
