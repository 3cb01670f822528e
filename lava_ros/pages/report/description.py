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

"""What a bag says about its recording in ``custom_data``, as far as it can be read."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from lava_ros.errors import LavaError
from lava_ros.files.yaml import parse_json, parse_yaml


@dataclass(frozen=True)
class EffectChange:
    """Effects from a simulated time [s] on: texts that begin with ``on`` or ``off``, by name."""

    time: float
    effects: dict[str, str]


@dataclass(frozen=True)
class Description:
    """Parameters by name, effects at the start and their changes, version and device.

    Parts that are missing or cannot be read are empty.
    """

    parameters: Mapping[str, Any]
    effects: tuple[EffectChange, ...]
    version: str
    device: str


def describe(custom_data: Mapping[str, str]) -> Description:
    """Read a bag's custom data."""
    told = plain(custom_data)
    return Description(
        parameters={str(key): value for key, value in (told['parameters'] or {}).items()},
        effects=tuple(
            EffectChange(
                float(entry['time']),
                {str(key): str(value) for key, value in entry['effects'].items()},
            )
            for entry in told['effects'] or ()
        ),
        version=custom_data.get('version', ''),
        device=custom_data.get('device', ''),
    )


def plain(custom_data: Mapping[str, str]) -> dict[str, Any]:
    """The node's description of a recording as plain data; None for parts missing or malformed.

    ``scene`` is the result of scene_to_dict, ``parameters`` those of the node, ``effects`` the
    effects and the times of their changes, and ``resumed_from`` the bag and time of the checkpoint
    that the run was resumed from.
    """
    found: dict[str, Any] = {}
    for name, (parse, is_right) in _KNOWN.items():
        try:
            value = parse(name, custom_data.get(name, ''))
        except LavaError:
            value = None
        found[name] = value if is_right(value) else None
    return found


def _is_mapping(value: object) -> bool:
    return isinstance(value, dict)


def _is_origin(value: object) -> bool:
    return (
        isinstance(value, dict)
        and isinstance(value.get('bag'), str)
        and isinstance(value.get('time'), int | float)
    )


def _are_changes(value: object) -> bool:
    return isinstance(value, list) and all(
        isinstance(entry, dict)
        and isinstance(entry.get('time'), int | float)
        and isinstance(entry.get('effects'), dict)
        for entry in value
    )


#: Texts that the node writes, by name: the parser, and the check of what it returns.
_KNOWN: dict[str, tuple[Callable[[str, str], Any], Callable[[object], bool]]] = {
    'scene': (parse_yaml, _is_mapping),
    'parameters': (parse_yaml, _is_mapping),
    'effects': (parse_json, _are_changes),
    'resumed_from': (parse_json, _is_origin),
}
