# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.


"""`lava calibrate`: constants that make a hindcast cover what was mapped, and how sure."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict
import json
from pathlib import Path
from typing import Any, TYPE_CHECKING

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.presets import PRESETS

if TYPE_CHECKING:
    from lava_ros.hindcast.calibration import Finding, Trial

#: What a calibration leaves in its folder.
TABLE, RESULT = 'runs.csv', 'calibration.json'


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the `lava` parser."""
    parser = subparsers.add_parser(
        'calibrate',
        help='search for the constants that fit a mapped eruption',
        description='Run a case (docs/VALIDATION.md) with many sets of a few constants inside '
        'their published ranges, and report the runs that are nearly as good as the best, how far '
        'each constant spreads in them, and which ones the score does not depend on. Started '
        'again it goes on with the runs that it has.',
    )
    parser.add_argument('case', metavar='CASE_DIR', help='folder of the case')
    parser.add_argument(
        '--preset', choices=tuple(PRESETS), default='draft', help='accuracy (default: %(default)s)'
    )
    parser.add_argument(
        '--runs', type=int, default=48, metavar='N', help='runs (default: %(default)s)'
    )
    parser.add_argument(
        '--directions',
        type=int,
        default=1,
        metavar='N',
        help='runs of each set, turned and mirrored (8 are all): what half of them cover is '
        'compared, which chance moves less (default: %(default)s)',
    )
    parser.add_argument(
        '--unknown',
        action='append',
        default=[],
        metavar='NAME[=LOW:HIGH]',
        help='what to search, and in which range: viscosity [Pa s], yield_strength [Pa], '
        'emissivity, solidus [K], vent_temperature [K], discharge [1]; may be repeated (default: '
        'those with a published range)',
    )
    parser.add_argument(
        '--workers',
        type=int,
        default=1,
        metavar='N',
        help='runs at once, which share the GPU (default: %(default)s)',
    )
    parser.add_argument('--device', help='cpu, cuda:0, ... (default: the first GPU, else the CPU)')
    parser.add_argument('--spacing', type=float, metavar='M', help="particles' distance [m]")
    parser.add_argument('--material', metavar='NAME', help="lava in place of the case's")
    parser.add_argument('--low-pass', type=float, metavar='M', help='smooth the elevation first')
    parser.add_argument('--seed', type=int, default=0, help='of the search (default: 0)')
    parser.add_argument(
        '-o',
        '--output',
        metavar='DIR',
        help='folder for the table and the result (default: calibrations/<case>_<preset>)',
    )
    parser.add_argument('--json', metavar='FILE', help='also write the result here')
    parser.add_argument(
        '--fresh', action='store_true', help='start anew where earlier runs could be used'
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the calibration.

    Raises:
        LavaError: The case, an argument or the output cannot be used.
    """
    from lava_ros.cli.progress import Progress
    from lava_ros.hindcast.calibration import (
        BATCH,
        Evaluator,
        findings,
        near_best,
        read_trials,
        search,
        write_trials,
    )
    from lava_ros.hindcast.case import load_case
    from lava_ros.hindcast.run import Settings
    from lava_ros.hindcast.several import MOST
    from lava_ros.hindcast.unknowns import unknowns_of

    runs = int(validation.number('--runs', args.runs, at_least=4, at_most=1e6))
    workers = int(validation.number('--workers', args.workers, at_least=1, at_most=64))
    directions = int(validation.number('--directions', args.directions, at_least=1, at_most=MOST))
    options = {'material': args.material, 'low_pass_width': args.low_pass}
    case = load_case(args.case, **options)
    unknowns = unknowns_of(case, *_chosen(args.unknown))
    settings = Settings(args.preset, args.spacing, args.device)
    output = Path(args.output or Path('calibrations') / f'{case.name}_{args.preset}')
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LavaError('--output', str(output), f'a folder to write to ({error})') from error
    table = output / TABLE
    validation.file_to_write('--output', table)
    if args.json:
        # what cannot be written had better be known before
        validation.file_to_write('--json', args.json)
    known = [] if args.fresh else read_trials(table, unknowns)
    others = {trial.numbers['directions'] for trial in known} - {directions}
    if others:
        right = f'{min(others):g} as in {table}, or --fresh'
        raise LavaError('--directions', directions, right)
    evaluator = Evaluator(
        Path(args.case), settings, workers=workers, runs=directions, **options
    )
    so_far: list[Trial] = []
    with Progress() as progress:

        def told(count: int, trial: Trial) -> None:
            so_far.append(trial)
            write_trials(table, unknowns, [*so_far, *known[len(so_far) :]])
            progress.show(f'run {count}: Jaccard {trial.jaccard:.3f}', count / runs)

        try:
            trials = search(
                unknowns,
                evaluator,
                runs=runs,
                seed=args.seed,
                batch=max(BATCH, workers),
                known=known,
                progress=told,
            )
        finally:
            evaluator.close()
    found, near = findings(unknowns, trials), near_best(trials)
    text = json.dumps(_as_dict(case.name, settings.preset, found, near, trials), indent=1) + '\n'
    for path in [output / RESULT, *([Path(args.json)] if args.json else [])]:
        try:
            path.write_text(text, encoding='utf-8')
        except OSError as error:
            raise LavaError('--json', str(path), f'a file to write ({error})') from error
    _print(found, near, trials)
    print(f'written to {table}\nwritten to {output / RESULT}')
    return 0


def _chosen(texts: Sequence[str]) -> tuple[tuple[str, ...], dict[str, tuple[float, float]]]:
    """Names of unknowns, and the ranges of those that have one."""
    names, ranges = [], {}
    for text in texts:
        name, has_range, span = text.partition('=')
        names.append(name)
        if has_range:
            try:
                low, high = (float(part) for part in span.split(':'))
            except ValueError:
                raise LavaError('--unknown', text, 'NAME or NAME=LOW:HIGH') from None
            ranges[name] = (low, high)
    return tuple(names), ranges


def _as_dict(
    case: str,
    preset: str,
    found: Sequence[Finding],
    near: Sequence[Trial],
    trials: Sequence[Trial],
) -> dict[str, Any]:
    return {
        'case': case,
        'preset': preset,
        'runs': len(trials),
        'usual': {**trials[0].values, **trials[0].numbers},
        'best': {**near[0].values, **near[0].numbers},
        'near_best': [{**trial.values, **trial.numbers} for trial in near],
        'unknowns': [asdict(item) for item in found],
    }


def _print(found: Sequence[Finding], near: Sequence[Trial], trials: Sequence[Trial]) -> None:
    usual, best = trials[0].jaccard, near[0].jaccard
    print(f'Jaccard {usual:.3f} with the usual values, {best:.3f} at best in {len(trials)} runs')
    print(f'{len(near)} runs are within {best - near[-1].jaccard:.3f} of the best; in them')
    head = f'{"":17} {"usual":>9} {"best":>9} {"from":>9} {"to":>9}  of its range  correlation'
    print(head)
    for item in found:
        unknown = item.unknown
        numbers = (unknown.usual, item.best, item.low, item.high)
        shown = ' '.join(f'{value:9.4g}' for value in numbers)
        verdict = '' if item.is_sensitive else '  the fit does not depend on it'
        print(
            f'{unknown.name:17} {shown}  {100.0 * item.spread:9.0f} %  {item.correlation:+11.2f}'
            f'{verdict}'
        )
    for item in found:
        unknown = item.unknown
        print(f'{unknown.name}: {unknown.low:g} to {unknown.high:g} {unknown.unit}'.rstrip()
              + f', {unknown.source}')
