# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Numbers that cannot be, each with the likely slip, and the right ones beside them."""

from datetime import datetime, timezone
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import yaml

from command_line import lava
from geodata import write_raster, write_scene
from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.scene import scene_from_dict, scene_from_yaml, Terrain
from lava_ros.scene.materials import materials
from lava_ros.scene.plausibility import check_date, RANGES
from lava_ros.scene.terrain_files import load_terrain

#: Elevation of a slope [m], rows from the north, in cells of 25 m of UTM zone 19 south.
X = np.arange(200.0) * 25.0
SLOPE = np.tile(100.0 + 0.15 * X, (200, 1)).astype(np.float32)
PLACE: dict[str, Any] = {'crs': 'EPSG:32719', 'cell': 25.0, 'north_west': (300_000.0, 5_640_000.0)}

#: Lava that is silicic, and lava of Hawaii.
RHYOLITE = {'viscosity': 1e10, 'reference_temperature': 1100.0, 'solidus': 900.0}
FLUID = {'viscosity': 100.0, 'reference_temperature': 1420.0}


class Slip(NamedTuple):
    """A slip: the wrong and the right options, files or keys of a scene, and words that name it.

    ``wrong`` and ``right`` are words of the command line, or mappings: ``elevation`` and the place
    of a raster, or keys of a scene.
    """

    wrong: Any
    right: Any
    words: str


def vent(**keys: Any) -> dict[str, Any]:
    """Return a scene with a vent on the slope."""
    lava_of_it = keys.pop('lava', {})
    place = {'projected': [302_500.0, 5_637_500.0], 'effusion_rate': 10.0}
    return {'vents': [{**place, **keys}], **({'lava': lava_of_it} if lava_of_it else {})}


def rate(value: float, **lava_of_it: float) -> dict[str, Any]:
    """Return a scene with an effusion rate."""
    return vent(effusion_rate=value, lava=lava_of_it)


def place(*words: str) -> tuple[str, ...]:
    """Return the options for a vent."""
    return tuple(f'--vent={word}' for word in words)


ON = place('302500,5637500')

