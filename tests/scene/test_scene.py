# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Scenes, volumes of vents, and materials."""

from dataclasses import replace
import math
from pathlib import Path

import numpy as np
import pytest

from geodata import write_scene
from lava_ros.effects import possible
from lava_ros.errors import LavaError
from lava_ros.files.resources import share_path
from lava_ros.scene import (
    check_vents,
    Lava,
    Scene,
    scene_from_dict,
    scene_from_yaml,
    scene_to_dict,
    Terrain,
    Vent,
    vents_from_list,
)
from lava_ros.scene.materials import DEFAULT, material_named, materials
from lava_ros.scene.terrain_files import terrain_path
from lava_ros.scene.uncertainty import Uncertainty
from lava_ros.scene.vents import are_alike, match_vents, schedule


def flat(rows=10, columns=20, **options):
    """Return a flat terrain with cells of 10 m."""
    return Terrain(np.zeros((rows, columns)), 10.0, **options)


def test_terrain_finds_the_cell_of_a_position():
    terrain = flat(origin=(100.0, -50.0))
    assert terrain.extent == (100.0, -50.0, 300.0, 50.0)
    assert terrain.cell_at(100.0, -50.0) == (0, 0)
    assert terrain.cell_at(299.9, 49.9) == (9, 19)
    assert terrain.cell_at(300.0, 0.0) is None
    assert not terrain.covers(0.0, 0.0)
    elevation = np.zeros((4, 4))
    elevation[1, 2] = np.nan
    terrain = Terrain(elevation, 1.0)
    assert not terrain.covers(2.5, 1.5)
    assert terrain.covers(1.5, 2.5)


HUGE = 10**400
MIDDLE = (25.0, 15.0)
COLD = Vent(MIDDLE, 1.0, temperature=1100.0)


@pytest.mark.parametrize(('make', 'field'), [
    (lambda: Terrain(np.zeros(5), 1.0), 'terrain.elevation'),
    (lambda: Terrain(np.zeros((3, 3)), 1.0, (0.0, math.nan)), 'terrain.origin[1]'),
    (lambda: Terrain(np.zeros((3, 3)), 1.0, epsg='UTM'), 'terrain.epsg'),
    (lambda: Vent(MIDDLE, -1.0), 'vent.discharge'),
    (lambda: Vent(MIDDLE, [(0.0, 1.0), (0.0, 2.0)]), 'vent.discharge[1][0]'),
    (lambda: Vent(MIDDLE, 1.0, 20.0), 'vent.temperature'),
    (lambda: Vent(MIDDLE, 1.0, end='far'), 'vent.end'),
    (lambda: Lava.paper(density=0), 'lava.density'),
    (lambda: Terrain([['1', '2'], ['3', '4']], 1.0), 'terrain.elevation'),
    (lambda: Terrain(np.zeros((2, 2)), 1.0, (1.7e308, 0.0)), 'terrain.origin[0]'),
    (lambda: Vent(MIDDLE, [(0.0, 3e38)]), 'vent.discharge[0][1]'),
    (lambda: Vent(MIDDLE, 1.0, velocity=(1e30, 0.0)), 'vent.velocity[0]'),
    (lambda: Vent((1e300, 0.0), 1.0), 'vent.position[0]'),
    (lambda: Lava.paper(density=HUGE), 'lava.density'),
    (lambda: Scene(flat(), None, lava=Lava.paper()), 'vents'),
    (lambda: Scene(flat(), [COLD], Lava.paper(solidus=1200.0)), 'vents[0].temperature'),
    (lambda: Scene(flat(), gravity=1e-300, lava=Lava.paper()), 'scene.gravity'),
    (lambda: Scene(flat(), (Vent(MIDDLE, 1.0), Vent((5.0, 500.0), 1.0))), 'vents[1].position'),
    (lambda: check_vents([Vent(MIDDLE, 1.0, end=(-1.0, 5.0))], flat()), 'vents[0].end'),
])
def test_error_names_the_invalid_field(make, field):
    with pytest.raises(LavaError) as caught:
        make()
    assert caught.value.field == field


