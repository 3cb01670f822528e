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

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from lava_ros.errors import LavaError
from lava_ros.files.yaml import parse_json, parse_yaml


@dataclass(frozen=True)
class EffectChange:
    """Effects that were on or off from a time on.

    Attributes:
        time: Simulated time [s].
        effects: Why each is on or off, a text that begins with ``on`` or ``off``, by name.
    """

    time: float
    effects: dict[str, str]


@dataclass(frozen=True)
class Description:
    """What describes a recording. What is absent or cannot be read is empty.

    Attributes:
        parameters: The node's parameters by name.
        effects: All effects at the start, then what changed.
        version: Version of the package that recorded.
        device: Device of the simulation.
    """

    parameters: Mapping[str, Any]
    effects: tuple[EffectChange, ...]
    version: str
    device: str


def describe(custom_data: Mapping[str, str]) -> Description:
    """Read a bag's custom data."""
    return Description(
        parameters=_parameters(custom_data.get('parameters', '')),
        effects=_effects(custom_data.get('effects', '')),
        version=custom_data.get('version', ''),
        device=custom_data.get('device', ''),
    )


def _parameters(text: str) -> Mapping[str, Any]:
    try:
        data = parse_yaml('parameters', text)
    except LavaError:
        return {}
    return {str(key): value for key, value in data.items()} if isinstance(data, Mapping) else {}


def _effects(text: str) -> tuple[EffectChange, ...]:
    try:
        entries = parse_json('effects', text)
    except LavaError:
        return ()
    if not isinstance(entries, list):
        return ()
    return tuple(
        EffectChange(
            float(entry['time']), {str(key): str(value) for key, value in entry['effects'].items()}
        )
        for entry in entries
        if isinstance(entry, Mapping)
        and isinstance(entry.get('time'), int | float)
        and isinstance(entry.get('effects'), Mapping)
    )
