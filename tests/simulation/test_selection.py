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

"""What is chosen for a scene: particle spacing from the width of the flow, and effects."""

import csv
from dataclasses import replace
import math
from pathlib import Path

import numpy as np
import pytest

from lava_ros.effects import EFFECTS
from lava_ros.errors import LavaError
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.presets import PRESETS
from lava_ros.simulation.resolution import (
    ACROSS,
    flow_width,
    LEAST_ACROSS,
    MOST_PARTICLES,
    resolution_of,
    resolved_accuracy,
    WIDEST,
)
from lava_ros.simulation.selection import decide, effects_for, scales_of, slopes_of
from solver import incline

LAVA = Lava(density=2600.0, viscosity=1e4, arrhenius=0.0)
SLOPE = math.tan(math.radians(5.0))
HOUR = 3600.0
ROOT = Path(__file__).parents[2]

#: Lava that nothing but its weight and its viscosity moves.
PLAIN = Lava(viscosity=1e5, arrhenius=0.0, emissivity=0.0, convection=0.0)

#: rho g tan(b) cos^4(b) / (3 mu) on that slope [1/(m s)].
MOBILITY = 2600.0 * 9.81 * SLOPE / (1.0 + SLOPE**2) ** 2 / 3e4


def ground(cell: float, wall: float = 0.0) -> Terrain:
    """An incline of 5 degrees, 2 km by 600 m, with walls that rise by ``wall`` to both sides."""
    x = (np.arange(round(2000.0 / cell)) + 0.5) * cell
    y = (np.arange(round(600.0 / cell)) + 0.5) * cell - 300.0
    return Terrain(1000.0 - SLOPE * x + wall * np.abs(y)[:, None], cell)


def scene(terrain: Terrain, discharge: float = 10.0) -> Scene:
    """A vent near the upper end, in the middle."""
    return Scene(terrain, (Vent((100.0, 300.0), discharge),), LAVA)


@pytest.mark.parametrize('cell', [2.5, 5.0, 10.0])
def test_a_valley_is_filled_to_its_normal_depth(cell: float):
    """In a V with walls 1:n, Q = K n h^4 / 2 and the width is 2 n h; cells round its bottom."""
    for wall in (0.12, 0.2):
        depth = (20.0 * wall / MOBILITY) ** 0.25
        found = flow_width(scene(ground(cell, wall)), horizon=2.0 * HOUR)
        assert found == pytest.approx(2.0 * depth / wall, rel=0.03, abs=0.5 * cell)


def test_on_an_incline_it_is_as_wide_as_the_steady_flow():
    """Smith (1973): half the width is ((14/3) x / tan b)^(3/7) (35 Q / 32 K)^(1/7)."""
    thin = replace(LAVA, viscosity=1.0)
    short = replace(scene(ground(2.0)), lava=thin)
    mobility = 1e4 * MOBILITY
    middle = 2.0 * (14.0 / 3.0 * 950.0 / SLOPE) ** (3 / 7) * (350.0 / 32.0 / mobility) ** (1 / 7)
    thickness = (3.0 * 10.0 / (2600.0 * 9.81)) ** 0.25
    assert middle > WIDEST * thickness
    assert flow_width(short) == pytest.approx(WIDEST * thickness)
    steep = replace(short, terrain=replace(short.terrain, elevation=8.0 * short.terrain.elevation))
    slope = 8.0 * SLOPE
    found = flow_width(steep)
    # lava gets as far as 253 points of the path, 8 m apart; the median is at half of the way
    mobility = 2600.0 * 9.81 * slope / (1.0 + slope**2) ** 2 / 3.0
    middle = (14.0 / 3.0 * 950.0 / slope) ** (3 / 7) * (350.0 / 32.0 / mobility) ** (1 / 7)
    assert found == pytest.approx(min(2.0 * middle, WIDEST * thickness), rel=0.06)


def test_on_level_ground_it_is_as_wide_as_the_flow_has_spread():
    """Huppert (1982): a radius of 0.715 (g Q^3 / 3 nu)^(1/8) t^(1/2), up to some thicknesses."""
    flat = scene(Terrain(np.zeros((100, 100)), 10.0))
    radius = 0.715 * (9.81 * 1000.0 * 2600.0 / 3e4) ** 0.125 * 100.0**0.5
    assert flow_width(flat, horizon=100.0) == pytest.approx(2.0 * radius)
    thickness = (3e4 * 10.0 / (2600.0 * 9.81)) ** 0.25
    assert flow_width(flat, horizon=1e9) == pytest.approx(WIDEST * thickness)


