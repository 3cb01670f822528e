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

"""`lava ensemble`: many runs of a scene that is uncertain, merged to maps of probability."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
import json
from pathlib import Path
import sys
import time
from typing import Any, TYPE_CHECKING

from lava_ros import presets, validation
from lava_ros.errors import LavaError

if TYPE_CHECKING:
    from lava_ros.forecast.ensemble import Ensemble
    from lava_ros.forecast.members import Plan
    from lava_ros.forecast.probability import HazardMaps

#: Folder of the bag in the output.
BAG = 'atlas'


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the `lava` parser."""
    parser = subparsers.add_parser(
        'ensemble',
        help='run a scene many times, and map how likely lava comes, and when',
        description='Draw what is uncertain about a scene (its section `uncertainty`) for each '
        'member, run the members on all cores or GPUs, and write the probability that lava comes, '
        'the times by which 10, 50 and 90 %% of the members had lava, and the expected thickness, '
        'as GeoTIFF and as a bag. The same command again goes on where it was interrupted; with '
        'more members it adds to them.',
    )
    parser.add_argument('scene', metavar='SCENE', help='scene file (YAML) with `uncertainty`')
    parser.add_argument(
        '-o', '--output', required=True, metavar='DIR',
        help='folder for members and maps: new, empty, or of the same ensemble',
    )
    parser.add_argument(
        '--members', type=int, default=64, metavar='N', help='members (default: %(default)s)'
    )
    parser.add_argument(
        '--horizon', default='6h', metavar='TIME',
        help='how far ahead each runs: 6h, 90min (default: %(default)s)',
    )
    parser.add_argument(
        '--preset', default='draft', metavar='NAME', help='accuracy (default: %(default)s)'
    )
    parser.add_argument('--seed', type=int, default=0, metavar='N', help='draw other members')
    parser.add_argument(
        '--susceptibility', metavar='FILE',
        help='raster of where the vent may open, in place of its position',
    )
    parser.add_argument(
        '--observed', metavar='FILE',
        help='raster of where lava was seen (above 0): members weigh by how well they agree',
    )
    parser.add_argument(
        '--observed-at', metavar='TIME', help='when that was, after the start of the scene'
    )
    parser.add_argument(
        '--threshold', type=float, default=0.1, metavar='M',
        help='thickness from which on lava has come [m] (default: %(default)s)',
    )
    parser.add_argument(
        '--workers', type=int, metavar='N',
        help='processes (default: one for each GPU, else for each core)',
    )
    parser.add_argument(
        '--scheduler', metavar='ADDRESS', help='a Dask scheduler to use, tcp://host:8786'
    )
    parser.add_argument('--device', help='cpu, cuda:0, ... (default: the first GPU, else the CPU)')
    parser.add_argument('--json', metavar='FILE', help='also write what came of it to a file')
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the ensemble.

    Raises:
        LavaError: An argument or a file cannot be used, or a member fails.
    """
    from lava_ros.cli.durations import seconds_of
    from lava_ros.cli.progress import Progress
    from lava_ros.forecast.atlas import write_report
    from lava_ros.forecast.ensemble import run_ensemble
    from lava_ros.forecast.members import check_members, make_plan
    from lava_ros.forecast.rasters import outline_from_file, susceptibility_from_file
    from lava_ros.forecast.sampling import draw_members
    from lava_ros.forecast.store import Store
    from lava_ros.geotiff import require_rasterio
    from lava_ros.scene import scene_from_yaml

    horizon = seconds_of('--horizon', args.horizon)
    if (args.observed is None) != (args.observed_at is None):
        raise LavaError('--observed-at', args.observed_at, 'a time beside --observed, not without')
    require_rasterio(args.output)
    if args.json:
        # what cannot be written had better be known before the members have run
        validation.file_to_write('--json', args.json)
    scene = scene_from_yaml(args.scene)
    susceptibility = None
    if args.susceptibility is not None:
        susceptibility = susceptibility_from_file(args.susceptibility, scene.terrain)
    outline = None
    if args.observed is not None:
        seen = seconds_of('--observed-at', args.observed_at)
        outline = outline_from_file(args.observed, scene.terrain, seen)
    members = draw_members(
        scene, args.members, seed=args.seed, susceptibility=susceptibility
    )
    check_members(scene, members)
    plan = make_plan(
        scene,
        horizon=horizon,
        accuracy=presets.preset_accuracy(args.preset),
        threshold=args.threshold,
    )
    runner, where = _runner(args)
    store = Store(args.output, plan, seed=args.seed, susceptibility=susceptibility)
    started = time.monotonic()
    with _resumable(), Progress() as progress:
        progress.show('members begin', 0.0)
        ensemble = run_ensemble(
            plan,
            members,
            store,
            runner=runner,
            outline=outline,
            on_finished=lambda done, resumed: progress.show(
                f'{done} of {len(members)} members', (done - resumed) / (len(members) - resumed)
            ),
            on_maps=lambda maps: _write_maps(args, plan, maps),
        )
    wall = time.monotonic() - started
    report = _report(args, plan, ensemble, wall, where)
    report['files'] = _write(args, plan, ensemble, report)
    if args.json:
        write_report(args.json, report)
    _print(report)
    return 0


@contextmanager
def _resumable() -> Iterator[None]:
    try:
        yield
    except KeyboardInterrupt:
        print('lava ensemble: interrupted; the same command goes on from here', file=sys.stderr)
        raise


def _runner(args: argparse.Namespace) -> tuple[Any, dict[str, Any]]:
    """What runs the members, and how to say so."""
    import warp as wp

    from lava_ros.forecast.cluster import DaskRunner, default_workers
    from lava_ros.forecast.ensemble import run_here
    import lava_ros.simulation  # noqa: F401  (quietens Warp)

    if args.device is not None and args.scheduler is None:
        validation.choice('--device', args.device, [str(item) for item in wp.get_devices()])
    device = args.device or str(wp.get_preferred_device())
    workers = args.workers
    if workers is not None:
        workers = int(validation.number('--workers', workers, at_least=1, at_most=1024))
        if args.scheduler is not None:
            raise LavaError('--workers', workers, 'absent beside --scheduler, which has its own')
    if args.scheduler is not None:
        runner = DaskRunner(scheduler=args.scheduler, device=args.device)
        return runner, {'scheduler': args.scheduler, 'device': args.device}
    if workers is None:
        # one that is named is shared by nobody
        workers = 1 if args.device not in (None, 'cpu') else default_workers()
    where = {'workers': workers, 'device': device}
    if workers == 1:
        return lambda plan, members: run_here(plan, members, device=args.device), where
    return DaskRunner(workers=workers, device=args.device), where


def _report(
    args: argparse.Namespace, plan: Plan, ensemble: Ensemble, wall: float, where: dict[str, Any]
) -> dict[str, Any]:
    import numpy as np

    maps, area = ensemble.maps, plan.scene.terrain.resolution**2
    ran = maps.members - ensemble.resumed
    likely = np.nan_to_num(maps.probability)
    report: dict[str, Any] = {
        'members': maps.members,
        'resumed': ensemble.resumed,
        'effective_members': maps.effective_members,
        'sampling_error_percent': maps.sampling_error,
        'horizon_s': plan.horizon,
        'arrival_error_s': maps.arrival_error,
        'threshold_m': plan.threshold,
        'preset': args.preset,
        'seed': args.seed,
        **where,
        'wall_s': wall,
        'members_per_s': ran / wall if ran else None,
        'area_m2': {
            f'at least {percent} %': float((likely >= percent).sum() * area)
            for percent in (10, 50, 90)
        },
    }
    if ensemble.weights is not None:
        weights = ensemble.weights
        report['observed'] = {
            'jaccard_mean': float(weights.jaccard.mean()),
            'jaccard_best': float(weights.jaccard.max()),
            'sharpness': weights.sharpness,
        }
    return report


def _write(
    args: argparse.Namespace, plan: Plan, ensemble: Ensemble, report: dict[str, Any]
) -> list[str]:
    """Write the maps, and name the files."""
    files = _write_maps(args, plan, ensemble.maps)
    if any(find_spec(name) is None for name in ('rclpy', 'nav_msgs')):
        print(
            "lava ensemble: no bag without ROS 2; pip install 'lava_ros[ros]' brings it",
            file=sys.stderr,
        )
        return files
    from lava_ros.ros.atlas_bag import write_atlas_bag

    bag = Path(args.output) / BAG
    write_atlas_bag(
        bag,
        ensemble.maps,
        plan,
        stamp_ns=time.time_ns(),
        custom_data={'ensemble': json.dumps(report)},
    )
    return [*files, str(bag)]


def _write_maps(args: argparse.Namespace, plan: Plan, maps: HazardMaps) -> list[str]:
    from lava_ros.forecast.atlas import write_atlas

    tags = {'scene': Path(args.scene).name, 'seed': str(args.seed), 'preset': args.preset}
    return [str(path) for path in write_atlas(Path(args.output), maps, plan, tags)]


def _print(report: dict[str, Any]) -> None:
    ran = report['members'] - report['resumed']
    pace = f', {report["members_per_s"]:.3g} a second' if ran else ''
    print(f'{ran} members run in {report["wall_s"]:.0f} s{pace}, {report["resumed"]} there before')
    print(
        f'probability from {report["members"]} members'
        + (
            f' that count like {report["effective_members"]:.1f}; they agree in '
            f'{100 * report["observed"]["jaccard_mean"]:.0f} % on average with what was seen'
            if 'observed' in report
            else ''
        )
        + f': within {report["sampling_error_percent"]:.2g} percentage points at even odds'
    )
    print(f'arrival times within {report["arrival_error_s"]:g} s')
    for name, area in report['area_m2'].items():
        print(f'{name:>13}: {1e-6 * area:8.3f} km2')
    print('\n'.join(f'written to {path}' for path in report['files']))
