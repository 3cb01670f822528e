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


"""`lava hindcast`: a mapped eruption again, and how well the simulation covers it."""

from __future__ import annotations

import argparse
from dataclasses import asdict
import json
from pathlib import Path
import shutil
import sys
from typing import Any, TYPE_CHECKING

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.presets import DEFAULT, PRESETS

if TYPE_CHECKING:
    from lava_ros.hindcast.case import Case
    from lava_ros.hindcast.run import Result, Run, Settings
    from lava_ros.hindcast.score import Score
    from lava_ros.hindcast.several import Agreement

#: What a hindcast leaves in its folder.
RESULT, PICTURE, PAGE, BAG = 'hindcast.json', 'comparison.png', 'hindcast.html', 'bag'


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the `lava` parser."""
    parser = subparsers.add_parser(
        'hindcast',
        help='simulate a mapped eruption and compare',
        description='Simulate an eruption from a folder with elevation.asc, vent.csv, '
        'effusion_rate.csv, footprint.asc and maybe case.yaml (docs/VALIDATION.md), and compare '
        'what it covers with the footprint. A run that is cut off goes on when it is started '
        'again.',
    )
    parser.add_argument('case', metavar='CASE_DIR', help='folder of the case')
    parser.add_argument(
        '--preset', choices=tuple(PRESETS), default=DEFAULT, help='accuracy (default: %(default)s)'
    )
    parser.add_argument('--json', metavar='FILE', help='also write the numbers here')
    parser.add_argument(
        '-o',
        '--output',
        metavar='DIR',
        help='folder for maps, bag and page (default: hindcasts/<case>_<preset>)',
    )
    parser.add_argument('--device', help='cpu, cuda:0, ... (default: the first GPU, else the CPU)')
    parser.add_argument(
        '--material', metavar='NAME', help="lava in place of the case's (lava materials)"
    )
    parser.add_argument(
        '--low-pass',
        type=float,
        metavar='M',
        help='smooth the elevation with a Gaussian of this standard deviation [m]',
    )
    parser.add_argument(
        '--spacing', type=float, metavar='M', help="particles' distance [m], not the preset's"
    )
    parser.add_argument(
        '--runs',
        type=int,
        default=1,
        metavar='N',
        help='as many more runs, turned and mirrored: their scatter, and what at least half of '
        'them cover (from 2; 8 are all directions; default: none)',
    )
    parser.add_argument(
        '--maps', type=int, default=24, metavar='N', help='maps of the run (default: %(default)s)'
    )
    parser.add_argument('--on', action='append', default=[], metavar='EFFECT', help='force it on')
    parser.add_argument(
        '--off', action='append', default=[], metavar='EFFECT', help='force it off'
    )
    parser.add_argument(
        '--fresh', action='store_true', help='start anew where an unfinished run could go on'
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the hindcast.

    Raises:
        LavaError: The case, an argument or the output cannot be used.
    """
    from lava_ros.cli.progress import Progress
    from lava_ros.hindcast.case import load_case
    from lava_ros.hindcast.run import Run, Settings, UNFINISHED
    from lava_ros.hindcast.score import judge
    from lava_ros.plot import duration

    case = load_case(args.case, material=args.material, low_pass_width=args.low_pass)
    forced = {**dict.fromkeys(args.on, True), **dict.fromkeys(args.off, False)}
    settings = Settings(args.preset, args.spacing, args.device, forced, args.maps)
    output = Path(args.output or Path('hindcasts') / f'{case.name}_{args.preset}')
    _prepare(output)
    if args.json:
        # what cannot be written had better be known before
        validation.file_to_write('--json', args.json)
    unfinished = output / UNFINISHED
    if args.fresh:
        shutil.rmtree(unfinished, ignore_errors=True)
    hindcast = Run(case, settings, folder=unfinished)
    if hindcast.is_resumed:
        print(f'going on with the unfinished run in {output}', file=sys.stderr)
    with Progress() as progress:
        for share, _ in hindcast.snapshots():
            progress.show(duration(share * case.duration), share)
    result = hindcast.result()
    judged = judge(case, result.snapshot.thickness)
    several = _several(case, settings, args.runs, unfinished) if args.runs != 1 else None
    files = _write(case, settings, hindcast, result, judged, several, output)
    shutil.rmtree(unfinished, ignore_errors=True)
    data = as_dict(case, settings, result, judged)
    if several is not None:
        data['runs'] = several.as_dict()
    text = json.dumps(data, indent=1, allow_nan=False) + '\n'
    for path in [output / RESULT, *([Path(args.json)] if args.json else [])]:
        try:
            path.write_text(text, encoding='utf-8')
        except OSError as error:
            raise LavaError('--json', str(path), f'a file to write ({error})') from error
    _print(case, result, judged, several, [*files, output / RESULT])
    return 0


