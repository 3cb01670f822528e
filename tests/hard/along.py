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

"""What holds at each step of a frame: the frame is played again from its start, step by step.

Lava that comes out and runs off, breaks loose for a moment, or falls and climbs, shows that at
neither end of a frame.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from hard.ground import Moment
from lava_ros.simulation import Simulation
from lava_ros.simulation.checkpoint import Checkpoint
from lava_ros.simulation.state import STAGE, STEPS

#: Steps of a frame that are looked at, about: each takes a few milliseconds.
MOST_LOOKS = 4000


def along(
    start: Checkpoint, simulation: Simulation, steps: int, rate: Callable[[Moment], float]
) -> Iterator[tuple[float, float, float]]:
    """A rate at the start and at the end of each step, and the step's length [s].

    Args:
        start: The frame's start.
        simulation: The simulation at the frame's end.
        steps: How many there were; of many only one in so many is taken, as long as all of them.
        rate: What is asked of a moment.
    """
    again = Simulation.resume(start, device=simulation.device)
    if start.scene.vents != simulation.scene.vents:
        again.set_vents(simulation.scene.vents)
    counts, every = again._state.counts, 1 + steps // MOST_LOOKS
    begun, step, former = start.time, int(counts.numpy()[STEPS]), rate(Moment(again))
    is_taken = True
    for _ in again.advancing(simulation.time):
        stage, reached = (int(counts.numpy()[count]) for count in (STAGE, STEPS))
        if stage == 0 and reached > step:
            was_taken, is_taken = is_taken, reached % every == 0
            now = rate(Moment(again)) if was_taken or is_taken else 0.0
            if was_taken:
                yield former, now, every * (again.time - begun)
            begun, step, former = again.time, reached, now
