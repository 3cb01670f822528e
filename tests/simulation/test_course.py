# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Expected width, thickness and temperature along the steepest descent."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
import math

import numpy as np
import pytest

from lava_ros.effects import considered
from lava_ros.hindcast.coarse import coarsened
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.materials import material_named
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.presets import preset_accuracy
from lava_ros.simulation.resolution import resolution_of, resolved_accuracy
from lava_ros.simulation.selection import effects_for
from lava_ros.simulation.setup import descent as descent_module
from lava_ros.simulation.setup.course import Course, course_of
from lava_ros.simulation.setup.descent import find_path, slope_at
from slope_scenes import ground, HOUR, LAVA, MOBILITY, scene, SLOPE


def width_of(scene: Scene, horizon: float = 24.0 * HOUR) -> float:
    """Return the expected width of a flow [m]."""
    course = course_of(scene, horizon=horizon)
    assert course is not None
    return course.width


def unheated_course(scene: Scene, horizon: float) -> Course | None:
    """Return the expected course of a flow without the heat of its fall."""
    return course_of(scene, considered(scene, {'viscous_heating': False}), horizon=horizon)


@pytest.mark.parametrize('cell', [2.5, 5.0, 10.0])
def test_valley_is_filled_to_its_normal_depth(cell: float):
    """In a V with walls 1:n, Q = K n h^4 / 2 and the width is 2 n h."""
    for wall in (0.12, 0.2):
        depth = (20.0 * wall / MOBILITY) ** 0.25
        course = course_of(scene(ground(cell, wall)), horizon=2.0 * HOUR)
        # the path is followed on cells of 5 m or more, whose means raise the bottom
        half_cell = 0.5 * max(cell, 5.0)
        assert course.width == pytest.approx(2.0 * depth / wall, rel=0.03, abs=half_cell)
        # the mean over the volume of a triangle is two thirds of its depth
        assert course.thickness == pytest.approx(2.0 / 3.0 * depth, rel=0.06)
        assert course.columns.speed == pytest.approx(
            10.0 * wall / depth**2, rel=0.03 + 0.5 * half_cell * wall / depth
        )


def test_mirrored_valley_has_the_same_course():
    y = np.arange(120)[:, None] * 5.0 - 297.5
    elevation = ground(5.0).elevation + np.where(y < 0.0, -0.12 * y, 0.4 * y)
    courses = [
        course_of(scene(Terrain(one, 5.0)), horizon=2.0 * HOUR)
        for one in (elevation, elevation[::-1])
    ]
    for name in ('width', 'thickness', 'speed'):
        one, other = (getattr(course.columns, name) for course in courses)
        assert one == pytest.approx(other, rel=1e-6), name


@pytest.mark.parametrize('across', [0.4, -0.4])
def test_slope_is_that_of_the_steepest_way(across):
    y, x = np.mgrid[0:9, 0:9] * 5.0
    plane = Terrain(0.3 * x + across * y, 5.0)
    assert slope_at(plane, np.array([20.0, 20.0])) == pytest.approx(0.5)


def test_descent_ends_with_its_first_point_on_unknown_ground_or_its_last_allowed(monkeypatch):
    known, start = ground(10.0), (100.0, 300.0)
    elevation = known.elevation.copy()
    elevation[:, 100:110] = np.nan
    points, heights = find_path(replace(known, elevation=elevation), start)
    assert points[-2, 0] < 1000.0 <= points[-1, 0]
    assert (np.diff(heights) < 0.0).all()
    # on the plane of the known ground, also from its border
    points, heights = find_path(replace(known, elevation=elevation), (998.0, 300.0))
    assert points[:, 0] == pytest.approx([958.0, 998.0, 1038.0])
    assert heights == pytest.approx(1000.0 - SLOPE * points[:, 0])
    monkeypatch.setattr(descent_module, '_MAX_POINTS', 5)
    assert len(find_path(known, start)[0]) == 5


