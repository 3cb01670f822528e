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


"""Lavas by name."""

from pathlib import Path

import numpy as np
import pytest

from lava_ros.effects.crystals import fraction
from lava_ros.errors import LavaError
from lava_ros.scene import Scene, scene_from_dict, scene_from_yaml, Terrain, Vent
from lava_ros.scene.lava import Lava
from lava_ros.scene.materials import DEFAULT, material_named, materials


@pytest.mark.parametrize('name', materials())
def test_materials_are_usable_and_sourced(name: str) -> None:
    """Each makes a lava that flows out of its vent, and each number names its reference."""
    material = material_named(name)
    lava = material.lava
    temperature = float(material.vent_temperature.value)
    assert lava.solidus < temperature
    assert 1.0 < lava.viscosity_at(temperature) < 1e6
    for constant in (material.vent_temperature, *material.constants.values()):
        assert len(constant.source) > 30
        if constant.range is not None:
            low, high = constant.range
            assert low <= float(constant.value) <= high
            assert len(constant.range_source) > 30


def test_paper_is_the_default_lava() -> None:
    """Table 3.1 of the paper is what `Lava()` has."""
    assert material_named('kedadry2023').lava == Lava()


@pytest.mark.parametrize('temperature', [1143.0, 1250.0, 1360.0])
def test_etna_has_the_published_laws(temperature: float) -> None:
    """log10 mu = 20.7089 - 0.0133 T and log10 tau_y = 13.00997 - 0.0089 T."""
    lava = material_named('etna_magflow').lava
    assert np.log10(lava.viscosity_at(temperature)) == pytest.approx(
        20.7089 - 0.0133 * temperature, abs=2e-3
    )
    assert np.log10(lava.yield_strength_at(temperature)) == pytest.approx(
        13.00997 - 0.0089 * temperature, abs=2e-3
    )


def test_crystals_are_the_published_ones() -> None:
    """At the vent and at the solidus, by the line between them."""
    reunion = material_named('reunion_basalt').lava
    assert fraction(reunion, 1387.15) == pytest.approx(0.104, abs=1e-3)
    kilauea = material_named('kilauea_tholeiite').lava
    assert fraction(kilauea, 1423.15) == pytest.approx(0.05, abs=1e-3)
    assert fraction(kilauea, 1237.15) == pytest.approx(0.30, abs=1e-3)


def test_scene_names_a_material(tmp_path: Path) -> None:
    """A scene file takes a lava by name, replaces constants, and vents have its temperature."""
    np.savez(tmp_path / 'ground.npz', elevation=np.zeros((20, 20)), resolution=10.0)
    (tmp_path / 'scene.yaml').write_text(
        'terrain: {file: ground.npz}\n'
        'vents:\n- {position: [50, 50], discharge: 1}\n'
        '- {position: [90, 50], discharge: 1, temperature: 1340}\n'
        'lava: {material: etna_basalt, emissivity: 0.7}\n'
    )
    scene = scene_from_yaml(tmp_path / 'scene.yaml')
    assert scene.lava.emissivity == 0.7
    assert scene.lava.solidus == 1143.0
    assert [vent.temperature for vent in scene.vents] == [1360.0, 1340.0]


@pytest.mark.parametrize('name', ['obsidian', 3, None])
def test_unknown_materials_are_refused(name: object) -> None:
    """A name that is none is answered by those there are."""
    with pytest.raises(LavaError, match='etna_basalt'):
        material_named(name)


def test_what_names_no_lava_has_one() -> None:
    """A scene in Python is the one of a file that says as little, and the lava is `DEFAULT`'s."""
    terrain = Terrain(np.zeros((20, 20)), 10.0)
    written = scene_from_dict({'vents': [{'position': [50, 50], 'discharge': 1}]}, terrain)
    scene = Scene(terrain, (Vent((50.0, 50.0), 1.0, name='vent 0'),))
    assert scene.lava == written.lava == material_named(DEFAULT).lava
    assert scene.vents == written.vents
    assert scene.vents[0].temperature == material_named(DEFAULT).vent_temperature.value
    hotter = Scene(terrain, (Vent((50.0, 50.0), 1.0),), Lava(reference_temperature=1400.0))
    assert hotter.vents[0].temperature == 1400.0
