# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Automatic particle spacing, and automatic choice of effects."""

from dataclasses import replace
import math

import numpy as np
import pytest

from lava_ros.effects import EFFECTS
from lava_ros.effects.laws import LATERAL_DRAG
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.resolution import (
    ACROSS,
    COOLED,
    EDGES,
    MIN_ACROSS,
    MOST_PARTICLES,
    resolution_of,
    resolved_accuracy,
)
from lava_ros.simulation.selection import (
    decide,
    effects_for,
    expected_scales,
    HORIZON,
    slopes_of,
)
from lava_ros.simulation.setup.course import course_of
from slope_scenes import ground, HOUR, LAVA, scene
from solver import incline

#: Lava that only moves by its weight and viscosity.
PLAIN = Lava.paper(viscosity=1e5, arrhenius=0.0, emissivity=0.0, convection=0.0)


def test_spacing_follows_the_width_of_the_flow():
    valley = scene(ground(5.0, 0.2))
    width = course_of(valley, horizon=HORIZON).width
    for refinement in (0.5, 1.0, 2.0):
        found = resolution_of(valley, Accuracy(refinement=refinement))
        assert found.limit == 'flow'
        assert found.across == pytest.approx(ACROSS * refinement, rel=5e-3)
        assert found.spacing == pytest.approx(width / found.across)
        assert found.is_coarse == (found.across < MIN_ACROSS)
    assert resolved_accuracy(Accuracy(), valley).spacing == resolution_of(
        valley, Accuracy()
    ).spacing
    narrow = resolution_of(scene(ground(5.0, 0.2), 0.1), Accuracy())
    assert narrow.spacing < 0.5 * width / ACROSS


def test_spacing_in_a_wide_flow_resolves_the_columns_that_freeze():
    # 0.9 of the way to the solidus, or a tenth of it
    cooling = replace(LAVA, emissivity=0.9, convection=50.0)
    cold, hot = (
        replace(scene(ground(5.0)), lava=replace(cooling, solidus=solidus))
        for solidus in (1340.0, 700.0)
    )
    for refinement in (0.5, 1.0, 2.0):
        accuracy = Accuracy(refinement=refinement)
        course, found = (of(cold, *what, horizon=HOUR) for of, what in (
            (course_of, ()), (resolution_of, (accuracy,))
        ))
        assert course.cooled > COOLED and course.width > ACROSS * EDGES * course.thickness
        assert found.limit == 'edges'
        assert found.spacing == pytest.approx(EDGES * course.thickness / refinement, rel=5e-3)
        assert found.across > ACROSS * refinement
        wide = resolution_of(hot, accuracy, horizon=HOUR)
        assert course_of(hot, horizon=HOUR).cooled < COOLED and wide.limit == 'flow'


def test_particle_volume_follows_the_expected_thickness():
    steep = scene(ground(5.0, 0.2))
    simulation = Simulation(steep, device='cpu')
    spacing, thickness = simulation.accuracy.spacing, simulation.accuracy.thickness
    assert thickness == course_of(steep, horizon=HORIZON).thickness
    assert simulation.accuracy.particle_volume == pytest.approx(spacing**2 * thickness)


def test_number_of_particles_is_limited():
    flood = scene(ground(5.0, 0.1), 10.0)
    found = resolution_of(flood, Accuracy(), horizon=1e8)
    count = 1e9 / (found.spacing**2 * found.thickness)
    assert count == pytest.approx(MOST_PARTICLES, rel=0.02)
    assert found.limit == 'particles' and 'largest number of particles' in found.text()


@pytest.mark.parametrize('viscosity', [1e4, 1e8, 1e12])
def test_spacing_resolves_lava_that_has_hardly_left_its_vent(viscosity):
    lump = replace(scene(ground(5.0)), lava=replace(LAVA, viscosity=viscosity))
    for horizon in (10.0, HOUR):
        found = resolution_of(lump, Accuracy(), horizon=horizon)
        assert 10.0 * horizon / (found.spacing**2 * found.thickness) > 0.75 * ACROSS**2