def test_half_of_the_lava_is_as_cold_as_the_course_says():
    cold = replace(LAVA, convection=50.0, solidus=1200.0)
    course = course_of(replace(scene(ground(10.0)), lava=cold), horizon=6.0 * HOUR)
    columns, hot = course.columns, course.temperature
    limit = hot - course.cooled * (hot - cold.solidus)
    share = columns.volume[columns.temperature <= limit + 1e-6].sum() / columns.volume.sum()
    assert share == pytest.approx(0.5, abs=(columns.volume / columns.volume.sum()).max())


@pytest.mark.parametrize('convection', [500.0, 5000.0])
def test_lava_that_soon_solidifies_is_as_thick_as_at_its_solidus(convection):
    """Extrapolated below it, the law of viscosity made such lava kilometres thick."""
    cold = replace(LAVA, arrhenius=0.03, convection=convection, viscosity=1e6, solidus=1400.0)
    stiff = replace(cold, convection=0.0, viscosity=cold.viscosity_at(1400.0))
    thickness, expected = (
        course_of(replace(scene(ground(5.0), 1.0), lava=lava), horizon=HOUR).thickness
        for lava in (cold, stiff)
    )
    assert thickness == pytest.approx(expected, rel=0.1)


def test_width_on_an_incline_is_that_of_the_steady_flow():
    """Smith (1973): half the width is ((14/3) x / tan b)^(3/7) (35 Q / 32 K)^(1/7)."""
    thin = replace(scene(ground(2.0)), lava=replace(LAVA, viscosity=1.0))
    for steep in (1.0, 8.0):
        terrain = replace(thin.terrain, elevation=steep * thin.terrain.elevation)
        slope = steep * SLOPE
        mobility = 2600.0 * 9.81 * slope / (1.0 + slope**2) ** 2 / 3.0
        course = course_of(replace(thin, terrain=terrain), horizon=24.0 * HOUR)
        distance = 8.0 * np.arange(1, len(course.columns.width) + 1)
        expected = 2.0 * (14.0 / 3.0 * distance / slope) ** (3 / 7)
        expected *= (350.0 / 32.0 / mobility) ** (1 / 7)
        # closer to the vent the flow has the width of the vent
        is_wide = expected > 25.0
        assert is_wide.sum() > 100
        assert course.columns.width[is_wide] == pytest.approx(expected[is_wide], rel=0.02)


def test_width_on_level_ground_is_that_of_a_spreading_flow():
    """Huppert (1982): a radius of 0.715 (g Q^3 / 3 nu)^(1/8) t^(1/2)."""
    flat = scene(Terrain(np.zeros((100, 100)), 10.0))
    radius = 0.715 * (9.81 * 1000.0 * 2600.0 / 3e4) ** 0.125 * 100.0**0.5
    course = course_of(flat, horizon=100.0)
    assert course.width == pytest.approx(2.0 * radius)
    assert course.thickness * math.pi * radius**2 == pytest.approx(1000.0, rel=0.01)
    # the discharge through a cylinder around half of it
    cylinder = 2.0 * math.pi * radius * course.columns.thickness
    assert course.columns.speed * cylinder == pytest.approx(10.0)
    assert course.fall == 0.0


def test_course_ends_where_the_front_is_at_the_horizon():
    terrain = ground(5.0, 0.02)
    y = np.abs((np.arange(120) + 0.5) * 5.0 - 300.0)
    gorge = terrain.elevation.copy()
    gorge[:, 100:] += 0.5 * y[:, None]
    there = scene(replace(terrain, elevation=gorge))
    early, late = (course_of(there, horizon=hours * HOUR) for hours in (0.5, 24.0))
    assert late.width < 0.5 * early.width
    assert late.fall > 2.0 * early.fall


def test_cooling_lava_widens_and_stops_at_its_solidus():
    hot = scene(ground(5.0, 0.1))
    cooling = replace(hot.lava, emissivity=0.9, arrhenius=0.03, reference_temperature=1423.0)
    stiff, cool, plain = (
        unheated_course(replace(hot, lava=lava), 24.0 * HOUR)
        for lava in (
            cooling, replace(cooling, solidus=1300.0), replace(cooling, emissivity=0.0)
        )
    )
    assert (np.diff(stiff.columns.temperature) < 0.0).all()
    assert (plain.columns.temperature == 1423.0).all()
    count = len(cool.columns.width)
    assert 1 < count < len(stiff.columns.width)
    assert stiff.columns.width[count] > 1.1 * plain.columns.width[count]
    assert (cool.columns.temperature[1:] > 1300.0).all()


