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

"""The node with a fault inside, which a test switches on and off by writing a file.

The first argument is the file, the others are the node's. While the file names a fault:

- ``raise``: a step of the simulation raises, as when a device is lost;
- ``memory``: there is no memory for more particles, as Warp says it, and more are wanted;
- ``broken``: a particle's position becomes NaN in the next step, once;
- ``slow``: a step of the simulation takes as long as the fault, and says so by a file ``.slow``;
- ``map``: the map that the simulation shows has one NaN in it;
- ``configure``: configuring raises in its middle.
"""

from dataclasses import replace
from pathlib import Path
import sys
import time

import numpy as np

from lava_ros.ros import active_node as active
from lava_ros.ros.active_node import ActiveNode
from lava_ros.ros.node import main
from lava_ros.simulation import Simulation
from lava_ros.simulation.snapshot import PendingSnapshot
from lava_ros.simulation.state import State

FAULT = Path(sys.argv.pop(1))

#: What Warp raises when an allocation fails.
NO_MEMORY = "Failed to allocate 1342177280 bytes on device 'cpu'"

advance, result, allocate = Simulation.advance, PendingSnapshot.result, State._allocate
begin = ActiveNode._begin


def fault():
    """The fault that is wanted."""
    return FAULT.read_text(encoding='utf-8') if FAULT.exists() else ''


def faulty_advance(simulation, until, *, wall_limit=None):
    """Advance, or fail at it."""
    wanted, state = fault(), simulation._state
    if wanted == 'raise':
        raise RuntimeError('device lost')
    while fault() == 'slow':
        FAULT.with_suffix('.slow').touch()
        time.sleep(0.05)
    if wanted == 'memory':
        state.grow(2 * state.capacity)
    if wanted == 'broken':
        rows = state.particle.numpy()
        rows[0, 0] = np.nan
        state.particle.assign(rows)
        FAULT.write_text('', encoding='utf-8')
    return advance(simulation, until, wall_limit=wall_limit)


def faulty_result(pending):
    """Show the flow, or a map with a hole."""
    shown = result(pending)
    if fault() == 'map':
        thickness = shown.thickness.copy()
        thickness[15, 6] = np.nan
        shown = replace(shown, thickness=thickness)
    return shown


def faulty_allocate(state, capacity):
    """Allocate, or find no memory."""
    if fault() == 'memory':
        raise RuntimeError(NO_MEMORY)
    allocate(state, capacity)


def faulty_begin(active_node, sources):
    """Begin, or fail at it."""
    if fault() == 'configure':
        raise RuntimeError('configure went wrong')
    begin(active_node, sources)


if __name__ == '__main__':
    active.STOP_TIMEOUT = active.CHECKPOINT_TIMEOUT = 1.0
    active.HEARTBEAT = 0.2
    ActiveNode._begin = faulty_begin
    Simulation.advance = faulty_advance
    PendingSnapshot.result = faulty_result
    State._allocate = faulty_allocate
    sys.exit(main())
