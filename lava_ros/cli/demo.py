# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava ros demo`: a flow on a mountain."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from contextlib import closing, suppress
import os
from pathlib import Path
import sys
import time
from typing import Any, TYPE_CHECKING

from lava_ros import validation
from lava_ros.cli.console import flow_facts, print_facts, Progress, write_json
from lava_ros.cli.options import argument, command, output_option, seconds_of, shared
from lava_ros.cli.ros import ChildError, domain_of, require_ros, running_node
from lava_ros.cli.scene_options import SCENE
from lava_ros.errors import refusing

if TYPE_CHECKING:
    from lava_ros.scene import Scene

#: Default wall time of the flow [s]; a GPU would finish too fast to watch.
DEFAULT_WALL_TIME = 25.0

#: Limits of the node's time_scale.
SPEED_RANGE = (1e-3, 1e6)

#: Maximum time without progress of the node [s]; a first run compiles kernels.
PROGRESS_TIMEOUT = 120.0

#: Minimum wait for the numerical error at the end [s]; its process loads the solver.
MIN_ERROR_TIME = 15.0

#: Files in the folder of the bag.
RESULT, PICTURE = 'demo.json', 'demo.png'


@command(
    *SCENE,
    shared('--until', '12h', default='12h'),
    output_option(
        'DIR', 'bag to record; if it exists, a number is added to the name',
        'bags/demo',
    ),
    argument(
        '--max-speed', 'X', 'run at most X times as fast as real time (default: the speed '
        f'that takes {DEFAULT_WALL_TIME:g} s in all)', float,
    ),
    '--preset', '--spacing', '--device', '--domain', '--json',
)
def demo(args: argparse.Namespace) -> int:
    """Simulate a lava flow on a mountain, live in ROS 2, and record it.

    The command starts the node on a scene, receives its maps over DDS, records them in a bag,
    draws a picture of the last ones, and ends the node.
    """
    from lava_ros.cli.scenes import scene_from_arguments
    from lava_ros.products.pictures import draw_runs
    from lava_ros.scene.erupting_lava import EruptingLava
    from lava_ros.scene.onset import Onset

    require_ros()
    duration = seconds_of('--until', args.until)
    if args.spacing is not None:
        validation.number('--spacing', args.spacing, above=0.0, unit='m')
    slowest, fastest = SPEED_RANGE
    speed = min(max(duration / DEFAULT_WALL_TIME, slowest), fastest)
    if args.max_speed is not None:
        speed = validation.number(
            '--max-speed', args.max_speed, at_least=slowest, at_most=fastest
        )
    domain = domain_of(args.domain)
    # only this machine discovers the node
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    scene = scene_from_arguments(args)
    onset = Onset.of(scene)
    output = _unused(args.output)
    settings = {
        'record': True,
        'bag_directory': str(output),
        'preset': args.preset,
        'spacing': args.spacing or 0.0,
        'device': args.device or '',
        'onset': onset.text if onset else '',
        'epsg': scene.terrain.epsg or 0,
        'offset_easting': scene.terrain.offset[0],
        'offset_northing': scene.terrain.offset[1],
        'end_time': duration,
        'time_scale': speed,
        'horizon': duration / 3600.0,
    }
    started = time.monotonic()
    try:
        values, frames = _flow(scene, settings, domain, duration)
    except ChildError as error:
        print(f'lava ros demo: {error}', file=sys.stderr)
        return 1
    result = _result(values, speed) | {
        'height_maps_received': frames, 'erupting_lava': EruptingLava.of(scene).as_dict(),
    }
    draw_runs([output], output / PICTURE)
    result['wall_time_s'] = round(time.monotonic() - started, 2)
    result['bag'], result['picture'] = str(output), str(output / PICTURE)
    write_json(result, output / RESULT, args.json)
    _print_result(result)
    return 0


def _unused(name: str) -> Path:
    """Return a folder that does not exist, and print it if it has another name."""
    from lava_ros.runs.store import numbered

    expected = 'the name of a folder'
    with refusing('--output', name, expected, OSError), suppress(FileNotFoundError):
        os.lstat(name)
    output = next(path for path in numbered(Path(name)) if not os.path.lexists(path))
    if output != Path(name):
        print(f'{name} exists and is kept; this demo records to {output}')
    return output