SLIPS = {
    # Laki 1783 had 8,700 m3/s
    'm3 a day': Slip((*ON, '--effusion-rate=1600000'), (*ON, '--effusion-rate=18.5'), 'm3 a day'),
    'm3 a day, 4e5': Slip(rate(4e5), rate(8700.0), '400000 m3 a day would be 4.63 m3/s'),
    'm3 an hour': Slip(rate(36_000.0), rate(10.0), '36000 m3 an hour would be 10 m3/s'),
    'litres a second': Slip(rate(5e4), rate(50.0), '50000 litres a second would be 50 m3/s'),
    'km3 a day': Slip(rate(1e-4), rate(1.16), '0.0001 km3 a day would be 1.16 m3/s'),
    'rhyolite as fast as basalt': Slip(
        rate(5000.0, **RHYOLITE), rate(60.0, **RHYOLITE), 'm3 an hour would be 1.39'
    ),
    'dome in m3 a day': Slip(
        rate(86_400.0, **RHYOLITE), rate(1.0, **RHYOLITE), 'm3 a day would be 1 m3/s'
    ),
    'decimal comma in a rate': Slip(
        (*ON, '--effusion-rate=18,5'), (*ON, '--effusion-rate=18.5'), 'decimal point: 18.5'
    ),
    'decimal comma in a scene': Slip(rate('18,5'), rate(18.5), 'decimal point: 18.5'),  # type: ignore[arg-type]
    'decimal comma in a temperature': Slip(
        vent(temperature='1360,5'), vent(temperature=1360.5), 'decimal point: 1360.5'
    ),
    'decimal commas in a place': Slip(
        place('302500,0,5637500,0'), place('302500.0,5637500.0'), '302500.0,5637500.0'
    ),
    'temperature in Celsius': Slip(
        vent(temperature=1100.0), vent(temperature=1373.15), '1100 Celsius are 1373.15 K'
    ),
    'temperature in Fahrenheit': Slip(
        vent(temperature=1990.0), vent(temperature=1361.0), '1990 Fahrenheit would be 1.36e+03 K'
    ),
    'air in Celsius': Slip(
        vent() | {'ambient_temperature': 20.0}, vent() | {'ambient_temperature': 293.15},
        '20 Celsius are 293.15 K',
    ),
    'solidus in Celsius': Slip(
        vent(lava={'solidus': 900.0, 'viscosity': 1e4}),
        vent(lava={'solidus': 1173.15, 'viscosity': 1e4}), '900 Celsius would be 1173.15 K',
    ),
    'log10 of a viscosity': Slip(
        vent(lava={'viscosity': 4.0}), vent(lava={'viscosity': 1e4}), 'log10 Pa s would be 10000'
    ),
    'viscosity above any': Slip(
        vent(lava={'viscosity': 5e12}), vent(lava={'viscosity': 5e11}),
        '5e+12 poise would be 5e+11',
    ),
    'viscosity below any': Slip(
        vent(lava={'viscosity': 1e-3}), vent(lava=FLUID), '0.001 kPa s would be 1 Pa s'
    ),
    'density in g/cm3': Slip(
        vent(lava={'density': 2.6}), vent(lava={'density': 2600.0}), '2.6 g/cm3 would be 2.6e+03'
    ),
    'density in lb/ft3': Slip(
        vent(lava={'density': 162.0}), vent(lava={'density': 2595.0}),
        '162 lb/ft3 would be 2.59e+03',
    ),
    'specific heat in kJ': Slip(
        vent(lava={'specific_heat': 1.15}), vent(lava={'specific_heat': 1150.0}),
        '1.15 kJ/(kg K) would be 1.15e+03',
    ),
    'yield strength in dyn/cm2': Slip(
        vent(lava={'yield_strength': 4e6}), vent(lava={'yield_strength': 4e5}), 'dyn/cm2 would be'
    ),
    'gravity in cm/s2': Slip(
        vent() | {'gravity': 981.0}, vent() | {'gravity': 1.8}, '981 cm/s2 would be 9.81 m/s2'
    ),
    'gravity in g': Slip(
        vent() | {'gravity': 0.1}, vent() | {'gravity': 1.62}, '0.1 g would be 0.981 m/s2'
    ),
    'radius in cm': Slip(vent(radius=2500.0), vent(radius=25.0), '2500 cm would be 25 m'),
    'radius of a lava lake in mm': Slip(
        vent(radius=9e4), vent(radius=90.0), '90000 mm would be 90 m'
    ),
    'times in ms': Slip(
        vent(effusion_rate=[[0.0, 10.0], [8.64e9, 0.0]]),
        vent(effusion_rate=[[0.0, 10.0], [8.64e6, 0.0]]), 'ms would be 8.64e+06 s',
    ),
    'elevations in km': Slip(
        {'elevation': SLOPE / 1000.0}, {'elevation': SLOPE}, 'in kilometres it would be 746 m'
    ),
    'elevations in km below the sea': Slip(
        {'elevation': SLOPE / 1000.0 - 5.0}, {'elevation': SLOPE - 5000.0},
        'in kilometres it would be 746 m',
    ),
    'elevations in dm': Slip(
        {'elevation': 11.5 * (SLOPE - 100.0)}, {'elevation': 1.15 * (SLOPE - 100.0)},
        'unusually steep: in feet it would be 2.62e+03 m; in decimetres it would be 858 m',
    ),
    'elevations in feet': Slip(
        {'elevation': (SLOPE + 5000.0) * 3.2808}, {'elevation': SLOPE + 5000.0},
        'multiply feet by 0.3048',
    ),
    'cells in cm': Slip(
        {'elevation': SLOPE, 'cell': 2500.0}, {'elevation': SLOPE, 'cell': 25.0},
        '2500 centimetres would be 25 m',
    ),
    'sea at 0 m': Slip(
        {'elevation': np.maximum(SLOPE - 300.0, 0.0)}, {'elevation': np.maximum(SLOPE, 1.0)},
        '--sea-level 0',
    ),
    'sea floor': Slip(
        {'elevation': SLOPE - 700.0}, {'elevation': SLOPE - 400.0}, 'of the cells are below 0 m',
    ),
    'latitude first': Slip(
        place('-39.385,-71.3'), place('-71.3,-39.385'), 'longitude and latitude are swapped'
    ),
    'latitude first with hemispheres lost': Slip(
        place('39.385,71.3'), place('71.3W,39.385S'), 'swapped) in the western and southern'
    ),
    'northern hemisphere': Slip(
        place('-71.3,39.385'), place('-71.3,-39.385'), 'in the southern hemisphere'
    ),
    'eastern hemisphere': Slip(
        place('71.3,-39.385'), place('-71.3,-39.385'), 'in the western hemisphere'
    ),
    'northing first': Slip(
        place('5637500,302500'), place('302500,5637500'), 'easting and northing are swapped'
    ),
    'place in km': Slip(place('302.5,5637.5'), place('302500,5637500'), 'in kilometres'),
    'place in feet': Slip(
        place('992454,18495734'), place('302500,5637500'), 'in feet'
    ),
    'northing of the north': Slip(
        place('302500,-4362500'), place('302500,5637500'), 'northing of the southern hemisphere'
    ),
    'neighbouring zone': Slip(
        place('-213000,5608000'), place('302500,5637500'), 'in the neighbouring zone, EPSG:32720'
    ),
    'place in the map frame': Slip(
        place('2500,2500'), place('302500,5637500'), 'lower-left corner of the terrain'
    ),
    'year of the next century': Slip(
        (*ON, '--effusion-rate={table}:2121'), (*ON, '--effusion-rate={table}:2021'),
        'a digit of the year may be wrong (2021)',
    ),
    'place typed twice': Slip(
        (*ON, *ON, '--effusion-rate=9'), (*ON, *place('302500,5637501'), '--effusion-rate=9'),
        '2 vents at 302500, 5637500 are alike, and each emits 9 m3/s at most',
    ),
    'vent copied in a scene': Slip(
        {'vents': 2 * vent()['vents']}, {'vents': vent()['vents'] + vent(radius=9.0)['vents']},
        '2 vents at 302500, 5637500 are alike, and each emits 10 m3/s at most',
    ),
    'year without a digit': Slip(
        (*ON, '--effusion-rate={table}:1021'), (*ON, '--effusion-rate={table}:2011'),
        'more than 500 years ago',
    ),
}