def test_volume_is_the_integral_of_the_stepwise_series():
    vent = Vent((0.0, 0.0), [(0.0, 2.0), (10.0, 5.0), (20.0, 0.0)])
    assert vent.volume_between(0.0, 30.0) == 70.0
    assert vent.volume_between(5.0, 15.0) == 35.0
    assert vent.volume_between(-10.0, 0.0) == 0.0
    assert Vent((0.0, 0.0), 3.0).volume_between(10.0, 12.0) == 6.0
    vent = Vent((0.0, 0.0), [(10.0, 2.0), (20.0, 5.0), (25.0, 0.0)])
    assert vent.volumes_at([0.0, 12.0, 20.0, 30.0], since=11.0) == [0.0, 2.0, 18.0, 43.0]
    assert Vent((0.0, 0.0), 3.0).volumes_at([4.0, 5.0, 7.0], since=5.0) == [0.0, 0.0, 6.0]
    assert [vent.discharge_at(time) for time in (9.0, 10.0, 24.0, 25.0)] == [0.0, 2.0, 5.0, 0.0]


def scene_file(folder, text):
    """Write a scene on flat ground with its lower-left corner at 1000, 2000."""
    path = write_scene(folder, np.zeros((10, 20)), 10.0, text, offset=(1000.0, 2000.0))
    if 'terrain' in text:
        path.write_text(text)
    return path


def test_scene_file_has_terrain_lava_and_vents(tmp_path):
    text = """
terrain: {file: ground.npz, offset: [990.0, 2000.0]}
lava: {material: kedadry2023, viscosity: 1e4, density: 2600}
vents:
  - {position: [50, 50], discharge: 3, temperature: 1400}
  - {projected: [1060, 2070], projected_end: [1080, 2070], radius: 2, discharge: [[0, 1], [60, 2]]}
ambient_temperature: 290
"""
    scene = scene_from_yaml(scene_file(tmp_path, text))
    assert scene.lava == Lava.paper(viscosity=1e4, density=2600.0)
    assert scene.vents[0] == Vent((50.0, 50.0), 3.0, 1400.0, name='vent 0')
    assert scene.vents[1].position == (70.0, 70.0)
    assert scene.vents[1].end == (90.0, 70.0)
    assert scene.vents[1].discharge == ((0.0, 1.0), (60.0, 2.0))
    assert scene.ambient_temperature == 290.0
    assert scene_to_dict(scene)['terrain']['offset'] == [990.0, 2000.0]


def test_another_terrain_gets_the_offset_of_the_scene_file(tmp_path):
    text = """
terrain: {file: ground.npz, offset: [990.0, 2003.0]}
vents: [{position: [50, 50], discharge: 3}]
"""
    other = Terrain(np.zeros((10, 20)), 10.0, origin=(0.0, 0.0), offset=(1000.0, 2000.0))
    scene = scene_from_yaml(scene_file(tmp_path, text), terrain=other)
    assert (scene.terrain.offset, scene.terrain.origin) == ((990.0, 2003.0), (10.0, -3.0))
    assert scene.terrain.corner == other.corner
    assert scene.vents[0].position == (50.0, 50.0)


def test_finds_scenes_of_the_package_by_name(tmp_path, monkeypatch, caplog):
    monkeypatch.chdir(tmp_path)
    caplog.set_level('INFO')
    scene = scene_from_yaml('etna.yaml')
    assert scene.vents[0].name == 'crater'
    assert 'etna.yaml: no such file here, so that of the package' in caplog.text
    assert terrain_path('st_helens.npz').is_file()
    (tmp_path / 'etna.yaml').write_text('vents: here')
    (tmp_path / 'st_helens.npz').write_text('')
    with pytest.raises(LavaError, match='scene.terrain is missing'):
        scene_from_yaml('etna.yaml')
    assert terrain_path('st_helens.npz') == Path('st_helens.npz')
    with pytest.raises(LavaError, match='looked for') as caught:
        scene_from_yaml('nothing.yaml')
    for place in (tmp_path / 'nothing.yaml', 'examples/nothing.yaml'):
        assert str(place) in str(caught.value)


