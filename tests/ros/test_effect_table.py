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

"""The table of effects: what is on, and why."""

from dataclasses import asdict, replace

import numpy as np

from lava_ros.choice import decide, effects_for
from lava_ros.effects import Effects
from lava_ros.ros.effect_table import effect_table, is_on
from lava_ros.scene import Lava, Scene, Terrain, Vent


def _scene(slope=0.5, **material):
    x = 10.0 * np.arange(30)
    terrain = Terrain(np.tile(500.0 - slope * x, (20, 1)), 10.0)
    return Scene(terrain, (Vent((50.0, 100.0), 20.0),), Lava(**material))


def _table(scene, **forced):
    return effect_table(effects_for(scene, forced), decide(scene, forced))


def test_every_effect_has_a_text_with_its_number():
    """Each effect is on or off, as the choice says, with the number and the threshold."""
    scene = _scene()
    table = _table(scene)
    assert {name: is_on(text) for name, text in table.items()} == asdict(effects_for(scene))
    assert table['steep'].startswith('on: slope = 0.5 > 0.087')
    assert table['yielding'] == 'off: the material has none'
    assert table['merging'] == 'off: never chosen, only forced'


def test_forced_effects_say_so():
    """Forced on or off, with or without a number of their own."""
    table = _table(_scene(), steep=False, helmholtz=True, merging=True)
    assert table['steep'] == 'off: forced'
    assert table['helmholtz'] == table['merging'] == 'on: forced'


def test_what_is_on_wins_over_the_number():
    """An effect left out beside another says which; ground that has frozen stays."""
    scene = _scene(viscosity=20.0)
    decisions = decide(scene, {'green': True})
    inertia = {item.criterion.effect: item for item in decisions}['inertia']
    table = effect_table(effects_for(scene, {'green': True}), decisions)
    assert table['inertia'] == f'off: {inertia.reason}'
    assert table['inertia'].endswith(', but not beside green')
    frozen = replace(Effects(), solidification=True)
    table = effect_table(frozen, decide(_scene(solidus=1200.0), horizon=1.0))
    assert table['solidification'].startswith('on: share of the way to the solidus = ')
    assert table['solidification'].endswith(', but what has frozen stays')