def said(folder: Path, given: Any) -> tuple[int, str]:
    """Run ``lava effects`` with options, a raster or a scene; return its status and messages."""
    raster = {**PLACE, 'elevation': SLOPE, **(given if 'elevation' in given else {})}
    write_raster(folder / 'm.tif', np.float32(raster.pop('elevation')), **raster)
    words: list[Any] = ['--terrain', folder / 'm.tif']
    if isinstance(given, tuple):
        for word in given:
            option, _, year = word.partition('{table}:')
            if year:
                table = folder / 'rates.csv'
                table.write_text(f'date,effusion_rate\n{year}-03-13,5\n{year}-03-15,0\n')
                word = f'{option}{table}'
            words.append(word)
    elif 'elevation' not in given:
        text = {'terrain': {'file': 'm.tif'}, **given}
        (folder / 'scene.yaml').write_text(yaml.safe_dump(text))
        words = [folder / 'scene.yaml']
    status, _, messages = lava('effects', *words)
    return status, messages


@pytest.mark.parametrize('name', SLIPS)
def test_names_an_implausible_number_and_its_slip(tmp_path, name):
    slip = SLIPS[name]
    _, messages = said(tmp_path, slip.wrong)
    assert slip.words in messages
    status, messages = said(tmp_path, slip.right)
    assert status == 0, messages
    assert slip.words not in messages and 'would be' not in messages


#: Scenes that are unusual, and right.
RIGHT = {
    'Laki 1783': rate(8700.0),
    'Eldgja 934': rate(15_000.0),
    'rhyolite': rate(60.0, **RHYOLITE),
    'dome': rate(0.5, viscosity=1e11, reference_temperature=1123.0, solidus=950.0),
    'lava lake': vent(effusion_rate=0.05, radius=120.0),
    'komatiite': vent(
        temperature=1870.0, lava={'viscosity': 1.0, 'reference_temperature': 1870.0}
    ),
    'Io': vent() | {'gravity': 1.8, 'ambient_temperature': 110.0},
    'no lava yet': rate(0.0),
}


