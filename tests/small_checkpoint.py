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

"""The smallest checkpoint: particles in any number on a flat scene, for tests of what keeps it."""

import numpy as np

from lava_ros.effects import Effects
from lava_ros.scene import Lava, Scene, Terrain
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.checkpoint import Checkpoint


def small_checkpoint(time: float, particles: int) -> Checkpoint:
    """A checkpoint at a time [s], other than at any other, that hardly compresses."""
    random = np.random.default_rng(int(time))
    return Checkpoint(
        time=time,
        scene=Scene(Terrain(np.zeros((3, 4)), 1.0), lava=Lava()),
        effects=Effects(),
        forced=None,
        horizon=1.0,
        accuracy=Accuracy(),
        emitted=0.0,
        since=0.0,
        capacity=2**20,
        arrays={'state.particle': random.random((particles, 4), dtype=np.float32)},
    )
