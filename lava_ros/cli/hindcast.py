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

"""`lava hindcast`: a mapped eruption, simulated and compared."""

import argparse
from dataclasses import asdict, replace
from pathlib import Path
import shutil
import sys
from typing import Any

from lava_ros import validation
from lava_ros.cli.options import argument, command, forced_effects
from lava_ros.cli.output import made_folder, Progress, write_json
from lava_ros.cli.scenes import vent_arguments, vents_as_given
from lava_ros.errors import LavaError
from lava_ros.files import file_to_write
from lava_ros.hindcast.case import Case, load_case
from lava_ros.hindcast.page import draw_comparison, facts, warnings, write_maps, write_page
from lava_ros.hindcast.replicates import Agreement, agreement, MOST, run_replicates
from lava_ros.hindcast.run import Result, Run, Settings, UNFINISHED
from lava_ros.hindcast.score import covered_by, judge, Score
from lava_ros.hindcast.tables import VentRow
from lava_ros.maps.plot import duration
from lava_ros.scene import Terrain

#: What a hindcast leaves in its folder.
RESULT, PICTURE, PAGE, BAG = 'hindcast.json', 'comparison.png', 'hindcast.html', 'bag'


@command(
    argument('case', metavar='CASE_DIR', help='folder of the case'),
    '--preset', '--spacing', '--device', '--low-pass', '--on', '--off', '--fresh', '--json',
    argument(
        '-o', '--output', metavar='DIR',
        help='folder for maps, bag and page (default: hindcasts/<case>_<preset>)',
    ),
    *vent_arguments('case'),
    argument(
        '--runs', type=int, default=1, metavar='N',
        help='make N more runs, rotated and mirrored, and report their scatter and the area that '
        'at least half of them cover; from 2 to 8, which are all directions (default: none)',
    ),
    argument(
        '--maps', type=int, default=24, metavar='N',
        help='number of maps of the run (default: %(default)s)',
    ),
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
    hindcast = Run(case, settings, folder=unfinished)
    if hindcast.is_resumed:
        print(f'continuing the unfinished run in {output}', file=sys.stderr)
    with Progress() as progress:
        for share, _ in hindcast.snapshots():
            progress.show(duration(share * case.duration), share)
    result = hindcast.result()
    judged = judge(case, result.snapshot.thickness, covered_by(result.snapshot))
    several = _several(case, settings, runs, unfinished) if runs > 1 else None
    files = _write(case, settings, hindcast, result, judged, several, output)
    shutil.rmtree(unfinished, ignore_errors=True)
    data = as_dict(case, settings, result, judged)
    if several is not None:
        data['runs'] = several.as_dict()
    write_json(data, output / RESULT, args.json)
    _print(case, result, judged, several, [*files, output / RESULT])
    return 0


def _vents(
    args: argparse.Namespace, rows: tuple[VentRow, ...], ground: Terrain
) -> tuple[VentRow, ...]:
    given = vents_as_given(args, ground)
    if not given:
        return tuple(replace(row, discharge=args.discharge) for row in rows)
    is_own = [vent.discharge is not None for vent in given]
    if any(is_own) and not all(is_own):
        right = 'one for every vent, or for none'
        raise LavaError(f'discharge of {given[is_own.index(False)].name!r}', None, right)
    return tuple(given)


def _several(case: Case, settings: Settings, runs: int, unfinished: Path) -> Agreement:
    with Progress() as progress:
        results = run_replicates(
            case,
            settings,
            runs,
            folder=unfinished / 'several',
            progress=lambda share: progress.show(f'{runs} runs', share),
        )
    return agreement(case, [result.snapshot for result in results])


def as_dict(case: Case, settings: Settings, result: Result, judged: Score) -> dict[str, Any]:
    """A hindcast as plain data."""
    snapshot, budget = result.snapshot, result.snapshot.budget
    return {
        'case': case.name,
        'title': case.title,
        'material': case.material.name if case.material is not None else None,
        'preset': settings.preset,
        'device': result.device,
        'simulated_s': snapshot.time,
        'score': judged.as_dict(),
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
    if output.is_dir() and any(output.iterdir()):
        names = {item.name for item in output.iterdir()}
        if not {RESULT, UNFINISHED} & names:
            right = 'a folder that is new, empty or of a hindcast'
            raise LavaError('--output', str(output), right)
    file_to_write('--output', made_folder(output) / PICTURE)


def _write(
    case: Case,
    settings: Settings,
    hindcast: Run,
    result: Result,
    judged: Score,
    several: Agreement | None,
    output: Path,
) -> list[Path]:
    files = write_maps(case, result, output, several)
    picture, page = output / PICTURE, output / PAGE
    draw_comparison(case, result.snapshot, judged, picture)
    write_page(case, settings, result, judged, picture, page, several)
    return [*files, picture, page, *_write_bag(case, hindcast, result, output / BAG)]


def _write_bag(case: Case, hindcast: Run, result: Result, bag: Path) -> list[Path]:
    try:
        from lava_ros.ros.offline_bags import write_snapshots
    except ImportError:
        print('lava hindcast: wrote no bag, which needs ROS 2', file=sys.stderr)
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
    print(case.title)
    for term, value in facts(judged, several).items():
        print(f'  {term:26} {value}')
    for term, value in result.snapshot.budget.rows():
        print(f'  {"volume " + term:26} {value}')
    print(f'  {"wall time":26} {result.wall_time:.1f} s on {result.device}')
    for item in warnings(case, result):
        print(f'lava hindcast: {item}', file=sys.stderr)
    print('\n'.join(f'written to {path}' for path in files))