@pytest.mark.parametrize('name', ['etna', 'uncertain'])
def test_scenes_of_the_package_have_a_vent_in_the_crater(name):
    scene = scene_from_yaml(share_path(f'examples/{name}.yaml'))
    (vent,) = scene.vents
    assert scene.terrain.elevation[scene.terrain.cell_at(*vent.position)] > 1700.0
    assert (scene.uncertainty == Uncertainty(material='etna_basalt')) == (name == 'etna')


def test_detects_celsius_instead_of_kelvin(tmp_path, caplog):
    vent = 'vents: [{{position: [50, 50], discharge: 3, temperature: {}}}]\n'
    with pytest.raises(LavaError, match=r'is 1114.*solidus, 1143 K.*\(1114 Celsius are 1387.15 K'):
        scene_from_yaml(scene_file(tmp_path, vent.format(1114)))
    paper = 'lava: {material: kedadry2023}'
    scene_from_yaml(scene_file(tmp_path, vent.format(1114) + paper))
    assert '309 K below lava.reference_temperature: 1114 Celsius would be' in caplog.text
    caplog.clear()
    scene_from_yaml(scene_file(tmp_path, vent.format(1300) + paper))
    assert caplog.text == ''


def test_error_about_a_projected_vent_has_projected_coordinates(tmp_path):
    text = 'vents: [{projected: [900, 2050], discharge: 3}]'
    sentence = r'projected is \(900, 2050\).*easting 1000 to 1200 m and northing 2000 to 2100'
    with pytest.raises(LavaError, match=sentence):
        scene_from_yaml(scene_file(tmp_path, text))
    data = [{'position': [5, 5], 'projected': [5, 5], 'discharge': 1}]
    with pytest.raises(LavaError, match='projected and position exclude each other'):
        vents_from_list(data, flat())


VENT = Vent((10.0, 20.0), 5.0, name='first')


def test_schedule_appends_changes_of_discharge():
    assert schedule((VENT,), (VENT,), 100.0) == (VENT,)
    one = schedule((VENT,), (replace(VENT, discharge=8.0, name='renamed'),), 100.0)
    assert [(vent.name, vent.discharge) for vent in one] == [
        ('renamed', ((0.0, 5.0), (100.0, 8.0)))
    ]
    two = schedule(one, (replace(VENT, discharge=((50.0, 1.0), (150.0, 2.0), (300.0, 3.0))),), 200)
    assert two[0].discharge == ((0.0, 5.0), (100.0, 8.0), (200.0, 2.0), (300.0, 3.0))
    # the change at 300 s, still in the future, is dropped
    three = schedule(two, (VENT,), 250.0)
    assert three[0].discharge == ((0.0, 5.0), (100.0, 8.0), (200.0, 2.0), (250.0, 5.0))


def test_schedule_closes_and_opens_vents():
    other = Vent((30.0, 20.0), 1.0)
    closed = schedule((VENT,), (other,), 60.0)
    assert [vent.discharge for vent in closed] == [((0.0, 5.0), (60.0, 0.0)), ((60.0, 1.0),)]
    assert [vent.volume_between(0.0, 100.0) for vent in closed] == [300.0, 40.0]
    again = schedule(closed, (VENT,), 80.0)
    assert [vent.volume_between(0.0, 100.0) for vent in again] == [20.0, 400.0]
    assert schedule((), (VENT,), 0.0) == (VENT,)


