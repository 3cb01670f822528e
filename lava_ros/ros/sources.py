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

"""What a node starts with: a scene, a terrain or a bag to resume; and the simulation of it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
import math
from pathlib import Path
from typing import Any, TYPE_CHECKING

from rclpy.node import Node

from lava_ros.bag import BagReader
from lava_ros.bag.checkpoints import newest_checkpoint
from lava_ros.errors import LavaError
from lava_ros.files.yaml import parse_yaml
from lava_ros.ros import parameters
from lava_ros.ros.deadline import DeadlineChooser
from lava_ros.ros.parameters import constant_values, Settings
from lava_ros.ros.session import Origin
from lava_ros.scene import constants_of, Scene, scene_from_yaml, Terrain, Vent, vents_from_list
from lava_ros.scene.terrain_files import load_terrain
from lava_ros.simulation.checkpoint import Checkpoint
from lava_ros.simulation.presets import PRESETS
from lava_ros.simulation.resolution import resolved_accuracy

if TYPE_CHECKING:
    from lava_ros.simulation import Simulation


@dataclass(frozen=True)
class Sources:
    """What a node starts with; with nothing it waits for the topics.

    Attributes:
        scene: The scene, that of the checkpoint where there is one.
        terrain: Terrain without a scene.
        checkpoint: What to go on from.
        origin: Where that has been found.
        before: The vents up to then, with all they have emitted, as far as its bag says.
    """

    scene: Scene | None = None
    terrain: Terrain | None = None
    checkpoint: Checkpoint | None = None
    origin: Origin | None = None
    before: tuple[Vent, ...] = ()

    @property
    def constants(self) -> dict[str, Any]:
        """Lava and surroundings, and the defaults of their parameters."""
        return constants_of(self.scene)


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
    before = _vents_of(bag, checkpoint.scene.terrain)
    return Sources(scene=checkpoint.scene, checkpoint=checkpoint, origin=origin, before=before)


def _vents_of(bag: str, terrain: Terrain) -> tuple[Vent, ...]:
    """What a bag says of its vents, nothing where that cannot be used."""
    try:
        scene = parse_yaml('scene', BagReader(bag).custom_data.get('scene', ''))
        listed = scene['vents'] if isinstance(scene, Mapping) else []
        return vents_from_list(listed, terrain)
    except (LavaError, KeyError):
        return ()


def adopted(
    checkpoint: Checkpoint, values: Mapping[str, Any], defaults: Mapping[str, Any]
) -> dict[str, Any]:
    """The parameters that a checkpoint sets in place of their defaults, by name.

    ``values`` are the parameters as given, ``defaults`` their defaults.

    Raises:
        LavaError: A parameter was given and contradicts the checkpoint.
    """
    result = {}
    for name, decided in _decided(checkpoint).items():
        if _is_same(values[name], decided):
            continue
        if not _is_same(values[name], defaults[name]):
            right = f'{decided!r} as in the checkpoint, or left out beside resume'
            raise LavaError(name, values[name], right)
        result[name] = decided
    return result


def _decided(checkpoint: Checkpoint) -> dict[str, Any]:
    """The parameters that what is resumed has been made with, by name."""
    forced = checkpoint.forced or {}
    # ROS writes an empty list of texts as one empty text
    result: dict[str, Any] = {
        'effects_on': [name for name in forced if forced[name]] or [''],
        'effects_off': [name for name in forced if not forced[name]] or [''],
        'horizon': checkpoint.horizon / 3600.0,
        **constant_values(constants_of(checkpoint.scene)),
    }
    accuracy, scene = checkpoint.accuracy, checkpoint.scene
    for name, preset in PRESETS.items():
        own = replace(preset.accuracy, spacing=accuracy.spacing, thickness=accuracy.thickness)
        if own == accuracy:
            automatic = resolved_accuracy(preset.accuracy, scene, horizon=checkpoint.horizon)
            result['preset'] = name
            result['spacing'] = 0.0 if automatic.spacing == accuracy.spacing else accuracy.spacing
    return result


def _is_same(one: Any, other: Any) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-12)
    if isinstance(one, list | tuple) or isinstance(other, list | tuple):
        return {*(one or ()), ''} == {*(other or ()), ''}
    return bool(one == other)


def new_simulation(
    scene: Scene, settings: Settings, chooser: DeadlineChooser
) -> 'Simulation':
    """Make a simulation of a scene at time 0; LavaError where the settings do not suit it."""
    from lava_ros.simulation import Simulation

    return Simulation(
        scene,
        accuracy=chooser.accuracy(scene, settings),
        device=settings.device,
        effects=settings.forced,
        horizon=settings.horizon,
        notes_arrival=True,
    )


def resumed_simulation(checkpoint: Checkpoint, settings: Settings) -> 'Simulation':
    """A simulation that goes on from a checkpoint; LavaError where it does not fit together."""
    from lava_ros.simulation import Simulation

    return Simulation.resume(checkpoint, device=settings.device)
