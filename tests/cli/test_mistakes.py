# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Typical mistakes on the command line and in files: errors name field, value and remedy."""

from pathlib import Path
import shlex

import numpy as np
import pytest

from command_line import lava, refused
from lava_ros.cli.parser import COMMANDS

ROOT = Path(__file__).parents[2]

#: A terrain at Piton de la Fournaise, and files that fit it.
FILES = {
    'scene.yaml': (
        'terrain: {file: ground.npz}\n'
        'vents:\n'
        '  - name: crater\n'
        '    projected: [365300.0, 7650400.0]\n'
        '    effusion_rate: 8.0\n'
        'lava: {material: etna_basalt}\n'
    ),
    'places.csv': 'name,x,y\nhut,365500,7650500\n',
    'vents.csv': 'x,y,q\n365300,7650400,9\n',
    'rates.csv': 'date;TADR\n2021-09-19;20\n2021-09-20;40\n',
    'full/notes.txt': 'not a bag\n',
}

#: Mistakes on the command line: the line, and parts of the error. BAG is a bag.
LINES = {
    'mistyped command': ('efects scene.yaml', "COMMAND is 'efects'", 'did you mean lava effects?'),
    'mistyped command of two words': (
        'check instal', "COMMAND is 'instal'", 'did you mean lava check install?'),
    'command without its first word': ('recove', "is 'recove'", 'did you mean lava bag recover?'),
    'command of another family': ('bag replay BAG', "is 'replay'", 'mean lava ros replay?'),
    'mistyped old name': ('hindcats valley', "is 'hindcats'", 'did you mean lava run CASE?'),
    'family alone': ('check', 'COMMAND is missing', 'one of install, solver, accuracy, speed'),
    'old name of an option': ('map BAG -o a.png --time 1h', '--time: unknown', 'is now --at'),
    'scene as an option': (
        'effects --scene scene.yaml', '--scene: unknown option', 'give the SCENE without'),
    'option of other commands': (
        'export BAG -o out --members 4', '--members: unknown option here',
        'belongs to lava run, lava plan'),
    'option of an ensemble': (
        'run scene.yaml --seed 3', '--seed has no effect without --members', 'Add --members'),
    'option of a mapped eruption': (
        'run scene.yaml --runs 4', '--runs has no effect without', 'folder of a mapped eruption'),
    'two targets': (
        'run scene.yaml --within 60s --error 10%', '--within and --error exclude', 'Leave out'),
    'time in a list': (
        'effects scene.yaml --terrain-at 5min ground.npz --terrain-at 4min ground.npz',
        '--terrain-at[1].time is 4min', 'after the event before'),
    'fraction of a scale': ('map BAG -o a.png --scale 1:2,5', "--scale is '1:2,5'", '1:N with N'),
    'scale that is too large': (
        'map BAG -o a.png --scale 1:2e1', '--scale is 1:2e1', 'fit on A4'),
    'error above all': (
        'run scene.yaml --error 200%', "--error is '200%'", 'at most 100'),
    'option of an animation': (
        'map BAG -o a.png --fps 3', '--fps does not apply to .png', 'Leave it out'),
    'several runs in an animation': ('map BAG BAG -o a.gif', 'RUN is', 'one run, for an'),
    'command that does not exist': ('help', "COMMAND is 'help'", "'lava --help' lists"),
    'option before the command': (
        '--preset fine effects scene.yaml', '--preset: unknown option', 'lava COMMAND --preset'),
    'mistyped option': (
        'effects scene.yaml --materiel basalt', '--materiel: unknown', 'did you mean --material?'),
    'mistyped option in place of a required one': (
        'map BAG --otput a.png', '--otput: unknown option', 'did you mean --output?'),
    'long option with one dash': (
        'effects scene.yaml -preset fine', '-preset: unknown option', 'did you mean --preset?'),
    'long option with one dash, as a short one': (
        'map BAG -output a.png', '-output: unknown option', 'did you mean --output?'),
    'mistyped choice': (
        'effects scene.yaml --preset fin', "--preset is 'fin'", 'one of draft', 'mean fine?'),
    'format by another name': (
        'export BAG -o out --formats geotiff', "--formats is 'geotiff'", 'did you mean tif?'),
    'mistyped map': (
        'export BAG -o out --maps thicknes', "--maps is 'thicknes'", 'did you mean thickness?'),
    'option without its value': (
        'effects scene.yaml --preset', '--preset: expected one argument', 'one of draft'),
    'too few values': (
        'map BAG -o a.png --extent 1 2 3', '--extent: expected 4 arguments', 'in metres of the'),
    'time without its file': (
        'effects scene.yaml --terrain-at 2h', '--terrain-at: expected 2', 'elevation at and'),
    'required option': ('plan scene.yaml', '--within is missing', 'wall time to use: 30s, 10min'),
    'required output': ('export BAG', '--output is missing', 'folder to write to'),
    'required file': ('places BAG', 'FILE is missing', '.csv with x,y or lon,lat'),
    'a second scene': (
        'effects scene.yaml other.yaml', "unexpected argument 'other.yaml'", 'effects --help'),
    'time of two words': (
        'plan scene.yaml --within 10 minutes', "argument 'minutes'", 'put quotes around'),
    'unknown unit': ('plan scene.yaml --within 10mins', "--within is '10mins'", 'min, h, d: 6h'),
    'negative time': ('map BAG -o a.png --at -1h', "--at is '-1h'", 'at least 0', 'unit: 6h'),
    'time beyond the bag': ('map BAG -o a.png --at 5d', "--at is '5d'", 'to 43200 s'),
    'no time at all': ('plan scene.yaml --within 0', "--within is '0'", 'above 0'),
    'number as a word': (
        'run scene.yaml -o out --members ten', "--members is 'ten'", 'a whole number'),
    'no members': ('run scene.yaml -o out --members 0', '--members is 0', 'from 1 to 10'),
    'fraction of a seed': (
        'run scene.yaml -o out --members 4 --seed 1.5', "--seed is '1.5'", 'a whole number'),
    'name of a zone as EPSG code': (
        'effects scene.yaml --epsg UTM40S', "--epsg is 'UTM40S'", 'an EPSG code such as 32633'),
    'decimal comma': (
        'effects scene.yaml --effusion-rate 18,5', "--effusion-rate is '18,5'", 'point: 18.5'),
    'negative rate by its other name': (
        'effects scene.yaml --discharge -5', '--effusion-rate is -5', 'at least 0 m3/s'),
    'number with a unit': (
        'export BAG -o out --threshold 10cm', "--threshold is '10cm'", 'without a unit'),
    'latitude first': (
        'effects scene.yaml --vent -21.2430,55.7018', "--vent is '-21.2430,55.7018'",
        'longitude and latitude are swapped'),
    'place with a height': (
        'effects scene.yaml --vent 1,2,3', "--vent is '1,2,3'", 'longitude,latitude [degrees] or'),
    'place in degrees elsewhere': (
        'effects scene.yaml --vent -155.2,19.4', "--vent is '-155.2,19.4'", 'of another place'),
    'place without a comma': (
        'effects scene.yaml --vent "365300 7650400"', "--vent is '365300 7650400'",
        'easting,northing [m]'),
    'place off the map': (
        'effects scene.yaml --vent 500000,4170000', "--vent is '500000,4170000'",
        'covers easting 365000 to 366000 m'),
    'options that exclude each other': (
        'effects scene.yaml --vent 365300,7650400 --vents vents.csv', '--vent and --vents exclude',
        'Leave out one of them.'),
    'option without another': (
        'effects scene.yaml --porosity 0.2', '--porosity has no effect without', 'Add a table of'),
    'mistyped file': ('effects scene.yaml --vents vent.csv', "'vent.csv'", 'mean vents.csv?'),
    'other suffix': ('effects scene.yml', "scene is 'scene.yml'", 'did you mean scene.yaml?'),
    'folder as a file': ('effects --terrain full', "is 'full'", 'a file; this is a folder'),
    'folder that is not a case': (
        'effects full', "case is 'full'", 'a folder that also contains elevation.asc'),
    'elevation twice': (
        'effects ground.npz --terrain ground.npz', 'elevation ground.npz and --terrain exclude',
        'Leave out one of them.'),
    'mistyped material': (
        'effects scene.yaml --material Etna-Basalt', "--material is 'Etna-Basalt'",
        'did you mean etna_basalt?'),
    'mistyped effect': ('effects scene.yaml --on yeild', "--on is 'yeild'", 'mean yielding?'),
    'effect on and off': (
        'effects scene.yaml --on vft --off vft', '--on vft and --off vft exclude', 'Leave out'),
    'format of a picture': (
        'map BAG -o map.jpg', "--output is 'map.jpg'", 'ends with .png or .pdf or .svg'),
    'folder that does not exist': (
        'map BAG -o missing/map.png', "--output is 'missing/map.png'", 'a folder that exists'),
    'folder that is full': ('export BAG -o full', "output is 'full'", 'new or empty'),
    'date of another country': (
        'map BAG -o a.png --start 14.07.2006', "--start is '14.07.2006'", 'in UTC unless'),
    'missing value with a unit': (
        'effects scene.yaml --nodata -9999m', "--nodata is '-9999m'", 'a number, or none'),
    'bag that is none': ('bag info scene.yaml', "bag is 'scene.yaml'", 'expected an MCAP file'),
    'folder without a bag': ('bag info full', "bag is 'full'", 'a directory with .mcap files'),
    'beginning of a name': ('materials etna', "is 'etna'", 'did you mean etna_basalt?'),
}