def _several(case: Case, settings: Settings, runs: int, unfinished: Path) -> Agreement:
    from lava_ros.cli.progress import Progress
    from lava_ros.hindcast.several import agreement, run_several

    with Progress() as progress:
        results = run_several(
            case,
            settings,
            runs,
            folder=unfinished / 'several',
            progress=lambda share: progress.show(f'{runs} runs', share),
        )
    return agreement(case, [result.snapshot.thickness for result in results])


def as_dict(case: Case, settings: Settings, result: Result, judged: Score) -> dict[str, Any]:
    """A hindcast as plain data."""
    from lava_ros.hindcast.score import judge

    snapshot, budget = result.snapshot, result.snapshot.budget
    return {
        'case': case.name,
        'title': case.title,
        'material': case.material.name if case.material is not None else None,
        'preset': settings.preset,
        'device': result.device,
        'simulated_s': snapshot.time,
        'score': judged.as_dict(),
        'jaccard_of_peak': judge(case, result.peak).jaccard,
        'volume': {**asdict(budget), 'error': budget.error},
        'wall_time_s': round(result.wall_time, 3),
        'steps': snapshot.steps.count,
        'evaluations': snapshot.steps.evaluations,
        'particles_at_most': result.most_particles,
        'particles_emitted': round(
            budget.emitted / (result.accuracy.spacing**2 * result.accuracy.thickness)  # type: ignore[operator]
        ),
        'effects': list(result.effects),
        'accuracy': asdict(result.accuracy),
        'resolution': {**asdict(result.resolution), 'footprint_error': result.resolution.error},
        'cell_m': case.scene.terrain.resolution * settings.coarseness(case),
        'lava': asdict(case.scene.lava),
        'vents': [asdict(vent) for vent in case.scene.vents],
        'low_pass_m': case.low_pass,
    }


def _prepare(output: Path) -> None:
    """Make the folder, and refuse one that holds something else."""
    from lava_ros.hindcast.run import UNFINISHED

    if output.is_dir() and any(output.iterdir()):
        names = {item.name for item in output.iterdir()}
        if not {RESULT, UNFINISHED} & names:
            right = 'a folder that is new, empty or of a hindcast'
            raise LavaError('--output', str(output), right)
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LavaError('--output', str(output), f'a folder to write to ({error})') from error
    validation.file_to_write('--output', output / PICTURE)


def _write(
    case: Case,
    settings: Settings,
    hindcast: Run,
    result: Result,
    judged: Score,
    several: Agreement | None,
    output: Path,
) -> list[Path]:
    from lava_ros.hindcast.maps import write_maps, write_share
    from lava_ros.hindcast.page import write_page
    from lava_ros.hindcast.picture import draw_comparison

    files = write_maps(case, result, output)
    picture, page = output / PICTURE, output / PAGE
    draw_comparison(case, result.snapshot.thickness, judged, picture)
    write_page(case, settings, result, judged, picture, page, several)
    if several is not None:
        files.append(write_share(case, several, output))
    return [*files, picture, page, *_write_bag(case, hindcast, result, output / BAG)]


def _write_bag(case: Case, hindcast: Run, result: Result, bag: Path) -> list[Path]:
    """Write the maps as a bag, where ROS 2 is installed."""
    try:
        from lava_ros.ros.snapshot_bag import write_snapshots
    except ImportError:
        print('lava hindcast: no bag: ROS 2 is not installed', file=sys.stderr)
        return []
    shutil.rmtree(bag, ignore_errors=True)
    try:
        write_snapshots(
            bag,
            case.scene,
            hindcast.kept(),
            custom_data={'device': result.device, 'case': case.name},
            terrains=[(event.time - case.start, event.terrain) for event in case.events],
        )
    except OSError as error:
        raise LavaError('output', str(bag), f'a folder to write to ({error})') from error
    return [bag]


def _print(
    case: Case, result: Result, judged: Score, several: Agreement | None, files: list[Path]
) -> None:
    from lava_ros.hindcast.page import facts, warnings

    print(case.title)
    for term, value in facts(judged, several).items():
        print(f'  {term:26} {value}')
    budget = result.snapshot.budget
    print(f'  {"volume unaccounted for":26} {budget.error:.1e}')
    print(f'  {"wall time":26} {result.wall_time:.1f} s on {result.device}')
    for item in warnings(case, result):
        print(f'lava hindcast: {item}', file=sys.stderr)
    print('\n'.join(f'written to {path}' for path in files))