def test_heat_loss_is_that_of_a_column():
    """A surface w / cos b large per metre of the map loses q w / cos b of the heat rho c Q T."""
    lava = replace(LAVA, emissivity=0.0, convection=40.0)
    course = unheated_course(replace(scene(ground(5.0, 0.2)), lava=lava), 24.0 * HOUR)
    width = course.columns.width[1:] * math.sqrt(1.0 + SLOPE**2)
    ambient = replace(scene(ground(5.0, 0.2)), lava=lava).ambient_temperature
    excess = course.columns.temperature - ambient
    capacity = lava.density * lava.specific_heat * 10.0
    expected = -40.0 * width * 20.0 / capacity
    assert np.diff(np.log(excess)) == pytest.approx(expected, rel=1e-3)


def test_yielding_lava_is_thicker_than_its_strength_over_its_weight():
    strong = replace(scene(ground(5.0)), lava=replace(LAVA, yield_strength=4000.0))
    course = course_of(strong, horizon=6.0 * HOUR)
    least = 4000.0 / (2600.0 * 9.81 * SLOPE)
    assert (course.columns.thickness > least).all()
    assert course.thickness > 1.5 * course_of(scene(ground(5.0)), horizon=6.0 * HOUR).thickness


def test_thickness_of_very_strong_lava_is_that_of_a_hemisphere():
    ground = Terrain(np.tile(0.01 * np.arange(26.0), (24, 1)), 1.0)
    vent = Vent((16.5, 9.5), ((0.0, 1.0), (1.0, 0.0)), temperature=900.0, radius=1.0)
    lava = Lava.paper(
        density=1000.0, viscosity=1.0, yield_strength=100.0, yield_rate=0.05,
        reference_temperature=1423.0, liquidus=1350.0, solidus=800.0, arrhenius=0.0,
    )
    found = resolved_accuracy(Accuracy(spacing=1.4), Scene(ground, (vent,), lava))
    # of 1 m3
    assert found.thickness == pytest.approx((1.5 / math.pi) ** (1.0 / 3.0))


def test_vent_next_to_a_hole_has_a_finite_width():
    terrain = ground(10.0)
    elevation = terrain.elevation.copy()
    elevation[:, 12:] = np.nan
    found = width_of(scene(replace(terrain, elevation=elevation)), HOUR)
    assert 10.0 < found < 1000.0


def test_pit_does_not_end_the_path():
    terrain = ground(5.0, 0.1)
    elevation = terrain.elevation.copy()
    elevation[57:63, 60:66] -= 6.0
    whole, pitted = (
        course_of(scene(replace(terrain, elevation=item)), horizon=24.0 * HOUR)
        for item in (terrain.elevation, elevation)
    )
    assert pitted.fall > 0.9 * whole.fall


def test_overlapping_vents_are_one_source():
    valley = scene(ground(5.0, 0.1))
    one = course_of(valley, horizon=HOUR)
    shifts = [(dx, dy) for dx in np.linspace(-5.0, 5.0, 5) for dy in np.linspace(-5.0, 5.0, 5)]
    pieces = tuple(Vent((100.0 + dx, 300.0 + dy), 0.4) for dx, dy in shifts)
    assert width_of(replace(valley, vents=pieces), HOUR) == pytest.approx(one.width, rel=0.05)
    plane = scene(ground(5.0))
    fissure = Vent((100.0, 200.0), 10.0, end=(100.0, 400.0), radius=5.0)
    ends = np.linspace(200.0, 400.0, 9)
    pieces = tuple(
        Vent((100.0, start), 1.25, end=(100.0, end), radius=5.0)
        for start, end in pairwise(ends)
    )
    whole, split = (replace(plane, vents=vents) for vents in ((fissure,), pieces))
    assert width_of(split, HOUR) == pytest.approx(width_of(whole, HOUR), rel=0.05)
    assert width_of(whole, HOUR) > 200.0
    apart = (Vent((100.0, 300.0), 10.0), Vent((100.0, 100.0), 2.0))
    both = course_of(replace(valley, vents=apart), horizon=HOUR)
    assert both.width == pytest.approx(one.width)
    assert len(both.columns.width) > len(one.columns.width)