@pytest.mark.parametrize(
    ('viscosity', 'discharge', 'phrases'),
    [
        (1e4, 10.0, []),
        (1.0, 300.0, ['Reynolds number']),
        (0.3, 0.01, ['only lava of 0.1 m or more']),
        (1e-3, 1.0, ['only lava of 0.1 m or more', 'Reynolds number']),
    ],
)
def test_resolution_warns_of_thin_and_turbulent_lava(viscosity, discharge, phrases):
    fluid = replace(scene(ground(5.0), discharge), lava=replace(LAVA, viscosity=viscosity))
    found = resolution_of(fluid, Accuracy(), horizon=HOUR)
    warnings = found.warnings(0.1)
    assert [text in warning for text, warning in zip(phrases, warnings, strict=True)] == [
        True for _ in phrases
    ]
    assert all(warning in found.text() for warning in found.warnings())
    # without a given threshold that of thin lava is lower
    for quiet in (found.warnings(), found.warnings(1e-6)):
        assert not [text for text in quiet if 'inundation' in text]


def test_explicit_spacing_is_kept_and_may_be_under_resolved():
    valley = scene(ground(5.0, 0.1))
    found = resolution_of(valley, Accuracy(spacing=12.0))
    assert (found.spacing, found.limit) == (12.0, 'given')
    width = course_of(valley, horizon=HORIZON).width
    assert found.across == pytest.approx(width / 12.0)
    assert found.is_coarse and 'under-resolved' in found.text()


def test_spacing_without_discharge_follows_the_cells():
    for vents in ((), (Vent((100.0, 300.0), 0.0),)):
        found = resolution_of(Scene(ground(5.0), vents, LAVA), Accuracy(refinement=2.0))
        assert (found.spacing, found.limit) == (2.5, 'cells')
        assert math.isnan(found.width) and not found.is_coarse
        assert 'no effusion rate' in found.text()


def slope(angle, cell=10.0):
    """Return a terrain with a slope in degrees."""
    return incline(math.tan(math.radians(angle)), 40, 40, cell)


def effects_on(scene, **arguments):
    return set(effects_for(scene, **arguments))


@pytest.mark.parametrize(
    ('angle', 'changes', 'expected'),
    [
        (3.0, {}, set()),
        (20.0, {}, {'steep'}),
        (3.0, {'yield_strength': 1e4}, {'yielding'}),
        (3.0, {'flow_index': 0.5}, {'power_law'}),
        (3.0, {'emissivity': 0.9}, {'cooling'}),
        (3.0, {'emissivity': 0.9, 'arrhenius': 0.04}, {'cooling', 'arrhenius'}),
        (3.0, {'vft_b': 9000.0, 'vft_c': 600.0}, {'vft'}),
        (3.0, {'viscosity': 30.0}, {'inertia'}),
        (3.0, {'ground_conductivity': 2.0}, {'ground'}),
        (3.0, {'emissivity': 0.9, 'convection': 50.0, 'solidus': 1300.0},
         {'cooling', 'solidification'}),
        (3.0, {'emissivity': 0.9, 'crust': True, 'conductivity': 2.0}, {'crust'}),
        (3.0, {'emissivity': 0.9, 'crust_cover': 0.9}, {'cover'}),
    ],
)
def test_effects_are_on_that_material_or_terrain_require(angle, changes, expected):
    assert effects_on(Scene(slope(angle), lava=replace(PLAIN, **changes))) == expected


def test_lateral_stress_is_on_where_the_flow_is_narrow():
    """The threshold changes the speed by 5 %."""
    threshold = EFFECTS['helmholtz'].threshold
    assert 0.045 < (0.5 * math.pi * threshold) ** 2 / LATERAL_DRAG < 0.05
    for wall in (0.1, 0.25, 0.6):
        valley = scene(ground(2.5, wall))
        # a triangle has two thirds of its depth as mean thickness, weighted by volume
        is_narrow = 2.0 / 3.0 * wall > threshold
        assert ('helmholtz' in effects_on(valley, horizon=HOUR)) is is_narrow


