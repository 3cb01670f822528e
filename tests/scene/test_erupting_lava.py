# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lava as it leaves the vents: its material, temperature and viscosity."""

import numpy as np
import pytest

from lava_ros.scene import Scene, scene_from_dict, scene_to_dict, Terrain, Vent
from lava_ros.scene.erupting_lava import EruptingLava, material_of
from lava_ros.scene.lava import Lava
from lava_ros.scene.materials import materials

GROUND = Terrain(np.zeros((20, 20)), 10.0)


def scene_with(lava, *temperatures):
    vents = [
        {'position': [100.0, 100.0], 'discharge': 5.0, 'temperature': value, 'name': f'{value}'}
        for value in temperatures
    ]
    return scene_from_dict({'vents': vents, 'lava': lava}, GROUND)


def test_viscosity_is_that_at_the_temperature_of_the_vent():
    # 3e4 exp(-rate (1413 - 1360)) of the exponential law of this material
    scene = scene_with({'viscosity': 3e4, 'reference_temperature': 1360.0}, 1413.0)
    (_, temperature, viscosity), = EruptingLava.of(scene).vents
    rate = scene.lava.arrhenius
    assert temperature == 1413.0
    assert viscosity == pytest.approx(3e4 * np.exp(-53.0 * rate), rel=1e-6)
    assert '1140 °C (1413 K) and 5,' in EruptingLava.of(scene).text()


@pytest.mark.parametrize('name', materials())
def test_material_is_found_by_its_constants(name):
    lava = materials()[name].lava
    assert material_of(lava) == (name, ())
    assert EruptingLava.of(Scene(GROUND, lava=lava)).text() == name


def test_changed_constants_are_named_and_other_lava_has_no_material():
    assert EruptingLava.of(scene_with({'viscosity': 1e4, 'solidus': 1100.0})).text() == (
        'etna_basalt (changed: viscosity, solidus)'
    )
    other = Lava.paper(
        density=2000.0, viscosity=3.0, arrhenius=0.0, emissivity=0.5, convection=1.0,
        specific_heat=900.0,
    )
    assert material_of(other) == (None, ())


def test_text_has_the_range_of_several_vents():
    text = EruptingLava.of(scene_with({}, 1360.0, 1413.0)).text()
    assert 'at the vents 1087 to 1140 °C (1360 to 1413 K)' in text


@pytest.mark.parametrize('known', [
    None, {}, {'lava': 'basalt'}, {'lava': {'viscosity': 'thick'}}, {'vents': 'none'},
    {'vents': [{'temperature': 'hot'}]},
])
def test_invalid_description_has_no_lava(known):
    assert EruptingLava.described(known) is None


def test_description_has_the_lava_of_its_scene():
    scene = Scene(
        GROUND, (Vent((100.0, 100.0), 5.0, temperature=1400.0),), Lava.paper(viscosity=1e4)
    )
    found = EruptingLava.described(scene_to_dict(scene))
    assert found == EruptingLava.of(scene)
    assert found.as_dict() == {
        'material': 'kedadry2023', 'changed_constants': ['viscosity'],
        'vents': [{
            'name': '', 'temperature_k': 1400.0,
            'viscosity_pa_s': scene.lava.viscosity_at(1400.0),
        }],
    }


@pytest.mark.parametrize(('name', 'changes'), [
    # as similar to etna_basalt, and more similar
    ('etna_basalt_cells', {'crust_cover': 0.957, 'crust_cover_decay': 0.02}),
    ('etna_basalt_cells', {'viscosity': 5e5, 'crust_cover': 0.957, 'crust_cover_decay': 0.02}),
    ('etna_basalt', {'viscosity': 5.6e5, 'crust_cover': 1.0, 'crust_cover_decay': 0.15}),
    # its composition changes the law of the viscosity
    ('basalt', {'composition': {
        'SiO2': 50.05, 'MgO': 7.2, 'FeO': 12.7, 'CaO': 11.2, 'Al2O3': 14.0,
    }}),
])
def test_named_material_keeps_its_name_in_all_descriptions(name, changes):
    scene = scene_with({'material': name, **changes}, 1400.0)
    found = EruptingLava.of(scene)
    assert found.material == name
    assert EruptingLava.described(scene_to_dict(scene)) == found


def test_lava_with_the_constants_of_another_material_has_its_name():
    constants = {'viscosity': 5.6e5, 'crust_cover': 1.0, 'crust_cover_decay': 0.15}
    lava = {'material': 'etna_basalt', 'crust_strength': 1e4, **constants}
    assert EruptingLava.of(scene_with(lava, 1360.0)).material == 'etna_basalt_cells'