#: Mistakes in files: the line, the file, the replaced text and its replacement (without one, the
#: whole file), and parts of the error.
EDITS = {
    'mistyped section': (
        'scene.yaml', 'vents:', 'vent:', 'scene.vent: unknown key', 'did you mean vents?'),
    'mistyped key': (
        'scene.yaml', 'effusion_rate', 'efusion_rate', 'vents[0].efusion_rate: unknown key',
        'did you mean effusion_rate?'),
    'mistyped constant': (
        'scene.yaml', 'material: etna_basalt', 'viscocity: 1000.0', 'lava.viscocity: unknown key',
        'did you mean viscosity?'),
    'decimal comma in a scene': (
        'scene.yaml', '8.0', '18,5', "vents[0].effusion_rate is '18,5'", 'point: 18.5'),
    'unit in a scene': (
        'scene.yaml', '8.0', '8 m3/s', "effusion_rate is '8 m3/s'", 'm3/s, without a unit'),
    'Celsius': (
        'scene.yaml', 'effusion_rate', 'temperature: 1087\n    effusion_rate',
        'vents[0].temperature is 1087', '1087 Celsius are 1360.15 K'),
    'two positions': (
        'scene.yaml', 'name: crater', 'position: [300.0, 400.0]',
        'vents[0].projected and position exclude each other', 'Leave out one of them.'),
    'three coordinates': (
        'scene.yaml', '7650400.0', '7650400.0, 240.0', 'projected is [365300.0, 7650400.0, 240.0]',
        'two numbers [x, y] m'),
    'northing first': (
        'scene.yaml', '365300.0, 7650400.0', '7650400.0, 365300.0',
        'vents[0].projected is (7650400.0, 365300.0)', 'easting and northing are swapped'),
    'mistyped elevation file': (
        'scene.yaml', 'ground.npz', 'grond.npz', "terrain file is 'grond.npz'", 'ground.npz?'),
    'tab': (
        'scene.yaml', '    projected', '\tprojected', "scene is 'scene.yaml'", "character '\\t'",
        'line 4, column 1'),
    'key given twice': (
        'scene.yaml', 'lava:', 'lava: {}\nlava:', "'scene.yaml'", 'the key lava twice in line 7'),
    'material with a space': (
        'scene.yaml', 'etna_basalt', 'etna basalt', "lava.material is 'etna basalt'",
        'did you mean etna_basalt?'),
    'time that goes back': (
        'scene.yaml', '8.0', '[[0, 8.0], [3600, 9.0], [1800, 0.0]]',
        'effusion_rate[2][0] is 1800', 'a time after 3600 s'),
    'oxide that does not exist': (
        'scene.yaml', 'material: etna_basalt', 'composition: {SiO: 50.4}',
        'composition.SiO: unknown key', 'did you mean SiO2?'),
    'percent': (
        'scene.yaml', 'material: etna_basalt', 'emissivity: 95', 'lava.emissivity is 95',
        'at most 1'),
    'EPSG code with its name': (
        'scene.yaml', 'ground.npz', 'ground.npz, epsg: UTM40', "terrain.epsg is 'UTM40'",
        'an EPSG code such as 32633'),
    'number for a switch': (
        'scene.yaml', 'ground.npz', 'ground.npz, fill_holes: 1', 'terrain.fill_holes is 1',
        'true or false'),
    'empty scene': (
        'scene.yaml', '', '', "scene is 'scene.yaml'", 'with keys terrain, vents', 'is empty'),
    'table without names of columns': (
        'vents.csv', 'x,y,q\n', '', 'number of lines in vents.csv is 1', 'names of columns'),
    'negative rate in a table': (
        'vents.csv', ',9', ',-9', 'vents.csv, line 2, q is -9', 'at least 0 m3/s'),
    'solid lava in another unit': (
        'vents.csv', 'q\n365300,7650400,9', 'q,temperature_c\n365300,7650400,9,5e2',
        'temperature is 5e2 Celsius, expected above lava.solidus', ' K: colder lava is solid'),
    'solid lava in kelvin': (
        'vents.csv', 'q\n365300,7650400,9', 'q,temperature\n365300,7650400,9,8e2',
        'temperature is 8e2, expected above lava.solidus', '(800 Celsius are 1073.15 K)'),
    'word in a table': (
        'vents.csv', ',9', ',nine', "vents.csv, line 2, q is 'nine'", 'a finite number'),
    'row that is too short': (
        'vents.csv', ',9', '', "vents.csv, line 2 is '365300,7650400'", '3 values'),
    'date with slashes': (
        'rates.csv', '2021-09-20', '20/09/2021', "rates.csv, line 3, date is '20/09/2021'",
        'a date such as 2021-09-19T14:10:00Z'),
    'table without rates': (
        'rates.csv', 'TADR', 'temperature', "rates.csv, first line is 'date,temperature'",
        'effusion_rate or volume'),
}

