# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""One run of a mapped eruption, or several, for `lava run`."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
import shutil
import sys
from typing import Any

from lava_ros import validation
from lava_ros.cli.arrivals import add_arrivals, check_places, print_arrivals
from lava_ros.cli.console import Progress, with_units, write_json
from lava_ros.cli.options import device_named
from lava_ros.cli.planned import planned
from lava_ros.cli.run_options import RunOptions, with_method
from lava_ros.cli.run_request import simulated
from lava_ros.cli.scenes import log_late, sourced_case
from lava_ros.files.optional import require
from lava_ros.forecast.partner_runs import measure_run
from lava_ros.hindcast.case import Case
from lava_ros.hindcast.page import draw_comparison, facts, write_maps, write_page
from lava_ros.hindcast.replicates import agreement, MAX_REPLICATES, run_replicates
from lava_ros.hindcast.run import coarseness, request_of, Result, Settings
from lava_ros.hindcast.score import refer, Score, score_outlines, score_snapshot
from lava_ros.hindcast.spacing import choose_case_spacing
from lava_ros.layers.arrival import Arrival
from lava_ros.layers.recording import Recording
from lava_ros.runs.scene_run import Request, SceneRun
from lava_ros.scene.erupting_lava import EruptingLava
from lava_ros.simulation.accuracy import Accuracy

#: Files of a mapped eruption in the folder of its run, and folder of unfinished further runs.
PICTURE, PAGE, REPLICATES = 'comparison.png', 'hindcast.html', 'replicates'


def run_case(options: RunOptions) -> int:
    """Simulate a mapped eruption, compare it with the map, and return the exit status."""
    case, request = _requested(options)
    check_places(options.places, case.scene.terrain)
    with simulated(request) as made:
        result = Result.of_run(made)
        judged = score_snapshot(case, result.snapshot)
        results = _several(options, case, made, result)
        several = None
        if options.runs > 1:
            several = agreement(case, [item.snapshot for item in results])
        outlines, dated = _dated(case, results)
        error = measure_run(made)
        made.note_error(error)
        folder, preset = made.folder.path, made.folder.record['preset']
        picture, page = folder / PICTURE, folder / PAGE
        peak = _peak(folder, result.snapshot.threshold)
        files = write_maps(case, preset, result, peak, folder, several)
        draw_comparison(case, result, judged, picture, error)
        facts_of_case = _as_dict(case, result, judged)
        if several is not None:
            facts_of_case['runs'] = several.as_dict()
            facts_of_case['runs']['majority'] = _score_as_dict(several.majority)
        if outlines:
            facts_of_case['outlines'] = outlines
        remarks = made.warnings()
        write_page(
            case, preset, result, judged, picture, page, error, remarks, several, dated
        )
        record = {'folder': str(folder), **made.finish(facts_of_case)}
    shutil.rmtree(folder / REPLICATES, ignore_errors=True)
    table = add_arrivals(record, options.places, folder)
    write_json(record, options.json)
    print(case.title)
    rows = [('lava', EruptingLava.of(case.scene).text())]
    rows += facts(judged, result, error, several, dated).items()
    rows += [(f'volume {term}', value) for term, value in result.snapshot.budget.rows()]
    for term, value in [*rows, ('wall time', f'{result.wall_time:.1f} s on {result.device}')]:
        print(f'  {term:26} {value}')
    print_arrivals(table)
    for item in remarks:
        print(f'lava run: {item}', file=sys.stderr)
    print('\n'.join(f'written to {path}' for path in [*files, picture, page, folder]))
    return 0


