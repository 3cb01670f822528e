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

"""Where the node's first scene comes from: a file, a bag, or the topics."""

from dataclasses import dataclass
from pathlib import Path

from rclpy.node import Node

from lava_ros.bag.checkpoints import newest_checkpoint
from lava_ros.checkpoint import Checkpoint
from lava_ros.errors import LavaError
from lava_ros.lava import Lava
from lava_ros.ros import parameters
from lava_ros.ros.eruption import Origin
from lava_ros.scene import Scene, scene_from_yaml, Terrain
from lava_ros.terrain_files import load_terrain


@dataclass(frozen=True)
class Sources:
    """What a node starts with; with nothing it waits for the topics.

    Attributes:
        scene: The scene, that of the checkpoint where there is one.
        terrain: Terrain without a scene.
        checkpoint: What to go on from.
        origin: Where that has been found.
    """

    scene: Scene | None = None
    terrain: Terrain | None = None
    checkpoint: Checkpoint | None = None
    origin: Origin | None = None

    @property
    def lava(self) -> Lava:
        """The material, and the default of the parameters ``lava.*``."""
        return self.scene.lava if self.scene is not None else Lava()


def load_sources(node: Node) -> Sources:
    """Declare the parameters that say where the scene comes from, and load what they name.

    Raises:
        LavaError: A file or a bag is not usable, or there is a scene beside a bag to resume.
    """
    values = parameters.declare(node, parameters.SOURCES)
    if values['resume']:
        for name in ('scene', 'terrain_file'):
            if values[name]:
                right = 'left out beside resume: the checkpoint has it'
                raise LavaError(name, values[name], right)
        return _resumed(node, values['resume'])
    terrain = load_terrain(values['terrain_file']) if values['terrain_file'] else None
    if not values['scene']:
        return Sources(terrain=terrain)
    return Sources(scene=scene_from_yaml(values['scene'], terrain=terrain))


def _resumed(node: Node, bag: str) -> Sources:
    found = newest_checkpoint(bag)
    for error in found.refused:
        node.get_logger().warning(f'a newer checkpoint cannot be used: {error}')
    checkpoint = found.checkpoint
    node.get_logger().info(
        f'going on at {checkpoint.time:.3f} s simulated with {checkpoint.particle_count} '
        f'particles, from a checkpoint of lava_ros {checkpoint.written_by} in {bag}'
    )
    origin = Origin(str(Path(bag).absolute()), checkpoint.time, found.log_time_ns)
    return Sources(scene=checkpoint.scene, checkpoint=checkpoint, origin=origin)
