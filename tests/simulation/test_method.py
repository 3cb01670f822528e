# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The choice between particles and cells."""

import pytest

from lava_ros.scene import Lava, Scene, scene_from_yaml, Terrain, Vent
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.method import choose_method
from solver import flat

#: Lava of one temperature.
LAVA = Lava.paper(viscosity=1e6, density=2600.0, emissivity=0.0, convection=0.0, arrhenius=0.0)


def chosen(scene, horizon=3600.0, **forced):
    """Return the method for a scene, and the reason."""
    return choose_method(scene, Accuracy(), forced, horizon=horizon)


def test_lava_that_does_not_freeze_takes_cells():
    ground: Terrain = flat(60, 10.0)
    scene = Scene(ground, (Vent((0.0, 0.0), 5.0, radius=10.0),), LAVA)
    assert chosen(scene, inertia=False).method == 'cells'


@pytest.mark.parametrize('effect', ['inertia', 'green', 'merging'])
def test_effects_that_cells_lack_take_particles(effect):
    scene = Scene(flat(60, 10.0), (Vent((0.0, 0.0), 5.0, radius=10.0),), LAVA)
    choice = chosen(scene, **{effect: True})
    assert choice.method == 'particles' and effect in choice.reason


def test_lava_that_freezes_takes_particles():
    choice = chosen(scene_from_yaml('etna.yaml'), 43200.0, solidification=True)
    assert choice.method == 'particles' and 'freezes' in choice.reason


@pytest.mark.parametrize(('effect', 'text'), [
    ('helmholtz', 'lateral stress'), ('insulation', 'under a crust'),
])
def test_effects_that_favour_particles_take_particles(effect, text):
    lava = Lava.paper(viscosity=1e6, emissivity=0.9, solidus=1100.0)
    scene = Scene(flat(60, 10.0), (Vent((0.0, 0.0), 5.0, radius=10.0),), lava)
    others = 'cooling', 'cover', 'crust', 'crust_strength', 'solidification', 'inertia'
    choice = chosen(scene, **dict.fromkeys(others, False), **{effect: True})
    assert choice.method == 'particles' and text in choice.reason


def test_formulation_that_cells_lack_takes_particles():
    scene = Scene(flat(60, 10.0), (Vent((0.0, 0.0), 5.0, radius=10.0),), LAVA)
    choice = choose_method(scene, Accuracy(formulation='as-published'), {}, horizon=3600.0)
    assert choice.method == 'particles' and 'green' in choice.reason