def _requested(options: RunOptions) -> tuple[Case, Request]:
    """Return the case and the run that the options ask for.

    Raises:
        LavaError: If an argument or a file is not valid.
    """
    # checked before the first run, although only the replicates need it
    runs = validation.whole('--runs', options.runs, at_least=1, at_most=MAX_REPLICATES)
    target = options.target
    require('rasterio', 'GeoTIFF')
    case = sourced_case(options.source)
    options = with_method(options, case.scene, case.duration)
    device = device_named(options.device, options.method)
    settings = Settings(
        options.preset, options.spacing, device, options.forced, options.maps,
        mobility_limit=options.mobility_limit, method=options.method,
    )

    def accuracy() -> tuple[str, Accuracy]:
        chosen = settings
        if target:
            found = planned(
                case.scene, target, case.duration, settings.effects, device, members=runs,
                method=settings.method, adapted=settings.adapted,
            )
            chosen = replace(settings, preset=found.preset, spacing=found.spacing)
        elif settings.spacing is None and settings.method == 'particles':
            choice = choose_case_spacing(case, settings, runs=runs)
            chosen = replace(settings, spacing=choice.spacing)
            print(choice.text())
        resolved = chosen.accuracy(case)
        bound = resolved.mobility_limit
        if settings.mobility_limit is None and bound is not None:
            print(
                'lava that is fluid at the vent: its speed over its slope is limited to '
                f'{bound:g} m/s, as by a higher viscosity (--mobility-limit 1e9 for no limit)'
            )
        return chosen.preset, resolved

    remarks = [*case.remarks, *log_late(case.scene, case.duration)]
    if case.low_pass:
        remarks.append(f'the elevation was smoothed over {case.low_pass:g} m')
    if case.initial is not None:
        start = f'{case.start:g} s' if case.onset is None else case.onset.utc()
        remarks.append(f'the run starts from the outline of {start}')
    return case, request_of(
        case, settings, accuracy,
        {'within_s': target.get('within'), 'error': target.get('error'), 'runs': runs},
        # the plan chooses the preset
        name=case.name if target else '', inputs=case.inputs, remarks=remarks,
        output=options.output,
    )


def _several(
    options: RunOptions, case: Case, made: SceneRun, result: Result
) -> list[Result]:
    """Return the results of the run and of its rotated and mirrored runs."""
    if options.runs == 1:
        return [result]

    made.keep()
    settings = Settings(
        made.folder.record['preset'], result.accuracy.spacing, made.request.device,
        options.forced, options.maps, thickness=result.accuracy.thickness,
        mobility_limit=result.accuracy.mobility_limit, method=result.accuracy.method,
    )
    with Progress() as progress:
        return run_replicates(
            case, settings, options.runs, original=result, folder=made.folder.path / REPLICATES,
            progress=lambda done: progress.show(f'{options.runs} runs', done),
        )


def _peak(folder: Path, threshold: float) -> Any:
    """Return the largest thickness in any map of a bag [m], shape [rows, columns]."""
    history = Arrival(threshold)
    for frame in Recording(folder).frames():
        history.add(frame)
    assert history.peak is not None
    return history.peak


def _dated(
    case: Case, results: Sequence[Result]
) -> tuple[list[dict[str, Any]], dict[str, str]]:
    """Return the scores of the dated outlines as plain data, and as text by label."""
    if not case.outlines:
        return [], {}
    scores = score_outlines(case, [item.snapshot for item in results])
    references = refer(case, {item.outline: item.footprint_area_error for item in scores})
    plain = [
        with_units(asdict(item), s='time') | asdict(references[item.outline]) for item in scores
    ]
    return plain, {
        f'Jaccard on {item.outline}': f'{item.jaccard:.3f} (area of the footprint '
        f'{100 * item.footprint_area_error:+.0f} %; {references[item.outline].words})'
        for item in scores
    }


def _as_dict(case: Case, result: Result, judged: Score) -> dict[str, Any]:
    """Return what ``run.json`` has of a mapped eruption in addition to that of a scene."""
    budget, accuracy = result.snapshot.budget, result.accuracy
    return {
        'case': case.name,
        'title': case.title,
        'material': case.material.name,
        'composition_percent': {
            name: one.value for name, one in case.material.composition.items()
        },
        'low_pass_m': case.low_pass,
        'score': _score_as_dict(judged),
        'decisions': [item.as_dict() for item in result.decisions],
        'effects_error': result.effects_error,
        'evaluations': result.snapshot.steps.evaluations,
        **({'particles_emitted': round(budget.emitted / accuracy.particle_volume)}
           if accuracy.method == 'particles' else {}),
        'cell_m': case.scene.terrain.resolution * coarseness(case, accuracy),
    }


def _score_as_dict(judged: Score) -> dict[str, Any]:
    names = {
        'area': 'inundated_area', 'length': 'runout_length', 'thickest': 'largest_thickness',
        'volume': 'volume_on_map',
    }
    lengths = 'runout_length mapped_length mean_thickness median_thickness largest_thickness '
    plain = with_units(
        {names.get(name, name): value for name, value in asdict(judged).items()},
        m=f'{lengths} mapped_thickness', m2='inundated_area standing_area mapped_area',
        m3='volume_on_map',
    )
    return dict(plain)
