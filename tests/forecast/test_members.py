# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A member is the scene with what was drawn, and runs as that scene does."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.forecast.members import (
    check_members,
    make_plan,
    member_scene,
    MemberFields,
    plan_from,
    run_members,
    running,
)
from lava_ros.forecast.probability import footprint_of, Tally
from lava_ros.forecast.sampling import draw_members, Member
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.uncertainty import uncertainty_from_dict
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy

TERRAIN = Terrain(500.0 - 2.0 * np.add.outer(np.arange(30.0), np.zeros(24)), 20.0)

SCENE = Scene(
    TERRAIN,
    (
        Vent((240.0, 100.0), ((0.0, 10.0), (600.0, 4.0)), radius=30.0),
        Vent((200.0, 60.0), 2.0, end=(300.0, 60.0), temperature=1400.0),
    ),
    Lava(viscosity=5e3, yield_strength=100.0),
    uncertainty=uncertainty_from_dict({
        'discharge': {'distribution': 'lognormal', 'median': 1.0, 'factor': 1.5},
        'terrain': {'deviation': 1.0, 'correlation': 60.0},
    }),
)

DRAWN = Member(
    3, discharge=1.5, temperature=-20.0, viscosity=2.0, yield_strength=0.5,
    displacement=(15.0, -5.0), seed=(0, 3),
)


def test_the_spacing_of_all_is_that_of_the_median() -> None:
    """Lava that is likely far less viscous than the scene's makes a narrower flow."""
    viscosity = {'distribution': 'loguniform', 'low': 1e-4, 'high': 1.0}
    doubts = uncertainty_from_dict({'viscosity': viscosity})
    scene = replace(SCENE, uncertainty=doubts)
    found = make_plan(scene, horizon=3600.0).accuracy
    liquid = replace(SCENE, lava=replace(SCENE.lava, viscosity=50.0))
    expected = make_plan(liquid, horizon=3600.0).accuracy
    assert (found.spacing, found.thickness) == pytest.approx(
        (expected.spacing, expected.thickness)
    )
    assert found.thickness < make_plan(SCENE, horizon=3600.0).accuracy.thickness


def test_a_member_is_the_scene_with_what_was_drawn() -> None:
    """Factors, differences and displacement reach every vent and the lava, and nothing else."""
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


def test_an_eruption_has_its_duration_and_volume() -> None:
    """The series is stretched, a constant lasts as long; each vent keeps its share."""
    first, second = SCENE.vents
    series = replace(first, discharge=((-50.0, 10.0), (600.0, 4.0), (1200.0, 0.0)))
    scene = replace(SCENE, vents=(series, second))
    one, other = member_scene(scene, Member(0, eruption=(12_000.0, 2.16e5))).vents
    np.testing.assert_allclose(one.discharge, [(0.0, 20.0), (6000.0, 8.0), (12_000.0, 0.0)])
    np.testing.assert_allclose(other.discharge, [(0.0, 4.0), (12_000.0, 0.0)])
    for vents, words in (
        ((first, second), r"vents\[0\].discharge of member 0 is \(600.0, 4.0\)"),
        ((replace(second, discharge=0.0),), 'vents.discharge of member 0 is 0.0'),
    ):
        with pytest.raises(LavaError, match=words):
            member_scene(replace(SCENE, vents=vents), Member(0, eruption=(1e4, 1e5)))


def test_a_viscosity_by_the_vft_law_has_the_factor_too() -> None:
    """Twice the viscosity at any temperature."""
    lava = Lava(vft_b=5000.0, vft_c=600.0)
    scene = member_scene(replace(SCENE, lava=lava, uncertainty=uncertainty_from_dict({})), DRAWN)
    for temperature in (1200.0, 1423.0):
        ratio = scene.lava.viscosity_at(temperature) / lava.viscosity_at(temperature)
        assert ratio == pytest.approx(2.0)


def test_vents_stay_on_the_terrain() -> None:
    """A displacement that leads off it is halved; a fissure is as long as there is room for."""
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


def test_members_that_make_no_scene_are_refused_before_any_runs() -> None:
    """Lava that is solid where it comes out, by name and number; no vent; no single vent."""
    members = [Member(0), Member(1, temperature=-900.0)]
    with pytest.raises(LavaError, match=r'temperature of member 1 .* limits'):
        check_members(SCENE, members)
    with pytest.raises(LavaError, match='a vent'):
        check_members(replace(SCENE, vents=()), members[:1])
    with pytest.raises(LavaError, match='one vent'):
        check_members(SCENE, [Member(0, place=(30.0, 40.0))])
    check_members(replace(SCENE, vents=SCENE.vents[:1]), [Member(0, place=(30.0, 40.0))])


