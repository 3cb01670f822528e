# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A scene of uncertain discharge, from whose states live ensembles start."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from lava_ros.effects import Effects
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.uncertainty import uncertainty_from_dict
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.output.checkpoint import Checkpoint
from solver import only

SCENE = Scene(
    Terrain(np.tile(500.0 - 2.0 * np.arange(30), (20, 1)), 10.0),
    (Vent((55.0, 100.0), 20.0, radius=15.0),),
    Lava.paper(viscosity=1e4),
    uncertainty=uncertainty_from_dict(
        {'discharge': {'distribution': 'loguniform', 'low': 0.2, 'high': 5.0}}
    ),
)

RULES: dict[str, Any] = {'horizon': 120.0, 'threshold': 0.01, 'device': 'cpu'}
MEMBERS = 5


def checkpoints_at(times: Sequence[float], method: str = 'particles') -> list[Checkpoint]:
    """Return checkpoints of one simulation at some times [s]."""
    accuracy = Accuracy(method, spacing=10.0, thickness=1.0)
    effects = Effects() if method == 'particles' else only('steep')
    simulation = Simulation(SCENE, effects=effects, accuracy=accuracy, device='cpu')
    found = []
    for time in times:
        simulation.advance(time)
        found.append(simulation.checkpoint())
    return found
