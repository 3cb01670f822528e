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

"""Parameters of a node that resumes: they say what the checkpoint says, or contradict it."""

from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
import math
from typing import Any

from rclpy.node import Node

from lava_ros.checkpoint import Checkpoint
from lava_ros.errors import LavaError
from lava_ros.lava import Lava
from lava_ros.presets import PRESETS
from lava_ros.resolution import resolved_accuracy
from lava_ros.ros.parameters import LAVA, ParameterSpec, put


def adopt(
    node: Node,
    checkpoint: Checkpoint,
    values: Mapping[str, Any],
    specs: Iterable[ParameterSpec],
) -> dict[str, Any]:
    """Set the parameters that the checkpoint decides where they have been left out.

    Args:
        node: The node; its callbacks for changed parameters would be called.
        checkpoint: What is resumed.
        values: The node's parameters by name.
        specs: Their declarations.

    Returns:
        What was set, by name.

    Raises:
        LavaError: A parameter was given and says otherwise than the checkpoint.
    """
    result = adopted(checkpoint, values, {spec.name: spec.default for spec in specs})
    put(node, result)
    return result


def adopted(
    checkpoint: Checkpoint, values: Mapping[str, Any], defaults: Mapping[str, Any]
) -> dict[str, Any]:
    """The parameters that the checkpoint decides in place of a default.

    Args:
        checkpoint: What is resumed.
        values: The node's parameters by name.
        defaults: Their defaults by name.

    Raises:
        LavaError: One was given and says otherwise than the checkpoint.
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
    lava, forced = checkpoint.scene.lava, checkpoint.forced or {}
    # ROS writes an empty list of texts as one empty text
    result: dict[str, Any] = {
        'effects_on': [name for name in forced if forced[name]] or [''],
        'effects_off': [name for name in forced if not forced[name]] or [''],
        'horizon': checkpoint.horizon / 3600.0,
        **{LAVA + item.name: getattr(lava, item.name) for item in fields(Lava)},
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
