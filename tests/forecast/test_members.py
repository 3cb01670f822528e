# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A member runs as the scene with its drawn values."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.forecast.member_scenes import check_members, member_scene
from lava_ros.forecast.members import (
    make_plan,
    MemberFields,
    plan_from,
    run_members,
    running,
)
from lava_ros.forecast.probability import EnsembleAccumulator, footprint_by, footprint_of
from lava_ros.forecast.sampling import draw_members, Member
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.events import TerrainEvent
from lava_ros.scene.uncertainty import uncertainty_from_dict
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy, METHODS

TERRAIN = Terrain(500.0 - 2.0 * np.add.outer(np.arange(30.0), np.zeros(24)), 20.0)

SCENE = Scene(
    TERRAIN,
    (
        Vent((240.0, 100.0), ((0.0, 10.0), (600.0, 4.0)), radius=30.0),
        Vent((200.0, 60.0), 2.0, end=(300.0, 60.0), temperature=1400.0),
    ),
    Lava.paper(viscosity=5e3, yield_strength=100.0),
    uncertainty=uncertainty_from_dict({
        'discharge': {'distribution': 'lognormal', 'median': 1.0, 'factor': 1.5},
        'terrain': {'deviation': 1.0, 'correlation': 60.0},
    }),
)

DRAWN = Member(
    3, discharge=1.5, temperature=-20.0, viscosity=2.0, yield_strength=0.5,
    displacement=(15.0, -5.0), seed=(0, 3),
)


def test_spacing_suits_the_median_viscosity() -> None:
    viscosity = {'distribution': 'loguniform', 'low': 1e-4, 'high': 1.0}
    viscosities = uncertainty_from_dict({'viscosity': viscosity})
    scene = replace(SCENE, uncertainty=viscosities)
    found = make_plan(scene, horizon=3600.0).accuracy
    liquid = replace(SCENE, lava=replace(SCENE.lava, viscosity=50.0))
    expected = make_plan(liquid, horizon=3600.0).accuracy
    assert (found.spacing, found.thickness) == pytest.approx(
        (expected.spacing, expected.thickness)
    )
    assert found.thickness < make_plan(SCENE, horizon=3600.0).accuracy.thickness


def test_scene_of_a_member_has_the_drawn_values() -> None:
    scene = member_scene(SCENE, DRAWN)
    first, second = scene.vents
    assert first.discharge == ((0.0, 15.0), (600.0, 6.0))
    assert second.discharge == 3.0
    assert (first.temperature, second.temperature) == (1403.0, 1380.0)
    assert first.position == (255.0, 95.0)
    assert (second.position, second.end) == ((215.0, 55.0), (315.0, 55.0))
    assert scene.lava == replace(SCENE.lava, viscosity=1e4, yield_strength=50.0)
    rough = scene.terrain.elevation - TERRAIN.elevation
    assert 0.3 < rough.std() < 2.0
    same = member_scene(SCENE, DRAWN, rough=False)
    assert same.terrain is TERRAIN and same.vents == scene.vents


def test_discharge_is_scaled_to_the_duration_and_volume() -> None:
    first, second = SCENE.vents
    series = replace(first, discharge=((-50.0, 10.0), (600.0, 4.0), (1200.0, 0.0)))
    scene = replace(SCENE, vents=(series, second))
    one, other = member_scene(scene, Member(0, eruption=(12_000.0, 2.16e5))).vents
    np.testing.assert_allclose(one.discharge, [(0.0, 20.0), (6000.0, 8.0), (12_000.0, 0.0)])
    np.testing.assert_allclose(other.discharge, [(0.0, 4.0), (12_000.0, 0.0)])
    for vents, words in (
        ((first, second), r"vents\[0\].discharge of member 0 is \(600.0, 4.0\)"),
        ((replace(second, discharge=0.0),), 'vents.discharge of member 0 is 0'),
    ):
        with pytest.raises(LavaError, match=words):
            member_scene(replace(SCENE, vents=vents), Member(0, eruption=(1e4, 1e5)))


