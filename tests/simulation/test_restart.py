# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs that start with an emplaced flow, and ground that changes during a run."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from lava_ros.forecast.members import make_plan, run_members
from lava_ros.forecast.sampling import draw_members
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.emplaced import EmplacedFlow
from lava_ros.scene.events import TerrainEvent
from lava_ros.scene.reshaping import Barrier
from lava_ros.scene.uncertainty import uncertainty_from_dict
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.output.checkpoint import from_bytes
from lava_ros.simulation.resolution import resolution_of

#: An incline that falls by 0.1 towards the south, 40 x 24 cells of 10 m.
_Y, _X = np.mgrid[0:40, 0:24] * 10.0
GROUND = Terrain(200.0 + 0.1 * _Y, 10.0)

LAVA = Lava.paper(viscosity=1e4, arrhenius=0.0, emissivity=0.0, convection=0.0)

VENT = Vent((120.0, 300.0), 5.0, radius=20.0, temperature=1400.0)

#: A wall across the incline, in front of the vent.
WALL = Barrier(((20.0, 200.0), (220.0, 200.0)), height=20.0, width=20.0)

SCENE = Scene(GROUND, (VENT,), LAVA)

KNOBS = {'accuracy': Accuracy(spacing=5.0, thickness=1.0), 'effects': {}, 'device': 'cpu'}


def _lobe(cell: float, side: int) -> EmplacedFlow:
    return EmplacedFlow(np.full((side, side), 4.0), cell, (80.0, 260.0), 1380.0, 'lobe.tif')


@pytest.mark.parametrize(('cell', 'side'), [(10.0, 8), (2.0, 40)])
def test_emplaced_flow_is_the_initial_lava(cell: float, side: int) -> None:
    flow = _lobe(cell, side)
    assert flow.volume == pytest.approx(80.0 * 80.0 * 4.0)
    simulation = Simulation(replace(SCENE, vents=(), emplaced_flows=(flow,)), **KNOBS)
    start = simulation.snapshot()
    assert start.budget.emitted == pytest.approx(flow.volume, rel=1e-7)
    assert start.thickness.sum(dtype=float) * 100.0 == pytest.approx(flow.volume, rel=1e-3)
    assert np.nanmax(start.temperature) == pytest.approx(1380.0, rel=1e-5)
    simulation.advance(600.0)
    end = simulation.snapshot()
    assert end.budget.emitted == start.budget.emitted
    lowest = [np.flatnonzero(item.standing.any(axis=1))[0] for item in (start, end)]
    assert lowest[1] < lowest[0] - 2
    assert end.footprint[start.thickness > 1.0].all()


def test_spacing_without_a_vent_follows_the_emplaced_flow() -> None:
    scene = replace(SCENE, vents=(), emplaced_flows=(_lobe(10.0, 8),))
    found = resolution_of(scene, Accuracy())
    assert (found.thickness, found.spacing, found.limit) == (4.0, 6.0, 'edges')
    wide = replace(scene.emplaced_flows[0], thickness=np.full((300, 300), 0.1))
    found = resolution_of(replace(scene, emplaced_flows=(wide,)), Accuracy())
    # 9 km2, 200,000 particles
    assert found.limit == 'particles'
    assert found.spacing == pytest.approx(np.sqrt(9e6 / 200_000), rel=0.01)


def test_map_of_one_run_can_start_another() -> None:
    first = Simulation(SCENE, **KNOBS)
    first.advance(400.0)
    end = first.snapshot()
    flow = EmplacedFlow(end.thickness.astype(float), 10.0, (0.0, 0.0), 1400.0)
    second = Simulation(replace(SCENE, emplaced_flows=(flow,)), **KNOBS)
    start = second.snapshot()
    assert flow.volume == pytest.approx(end.budget.flowing, rel=1e-3)
    assert start.budget.flowing == pytest.approx(flow.volume, rel=1e-7)
    areas = [item.area(item.thickness > 0.5) for item in (end, start)]
    assert areas[1] == pytest.approx(areas[0], rel=0.1)
    second.advance(200.0)
    # 400 s of the first run, and 200 s of the vent
    assert second.budget().emitted == pytest.approx(flow.volume + 200.0 * 5.0, rel=1e-6)


def test_terrain_event_is_bitwise_identical_to_a_manual_change() -> None:
    event = TerrainEvent(120.0, 'a wall', barriers=(WALL,))
    by_hand = Simulation(SCENE, **KNOBS)
    by_hand.advance(120.0)
    by_hand.set_terrain(event.ground(GROUND))
    by_hand.advance(600.0)
    wanted = by_hand.snapshot()
    for stops in ([600.0], [50.0, 120.0, 121.0, 600.0]):
        simulation = Simulation(replace(SCENE, events=(event,)), **KNOBS)
        for time in stops:
            simulation.advance(time, limit=120.0 if time <= 120.0 else 600.0)
            assert (simulation.scene.terrain is GROUND) == (time <= 120.0)
        assert simulation.scene.events == ()
        np.testing.assert_array_equal(simulation.snapshot().thickness, wanted.thickness)
    assert wanted.terrain.elevation.max() > GROUND.elevation.max() - 0.1
    assert wanted.terrain.barriers == (WALL.line,)


def test_checkpoint_keeps_emplaced_flows_and_future_events() -> None:
    new = replace(GROUND, elevation=GROUND.elevation + np.where(_Y < 150.0, 8.0, 0.0))
    events = (
        TerrainEvent(30.0, 'a wall', barriers=(WALL,)), TerrainEvent(60.0, 'new ground', new)
    )
    flow = _lobe(10.0, 8)
    scene = replace(SCENE, emplaced_flows=(flow,), events=events)
    ends = []
    for stop in (10.0, 45.0):
        simulation = Simulation(scene, **KNOBS)
        simulation.advance(stop, limit=90.0)
        resumed = Simulation.resume(from_bytes(simulation.checkpoint().to_bytes()), device='cpu')
        assert len(resumed.scene.events) == (2 if stop < 30.0 else 1)
        (kept,) = resumed.scene.emplaced_flows
        assert (kept.volume, kept.temperature) == (flow.volume, flow.temperature)
        for one in (simulation, resumed):
            one.advance(90.0)
            ends.append(one.snapshot().thickness)
            np.testing.assert_array_equal(one.scene.terrain.elevation, new.elevation)
    for one, other in pairwise(ends):
        np.testing.assert_array_equal(one, other)


def test_terrain_event_applies_to_every_member() -> None:
    uncertain = uncertainty_from_dict({
        'discharge': {'distribution': 'uniform', 'low': 0.8, 'high': 1.2},
        'terrain': {'deviation': 0.2, 'correlation': 50.0},
    })
    scene = replace(SCENE, uncertainty=uncertain)
    same = TerrainEvent(60.0, 'the same ground', GROUND)
    near = replace(WALL, line=((20.0, 240.0), (220.0, 240.0)))
    wall = TerrainEvent(60.0, 'a wall', barriers=(near,))
    members = draw_members(scene, 2)
    found = []
    for events in ((), (same,), (wall,)):
        plan = make_plan(
            replace(scene, events=events), horizon=900.0, samples=5, accuracy=KNOBS['accuracy'],
        )
        found.append(run_members(plan, members, device='cpu'))
    for free, again, stopped in zip(*found, strict=True):
        first_row = [
            item.corner[0] + np.flatnonzero(np.isfinite(item.arrival).any(axis=1))[0]
            for item in (free, again, stopped)
        ]
        assert first_row[0] == pytest.approx(first_row[1], abs=1)
        assert first_row[2] > first_row[0] + 2
