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

"""What a worker says about itself."""

from dataclasses import dataclass
from enum import Enum


class WorkerState(Enum):
    """What the worker is doing."""

    WAITING = 'waiting for terrain'
    STARTING = 'starting'
    RUNNING = 'running'
    PAUSED = 'paused'
    FINISHED = 'finished'
    FAILED = 'failed'
    STOPPED = 'stopped'


@dataclass(frozen=True)
class WorkerStatus:
    """How the worker is doing.

    Attributes:
        state: What it is doing.
        error: What made it fail, empty unless the state is FAILED.
        speed: Simulated time per wall time, over the last seconds.
        mean_speed: The same since the simulation started, pauses left out.
        is_behind: Whether simulated time falls behind the clock.
        device: Name of the simulation's device, empty before there is one.
        lag: Time of the clock that simulated time is behind [s]; more than ``MAX_LAG`` is lost.
    """

    state: WorkerState
    error: str
    speed: float
    mean_speed: float
    is_behind: bool
    device: str
    lag: float = 0.0