@pytest.mark.parametrize('factor', [2, 3])
def test_coarser_cells_change_little(factor: int):
    fine = scene(ground(5.0, 0.08))
    coarse = replace(fine, terrain=coarsened(fine.terrain, factor))
    one, other = (course_of(item, horizon=6.0 * HOUR) for item in (fine, coarse))
    assert other.width == pytest.approx(one.width, rel=0.1)
    assert other.thickness == pytest.approx(one.thickness, rel=0.1)


def test_no_course_without_a_discharge():
    later = Vent((100.0, 300.0), ((0.0, 0.0), (7200.0, 5.0)))
    for vents in ((), (Vent((100.0, 300.0), 0.0),), (later,)):
        assert course_of(Scene(ground(5.0), vents, LAVA), horizon=HOUR) is None


def gully(unknown: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Scene:
    """Return a gully of 35 degrees without data where ``unknown`` of x and y [m] is true.

    Rows and columns at the border without any data are left out.
    """
    x, y = np.meshgrid(np.arange(-197.5, 1400.0, 5.0), np.arange(-297.5, 300.0, 5.0))
    elevation = 3000.0 - math.tan(math.radians(35.0)) * x + 0.6 * np.sqrt(y**2 + 16.0)
    elevation[unknown(x, y)] = np.nan
    rows, columns = (
        np.flatnonzero(np.isfinite(elevation).any(axis=axis))[[0, -1]] + (0, 1) for axis in (1, 0)
    )
    origin = -200.0 + 5.0 * columns[0], -300.0 + 5.0 * rows[0]
    terrain = Terrain(elevation[slice(*rows), slice(*columns)], 5.0, origin=origin)
    lava = material_named('etna_basalt').lava
    return Scene(terrain, (Vent((0.0, 0.0), 6.0, radius=6.0, temperature=1360.0),), lava)


@pytest.mark.parametrize('unknown', [
    pytest.param(lambda x, y: x < -60.0, id='border-behind'),
    pytest.param(lambda x, y: x < -5.0, id='border-at-the-vent'),
    pytest.param(lambda x, y: y > 25.0, id='border-on-the-left'),
    pytest.param(lambda x, y: y < -25.0, id='border-on-the-right'),
    pytest.param(lambda x, y: np.abs(y) > 25.0, id='border-on-both-sides'),
    pytest.param(lambda x, y: (x < -5.0) | (y > 25.0), id='corner'),
    pytest.param(lambda x, y: (x > 100.0) & (x < 160.0) & (np.abs(y - 45.0) < 25.0), id='hole'),
    pytest.param(
        lambda x, y: (np.random.default_rng(1).random(x.shape) < 0.1) & (np.hypot(x, y) > 8.0),
        id='many-holes',
    ),
])
def test_unknown_ground_away_from_the_lava_changes_neither_spacing_nor_effects(unknown):
    accuracy = preset_accuracy('draft')

    def found(unknown):
        item = gully(unknown)
        effects = effects_for(item, accuracy=accuracy, horizon=1.5 * HOUR)
        return resolution_of(item, accuracy, horizon=1.5 * HOUR), effects

    (resolution, effects), (expected, needed) = found(unknown), found(lambda x, y: x < -200.0)
    assert effects == needed
    assert resolution.width == pytest.approx(expected.width, rel=0.1)
    assert resolution.spacing == pytest.approx(expected.spacing, rel=0.1)


@pytest.mark.parametrize('distance', [10.0, 30.0, 100.0])
def test_lava_that_soon_leaves_the_map_has_the_course_of_its_slope(distance):
    near, far = (
        course_of(gully(lambda x, y, end=end: x > end), horizon=1.5 * HOUR)
        for end in (distance, 1e9)
    )
    first = len(near.columns.width)
    assert near.fall > 0.0
    assert first <= distance / 20.0 + 1
    assert near.columns.ground_slope == pytest.approx(math.tan(math.radians(35.0)), rel=0.1)
    assert near.columns.width == pytest.approx(far.columns.width[:first], rel=0.25)
