# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava calibrate`: the constants of the lava that fit mapped eruptions."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict
import math
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

from lava_ros import validation
from lava_ros.cli.console import made_folder, Progress, write_json
from lava_ros.cli.options import argument, command, device_named, output_option
from lava_ros.errors import LavaError, RefusalError, refusing, Typed
from lava_ros.files import file_to_write, writable_file

if TYPE_CHECKING:
    from lava_ros.hindcast.calibration import CrossValidation, Finding, ParameterSample
    from lava_ros.hindcast.case import Case
    from lava_ros.hindcast.run import Settings

#: Files of a calibration in its folder.
TABLE, CALIBRATION, INTERVALS = 'runs.csv', 'calibration.json', 'posterior.csv'

#: File with the settings of the runs in the table.
SETTINGS = 'settings.json'


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
        'may be repeated (default: those with a published range that the cases do not state)',
        [], action='append',
    ),
    argument(
        '--fit-until', 'TIME', 'fit only the dated outlines up to this time, in s of the clock of '
        'the case or as a date, and forecast the later ones (default: fit all)',
    ),
    argument('--workers', 'N', 'number of simultaneous runs, which share the GPU', 1),
    output_option(
        'DIR', 'folder for the table and the result (default: '
        'calibrations/<cases>_<preset>)',
    ),
    '--method', '--preset', '--spacing', '--device', '--low-pass', '--seed', '--fresh', '--json',
    '--material',
    preset='draft',
)
def calibrate(args: argparse.Namespace) -> int:
    """Search for the constants of the lava that fit mapped eruptions.

    The command runs one or more cases (docs/VALIDATION.md) with many sets of values of a few
    constants inside their published ranges, the same set for all cases. It never changes a
    constant that a case states, unless --unknown names it. The score of a set is the mean over
    the cases, each the mean over its dated outlines. The command reports the sets that score
    nearly as well as the best, the spread of each constant among them, the constants that do
    not affect the score, the interval that contains each constant with a probability of 90 %,
    and how well constants fitted to the other cases score on each case. With --fit-until,
    outlines of later dates are forecast. The same command continues an interrupted search.
    """
    from lava_ros.cli.scenes import settle_method
    from lava_ros.hindcast import calibration
    from lava_ros.hindcast.case import load_case
    from lava_ros.hindcast.free_parameters import changed, free_parameters_of
    from lava_ros.hindcast.replicates import MAX_REPLICATES
    from lava_ros.hindcast.run import Settings
    from lava_ros.scene.erupting_lava import EruptingLava
    from lava_ros.simulation.setup.defaults import device_of
    from lava_ros.verification.rows import write_csv

    runs = validation.whole('--runs', args.runs, at_least=4, at_most=10**6)
    workers = validation.whole('--workers', args.workers, at_least=1, at_most=64)
    directions = validation.whole(
        '--directions', args.directions, at_least=1, at_most=MAX_REPLICATES
    )
    seed = validation.whole('--seed', args.seed, at_least=0, at_most=2**32 - 1)
    cases = [
        load_case(folder, material=args.material, low_pass=args.low_pass)
        for folder in args.case
    ]
    names = _names(cases)
    stated = frozenset().union(*(case.stated for case in cases))
    parameters = free_parameters_of(cases[0], *_chosen(args.unknown), stated=stated)
    moved = [item.name for item in parameters]
    kept, asked = sorted(stated - {*moved}), sorted(stated & {*moved})
    until = _until(args.fit_until, cases)
    args.method, args.device = settle_method(
        args.method, args.device, cases[0].scene, cases[0].duration, Settings().effects,
        args.preset,
    )
    args.device = device_named(args.device, args.method)
    settings = Settings(args.preset, args.spacing, args.device, method=args.method)
    kept_settings = _plain(args, cases, settings)
    output = made_folder(args.output or Path('calibrations') / '_'.join([*names, args.preset]))
    table = output / TABLE
    present = {item.name for item in output.iterdir()}
    if present and not {TABLE, SETTINGS} & present:
        raise LavaError('--output', str(output), 'a folder that is new, empty or of a calibration')
    for name in (TABLE, SETTINGS, CALIBRATION, INTERVALS):
        writable_file('--output', output / name)
    results = [name for case in cases for name in calibration.result_names(case)]
    known = [] if args.fresh else calibration.read_samples(table, parameters, results)
    if known:
        print(f'continuing with the {len(known)} sets in {table}', file=sys.stderr)
    else:
        file_to_write('--output', table)
    _keep_settings(kept_settings, output, has_runs=bool(known))
    others = {
        numbers['directions'] for sample in known for numbers in sample.numbers.values()
    } - {directions}
    if others:
        expected = f'{min(others):g} as in {table}, or --fresh'
        raise LavaError('--directions', directions, expected)
    fitted = [
        name for case in cases for name, time in _times(case)
        if time <= until.get(case.name, math.inf)
    ]
    if any(sample.fitted != fitted for sample in known):
        expected = f'the time with which {table} was written, or --fresh'
        raise LavaError('--fit-until', args.fit_until, expected)
    print(f'moved: {", ".join(moved)}')
    if kept:
        print(f'kept as stated: {", ".join(kept)}')
    if asked:
        print(f'stated, but moved by --unknown: {", ".join(asked)}')
    so_far: list[ParameterSample] = []

    def report(count: int, sample: ParameterSample) -> None:
        so_far.append(sample)
        every = calibration.with_known(so_far, known)
        calibration.write_samples(table, parameters, every)
        progress.show(f'set {count}: Jaccard {sample.jaccard:.3f}', count / runs)

    begun = calibration.evaluating(
        cases, settings, workers=workers, runs=directions, until=until
    )
    with begun as evaluate, Progress() as progress:
        samples = calibration.search(
            parameters,
            evaluate,
            runs=runs,
            seed=seed,
            batch=max(calibration.BATCH, workers) if device_of(args.device).is_cuda else workers,
            known=known,
            progress=report,
        )
    found = calibration.findings(parameters, samples)
    near = calibration.near_optimal(samples)
    _, effective = calibration.posterior_quantiles(parameters, samples)
    left_out = calibration.leave_one_out(samples, names)
    forecasts = [item for case in cases for item in _forecasts(case, near[0], fitted)]
    data = {
        'cases': names,
        'preset': settings.preset,
        'runs': len(samples),
        'moved': moved,
        'kept': kept,
        'erupting_lava': {
            case.name: EruptingLava.of(changed(case, near[0].values).scene).as_dict()
            for case in cases
        },
        'usual': asdict(samples[0]),
        'best': asdict(near[0]),
        'near_best': [asdict(sample) for sample in near],
        'leave_one_out': [asdict(item) for item in left_out],
        'fitted': fitted,
        'forecasts': forecasts,
        'unknowns': [asdict(item) for item in found],
        'effective_sets': effective,
    }
    write_json(data, output / CALIBRATION, args.json)
    write_csv([_interval(item) for item in found], output / INTERVALS)
    _print_findings(found, near, samples, left_out)
    print(f'distribution of each constant given the fit, from {effective:.1f} sets of equal '
          'weight: quantiles of 5, 50 and 95 %')
    for item in found:
        shown = ' '.join(f'{value:9.4g}' for value in item.quantiles)
        print(f'{item.unknown.name:17} {shown} {item.unknown.unit}'.rstrip())
    for one in forecasts:
        print(f'forecast of {one["outline"]}: Jaccard {one["jaccard"]:.3f}, of the last fitted '
              f'outline {one["persistence"]:.3f}, of steepest descent {one["descent"]:.3f}')
    for path in (table, output / CALIBRATION, output / INTERVALS):
        print(f'written to {path}')
    return 0


