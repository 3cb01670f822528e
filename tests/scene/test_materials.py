# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Laws of named lavas, and warnings about given constants, which name many effects."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.effects.crystals import fraction
from lava_ros.scene import Lava, scene_from_dict, Terrain
from lava_ros.scene.materials import DEFAULT, lava_from_dict, material_named


@pytest.mark.parametrize('temperature', [1143.0, 1250.0, 1360.0])
def test_material_laws_are_as_published(temperature):
    """``Lava.paper()`` is table 3.1 of the paper.

    Etna: log10 mu = 20.7089 - 0.0133 T and log10 tau_y = 13.00997 - 0.0089 T.
    """
    assert material_named('kedadry2023').lava == Lava.paper()
    lava = material_named('etna_magflow').lava
    assert np.log10(lava.viscosity_at(temperature)) == pytest.approx(
        20.7089 - 0.0133 * temperature, abs=2e-3
    )
    assert np.log10(lava.yield_strength_at(temperature)) == pytest.approx(
        13.00997 - 0.0089 * temperature, abs=2e-3
    )
    # crystals at the vent and at the solidus, on a line between both
    reunion = material_named('reunion_basalt').lava
    assert fraction(reunion, 1387.15) == pytest.approx(0.104, abs=1e-3)
    kilauea = material_named('kilauea_tholeiite').lava
    assert fraction(kilauea, 1423.15) == pytest.approx(0.05, abs=1e-3)
    assert fraction(kilauea, 1237.15) == pytest.approx(0.30, abs=1e-3)
    basalt = material_named('basalt').lava
    assert fraction(basalt, 1137.0 + 273.15) == pytest.approx(0.15, abs=1e-3)
    assert fraction(basalt, 990.0 + 273.15) == pytest.approx(0.60, abs=1e-3)


@pytest.mark.parametrize(
    ('lava', 'phrase'),
    [
        ({'density': 2.7}, 'density is 2.7 kg/m3, below 500 kg/m3'),
        ({'specific_heat': 1.15}, 'would be 1.15e+03 J/(kg K)'),
        ({'latent_heat': 350.0}, 'would be 3.5e+05 J/kg'),
        ({'viscosity': 5.0}, 'viscosity is 5 Pa s: 5 log10 Pa s would be 100000 Pa s'),
        ({'solidus': 900.0}, '900 Celsius would be 1173.15 K, closer to the usual 1143 K'),
        ({'reference_temperature': 1150.0}, '1150 Celsius would be 1423.15 K'),
        ({'crust_temperature': 500.0}, '500 Celsius would be 773.15 K'),
        ({'material': 'basalt', 'viscosity': 1e5}, 'no effect: the VFT law of this lava gives'),
        ({'material': 'basalt', 'arrhenius': 0.04}, 'no effect: the VFT law of this lava gives'),
        ({'crystals': 0.3}, 'no effect: the lava lacks other constants of the effect crystals'),
        ({'material': 'kedadry2023', 'yield_rate': 0.02}, 'of the effect yielding'),
        ({'viscosity': 100.0, 'density': 2200.0, 'solidus': 1150.0, 'yield_rate': 0.0}, ''),
        ({'material': 'basalt', 'crystals': 0.4, 'liquidus': 1500.0, 'vft_a': -4.0}, ''),
    ],
)
def test_warns_of_constants_in_another_unit_or_without_effect(lava, phrase, caplog):
    scene_from_dict({'lava': lava}, Terrain(np.zeros((10, 20)), 10.0))
    assert phrase in caplog.text and len(caplog.records) == bool(phrase)


@pytest.mark.parametrize('given', [
    {}, {'viscosity': 1e4}, {'viscosity': 1e5, 'solidus': 1150.0}, {'crust_cover': 0.5},
])
def test_same_words_give_the_same_lava_in_python_and_in_yaml(given):
    lava, material = lava_from_dict('lava', given)
    assert Lava(**given) == lava and material.name == DEFAULT
    # the paper's constants are those of a material of their own
    paper, _ = lava_from_dict('lava', {'material': 'kedadry2023', **given})
    assert Lava.paper(**given) == paper
    assert (Lava(**given) == Lava.paper(**given)) is False
    assert replace(Lava(**given), density=2000.0) == Lava(**given, density=2000.0)