def test_it_is_that_of_the_way_that_lava_takes_in_time():
    """A gorge below the plain counts once the front gets there."""
    terrain = ground(5.0, 0.02)
    y = np.abs((np.arange(120) + 0.5) * 5.0 - 300.0)
    gorge = terrain.elevation.copy()
    gorge[:, 100:] += 0.5 * y[:, None]
    there = scene(replace(terrain, elevation=gorge))
    early, late = (flow_width(there, horizon=hours * HOUR) for hours in (0.5, 24.0))
    assert late < 0.5 * early


def test_cooled_lava_is_wider():
    """Lava that stiffens up to a solidus needs a deeper and wider cross-section."""
    hot = scene(ground(5.0, 0.1))
    stiff = replace(hot.lava, arrhenius=0.03, reference_temperature=1423.0, solidus=1150.0)
    assert flow_width(replace(hot, lava=stiff)) > 1.2 * flow_width(hot)


def test_holes_and_borders_end_the_way():
    """A vent beside a hole has the width that level ground gives it, not NaN."""
    terrain = ground(10.0)
    elevation = terrain.elevation.copy()
    elevation[:, 12:] = np.nan
    found = flow_width(scene(replace(terrain, elevation=elevation)), horizon=HOUR)
    assert 10.0 < found < 1000.0


def test_the_spacing_follows_the_width():
    """So many particles across at a refinement of 1, and finer with it."""
    valley = scene(ground(5.0, 0.1))
    width = flow_width(valley)
    for refinement in (0.5, 1.0, 2.0):
        found = resolution_of(valley, Accuracy(refinement=refinement))
        assert found.limit == 'flow'
        assert found.across == pytest.approx(ACROSS * refinement, rel=5e-3)
        assert found.spacing == pytest.approx(width / found.across)
        assert found.is_coarse == (found.across < LEAST_ACROSS)
    assert resolved_accuracy(Accuracy(), valley).spacing == resolution_of(
        valley, Accuracy()
    ).spacing
    narrow = resolution_of(scene(ground(5.0, 0.1), 0.1), Accuracy())
    assert narrow.spacing < 0.5 * width / ACROSS


def test_particles_are_bounded():
    """What the horizon brings is at most so many particles, and that is said."""
    flood = scene(ground(5.0, 0.1), 10.0)
    found = resolution_of(flood, Accuracy(), horizon=1e8)
    count = 1e9 / (found.spacing**2 * found.thickness)
    assert count == pytest.approx(MOST_PARTICLES, rel=0.02)
    assert found.limit == 'particles' and 'largest number of particles' in found.text()


def test_what_is_given_is_kept():
    """A spacing overrules the rule; few particles across are under-resolved."""
    valley = scene(ground(5.0, 0.1))
    found = resolution_of(valley, Accuracy(spacing=12.0))
    assert (found.spacing, found.limit) == (12.0, 'given')
    assert found.across == pytest.approx(flow_width(valley) / 12.0)
    assert found.is_coarse and 'under-resolved' in found.text()
    assert resolution_of(valley, Accuracy()).error < found.error <= 1.0


def test_without_a_discharge_cells_decide():
    """Nothing is known of the flow then."""
    for vents in ((), (Vent((100.0, 300.0), 0.0),)):
        found = resolution_of(Scene(ground(5.0), vents, LAVA), Accuracy(refinement=2.0))
        assert (found.spacing, found.limit) == (2.5, 'cells')
        assert math.isnan(found.width) and not found.is_coarse
        assert 'no discharge' in found.text()


def test_the_expected_error_is_what_was_measured():
    """Means over the mapped eruptions, and over the other scenes, at `draft` and `standard`."""
    with (ROOT / 'docs/benchmarks/convergence_h200.csv').open(encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    for lava in (LAVA, replace(LAVA, solidus=1100.0)):
        valley = replace(scene(ground(5.0, 0.1)), lava=lava)
        for preset in ('draft', 'standard'):
            errors = [
                1.0 - float(row['jaccard'])
                for row in rows
                if row['preset'] == preset
                and row['scene'].startswith('etna') == (lava.solidus > 0.0)
            ]
            found = resolution_of(valley, PRESETS[preset].accuracy).error
            assert found == pytest.approx(np.mean(errors), rel=0.1)


def slope(angle, cell=10.0):
    """A terrain that falls by an angle in degrees."""
    return incline(math.tan(math.radians(angle)), 40, 40, cell)


def switched_on(scene, **arguments):
    """Names of the effects that are chosen."""
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
         {'cooling', 'solidification', 'steep'}),
        (3.0, {'emissivity': 0.9, 'crust': True, 'conductivity': 2.0}, {'crust'}),
        (3.0, {'emissivity': 0.9, 'crust_cover': 0.9}, {'cover'}),
    ],
)
def test_each_effect_follows_its_number(angle, changes, expected):
    """What the material or the terrain brings with it is switched on, and nothing else."""
    assert switched_on(Scene(slope(angle), lava=replace(PLAIN, **changes))) == expected


