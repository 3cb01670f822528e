# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Emplaced lava and terrain events in the node's scene."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from command_line import refused
from lava_ros.cli import ros
from lava_ros.errors import LavaError
from lava_ros.live.session import SimulationSession
from lava_ros.scene import Lava, Scene, scene_from_yaml, Terrain, Vent
from lava_ros.scene.emplaced import EmplacedFlow
from lava_ros.scene.events import TerrainEvent
from lava_ros.scene.reshaping import Barrier
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy

GROUND = Terrain(
    np.tile(100.0 - 0.5 * np.arange(20.0), (16, 1)), 5.0, epsg=32633, offset=(5e5, 4.18e6)
)

WALL = Barrier(
    ((500_060.0, 4_180_010.0), (500_060.0, 4_180_070.0)), height=9.0, width=10.0, name='dam'
)

FLOW = EmplacedFlow(np.full((6, 4), 2.0), 2.5, (15.0, 30.0), 1360.0, 'old.tif')

SCENE = Scene(
    GROUND, (Vent((20.0, 40.0), 2.0, 1360.0, radius=5.0),), Lava.paper(viscosity=1e4),
    emplaced_flows=(FLOW,),
    events=(
        TerrainEvent(4.0, 'dug', replace(GROUND, elevation=GROUND.elevation + 0.5)),
        TerrainEvent(8.0, 'a dam', barriers=(WALL,)),
    ),
)


def _session() -> SimulationSession:
    accuracy = Accuracy(spacing=2.5, thickness=1.0)
    return SimulationSession(lambda scene: Simulation(scene, accuracy=accuracy, device='cpu'))


def test_events_are_applied_and_undone_by_a_reset() -> None:
    session = _session()
    session.start(SCENE)
    first, changes = session.simulation, session.view.changes
    assert first is not None
    for until, left in ((3.0, 2), (6.0, 1), (12.0, 0)):
        session.advance(until, wall_limit=60.0, max_particles=10_000)
        assert session.scene is not None
        assert len(session.scene.events) == left
        assert session.scene.terrain is first.scene.terrain
    # earlier forecasts are outdated
    assert session.view.changes == changes + 2
    assert float((session.scene.terrain.elevation - GROUND.elevation).max()) > 8.0
    session.reset()
    assert session.scene is not None and session.scene.events == SCENE.events
    assert session.scene.terrain is GROUND
    assert session.simulation is not first
    assert session.checkpoint().emitted == pytest.approx(FLOW.volume)
    # terrain from a topic is kept, and later events apply to it
    session.advance(6.0, wall_limit=60.0, max_particles=10_000)
    other = replace(GROUND, elevation=GROUND.elevation - 1.0)
    assert session.set_terrain(other)
    # terrain on which a future barrier is impossible is rejected
    with pytest.raises(LavaError, match='a line on the terrain'):
        session.set_terrain(replace(GROUND, elevation=GROUND.elevation[:, :7]))
    assert session.scene.terrain is other
    session.reset()
    assert session.scene.terrain is other and session.scene.events == SCENE.events


def test_child_gets_the_same_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[Any, ...]] = []

    def child(*words: str, log: Path, env: Mapping[str, str]) -> None:
        seen.append((words, log, env))

    monkeypatch.setattr(ros, 'Child', child)
    ros._started(SCENE, {}, 7, tmp_path)
    scene = scene_from_yaml(tmp_path / 'scene.yaml')
    (flow,) = scene.emplaced_flows
    assert flow.volume == pytest.approx(FLOW.volume, rel=1e-6)
    assert (flow.temperature, flow.source) == (1360.0, 'old.tif')
    grounds = []
    for one in (SCENE, scene):
        ground = one.terrain
        for event in one.events:
            ground = event.ground(ground)
            grounds.append(ground)
    for one, other in zip(grounds[:2], grounds[2:], strict=True):
        np.testing.assert_allclose(one.elevation, other.elevation, atol=1e-4)
        assert one.barriers == other.barriers
    assert [event.time for event in scene.events] == [4.0, 8.0]
    assert len(seen) == 1


@pytest.mark.parametrize(
    ('words', 'named'),
    [
        (['--emplaced-flow', 'flow.asc'], 'cannot be sent on a topic'),
        (['--terrain-at', '1h', 'none.npz'], 'none.npz'),
        (['--vent', '20,20'], '--vent and --no-vents exclude each other'),
        (['--vents', 'vents.csv'], '--vents and --no-vents exclude each other'),
    ],
)
def test_feed_rejects_what_it_would_not_publish(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], named: str
) -> None:
    monkeypatch.chdir(tmp_path)
    np.savez('ground.npz', elevation=GROUND.elevation, resolution=5.0)
    Path('flow.asc').write_text(
        'ncols 2\nnrows 2\nxllcorner 10\nyllcorner 10\ncellsize 5\n1 2\n0 3\n'
    )
    assert named in refused('ros', 'feed', '--terrain', 'ground.npz', '--no-vents', *words)
