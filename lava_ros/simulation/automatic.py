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

"""What a user leaves out, and what a formulation brings along."""

from dataclasses import replace
from typing import Any

import warp as wp

from lava_ros.accuracy import Accuracy
from lava_ros.effects import Effects
from lava_ros.errors import LavaError


def device_of(name: str | None) -> Any:
    """Find a Warp device by its name.

    Args:
        name: Such as ``cpu`` or ``cuda:0``; the first CUDA device, else the CPU, when left out.

    Raises:
        LavaError: There is no such device.
    """
    try:
        if name is None:
            return wp.get_preferred_device()
        return wp.get_device(name)
    except (ValueError, RuntimeError):
        known = ', '.join(str(device) for device in wp.get_devices())
        raise LavaError('device', name, f'one of {known}') from None


def formulated(effects: Effects, accuracy: Accuracy) -> Effects:
    """The effects as the formulation has them: the printed one is a Green's function.

    Raises:
        LavaError: The printed formulation is asked for inertia.
    """
    if accuracy.formulation != 'as-published':
        return effects
    if effects.inertia:
        right = 'false beside accuracy.formulation as-published, which has none'
        raise LavaError('effects.inertia', True, right)
    return replace(effects, green=True, steep=False)