@pytest.mark.parametrize('name', RIGHT)
def test_unusual_scenes_are_right(tmp_path, name):
    status, messages = said(tmp_path, RIGHT[name])
    assert status == 0, messages
    doubts = (' would be ', 'unusually', 'above', 'below')
    assert not [words for words in doubts if words in messages]


@pytest.mark.parametrize(('scene', 'words'), [
    (rate(1e-6), 'effusion_rate is 1e-06 m3/s, below 0.001 m3/s'),
    (rate(1e-6, **RHYOLITE), 'effusion_rate is 1e-06 m3/s, below 0.0001 m3/s'),
    (vent(radius=0.001), 'radius is 0.001 m, below 0.02 m'),
])
def test_small_numbers_are_not_explained_by_the_largest_ones(tmp_path, scene, words):
    status, messages = said(tmp_path, scene)
    assert status == 0 and words in messages
    assert 'largest' not in messages and 'up to some' not in messages


@pytest.mark.parametrize(('elevation', 'cell'), [
    # lidar of lava with blocks of 1 m
    (1500.0 + np.add.outer(0.02 * np.arange(300.0), (np.arange(300.0) % 5 == 0) * 1.0), 0.2),
    # Mauna Loa from the sea floor
    (np.tile(np.linspace(-5500.0, 4169.0, 400), (400, 1)), 250.0),
    # a sandur next to a volcano
    (700.0 + np.tile(0.005 * 10.0 * np.arange(300.0), (300, 1)), 10.0),
    # the wall of a caldera
    (np.where(np.arange(200.0) > 100.0, 1200.0, 300.0) + np.zeros((200, 1)), 10.0),
    # a plane
    (np.zeros((50, 50)), 10.0),
], ids=['lidar', 'sea floor', 'sandur', 'caldera', 'plane'])
def test_unusual_terrains_are_right(tmp_path, elevation, cell, caplog):
    load_terrain(write_raster(tmp_path / 'm.tif', np.float32(elevation), cell=cell))
    assert 'unusually' not in caplog.text and 'would be' not in caplog.text


@pytest.mark.parametrize('name', materials())
def test_named_lavas_are_credible(name, caplog):
    ground = Terrain(np.zeros((10, 20)), 10.0)
    data = {'lava': {'material': name}, 'vents': [{'position': [50.0, 50.0], 'discharge': 10.0}]}
    assert scene_from_dict(data, ground).vents
    assert not caplog.records


def test_user_may_insist(tmp_path):
    scene = rate(2e6)
    path = write_scene(tmp_path, SLOPE, 25.0, {
        **scene, 'vents': [{'position': [500.0, 500.0], 'effusion_rate': 2e6}],
    })
    with pytest.raises(LavaError, match='insist: true in the scene file or --insist'):
        scene_from_yaml(path)
    path.write_text(path.read_text() + 'insist: true\n')
    assert scene_from_yaml(path).vents[0].peak == 2e6
    write_raster(tmp_path / 'm.tif', SLOPE, **PLACE)
    words = ('effects', '--terrain', tmp_path / 'm.tif', *ON, '--effusion-rate', '2e6')
    assert lava(*words)[0] == 2
    status, _, messages = lava(*words, '--insist')
    assert status == 0 and 'm3 a day would be' in messages


@pytest.mark.parametrize(('date', 'words'), [
    ('2026-02-03', ''), ('1783-06-08', ''), ('2026-11-03', 'it would be 2026-03-11'),
    ('2036-05-20', '(2026)'), ('1021-05-20', '(2021)'),
])
def test_dates_are_compared_with_the_clock(date, words, caplog):
    now = datetime(2026, 6, 1, tzinfo=timezone.utc)
    check_date('--start', validation.date('--start', date), now)
    assert words in caplog.text if words else not caplog.text


def test_ranges_are_ordered():
    for item in RANGES.values():
        assert item.possible[0] <= item.believed[0] < item.believed[1] <= item.possible[1]
        assert len({slip.unit for slip in item.slips}) == len(item.slips) > 0