def test_lateral_stress_is_on_where_the_kernel_resolves_the_thickness():
    """Particles closer than the lava is thick feel the stress between them."""
    scene = Scene(slope(3.0), lava=PLAIN)
    thickness = scales_of(scene).thickness
    for share, expected in ((0.2, set()), (0.24, set()), (0.26, {'helmholtz'})):
        accuracy = Accuracy(spacing=thickness / share / 3.0, ratio=3.0)
        assert switched_on(scene, accuracy=accuracy) == expected


def test_what_freezes_makes_the_ground_steep():
    """On a gentle slope only the sides of frozen lava are steep, where the particles show them."""
    lava = replace(PLAIN, emissivity=0.9, convection=50.0, solidus=1300.0)
    frozen = Scene(slope(3.0), lava=lava)
    thickness = scales_of(frozen).thickness
    # tan 5 degrees is the slope at h / l = 0.0506: 1.73 times that
    for share, is_steep in ((0.048, False), (0.053, True)):
        accuracy = Accuracy(spacing=thickness / share / 3.0, ratio=3.0)
        assert ('steep' in switched_on(frozen, accuracy=accuracy)) is is_steep
        warm = replace(frozen, lava=replace(lava, emissivity=0.0, convection=0.0))
        assert 'steep' not in switched_on(warm, accuracy=accuracy)


def test_a_relief_of_kilometres_warms_lava():
    """A fall of 2 km warms lava by 17 K: more than 1 % of its heat."""
    assert switched_on(Scene(slope(4.0, 800.0), lava=PLAIN)) == {'viscous_heating'}


def test_the_horizon_decides_what_matters():
    """Cooling for some minutes is nothing, for a day it is something."""
    scene = Scene(slope(3.0), (Vent((200.0, 200.0), 10.0),), replace(PLAIN, emissivity=0.9))
    assert switched_on(scene, horizon=200.0) == set()
    assert switched_on(scene) == {'cooling'}


def test_overrides_win_and_are_checked():
    """A user can force an effect by name; another name is an error."""
    scene = Scene(slope(20.0), lava=PLAIN)
    assert switched_on(scene, overrides={'green': True, 'steep': False}) == {'green'}
    with pytest.raises(LavaError, match='effects.gren'):
        effects_for(scene, {'gren': True})
    with pytest.raises(LavaError, match='effects.green'):
        effects_for(scene, {'green': 'yes'})


def test_of_those_that_exclude_each_other_one_is_on():
    """A forced effect wins; what yields says to whom."""
    fluid = Scene(slope(3.0), lava=replace(PLAIN, viscosity=30.0))
    close = Accuracy(spacing=0.1)
    assert switched_on(fluid, accuracy=close) == {'inertia'}
    assert switched_on(fluid, accuracy=close, overrides={'green': True}) == {'green'}
    assert switched_on(fluid, accuracy=close, overrides={'inertia': False}) == {'helmholtz'}
    reasons = {item.name: item.reason for item in decide(fluid, accuracy=close)}
    assert reasons['helmholtz'].endswith('but not beside inertia')


def test_every_decision_says_why():
    """Each effect of the physics has a number, a threshold, a cost and a source."""
    decisions = decide(Scene(slope(20.0), lava=Lava()), {'inertia': False})
    named = [item.name for item in decisions]
    assert len(set(named)) == len(named)
    # merging changes no physics: it is on when asked for
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


def test_scales_are_those_of_a_sheet():
    """The speed is that of the expected thickness on the terrain's slope."""
    scales = scales_of(Scene(slope(5.0), lava=PLAIN))
    expected = 2500.0 * 9.81 * scales.thickness**2 * scales.slope / 3e5
    assert scales.speed == pytest.approx(expected)
    assert scales.slope == pytest.approx(math.tan(math.radians(5.0)), rel=1e-3)
    assert scales.end_temperature == scales.temperature


def test_slopes_skip_cells_without_data():
    """The largest slope is over neighbours that both have data."""
    elevation = np.zeros((4, 4))
    elevation[2, 2] = np.nan
    elevation[0, 0] = 5.0
    assert slopes_of(Terrain(elevation, 10.0)) == (0.5, 0.0)
