# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Commands with ROS 2: check of the installation, ROS domains, and a node as a child process."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from importlib.util import find_spec
import json
import os
from pathlib import Path
import random
import signal
import socket
import subprocess
import tempfile
from types import FrameType
from typing import Any, TYPE_CHECKING

from lava_ros import validation
from lava_ros.errors import RefusalError
from lava_ros.files.optional import INSTALL_ROS
from lava_ros.processes import child as processes

if TYPE_CHECKING:
    from lava_ros.scene import Scene, Terrain

#: Number of last lines of the log that are shown if a process fails.
SHOWN_LINES = 40


class ChildError(Exception):
    """A process ended unexpectedly or with an error; the message has the end of its log."""


class Child:
    """A Python module in a process of its own, which writes its output to a log file."""

    def __init__(
        self, name: str, module: str, *arguments: str, log: Path, env: Mapping[str, str]
    ) -> None:
        """Start the process."""
        self.name = name
        self._log = log
        _end_in_order()
        with log.open('wb') as output:
            self._child = processes.Child(
                'lava_ros.processes.program', module, *arguments, switches=['-u'], env=env,
                stdout=output, stderr=subprocess.STDOUT,
                # only the command gets Ctrl+C, and then ends its children in order
                start_new_session=True,
            )
        self._process = self._child.process

    def check(self) -> None:
        """Raise ChildError if the process has ended."""
        status = self._process.poll()
        if status is not None:
            raise ChildError(self.failure(f'ended by itself with status {status}'))

    def stop(self, timeout: float = 20.0) -> None:
        """Ask the process to end, and wait for at most ``timeout`` [s].

        Raises:
            ChildError: If the process does not end in time, or its status is not 0.
        """
        status = self.end(timeout)
        if status is None:
            raise ChildError(self.failure(f'did not end within {timeout:g} s'))
        if status != 0:
            raise ChildError(self.failure(f'ended with status {status}'))

    def end(self, timeout: float = 10.0) -> int | None:
        """Ask the process to end, kill it after a time [s]; return its status, None if killed."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
        try:
            return self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            return None

    def failure(self, what: str) -> str:
        """Describe a failure with the end of the log."""
        lines = self._log.read_text(errors='replace').splitlines()[-SHOWN_LINES:]
        shown = '\n'.join(f'    {line}' for line in lines) or '    (nothing)'
        return f'the {self.name} {what}; its log ends with\n{shown}'


def _end_in_order() -> None:
    """Let signals end the command like Ctrl+C, so that it ends its children."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        # leave the signal ignored under nohup
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _leave)


def _leave(number: int, _: FrameType | None) -> None:
    # a repeated signal must not interrupt the orderly end
    signal.signal(number, signal.SIG_IGN)
    raise SystemExit(128 + number)


def require_ros() -> None:
    """Check that the packages of ROS 2 are installed.

    Raises:
        LavaError: If a package is missing.
    """
    name = next((name for name in ('rclpy', 'nav_msgs') if find_spec(name) is None), None)
    if name is not None:
        problem = f'This command needs ROS 2: the Python package {name} is not installed'
        remedy = f'Source the setup file of ROS 2 Jazzy, or run {INSTALL_ROS}'
        raise RefusalError('ROS 2', problem, remedy)


def domain_of(chosen: int | None) -> int:
    """Return the ROS domain ``chosen``, or a free one for None.

    Raises:
        LavaError: If the number is not from 0 to 101, or no domain is free.
    """
    if chosen is not None:
        return validation.whole('--domain', chosen, at_least=0, at_most=101)
    for domain in random.SystemRandom().sample(range(1, 102), 101):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                # the port of the first participant
                probe.bind(('', 7410 + 250 * domain))
            except OSError:
                continue
            return domain
    problem = 'All ROS domains from 1 to 101 are in use'
    raise RefusalError('--domain', problem, 'Choose one with --domain')


@contextmanager
def running_node(scene: 'Scene', settings: Mapping[str, Any], domain: int) -> Iterator[Child]:
    """Start a node on a scene, print its domain, and end it afterwards."""
    print(f'ROS domain {domain}; to watch: ROS_DOMAIN_ID={domain} lava watch (or rviz2)')
    with tempfile.TemporaryDirectory(prefix='lava-node-') as folder:
        node = _started(scene, settings, domain, Path(folder))
        try:
            yield node
        finally:
            # gives the node time to finish its bag, even after a failure or Ctrl+C
            node.end()


def _save(path: Path, terrain: 'Terrain') -> None:
    import numpy as np

    from lava_ros.scene.terrain_files import barrier_tags

    names = (
        'elevation', 'resolution', 'origin', 'offset', 'source', 'epsg', 'wkt', 'sea_level',
    )
    grid = {name: getattr(terrain, name) for name in names} | barrier_tags(terrain)
    np.savez(path, **{k: v for k, v in grid.items() if v is not None})


def _started(scene: 'Scene', settings: Mapping[str, Any], domain: int, folder: Path) -> Child:
    from lava_ros.products.gis import Provenance, write_grid
    from lava_ros.scene import scene_to_dict

    _save(folder / 'terrain.npz', scene.terrain)
    plain = scene_to_dict(scene) | {'terrain': {'file': 'terrain.npz'}}
    if scene.emplaced_flows:
        plain['emplaced_flows'] = []
    for number, flow in enumerate(scene.emplaced_flows):
        # the bag contains the name of the file
        path = folder / f'flow_{number}' / f'{Path(flow.source).stem}.tif'
        path.parent.mkdir()
        cells = replace(
            scene.terrain, elevation=flow.thickness, resolution=flow.resolution,
            origin=flow.origin,
        )
        write_grid(path, 'thickness', cells.elevation, cells, Provenance('scene'))
        name = str(path.relative_to(folder))
        plain['emplaced_flows'].append({'file': name, 'temperature': flow.temperature})
    if scene.events:
        plain['events'] = []
    ground = scene.terrain
    for number, event in enumerate(scene.events):
        ground = event.ground(ground)
        _save(folder / f'event_{number}.npz', ground)
        plain['events'].append({'time': event.time, 'terrain': f'event_{number}.npz'})
    parameters = {**settings, 'scene': str(folder / 'scene.yaml')}
    # JSON is YAML
    (folder / 'scene.yaml').write_text(json.dumps(plain), encoding='utf-8')
    file = folder / 'parameters.yaml'
    file.write_text(json.dumps({'/**': {'ros__parameters': parameters}}), encoding='utf-8')
    return Child(
        'node', 'lava_ros.ros.node', '--ros-args', '--params-file', str(file),
        log=folder / 'node.log', env=os.environ | {'ROS_DOMAIN_ID': str(domain)},
    )
