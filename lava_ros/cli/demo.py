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

"""`lava demo`: lava flowing down real terrain in a real ROS 2 graph, from one command."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
import random
import socket
import sys
import tempfile
import time
from typing import Any, TYPE_CHECKING

import numpy as np
import yaml

from lava_ros import validation
from lava_ros.cli.children import Child, ChildError
from lava_ros.cli.ros import require_ros
from lava_ros.cli.scenes import add_scene_arguments, scene_from_arguments
from lava_ros.errors import LavaError
from lava_ros.presets import DEFAULT, PRESETS
from lava_ros.scene import Scene, scene_to_dict

if TYPE_CHECKING:
    from lava_ros.ros.monitor import Monitor, Observation

#: Simulated time of the demo [s].
DURATION = 3.0 * 3600.0

#: Shortest the flow may take [s]: a GPU would be done before anybody saw it.
LEAST_WALL_TIME = 25.0

#: What the node takes as time_scale.
SPEED_RANGE = (1e-3, 1e6)

#: Silence of the node after which it is taken for dead [s]; a first run compiles before it speaks.
LONGEST_SILENCE = 120.0

#: What the demo leaves in the bag's folder beside the bag; the first marks it as the demo's own.
RESULT, PICTURE = 'demo.json', 'demo.png'


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the `lava` parser."""
    parser = subparsers.add_parser(
        'demo',
        help='let lava flow down a mountain, live in ROS 2, and record it',
        description='Start the node on a scene, watch the flow over DDS, record it, draw it, '
        'and end.',
    )
    add_scene_arguments(parser)
    parser.add_argument(
        '--duration',
        type=float,
        default=DURATION,
        metavar='S',
        help=f'simulated time [s] (default: {DURATION:g})',
    )
    parser.add_argument(
        '--output',
        default='bags/demo',
        metavar='DIR',
        help='bag to record; an earlier demo there is replaced (default: bags/demo)',
    )
    parser.add_argument('--json', metavar='FILE', help='also write the result here')
    parser.add_argument('--device', help='cpu, cuda:0, ... (default: the first GPU, else the CPU)')
    parser.add_argument(
        '--preset',
        choices=tuple(PRESETS),
        default=DEFAULT,
        help=f'accuracy (default: {DEFAULT})',
    )
    parser.add_argument(
        '--spacing',
        type=float,
        metavar='M',
        help="distance between particles [m] in place of the preset's",
    )
    parser.add_argument(
        '--max-speed',
        type=float,
        metavar='X',
        help=f'run at most X times as fast as real time (default: {LEAST_WALL_TIME:g} s in all)',
    )
    parser.add_argument(
        '--domain', type=int, help='ROS domain to run in (default: a free one, isolated)'
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the demo.

    Returns:
        0, or 1 when the node fails.

    Raises:
        LavaError: An argument cannot be used, or ROS 2 is not installed.
    """
    require_ros()
    duration = validation.number('--duration', args.duration, above=0.0, unit='s')
    spacing = args.spacing
    if spacing is not None:
        spacing = validation.number('--spacing', spacing, above=0.0, unit='m')
    speed = min(max(duration / LEAST_WALL_TIME, SPEED_RANGE[0]), SPEED_RANGE[1])
    if args.max_speed is not None:
        low, high = SPEED_RANGE
        speed = validation.number('--max-speed', args.max_speed, at_least=low, at_most=high)
    if args.domain is not None:
        validation.number('--domain', args.domain, at_least=0.0, at_most=101.0)
    scene = scene_from_arguments(args)
    if args.json:
        # what cannot be written had better be known before
        validation.file_to_write('--json', args.json)
    output = Path(args.output)
    _remove_earlier_demo(output)
    domain = free_domain() if args.domain is None else args.domain
    settings = _node_parameters(scene, output, spacing, args.device)
    settings['preset'] = args.preset
    settings |= {'end_time': duration, 'time_scale': speed, 'horizon': duration / 3600.0}
    started = time.monotonic()
    try:
        seen = _flow(scene, settings, domain, duration)
    except ChildError as error:
        print(f'lava demo: {error}', file=sys.stderr)
        return 1
    finally:
        # Whatever happened, what lies there now is the demo's to replace.
        if output.is_dir():
            (output / RESULT).write_text('{}\n', encoding='utf-8')
    result = _result(seen, speed)
    _draw(output)
    result['wall_time'] = round(time.monotonic() - started, 2)
    result['bag'], result['picture'] = str(output), str(output / PICTURE)
    text = json.dumps(result, indent=2) + '\n'
    (output / RESULT).write_text(text, encoding='utf-8')
    if args.json:
        try:
            Path(args.json).write_text(text, encoding='utf-8')
        except OSError as error:
            raise LavaError('--json', args.json, f'a file to write ({error})') from error
    _print_table(result)
    return 0


def _remove_earlier_demo(output: Path) -> None:
    """Make room for the bag, without touching what no demo made.

    Raises:
        LavaError: There is something else.
    """
    if not output.exists():
        return
    own = {RESULT, PICTURE, 'metadata.yaml'}
    names = {item.name for item in output.iterdir()} if output.is_dir() else set()
    foreign = {name for name in names - own if not name.endswith('.mcap')}
    if RESULT not in names or foreign:
        raise LavaError(
            '--output', str(output), 'a folder that does not exist, or that an earlier demo made'
        )
    for name in names:
        (output / name).unlink()
    output.rmdir()


def free_domain() -> int:
    """A ROS domain nobody on this machine uses: its first participant's port is free."""
    for domain in random.SystemRandom().sample(range(1, 102), 101):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(('', 7410 + 250 * domain))
            except OSError:
                continue
            return domain
    raise LavaError('--domain', None, 'a ROS domain from 1 to 101: all are in use')


def _node_parameters(
    scene: Scene, output: Path, spacing: float | None, device: str | None
) -> dict[str, Any]:
    terrain = scene.terrain
    return {
        'record': True,
        'bag_directory': str(output),
        'spacing': spacing or 0.0,
        'device': device or '',
        'epsg': terrain.epsg or 0,
        'offset_easting': terrain.offset[0],
        'offset_northing': terrain.offset[1],
    }


def _write_scene(scene: Scene, folder: Path) -> dict[str, str]:
    """Write a scene for the node; returns the parameters that name its files."""
    terrain = scene.terrain
    grid: dict[str, Any] = {'elevation': terrain.elevation, 'resolution': terrain.resolution}
    grid |= {'origin': terrain.origin, 'offset': terrain.offset}
    if terrain.epsg is not None:
        grid['epsg'] = terrain.epsg
    np.savez(folder / 'terrain.npz', **grid)
    plain = scene_to_dict(scene) | {'terrain': {'file': 'terrain.npz'}}
    # JSON is YAML
    (folder / 'scene.yaml').write_text(json.dumps(plain), encoding='utf-8')
    return {'scene': str(folder / 'scene.yaml')}


def _flow(
    scene: Scene, parameters: dict[str, Any], domain: int, duration: float
) -> Observation:
    """Run the node until the flow has reached its end.

    Returns:
        What was heard last.

    Raises:
        ChildError: The node failed.
    """
    from lava_ros.ros.monitor import Monitor

    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    env = os.environ | {'ROS_DOMAIN_ID': str(domain)}
    print(f'ROS domain {domain}; to watch: ROS_DOMAIN_ID={domain} rviz2')
    with tempfile.TemporaryDirectory(prefix='lava-demo-') as folder:
        path = Path(folder)
        parameters = parameters | _write_scene(scene, path)
        document = {'/**': {'ros__parameters': parameters}}
        (path / 'parameters.yaml').write_text(yaml.safe_dump(document), encoding='utf-8')
        node = None
        monitor = Monitor(domain)
        try:
            arguments = ['--ros-args', '--params-file', str(path / 'parameters.yaml')]
            node = Child('node', 'lava_ros.ros.node', arguments, log=path / 'node.log', env=env)
            watched = _watch(monitor, node, duration)
            node.stop()
            return watched
        finally:
            monitor.close()
            # After a failure or Ctrl+C the node still gets the time to finish its bag.
            if node is not None:
                node.end()


def _watch(monitor: Monitor, node: Child, duration: float) -> Observation:
    """Show the progress until the flow has reached its end."""
    heard_at, heard = time.monotonic(), (0.0, '')
    with _Progress(duration) as progress:
        while True:
            seen = monitor.observe(0.2)
            now = time.monotonic()
            node.check()
            if seen.has_failed or seen.recorder_error or seen.refused:
                reason = seen.recorder_error or seen.refused or seen.message
                raise ChildError(node.failure(f'reports: {reason}'))
            if (seen.time, seen.state) != heard:
                heard_at, heard = now, (seen.time, seen.state)
            elif now - heard_at > LONGEST_SILENCE:
                raise ChildError(node.failure(f'made no progress for {LONGEST_SILENCE:g} s'))
            progress.show(seen)
            if seen.is_finished:
                return seen


class _Progress:
    """A bar in a terminal, a line for every tenth elsewhere."""

    def __init__(self, duration: float) -> None:
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        self._duration = duration
        self._tenths = -1
        self._is_terminal = sys.stdout.isatty()
        self._progress = Progress(
            TextColumn('{task.description}'),
            BarColumn(bar_width=None),
            TextColumn('{task.percentage:3.0f} %'),
            TimeRemainingColumn(compact=True),
            disable=not self._is_terminal,
            transient=True,
        )
        self._task = self._progress.add_task('starting', total=duration)

    def __enter__(self) -> _Progress:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def show(self, seen: Observation) -> None:
        """Show how far the flow is."""
        from lava_ros.plot import duration as words

        values = seen.values
        if seen.time > 0.0:
            text = f'{words(seen.time)} · {values["particles"]} particles · '
            text += f'{values["wet_cells"]} wet cells'
        else:
            text = seen.message or 'starting'
        self._progress.update(self._task, completed=seen.time, description=text)
        tenths = int(10.0 * seen.time / self._duration)
        if not self._is_terminal and tenths > self._tenths:
            self._tenths = tenths
            print(f'{10 * tenths:3d} %  {text}', flush=True)


def _result(seen: Observation, max_speed: float) -> dict[str, Any]:
    values = seen.values
    speed = float(values['mean_speed'])
    return {
        'simulated_time': seen.time,
        'particles': int(values['particles']),
        'spacing_m': float(values['spacing_m']),
        'particles_across': float(values['particles_across']),
        'footprint_error': float(values['footprint_error']),
        'wet_cells': int(values['wet_cells']),
        'volume_emitted': float(values['volume_emitted_m3']),
        'volume_held': float(values['volume_held_m3']),
        'volume_pending': float(values['volume_pending_m3']),
        'volume_left': float(values['volume_left_m3']),
        'volume_frozen': float(values['volume_frozen_m3']),
        'volume_error': float(values['volume_error']),
        'steps': int(values['steps']),
        'speed': round(speed, 1),
        'speed_is_limited': speed > 0.85 * max_speed,
        'device': values['device'],
        'height_maps_received': seen.frames,
    }


def _draw(output: Path) -> None:
    from lava_ros.frames import read_frame
    from lava_ros.plot import plot_frame

    plot_frame(read_frame(output), output / PICTURE)


def _print_table(result: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    from lava_ros.plot import duration as words

    held = ' (held back to watch: --max-speed)' if result['speed_is_limited'] else ''
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style='bold')
    for name, value in (
        ('simulated time', words(result['simulated_time'])),
        ('particles', f'{result["particles"]:,}, {result["spacing_m"]:.3g} m apart'),
        ('particles across the flow', f'{result["particles_across"]:.2g}'),
        ('expected error of the footprint', f'{100.0 * result["footprint_error"]:.2g} %'),
        ('wet cells', f'{result["wet_cells"]:,}'),
        ('volume emitted', f'{result["volume_emitted"]:,.1f} m3'),
        ('volume held', f'{result["volume_held"]:,.1f} m3'),
        ('volume error', f'{result["volume_error"]:.1e}'),
        ('speed', f'{result["speed"]:,.0f} x real time{held}'),
        ('device', result['device']),
        ('maps over DDS', f'{result["height_maps_received"]} of height'),
        ('wall time', f'{result["wall_time"]:.1f} s'),
        ('bag', result['bag']),
        ('picture', result['picture']),
    ):
        table.add_row(name, str(value))
    Console(highlight=False, width=None if sys.stdout.isatty() else 100).print(table)