def test_fall_of_kilometres_switches_viscous_heating_on():
    """A fall of 2 km warms lava by 17 K, more than 1 % of its heat."""
    assert effects_on(Scene(slope(4.0, 800.0), lava=PLAIN)) == {'viscous_heating'}


def test_cooling_is_on_only_for_a_long_horizon():
    scene = Scene(slope(3.0), (Vent((200.0, 200.0), 1.0),), replace(PLAIN, emissivity=0.9))
    assert effects_on(scene, horizon=200.0) == set()
    assert effects_on(scene) == {'cooling'}


def test_one_of_two_exclusive_effects_is_on():
    fluid = replace(scene(ground(2.5, 0.6), 1000.0), lava=replace(LAVA, viscosity=1e3))
    rivals = {'inertia', 'helmholtz', 'green'}
    for overrides, expected in (
        ({}, 'inertia'), ({'green': True}, 'green'), ({'inertia': False}, 'helmholtz')
    ):
        assert effects_on(fluid, overrides=overrides) & rivals == {expected}
    reasons = {item.name: item.reason for item in decide(fluid)}
    assert reasons['helmholtz'].endswith('but excluded by inertia')


def test_every_decision_has_a_reason_and_a_source():
    decisions = decide(Scene(slope(20.0), lava=Lava.paper()), {'inertia': False})
    named = [item.name for item in decisions]
    assert len(set(named)) == len(named)
    # merging changes no physics, and is on only by request
    assert set(EFFECTS) - set(named) == {'merging'}
    for item in decisions:
        assert item.effect.admits
        assert item.effect.source
        assert item.reason
        if not item.is_forced and not math.isnan(item.value):
            assert item.is_on == (item.value > item.effect.threshold)
    reasons = {item.name: item.reason for item in decisions}
    assert reasons['inertia'] == 'forced'
    assert reasons['green'] == 'only when asked for'
    assert reasons['yielding'] == 'the material has none'
    assert reasons['steep'].startswith('slope = 0.36 > ')


@pytest.mark.parametrize(('constants', 'around', 'name', 'expected'), [
    ({}, {}, 'wind', 'wind_speed is 0'),
    ({}, {'wind_speed': 5.0}, 'wind', 'heat taken = '),
    ({'emissivity': 0.0, 'convection': 0.0}, {'wind_speed': 5.0}, 'wind', 'the material has none'),
    ({}, {}, 'cooling', 'heat lost = '),
    ({'crust_cover': 0.9}, {}, 'cooling', 'cover replaces it'),
    ({'crust_cover': 0.9}, {}, 'cover', 'heat lost = '),
    ({}, {}, 'cover', 'the material has none'),
    ({'vft_b': 6000.0, 'vft_c': 600.0}, {}, 'arrhenius', 'vft replaces it'),
])
def test_reason_of_an_effect_names_what_the_scene_lacks(constants, around, name, expected):
    found = decide(Scene(slope(20.0), lava=Lava.paper(**constants), **around))
    reasons = {item.name: item.reason for item in found}
    assert reasons[name].startswith(expected)


def test_expected_speed_is_that_of_a_sheet():
    scales = expected_scales(Scene(slope(5.0), lava=PLAIN))
    columns = scales.columns
    assert columns.slope == pytest.approx(math.tan(math.radians(5.0)), rel=1e-3)
    expected = 2500.0 * 9.81 * columns.thickness**2 * columns.slope / 3e5
    assert columns.speed == pytest.approx(expected)
    assert (scales.rest_temperature == scales.vent_temperature).all()


def test_slopes_skip_cells_without_data():
    elevation = np.zeros((4, 4))
    elevation[2, 2] = np.nan
    elevation[0, 0] = 5.0
    found = np.sort(slopes_of(Terrain(elevation, 10.0)))
    assert found == pytest.approx([0.0] * 5 + [math.hypot(0.5, 0.5)])
    assert slopes_of(Terrain(np.full((2, 2), 5.0), 10.0)) == [0.0]