def _plain(
    args: argparse.Namespace, cases: Sequence[Case], settings: Settings
) -> dict[str, Any]:
    """Return the settings of the runs; raise LavaError if a run cannot have them."""
    from lava_ros.hindcast.run import identity_of

    return {
        **{f'--{name}': getattr(args, name.replace('-', '_'))
           for name in ('method', 'preset', 'spacing', 'low-pass', 'material')},
        **{f'case {case.name}': identity_of(case, settings) for case in cases},
    }


def _keep_settings(plain: dict[str, Any], output: Path, *, has_runs: bool) -> None:
    """Write the settings of the runs; raise LavaError if earlier runs have others."""
    from lava_ros.files.yaml import parse_json

    path = output / SETTINGS
    if has_runs:
        expected = 'a folder with the settings of its runs, or --fresh'
        with refusing('--output', str(path), expected, OSError):
            earlier = parse_json(SETTINGS, path.read_text(encoding='utf-8'))
        for name, value in plain.items():
            if earlier.get(name, 'particles' if name == '--method' else None) != value:
                if name.startswith('case'):
                    problem = f'The {name} has changed since the runs in {output / TABLE}'
                    raise RefusalError(name, problem, 'Add --fresh to start again')
                expected = f'{earlier.get(name)}, as for the runs in {output / TABLE}, or --fresh'
                raise LavaError(name, value, expected)
    write_json(plain, path)


def _interval(item: Finding) -> dict[str, Any]:
    """Return a row of the table of quantiles."""
    from lava_ros.hindcast.calibration import LEVELS

    one = item.unknown
    row = {'name': one.name, 'unit': one.unit, 'low': one.low, 'high': one.high}
    row |= {'usual': one.usual, 'best': item.best}
    names = [f'p{100 * level:02.0f}' for level in LEVELS]
    return row | dict(zip(names, item.quantiles, strict=True))


