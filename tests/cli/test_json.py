# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The JSON of each command fits its schema, and its numbers have units."""

from collections.abc import Iterator
import json
from pathlib import Path
import re
import shlex
from typing import Any

import fastjsonschema
import numpy as np
import pytest

from command_line import done, lava
from eruption import write_case
from geodata import write_scene
from lava_ros.cli.parser import command_line_parser, COMMANDS
from lava_ros.doctor import Finding, OK
from lava_ros.verification.benchmarks import members
from scripts import load_script

ROOT = Path(__file__).parents[2]
SCRIPT = load_script(ROOT / 'docs/json_outputs.py')

#: Units at the end of a key; keys of a comparison end with its side.
UNIT = re.compile(
    r'_(s|ns|m|m2|m3|k|pa_s|percent|bytes|per_s|m_per_s|m3_per_s|s_per_simulated_hour)'
    r'(_without|_with)?$'
)

#: Meanings of numbers without a unit.
PLAIN = re.compile(r'(Fraction|Ratio|Number|Index|Factor|Logarithm)\b|.*`unit`')

#: A short line of each kind of result.
LINES = {
    'scene': 'run scene.yaml --until 1min --spacing 15 --maps 1 --places huts.csv -o new',
    'ensemble': 'run scene.yaml --members 2 --until 2min --spacing 15 --workers 1 -o many '
    '--places huts.csv --barriers dams.csv',
    'mapped eruption': 'run valley --spacing 40 --maps 1 --runs 2 -o case --places huts.csv',
    'probability of a mapped eruption': 'run valley --members 2 --spacing 40 --workers 1 -o odds',
    'narrowed ensemble': 'run valley --members 4 --spacing 40 --workers 1 -o narrow '
    '--observed valley/footprint.asc --observed-at 900s --posterior 2',
    'calibration': 'calibrate valley --spacing 40 --runs 4 --unknown viscosity -o fit',
    'plan': 'plan scene.yaml --until 5min --error 60%',
    'effects': 'effects scene.yaml',
    'materials': 'materials',
    'page': f'map {ROOT}/bags/sample -o page.png',
    'animation': f'map {ROOT}/bags/sample -o film.gif --seconds 0.5 --fps 4 --width 200',
    'page for a screen': f'map {ROOT}/bags/sample -o page.html',
    'places': f'places {ROOT}/bags/sample huts.csv',
    'places of an ensemble': 'places atlas huts.csv',
    'bag': f'bag info {ROOT}/bags/sample',
    'installation': 'check install',
    'solver': 'check solver --case sheet --preset draft',
    'accuracy': 'check accuracy --quick --case sheet -o rows',
    'speed': 'check speed members --particles 300 --repetitions 1',
    'demo': 'ros demo --preset draft --until 10min',
}

#: Commands without --device.
NO_DEVICE = ('materials', 'map', 'places', 'bag info', 'check install')


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a scene, a mapped eruption, places and a barrier."""
    folder = tmp_path_factory.mktemp('json')
    corner = (500_000.0, 4_180_000.0)
    y, x = np.mgrid[0:30, 0:24] * 20.0
    write_scene(folder, 500.0 - 0.1 * y + 5.0 * np.sin(x / 60.0), 20.0, {
        'vents': [{'position': [240.0, 100.0], 'discharge': 10.0, 'radius': 30.0}],
        'lava': {'viscosity': 5e3},
    }, epsg=32633, offset=corner)
    write_case(folder / 'valley', hours=0.3, yaml='epsg: 32633\nlava: {viscosity: 2.0e+4}\n')
    east, north = corner
    (folder / 'huts.csv').write_text(f'x,y,name\n{east + 240},{north + 190},hut\n')
    (folder / 'dams.csv').write_text(
        'wkt,name,barrier_height,width\n'
        f'"LINESTRING ({east + 180} {north + 170}, {east + 300} {north + 170})",upper,12,30\n'
    )
    return folder


def numbers(shape: dict[str, Any], key: str = '') -> Iterator[tuple[str, str]]:
    """Yield key and description of each number in a schema, also of lists and of names."""
    types = shape.get('type')
    if 'number' in (types if isinstance(types, list) else [types]):
        yield key, shape.get('description', '')
    for name, value in shape.get('properties', {}).items():
        # the unit of an object is that of its parts
        yield from numbers(value, key if UNIT.search(key) else name)
    for part in (*shape.get('anyOf', ()), shape.get('items'), shape.get('additionalProperties')):
        if isinstance(part, dict):
            yield from numbers(part, key)


def test_schemas_and_their_page_are_up_to_date() -> None:
    for path, text in SCRIPT.files().items():
        assert path.read_text(encoding='utf-8') == text, 'run python docs/json_outputs.py'


def test_every_command_with_json_has_a_schema_and_a_line_here() -> None:
    parsers = command_line_parser().commands
    having = {name for name in COMMANDS if '--json' in parsers[name].options}
    assert having == set(SCRIPT.COMMANDS)
    assert having == {name for name in COMMANDS for line in LINES.values()
                      if line.startswith(f'{name} ') or line == name}


@pytest.mark.parametrize('command', SCRIPT.COMMANDS)
def test_every_number_has_a_unit_or_says_what_it_is(command: str) -> None:
    found = list(numbers(SCRIPT.schema(command)))
    assert found or command == 'check install'
    for key, meaning in found:
        assert UNIT.search(key) or PLAIN.match(meaning), f'{key}: {meaning}'


@pytest.mark.parametrize('kind', [
    pytest.param(kind, marks=pytest.mark.nightly if kind == 'demo' else ()) for kind in LINES
])
def test_json_of_a_command_fits_its_schema(
    kind: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    finding = Finding('disk', OK, '2 GB')
    monkeypatch.setattr('lava_ros.cli.install._findings', lambda args: iter([finding]))
    monkeypatch.setattr(members, 'MEMBERS', {'cpu': (2,)})
    monkeypatch.setattr(members, 'SETS', ('bare',))
    words = shlex.split(LINES[kind])
    command = next(name for name in COMMANDS if ' '.join(words).startswith(name))
    if kind == 'places of an ensemble':
        ensemble = 'run scene.yaml --members 2 --until 1min --spacing 20 --workers 1 -o atlas'
        done(*ensemble.split(), '--device', 'cpu')
    device = () if command in NO_DEVICE else ('--device', 'cpu')
    done(*words, *device, '--json', tmp_path / 'a.json')
    data = json.loads((tmp_path / 'a.json').read_text())
    assert data['version'] == 1
    schema = SCRIPT.schema(command)
    # one shape for each kind: the error about several would not name the wrong key
    shape = next(
        item for item in schema.get('anyOf', [schema])
        if 'kind' not in data or item['properties']['kind']['const'] == data['kind']
    )
    fastjsonschema.compile(shape)(data)


def test_json_states_that_a_check_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    finding = Finding('disk', 'FAIL', 'full', 'make room')
    monkeypatch.setattr('lava_ros.cli.install._findings', lambda args: iter([finding]))
    status, out, _ = lava('check install', '--json')
    data = json.loads(out)
    assert (status, data['works'], data['checks'][0]['remedy']) == (1, False, 'make room')