def test_effects_are_those_that_any_member_calls_for() -> None:
    """A yield strength that matters in the stiffest members alone is on in all."""
    lava = replace(SCENE.lava, yield_strength=5.0)
    distribution = {'distribution': 'loguniform', 'low': 0.1, 'high': 100.0}
    certain = replace(SCENE, lava=lava, uncertainty=uncertainty_from_dict({}))
    uncertain = replace(
        certain, uncertainty=uncertainty_from_dict({'yield_strength': distribution})
    )
    assert not make_plan(certain, horizon=600.0).effects.yielding
    assert make_plan(uncertain, horizon=600.0).effects.yielding
    assert not make_plan(uncertain, horizon=600.0, effects={'yielding': False}).effects.yielding


@pytest.mark.parametrize('name', ['horizon', 'threshold', 'looks'])
def test_plans_are_checked(name: str) -> None:
    """What cannot be run up to, seen or looked at is refused."""
    with pytest.raises(LavaError, match=name):
        make_plan(SCENE, **{'horizon': 600.0, name: 0.0})


def test_a_run_is_that_of_the_scene(device: str) -> None:
    """Arrival and peak of a member are those of its scene, looked at as often."""
    plan = make_plan(SCENE, horizon=600.0, accuracy=Accuracy(refinement=0.5), looks=10)
    members = draw_members(SCENE, 2, seed=1)
    shares: dict[int, float] = {}
    told: list[float] = []
    results: list[MemberFields] = []
    for fields in running(plan, members, device=device, progress=shares):
        told.append(sum(shares.values()))
        results += [fields] if fields is not None else []
    assert told == sorted(told) and told[-1] == 2.0 and len(set(told)) > 5
    results.sort(key=lambda item: item.index)
    assert [item.index for item in results] == [0, 1]
    simulation = Simulation(
        member_scene(SCENE, members[1]), effects=plan.effects, accuracy=plan.accuracy,
        device=device,
    )
    looks = simulation.looks(plan.threshold, 11)
    for look in range(11):
        simulation.advance(60.0 * look, limit=600.0)
        simulation.look(looks)
    seen = simulation.seen(looks, where_wet=True)
    assert results[1].corner == seen.corner
    if device == 'cpu':
        np.testing.assert_array_equal(results[1].arrival, seen.arrival.astype(np.float32))
        np.testing.assert_array_equal(results[1].peak, seen.thickness)
        # the inundated area of the run itself, however often it is looked at
        rows, columns = map(slice, seen.corner, np.add(seen.corner, seen.arrival.shape))
        arrived = simulation.snapshot().arrived
        np.testing.assert_array_equal(results[1].arrival, arrived[rows, columns])
        assert np.isfinite(arrived).sum() == np.isfinite(results[1].arrival).sum()
    assert np.isfinite(results[1].arrival).sum() > 20
    assert not np.array_equal(results[0].arrival, results[1].arrival, equal_nan=True)


def test_lava_that_leaves_the_map_is_told(device: str) -> None:
    """By the share that is gone, and the maps by the number of such members."""
    (vent, _) = SCENE.vents
    scene = replace(SCENE, vents=(replace(vent, position=(240.0, 560.0)),))
    plan = make_plan(scene, horizon=1800.0, accuracy=Accuracy(refinement=0.5), looks=4)
    far, near = run_members(plan, [Member(0), Member(1, discharge=0.05)], device=device)
    assert far.left > 0.05 and near.left == 0.0
    tally = Tally(plan)
    for member in (far, near):
        tally.add(footprint_of(member, plan))
    assert tally.maps().members_beyond == 1


def test_a_member_can_go_on_from_a_running_simulation(device: str) -> None:
    """Without anything drawn it is that simulation; more discharge is more lava from then on."""
    scene = replace(SCENE, uncertainty=uncertainty_from_dict({}))
    accuracy = Accuracy(refinement=0.5, deterministic=True)
    # a review of the running simulation would switch it on later
    running = Simulation(scene, effects={'steep': True}, accuracy=accuracy, device=device)
    running.advance(300.0)
    plan = plan_from(running.checkpoint(), horizon=300.0, looks=5)
    same, more = run_members(plan, [Member(0), Member(1, discharge=3.0)], device=device)
    looks = running.looks(plan.threshold, 6)
    for look in range(6):
        running.advance(300.0 + 60.0 * look, limit=600.0)
        running.look(looks)
    seen = running.seen(looks, where_wet=True)
    assert same.corner == seen.corner
    np.testing.assert_array_equal(same.peak, seen.thickness)
    np.testing.assert_array_equal(same.arrival, (seen.arrival - 300.0).astype(np.float32))
    assert (same.arrival == 0.0).any() and (same.arrival > 0.0).any()
    assert np.isfinite(more.arrival).sum() > np.isfinite(same.arrival).sum()
    # a discharge that holds from now on does not reach back
    there = [np.argwhere(item.arrival == 0.0) + item.corner for item in (same, more)]
    np.testing.assert_array_equal(*there)
