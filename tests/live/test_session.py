# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Session of a simulation: its newest snapshot."""

import numpy as np

from lava_ros.live.session import SimulationSession
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy


def test_older_snapshot_never_replaces_a_newer_one() -> None:
    session = SimulationSession(
        lambda scene: Simulation(scene, accuracy=Accuracy(spacing=10.0), device='cpu')
    )
    ground = Terrain(np.zeros((20, 20)), 10.0)
    session.start(Scene(ground, (Vent((100.0, 100.0), 5.0),), lava=Lava.paper()))
    pending = []
    for until in (1.0, 2.0):
        session.advance(until, wall_limit=60.0, max_particles=1000)
        pending.append(session.begin_snapshot())
    first, second = pending
    assert first is not None and second is not None
    second()
    assert session.latest is not None
    newest = session.latest.time
    assert newest > 1.0
    first()
    assert session.latest.time == newest