def _flow(
    scene: Scene, parameters: dict[str, Any], domain: int, duration: float
) -> tuple[dict[str, str], int]:
    """Run the node until the flow has ended; return its last status and the number of maps.

    Raises:
        ChildError: If the node fails.
    """
    from lava_ros.clients.monitor import Monitor
    from lava_ros.layers.numbers import area_words
    from lava_ros.layers.numbers import duration as words

    with closing(Monitor(domain)) as monitor, running_node(scene, parameters, domain) as node:
        started = changed_at = time.monotonic()
        last = (0.0, '')
        with Progress() as progress:
            while not monitor.is_finished:
                monitor.listen(0.2)
                now, values = time.monotonic(), monitor.values('simulation')
                node.check()
                if monitor.error:
                    raise ChildError(node.failure(f'reports: {monitor.error}'))
                reached = float(values.get('simulated_time_s', 0.0))
                if (reached, values.get('state', '')) != last:
                    changed_at, last = now, (reached, values.get('state', ''))
                elif now - changed_at > PROGRESS_TIMEOUT:
                    raise ChildError(node.failure(f'made no progress for {PROGRESS_TIMEOUT:g} s'))
                text = values['message'] or 'starting'
                if reached > 0.0:
                    text = f'{words(reached)} · {values["particles"]} particles · '
                    text += f'{area_words(float(values["inundated_area_m2"]))} inundated'
                progress.show(text, reached / duration)
            # the end of the flow, measured by runs that take about an eighth of the time
            limit = time.monotonic() + max(MIN_ERROR_TIME, 0.25 * (time.monotonic() - started))
            progress.show('measuring the numerical error', 1.0)
            while time.monotonic() < limit and not _is_measured(monitor.values('simulation')):
                monitor.listen(0.2)
                node.check()
        node.stop()
        return monitor.values('simulation'), monitor.frames


def _is_measured(values: Mapping[str, str]) -> bool:
    """Return True if the numerical error is that of the end, or cannot be measured."""
    if ': ' in values.get('numerical_error', ''):
        return True
    return float(values.get('numerical_error_time_s', -1.0)) >= float(values['simulated_time_s'])


def _result(values: Mapping[str, str], max_speed: float) -> dict[str, Any]:
    from lava_ros.simulation.numerical_error import NOT_MEASURED
    from lava_ros.simulation.output.budget import VolumeBudget

    speed = float(values['mean_speed'])
    budget = VolumeBudget.from_texts(values)
    assert budget is not None
    return {
        'simulated_time_s': float(values['simulated_time_s']),
        'particles': int(values['particles']),
        'spacing_m': float(values['spacing_m']),
        'particles_across': float(values['particles_across']),
        'numerical_error_text': values.get('numerical_error', NOT_MEASURED),
        **{
            name: float(value) for name, value in values.items()
            if name.startswith('numerical_error_')
        },
        'inundated_area_m2': float(values['inundated_area_m2']),
        'standing_area_m2': float(values['standing_area_m2']),
        **{name: float(text) for name, text in budget.texts().items()},
        'warnings': budget.warnings_at_end(),
        'steps': int(values['steps']),
        'mean_speed': round(speed, 1),
        'speed_is_limited': speed > 0.85 * max_speed,
        'device': values['device'],
    }


def _print_result(result: dict[str, Any]) -> None:
    from lava_ros.layers.numbers import duration

    held = ' (limited so that you can watch: --max-speed X)' if result['speed_is_limited'] else ''
    print_facts([
        ('simulated time', duration(result['simulated_time_s'])),
        *flow_facts(result, result),
        ('mean speed', f'{result["mean_speed"]:,.0f} x real time{held}'),
        ('device', result['device']),
        ('maps over DDS', f'{result["height_maps_received"]} of height'),
        ('wall time', f'{result["wall_time_s"]:.1f} s'),
        ('bag', result['bag']),
        ('picture', result['picture']),
    ])
    for item in result['warnings']:
        print(f'lava ros demo: {item}', file=sys.stderr)