def test_viscosity_factor_applies_to_the_vft_law() -> None:
    lava = Lava.paper(vft_b=5000.0, vft_c=600.0)
    scene = member_scene(replace(SCENE, lava=lava, uncertainty=uncertainty_from_dict({})), DRAWN)
    for temperature in (1200.0, 1423.0):
        ratio = scene.lava.viscosity_at(temperature) / lava.viscosity_at(temperature)
        assert ratio == pytest.approx(2.0)


def test_vents_stay_on_the_terrain() -> None:
    far = member_scene(SCENE, replace(DRAWN, displacement=(0.0, -150.0)))
    # -75 m leads to y = 25 m; the fissure at y = 60 m moves by half as much
    assert far.vents[0].position == (240.0, 25.0)
    assert far.vents[1].position == (200.0, 22.5)
    one = replace(SCENE, vents=SCENE.vents[1:])
    placed = member_scene(one, Member(0, place=(30.0, 400.0)), rough=False).vents[0]
    assert placed.position == (5.0, 400.0) and placed.end == (55.0, 400.0)
    disc = replace(SCENE, vents=SCENE.vents[:1])
    placed = member_scene(disc, Member(0, place=(30.0, 400.0)), rough=False).vents[0]
    assert placed.position == (30.0, 400.0)


def test_refuses_members_without_a_valid_scene() -> None:
    members = [Member(0), Member(1, temperature=-900.0)]
    with pytest.raises(LavaError, match=r'temperature of member 1 .* limit its distribution'):
        check_members(SCENE, members)
    with pytest.raises(LavaError, match='a vent'):
        check_members(replace(SCENE, vents=()), members[:1])
    with pytest.raises(LavaError, match='one vent'):
        check_members(SCENE, [Member(0, place=(30.0, 40.0))])
    check_members(replace(SCENE, vents=SCENE.vents[:1]), [Member(0, place=(30.0, 40.0))])


def test_plan_has_the_effects_of_extreme_members() -> None:
    lava = replace(SCENE.lava, yield_strength=5.0)
    distribution = {'distribution': 'loguniform', 'low': 0.1, 'high': 100.0}
    certain = replace(SCENE, lava=lava, uncertainty=uncertainty_from_dict({}))
    uncertain = replace(
        certain, uncertainty=uncertainty_from_dict({'yield_strength': distribution})
    )
    assert not make_plan(certain, horizon=600.0).effects.yielding
    assert make_plan(uncertain, horizon=600.0).effects.yielding
    assert not make_plan(uncertain, horizon=600.0, effects={'yielding': False}).effects.yielding


@pytest.mark.parametrize('name', ['horizon', 'threshold', 'samples'])
def test_plan_refuses_zero(name: str) -> None:
    with pytest.raises(LavaError, match=name):
        make_plan(SCENE, **{'horizon': 600.0, name: 0.0})


def test_member_equals_the_simulation_of_its_scene(device: str) -> None:
    plan = make_plan(SCENE, horizon=600.0, accuracy=Accuracy(refinement=0.5), samples=10)
    members = draw_members(SCENE, 2, seed=1)
    fractions: dict[int, float] = {}
    totals: list[float] = []
    results: list[MemberFields] = []
    for fields in running(plan, members, device=device, progress=fractions):
        totals.append(sum(fractions.values()))
        results += [fields] if fields is not None else []
    assert totals == sorted(totals) and totals[-1] == 2.0 and len(set(totals)) > 5
    results.sort(key=lambda item: item.index)
    assert [item.index for item in results] == [0, 1]
    simulation = Simulation(
        member_scene(SCENE, members[1]), effects=plan.effects, accuracy=plan.accuracy,
        device=device,
    )
    peaks = simulation.start_peaks(plan.threshold)
    for look in range(11):
        simulation.advance(60.0 * look, limit=600.0)
        list(simulation.observing(peaks))
    flow = simulation.read_peaks(peaks, where_wet=True)
    assert results[1].corner == flow.corner
    if device == 'cpu':
        np.testing.assert_array_equal(results[1].arrival, flow.arrival.astype(np.float32))
        np.testing.assert_array_equal(results[1].peak, flow.thickness)
        # the inundated area does not depend on the number of observations
        rows, columns = map(slice, flow.corner, np.add(flow.corner, flow.arrival.shape))
        arrived = simulation.snapshot().arrived
        np.testing.assert_array_equal(results[1].arrival, arrived[rows, columns])
        assert np.isfinite(arrived).sum() == np.isfinite(results[1].arrival).sum()
    assert np.isfinite(results[1].arrival).sum() > 20
    assert not np.array_equal(results[0].arrival, results[1].arrival, equal_nan=True)