def test_schedule_has_a_maximum_length_and_keeps_the_volume(monkeypatch):
    monkeypatch.setattr('lava_ros.scene.vents.MAX_SERIES', 50)
    monkeypatch.setattr('lava_ros.scene.vents.MAX_CLOSED', 10)
    vents = ()
    for time in range(200):
        vents = schedule(vents, (replace(VENT, discharge=float(1 + time % 3)),), time)
        series = vents[0].series
        assert len(series) <= 50 and series[0][0] <= 0.0
    emitted = sum(1.0 + time % 3 for time in range(200))
    assert vents[0].volume_between(0.0, 200.0) == pytest.approx(emitted)
    assert vents[0].discharge_at(198.5) == 1.0
    for time in range(20):
        place = Vent((1000.0 + 100.0 * time, 0.0), 1.0)
        vents = schedule(vents, (place,), 5000.0 + time)
    assert len(vents) == 10 + 1


def test_schedule_ignores_sensor_noise():
    vents = ()
    for time in range(100):
        noise = 1e-3 * (time % 2)
        trembling = replace(
            VENT, position=(10.0 + noise, 20.0), discharge=5.0 + noise, temperature=1300.0 + noise
        )
        vents = schedule(vents, (trembling,), float(time))
    assert len(vents) == 1 and vents[0].position == trembling.position
    assert vents[0].volume_between(0.0, 100.0) == pytest.approx(500.05)
    hotter = replace(trembling, temperature=1350.0)
    assert [vent.temperature for vent in schedule(vents, (hotter,), 100.0)] == [1300.001, 1350.0]


FISSURE = Vent((0.0, 0.0), 5.0, radius=5.0, end=(100.0, 0.0))


@pytest.mark.parametrize(('before', 'after', 'expected'), [
    ([VENT], [VENT], [0]),
    ([VENT], [replace(VENT, discharge=9.0, temperature=1200.0, radius=3.0)], [0]),
    # within its size; farther away with the same name; farther away with another or no name
    ([VENT], [replace(VENT, position=(19.0, 20.0), name='second')], [0]),
    ([VENT], [replace(VENT, position=(900.0, 20.0))], [0]),
    ([VENT], [replace(VENT, position=(900.0, 20.0), name='second')], [None]),
    ([replace(VENT, name='')], [Vent((900.0, 20.0), 5.0)], [None]),
    ([VENT], [], []),
    ([], [VENT], [None]),
    # a new vent, first in the list, next to one that stays
    ([VENT], [replace(VENT, position=(12.0, 20.0), name='new'), VENT], [None, 0]),
    # two noisy vents within each other's size, in another order
    (
        [VENT, replace(VENT, position=(15.0, 20.0), name='second')],
        [
            replace(VENT, position=(14.0, 20.0), name='second'),
            replace(VENT, position=(11.0, 20.0)),
        ],
        [1, 0],
    ),
    # two in one place with different temperatures, in another order
    (
        [Vent((0.0, 0.0), 1.0, 1300.0), Vent((0.0, 0.0), 1.0, 1200.0)],
        [Vent((0.0, 0.0), 2.0, 1200.0), Vent((0.0, 0.0), 2.0, 1300.0)],
        [1, 0],
    ),
    (
        [Vent((0.0, 0.0), 1.0, 1300.0), Vent((0.0, 0.0), 1.0, 1200.0)],
        [Vent((1e-3, 0.0), 2.0, 1200.0), Vent((2e-3, 0.0), 2.0, 1300.0)],
        [1, 0],
    ),
    # a fissure with reversed ends, a longer one, and one that becomes a disc
    ([FISSURE], [replace(FISSURE, position=(100.0, 0.0), end=(0.0, 0.0))], [0]),
    ([FISSURE], [replace(FISSURE, end=(140.0, 0.0))], [0]),
    ([FISSURE], [replace(FISSURE, end=(220.0, 0.0))], [None]),
    ([FISSURE], [replace(FISSURE, end=None)], [None]),
    ([replace(FISSURE, name='f')], [replace(FISSURE, name='f', end=None)], [None]),
])
def test_matches_vents_by_place_distance_and_name(before, after, expected):
    assert match_vents(before, after) == expected


