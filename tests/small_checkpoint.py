# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A minimal checkpoint: any number of particles on a flat scene."""

import numpy as np

from lava_ros.effects import Effects
from lava_ros.scene import Lava, Scene, Terrain
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.output.checkpoint import Checkpoint


def small_checkpoint(time: float, particles: int) -> Checkpoint:
    """Return a checkpoint that differs at each time [s], and hardly compresses."""
    random = np.random.default_rng(int(time))
    return Checkpoint(
        time=time, scene=Scene(Terrain(np.zeros((3, 4)), 1.0), lava=Lava.paper()),
        effects=Effects(),
        forced=None, horizon=1.0, accuracy=Accuracy(), emitted=0.0, since=0.0, capacity=2**20,
        arrays={'state.particle': random.random((particles, 4), dtype=np.float32)},
    )
