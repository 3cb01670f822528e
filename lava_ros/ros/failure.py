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

"""What people read when the simulation has failed."""

from typing import TYPE_CHECKING

from lava_ros.ros.eruption import SimulationError

if TYPE_CHECKING:
    from lava_ros.simulation.snapshot import Snapshot

#: What Warp says when a device has no memory left.
_NO_MEMORY = 'Failed to allocate'


def failure_text(error: Exception, latest: 'Snapshot | None') -> str:
    """Say why the simulation has failed, and what helps where that is known.

    Args:
        error: What was raised.
        latest: The last snapshot there is.
    """
    if isinstance(error, SimulationError):
        return str(error)
    if isinstance(error, MemoryError) or _NO_MEMORY in str(error):
        held = ''
        if latest is not None:
            rows, columns = latest.terrain.shape
            held = f' with {latest.particle_count} particles on {columns} x {rows} cells'
        reason = str(error) or type(error).__name__
        return f'out of memory{held}: {reason}; a larger spacing or a coarser terrain needs less'
    return f'{type(error).__name__}: {error}'