#: The option that reads each file.
READ = {'vents.csv': '--vents vents.csv', 'rates.csv': '--effusion-rate rates.csv'}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Write ``FILES`` and their terrain into the current folder."""
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_text(text)
    elevation = 200.0 + np.add.outer(0.3 * np.arange(100.0), np.arange(100.0))
    ground = {'elevation': elevation, 'resolution': 10.0, 'epsg': 32740}
    np.savez('ground.npz', **ground, offset=(365_000.0, 7_650_000.0))


def edit(name: str, before: str, after: str) -> None:
    """Replace a text in a file, which occurs there, or all of it if the text is empty."""
    text = Path(name).read_text()
    assert before in text
    Path(name).write_text(text.replace(before, after, 1) if before else after)


def error_of(line: str) -> str:
    """Return the error of a command line, the last line of its output."""
    return refused(*shlex.split(line.replace('BAG', str(ROOT / 'bags/sample')))).splitlines()[-1]


@pytest.mark.parametrize('mistake', LINES)
def test_error_names_field_value_and_remedy(mistake, folder):
    line, *parts = LINES[mistake]
    error = error_of(line)
    assert all(part in error for part in parts), error


@pytest.mark.parametrize('mistake', EDITS)
def test_error_of_a_file_names_field_value_and_remedy(mistake, folder):
    name, before, after, *parts = EDITS[mistake]
    edit(name, before, after)
    error = error_of(f'effects scene.yaml {READ.get(name, "")}')
    assert all(part in error for part in parts), error


#: Places of a number in inputs: the file, the replaced text and its replacement, the command, and
#: the field with its value in errors.
NUMBERS = {
    'option': ('', '', '', 'run scene.yaml --effusion-rate NUMBER', '--effusion-rate is NUMBER'),
    'option that is checked with the ground': (
        '', '', '', 'run scene.yaml --vent 365300,7650400 --spacing NUMBER',
        '--spacing is NUMBER'),
    'place of an option': (
        '', '', '', 'run scene.yaml --vent NUMBER,7650400', "--vent is 'NUMBER,7650400'"),
    'place of an option that is a list': (
        '', '', '', 'barrier ground.npz -o dam.tif --height 5 --line 365300,7650400 NUMBER,?',
        "--line is 'NUMBER,?'"),
    'item of an option': (
        '', '', '', 'map BAG -o a.pdf --extent NUMBER 0 -9 9', '--extent is [NUMBER, 0, -9, 9]'),
    'key': ('scene.yaml', '8.0', 'NUMBER', '', 'vents[0].effusion_rate is NUMBER'),
    'item of a series': (
        'scene.yaml', '8.0', '[[0, 1], [9, NUMBER]]', '',
        'vents[0].effusion_rate[1][1] is NUMBER'),
    'time of a series': (
        'scene.yaml', '8.0', '[[0, 1], [NUMBER, 2]]', '',
        'vents[0].effusion_rate[1][0] is NUMBER'),
    'projected place': (
        'scene.yaml', '365300.0, 7650400.0', '+365300.0, NUMBER', '',
        'vents[0].projected is (+365300.0, NUMBER)'),
    'place': (
        'scene.yaml', 'projected: [365300.0, 7650400.0]', 'position: [NUMBER, 20]', '',
        'vents[0].position is (NUMBER, 20)'),
    'end of a fissure': (
        'scene.yaml', 'projected: [365300.0, 7650400.0]', 'position: [5, 5]\n    end: [5, NUMBER]',
        '', 'vents[0].end is (5, NUMBER)'),
    'limit of a distribution': (
        'scene.yaml', 'lava:', 'uncertainty: {discharge: {distribution: lognormal, median: 1, '
        'factor: 2, limits: [7, NUMBER]}}\nlava:', '',
        'uncertainty.discharge.limits[1] is NUMBER'),
    'factor without limits': (
        'scene.yaml', 'lava:', 'uncertainty: {effusion_rate: {distribution: uniform, low: NUMBER, '
        'high: 2}}\nlava:', '', 'uncertainty.effusion_rate.low is NUMBER'),
    'constant': (
        'scene.yaml', 'material: etna_basalt', 'viscosity: NUMBER', '',
        'lava.viscosity is NUMBER'),
    'rate of vents': (
        'vents.csv', ',9', ',NUMBER', 'run scene.yaml --vents vents.csv',
        'vents.csv, line 2, q is NUMBER'),
    'place of vents': (
        'vents.csv', '365300', 'NUMBER', 'run scene.yaml --vents vents.csv',
        "'vent 0' of vents.csv is (NUMBER, 7650400)"),
    'rate in a table': (
        'rates.csv', ';40', ';NUMBER', 'run scene.yaml --effusion-rate rates.csv',
        'rates.csv, line 3, TADR is NUMBER'),
    'value in another unit': (
        'vents.csv', 'x,y,q\n365300,7650400,9', 'x,y,q,width_km\n365300,7650400,9,NUMBER',
        'run scene.yaml --vents vents.csv', 'vents.csv, line 2, width_km is NUMBER'),
}


@pytest.mark.parametrize('number', ['-5', '-5.0', '-5e0', '-0.050'])
@pytest.mark.parametrize('place', NUMBERS)
def test_error_shows_a_number_as_it_was_typed(place, number, folder):
    name, before, after, line, shown = (
        part.replace('NUMBER', number) for part in NUMBERS[place]
    )
    if name:
        edit(name, before, after)
    assert f'{shown}, expected ' in error_of(line or 'run scene.yaml')


@pytest.mark.parametrize('command', COMMANDS)
def test_every_command_suggests_its_options(command):
    error = refused(command, '--helpp')
    assert error.startswith(f'lava {command}: --helpp: unknown option; did you mean --help?')


@pytest.mark.parametrize('words', [
    'effects scene.yaml --epsg EPSG:32740', 'materials --json', 'materials --json -',
    'effects scene.yaml --vent 365300,7650400 --effusion-rate 1e1 --preset=draft',
])
def test_accepts_what_looks_like_a_mistake(words, folder):
    status, _, error = lava(*shlex.split(words))
    assert status == 0, error