def test_members_whose_lava_leaves_the_map_are_counted(device: str) -> None:
    (vent, _) = SCENE.vents
    scene = replace(SCENE, vents=(replace(vent, position=(240.0, 560.0)),))
    plan = make_plan(scene, horizon=1800.0, accuracy=Accuracy(refinement=0.5), samples=4)
    far, near = run_members(plan, [Member(0), Member(1, discharge=0.05)], device=device)
    assert far.left > 0.05 and near.left == 0.0
    tally = EnsembleAccumulator(plan)
    for member in (far, near):
        tally.add(footprint_of(member, plan))
    assert tally.maps().members_beyond == 1


def test_member_continues_a_running_simulation(device: str) -> None:
    scene = replace(SCENE, uncertainty=uncertainty_from_dict({}))
    accuracy = Accuracy(spacing=8.0, deterministic=True)
    # a review of the running simulation would switch it on later
    running = Simulation(scene, effects={'steep': True}, accuracy=accuracy, device=device)
    running.advance(300.0)
    plan = plan_from(running.checkpoint(), horizon=300.0, samples=5)
    same, more = run_members(plan, [Member(0), Member(1, discharge=3.0)], device=device)
    peaks = running.start_peaks(plan.threshold)
    for look in range(6):
        running.advance(300.0 + 60.0 * look, limit=600.0)
        list(running.observing(peaks))
    flow = running.read_peaks(peaks, where_wet=True)
    assert same.corner == flow.corner
    np.testing.assert_array_equal(same.peak, flow.thickness)
    np.testing.assert_array_equal(same.arrival, (flow.arrival - 300.0).astype(np.float32))
    assert (same.arrival == 0.0).any() and (same.arrival > 0.0).any()
    assert np.isfinite(more.arrival).sum() > np.isfinite(same.arrival).sum()
    # a discharge does not change what came before it
    there = [np.argwhere(item.arrival == 0.0) + item.corner for item in (same, more)]
    np.testing.assert_array_equal(*there)


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('change', ['loses', 'gains'])
def test_maps_equal_a_run_where_the_ground_loses_or_gains_data(
    device: str, method: str, change: str
) -> None:
    """In a snapshot, cells without data at its time are unknown."""
    hole, holed = np.zeros(TERRAIN.shape, dtype=bool), TERRAIN.elevation.copy()
    hole[6:9, 10:14] = True
    holed[hole] = np.nan
    before, after = TERRAIN, replace(TERRAIN, elevation=holed)
    if change == 'gains':
        before, after = after, before
    scene = replace(
        SCENE, terrain=before, vents=SCENE.vents[:1], uncertainty=uncertainty_from_dict({}),
        events=(TerrainEvent(300.0, change, after), TerrainEvent(600.0, 'later', before)),
    )
    accuracy = Accuracy(refinement=0.5, method=method)
    plan = make_plan(scene, horizon=600.0, accuracy=accuracy, samples=5)
    (member,) = run_members(plan, [Member(1)], device=device)
    footprint = footprint_of(member, plan)
    tally = EnsembleAccumulator(plan)
    tally.add(footprint)
    maps = tally.maps()
    simulation = Simulation(
        scene, effects=plan.effects, accuracy=plan.accuracy, device=device, horizon=600.0
    )
    simulation.advance(600.0)
    run = simulation.snapshot()
    assert run.terrain is after and np.isfinite(run.arrived[hole]).any()
    reached = np.where(after.has_data, 100.0 * np.isfinite(run.arrived), np.nan)
    np.testing.assert_array_equal(maps.probability, reached)
    np.testing.assert_array_equal(np.isnan(maps.thickness), np.isnan(run.thickness))
    assert set(maps.areas(TERRAIN.resolution).values()) == {run.area(run.inundated)}
    np.testing.assert_array_equal(footprint_by(footprint, plan, 600.0), run.footprint)
