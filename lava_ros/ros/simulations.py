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

"""Simulations as the node's parameters say; the solver is imported when the first is made."""

from lava_ros.checkpoint import Checkpoint
from lava_ros.ros.deadline import DeadlineChooser
from lava_ros.ros.eruption import SimulationLike
from lava_ros.ros.parameters import Settings
from lava_ros.scene import Scene


def new_simulation(
    scene: Scene, settings: Settings, chooser: DeadlineChooser
) -> SimulationLike:
    """A simulation of a scene at time 0.

    Args:
        scene: The scene.
        settings: The node's settings.
        chooser: Chooses the accuracy.

    Raises:
        LavaError: The settings do not go with the scene.
    """
    from lava_ros.simulation import Simulation

    return Simulation(
        scene,
        accuracy=chooser.accuracy(scene, settings),
        device=settings.device,
        effects=settings.forced,
        horizon=settings.horizon,
    )


def resumed_simulation(checkpoint: Checkpoint, settings: Settings) -> SimulationLike:
    """A simulation that goes on from a checkpoint.

    Raises:
        LavaError: The checkpoint does not fit together, or there is no such device.
    """
    from lava_ros.simulation import Simulation

    return Simulation.resume(checkpoint, device=settings.device)