def test_matches_a_vent_within_the_minimum_size():
    moved = replace(VENT, position=(40.0, 20.0), name='')
    assert match_vents([VENT], [moved]) == [None]
    assert match_vents([VENT], [moved], least=40.0) == [0]


@pytest.mark.parametrize(('change', 'expected'), [
    ({}, True),
    ({'discharge': 5.2}, True),
    ({'discharge': 5.3}, False),
    ({'discharge': ((0.0, 5.0),)}, False),
    ({'position': (10.0, 29.0)}, True),
    ({'position': (10.0, 31.0)}, False),
    ({'temperature': 1305.0}, True),
    ({'temperature': 1311.0}, False),
    ({'radius': 10.5}, True),
    ({'radius': 12.0}, False),
    ({'velocity': (1.0, 0.0)}, False),
    ({'name': 'renamed'}, True),
])
def test_vents_are_alike_within_sensor_noise(change, expected):
    vent = replace(VENT, temperature=1300.0)
    other = replace(vent, **change)
    assert are_alike([other], [vent]) is expected
    assert not are_alike([other, vent], [vent]) and not are_alike([], [vent])
    assert are_alike([], [])


@pytest.mark.parametrize('name', materials())
def test_material_flows_at_its_vent_and_has_references(name):
    material = material_named(name)
    lava = material.lava
    temperature = float(material.vent_temperature.value)
    assert lava.solidus < temperature
    assert 1.0 < lava.viscosity_at(temperature) < 1e6
    (vent,) = Scene(flat(), [replace(COLD, temperature=None)], lava).vents
    assert vent.temperature == temperature
    for constant in (material.vent_temperature, *material.constants.values()):
        assert len(constant.source) > 30
        if constant.range is not None:
            low, high = constant.range
            assert low <= float(constant.value) <= high
            assert len(constant.range_source) > 30
    if name != 'kedadry2023':
        # without a crust the surface radiates at the temperature of the core
        assert 'cover' in possible(lava)
        cold = (lava.crust_temperature / 1400.0) ** 4
        assert lava.crust_cover * cold + 1.0 - lava.crust_cover < 0.4


def test_scene_file_has_a_material_and_constants_that_replace_its_own(tmp_path):
    text = 'vents:\n- {position: [50, 50], discharge: 1}\n'
    text += '- {position: [90, 50], discharge: 1, temperature: 1340}\n'
    text += 'lava: {material: etna_basalt, emissivity: 0.7}\n'
    scene = scene_from_yaml(scene_file(tmp_path, text))
    assert scene.lava.emissivity == 0.7
    assert scene.lava.solidus == 1143.0
    assert [vent.temperature for vent in scene.vents] == [1360.0, 1340.0]
    assert Scene(flat(), [COLD], Lava.paper(solidus=1000.0)).vents == (COLD,)
    for name in ('obsidian', 3, None):
        with pytest.raises(LavaError, match='etna_basalt'):
            material_named(name)


def test_scene_without_lava_has_the_default_material():
    terrain = Terrain(np.zeros((20, 20)), 10.0)
    written = scene_from_dict({'vents': [{'position': [50, 50], 'discharge': 1}]}, terrain)
    scene = Scene(terrain, (Vent((50.0, 50.0), 1.0, name='vent 0'),))
    assert scene.lava == written.lava == material_named(DEFAULT).lava
    assert scene.vents == written.vents
    assert scene.vents[0].temperature == material_named(DEFAULT).vent_temperature.value
    hotter = Scene(terrain, (Vent((50.0, 50.0), 1.0),), Lava.paper(reference_temperature=1400.0))
    data = {'vents': [{'position': [50, 50], 'discharge': 1}]}
    written = scene_from_dict({**data, 'lava': {'reference_temperature': 1400.0}}, terrain)
    assert hotter.vents[0].temperature == written.vents[0].temperature == 1400.0