def _chosen(texts: Sequence[str]) -> tuple[tuple[str, ...], dict[str, tuple[float, float]]]:
    names, ranges = list[str](), dict[str, tuple[float, float]]()
    for text in texts:
        name, has_range, span = text.partition('=')
        name = {'effusion_rate': 'discharge'}.get(name, name)
        names.append(name)
        if has_range:
            try:
                low, high = (Typed(float(part), part) for part in span.split(':'))
            except ValueError:
                raise LavaError('--unknown', text, 'NAME or NAME=LOW:HIGH') from None
            ranges[name] = (low, high)
    return tuple(names), ranges


def _times(case: Case) -> list[tuple[str, float]]:
    """Return the names of the results of a case with the times of their outlines [s]."""
    from lava_ros.hindcast.calibration import result_names

    times = [item.time for item in case.outlines] or [0.0]
    return list(zip(result_names(case), times, strict=True))


def _until(text: str | None, cases: Sequence[Case]) -> dict[str, float]:
    """Return the time after which the outlines of each case are not fitted [s]."""
    from lava_ros.scene.from_outline import time_of_outline

    if text is None:
        return {}
    if not any(case.outlines for case in cases):
        raise validation.surplus('--fit-until', 'to cases without dated outlines')
    until = {}
    for case in cases:
        try:
            value: object = Typed(float(text), text)
        except ValueError:
            value = text
        until[case.name] = time_of_outline('--fit-until', value, case.start, case.onset)
        if case.outlines and until[case.name] < case.outlines[0].time:
            expected = f'a time after the first outline of {case.name}, {case.outlines[0].text}'
            raise LavaError('--fit-until', text, expected)
    return until


def _forecasts(case: Case, best: ParameterSample, fitted: Sequence[str]) -> list[dict[str, Any]]:
    """Return the scores of the best set, and of two references, on outlines not fitted."""
    from lava_ros.hindcast.score import refer

    pairs = list(zip([name for name, _ in _times(case)], case.outlines, strict=False))
    later = {outline.text: best.numbers[name] for name, outline in pairs if name not in fitted}
    if not later:
        return []
    last = [outline for name, outline in pairs if name in fitted][-1]
    errors = {text: numbers['footprint_area_error'] for text, numbers in later.items()}
    references = refer(case, errors, last.footprint)
    return [
        {'outline': f'{case.name} {text}', 'jaccard': numbers['jaccard']}
        | asdict(references[text])
        for text, numbers in later.items()
    ]


def _names(cases: Sequence[Case]) -> list[str]:
    """Return the names of the cases, which have to be distinct and of one material."""
    names = [case.name for case in cases]
    if len(set(names)) < len(names):
        raise LavaError('CASE_DIR', ' '.join(names), 'folders with different names')
    materials = sorted({case.material.name for case in cases})
    if len(materials) > 1:
        problem = f'The cases have different materials: {", ".join(materials)}'
        raise RefusalError('CASE_DIR', problem, 'Choose one with --material')
    return names


def _print_findings(
    found: Sequence[Finding],
    near: Sequence[ParameterSample],
    samples: Sequence[ParameterSample],
    left_out: Sequence[CrossValidation],
) -> None:
    from lava_ros.hindcast.calibration import has_enough_samples

    usual, best = samples[0].jaccard, near[0].jaccard
    print(f'Jaccard {usual:.3f} with the values of the case, {best:.3f} with the best of '
          f'{len(samples)} sets')
    for case in left_out:
        print(
            f'{case.case}: {near[0].mean([case.eruption]):.3f} with the best set, '
            f'{case.jaccard:.3f} with the set that is best for the others, {case.best:.3f} with '
            'its own best set'
        )
    print(f'{len(near)} sets are within {best - near[-1].jaccard:.3f} of the best; in them')
    print(f'{"":17} {"case":>9} {"best":>9} {"from":>9} {"to":>9}  of its range  correlation')
    absent = '  the fit does not depend on it' if has_enough_samples(samples) else '  too few sets'
    for item in found:
        numbers = (item.unknown.usual, item.best, item.low, item.high)
        shown = ' '.join(f'{value:9.4g}' for value in numbers)
        print(
            f'{item.unknown.name:17} {shown}  {100.0 * item.spread:9.0f} %  '
            f'{item.correlation:+11.2f}{"" if item.is_sensitive else absent}'
        )
    for one in (item.unknown for item in found):
        print(f'{one.name}: {one.low:g} to {one.high:g} {one.unit}'.rstrip() + f', {one.source}')
