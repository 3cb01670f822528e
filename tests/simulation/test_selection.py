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

"""The choice of effects."""

from dataclasses import replace
import math

import numpy as np
import pytest

from lava_ros.effects import EFFECTS
from lava_ros.errors import LavaError
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.selection import decide, effects_for, scales_of, slopes_of
from solver import incline

#: Lava that nothing but its weight and its viscosity moves.
PLAIN = Lava(viscosity=1e5, arrhenius=0.0, emissivity=0.0, convection=0.0)


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
