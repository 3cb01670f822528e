# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Viscosity of melts by their composition."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.scene import Lava, scene_from_dict, scene_to_dict, Terrain
from lava_ros.scene.composition import MOLAR_MASSES, vft_constants
from lava_ros.scene.materials import ANY_BASALT, material_named, materials

#: Example in the spreadsheet of Giordano et al. (2008).
EXAMPLE = dict(zip(
    MOLAR_MASSES, (62.4, 0.55, 20.01, 0.03, 0.02, 3.22, 9.08, 3.52, 0.93, 0.12, 2.0, 0.5),
    strict=True,
))

N_MORB = {
    'SiO2': 50.42, 'TiO2': 1.53, 'Al2O3': 15.13, 'FeO': 9.81, 'MgO': 7.76, 'CaO': 11.35,
    'Na2O': 2.83, 'K2O': 0.14,
}

#: Sample TVZOh of the examples of VESIcal.
RHYOLITE = {
    'SiO2': 77.9, 'TiO2': 0.08, 'Al2O3': 12.15, 'FeO': 0.95, 'MnO': 0.05, 'MgO': 0.06,
    'CaO': 0.55, 'Na2O': 4.05, 'K2O': 4.12, 'H2O': 4.63,
}


def test_constants_are_those_of_the_published_spreadsheet():
    constants = vft_constants('lava', EXAMPLE)
    assert constants == pytest.approx(
        {'vft_a': -4.55, 'vft_b': 7709.5575, 'vft_c': 326.4472}, rel=1e-5
    )


# the molar masses of the spreadsheet differ in the fourth digit
@pytest.mark.parametrize(('composition', 'celsius', 'expected'), [
    (EXAMPLE, 1200.0, 2.17324),
    (N_MORB, 1200.0, 1.757695),
    ({**N_MORB, 'H2O': 1.0}, 1200.0, 1.055301),
    (RHYOLITE, 900.0, 4.3229),
])
def test_viscosity_is_as_published(composition, celsius, expected):
    lava = Lava(**vft_constants('lava', composition))
    assert np.log10(lava.viscosity_at(celsius + 273.15)) == pytest.approx(expected, abs=3e-4)


def test_oxides_without_water_are_scaled_to_the_rest_of_100_percent():
    constants = vft_constants('lava', {**N_MORB, 'H2O': 1.0})
    scaled = {name: 0.97 * value for name, value in N_MORB.items()}
    assert vft_constants('lava', {**scaled, 'H2O': 1.0}) == pytest.approx(constants)
    assert vft_constants('lava', {**scaled, 'H2O': 0.97})['vft_c'] > constants['vft_c'] + 1.0


@pytest.mark.parametrize(('composition', 'message'), [
    ('basalt', r"lava\.composition is 'basalt', expected a mapping with keys SiO2, "),
    ({'SiO2': 50.0, 'Fe2O3': 10.0}, r'composition\.Fe2O3: unknown key, .* FeO'),
    ({'MgO': 50.0}, r'lava\.composition\.SiO2 is missing, expected a value'),
    ({**N_MORB, 'MgO': -7.76}, r'composition\.MgO is -7\.76, .* at least 0 wt% and at most 100'),
    ({**N_MORB, 'CaO': 'some'}, r"composition\.CaO is 'some', expected a finite number"),
    ({**N_MORB, 'CaO': None}, r'composition\.CaO is missing, expected a finite number'),
    ({**N_MORB, 'SiO2': 45.0}, r'sum of lava\.composition without H2O is 93\.55, .* 95 wt%'),
    ({**N_MORB, 'SiO2': 54.0}, r'sum of lava\.composition without H2O is 102\.55, .* 102 wt%'),
    ({'SiO2': 7.0, 'Al2O3': 78.0, 'MgO': 15.0}, r'B by lava\.composition is -.* above 0 K'),
    ({'SiO2': 33.0, 'Na2O': 33.0, 'P2O5': 34.0}, r'C by lava\.composition is -.* above 0 K'),
])
def test_bad_composition_is_refused(composition, message):
    with pytest.raises(LavaError, match=message):
        vft_constants('lava.composition', composition)


def scene_with(lava):
    terrain = Terrain(np.zeros((20, 20)), 10.0)
    data = {'vents': [{'position': [50, 50], 'discharge': 1}], 'lava': lava}
    return scene_from_dict(data, terrain)


def test_scene_with_a_composition_has_the_other_constants_of_any_basalt():
    scene, basalt = scene_with({'composition': N_MORB}), material_named(ANY_BASALT)
    assert scene.lava == basalt.lava_with(vft_constants('lava', N_MORB))
    assert scene.lava.is_vft and scene.lava != basalt.lava
    assert scene.vents[0].temperature == basalt.vent_temperature.value
    plain = scene_to_dict(scene)
    assert scene_from_dict({'lava': plain['lava']}, scene.terrain).lava == scene.lava
    other = scene_with({'material': 'reunion_basalt', 'composition': N_MORB, 'vft_a': -4.0})
    assert other.lava.crystals == material_named('reunion_basalt').lava.crystals
    assert (other.lava.vft_a, other.lava.vft_b) == (-4.0, scene.lava.vft_b)
    with pytest.raises(LavaError, match=r'sum of scene\.lava\.composition without H2O is 50'):
        scene_with({'composition': {'SiO2': 50}})


@pytest.mark.parametrize('name', [one.name for one in materials().values() if one.composition])
def test_material_with_a_composition_has_its_viscosity(name):
    material = material_named(name)
    composition = {oxide: one.value for oxide, one in material.composition.items()}
    scene = scene_with({'composition': composition})
    # vents without a temperature have that of the named material
    basalt = material_named(ANY_BASALT).lava
    expected = replace(material.lava, reference_temperature=basalt.reference_temperature)
    assert scene.lava == expected
    assert all(len(one.source) > 30 for one in material.composition.values())
