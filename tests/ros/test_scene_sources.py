# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Python, scene files, the command line and the node read the same inputs as the same scene."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import yaml

from eruption import VENT, write_case
from geodata import feature, write_features
from lava_ros.cli.parser import as_typed, parse_command_line
from lava_ros.cli.scenes import source_of
from lava_ros.errors import LavaError
from lava_ros.hindcast.case import load_case
from lava_ros.ros.parameters import NO_SEA
from lava_ros.ros.startup_inputs import _given
from lava_ros.runs.provenance import identity_of
from lava_ros.scene import Scene, SceneSource

#: Lower-left corner of the ground: 40 x 40 cells of 10 m.
CORNER = (500_000.0, 4_180_000.0)
GROUND = 300.0 - 0.1 * np.mgrid[0:40, 0:40][0] * 10.0

#: A vent without its effusion rate, and a scene.
CRATER = {'name': 'vent 0', 'projected': [500_150.0, 4_180_250.0], 'radius': 20.0}
BASE = {
    'terrain': {'file': 'ground.npz'},
    'vents': [CRATER | {'effusion_rate': 8.0}],
    'lava': {'material': 'reunion_basalt'},
}

PLACE = '500150,4180250'
DAM = {'time': 60.0, 'barriers': 'dam.geojson'}
FLOW = {'file': 'old.geojson', 'thickness': 3.0}
LATER = {'time': 7200.0, 'terrain': 'later.npz'}
DATED = {'file': 'rates.csv', 'start': '2026-03-01T06:00:00Z', 'porosity': 0.2}


class Inputs(NamedTuple):
    """The same inputs in the words of each user; None where one has no words for them.

    Attributes:
        keys: Changes of the base in a scene file.
        fields: Fields of a source with the base.
        words: Command line with the base.
        parameters: Parameters of a node with the base.
    """

    keys: dict[str, Any] | None
    fields: dict[str, Any]
    words: str | None
    parameters: dict[str, Any] | None = None


SAME = {
    'nothing more': Inputs({}, {}, '', {}),
    'terrain': Inputs(
        {'terrain': {'file': 'later.npz'}}, {'terrain': 'later.npz'}, '--terrain later.npz',
        {'terrain_file': 'later.npz'},
    ),
    'sea level': Inputs(
        {'terrain': {'file': 'ground.npz', 'sea_level': 262.0}}, {'sea_level': 262.0},
        '--sea-level 262', {'sea_level': 262.0},
    ),
    'sea level of a terrain': Inputs(
        {'terrain': {'file': 'later.npz', 'sea_level': 262.0}},
        {'terrain': 'later.npz', 'sea_level': 262.0}, '--terrain later.npz --sea-level 262',
        {'terrain_file': 'later.npz', 'sea_level': 262.0},
    ),
    'effusion rate': Inputs(
        {'vents': [CRATER | {'effusion_rate': 5.0}]}, {'effusion_rate': 5.0}, '--effusion-rate 5',
    ),
    'place and rate': Inputs(
        {'vents': [CRATER | {'effusion_rate': 5.0}]},
        {'vent': [(500_150.0, 4_180_250.0)], 'effusion_rate': 5.0},
        f'--vent {PLACE} --effusion-rate 5',
    ),
    'file of vents': Inputs(
        {'vents': [CRATER | {'effusion_rate': 6.0, 'temperature': 1400.0}]},
        {'vents': 'vents.csv'}, '--vents vents.csv',
    ),
    'dated table of dense-rock rates': Inputs(
        {'vents': [CRATER | {'effusion_rate': DATED}]},
        {'effusion_rate': 'rates.csv', 'start': DATED['start'], 'porosity': 0.2},
        f'--effusion-rate rates.csv --start {DATED["start"]} --porosity 0.2',
    ),
    'date of the start': Inputs(
        {'onset': '2026-03-01T06:00:00Z'}, {'start': '2026-03-01T06:00:00Z'},
        '--start 2026-03-01T06:00:00Z',
    ),
    'material': Inputs(
        {'lava': {'material': 'etna_basalt'}}, {'material': 'etna_basalt'},
        '--material etna_basalt',
    ),
    'emplaced flow': Inputs(
        {'emplaced_flows': [FLOW]}, {'emplaced_flows': [FLOW]},
        '--emplaced-flow old.geojson --emplaced-thickness 3',
    ),
    'emplaced flow as ground': Inputs(
        {'emplaced_flows': [FLOW | {'as': 'ground'}]},
        {'emplaced_flows': [FLOW | {'as': 'ground'}]},
        '--emplaced-flow old.geojson --emplaced-thickness 3 --emplaced-as ground',
    ),
    'new ground': Inputs({'events': [LATER]}, {'events': [LATER]}, '--terrain-at 2h later.npz'),
    'barriers': Inputs({'events': [DAM]}, {'events': [DAM]}, None),
    'elevation alone': Inputs(
        None, {'path': 'ground.npz', 'vent': [PLACE], 'effusion_rate': 5.0},
        f'ground.npz --vent {PLACE} --effusion-rate 5',
    ),
    'case': Inputs(None, {'path': 'valley'}, 'valley', {'scene': 'valley'}),
    'case with another vent': Inputs(
        None, {'path': 'valley', 'vent': [f'{VENT[0]},{VENT[1]}'], 'effusion_rate': 5.0},
        f'valley --vent {VENT[0]},{VENT[1]} --effusion-rate 5',
    ),
}

#: The same wrong inputs, and the name of the field in Python, in a file, on the command line and
#: of the node.
WRONG = {
    'sea level': (Inputs(
        {'terrain': {'file': 'ground.npz', 'sea_level': 1e6}}, {'sea_level': 1e6},
        '--sea-level 1e6', {'sea_level': 1e6},
    ), 'sea_level', 'terrain.sea_level', '--sea-level', 'sea_level'),
    'file of the terrain': (Inputs(
        {'terrain': {'file': 'no.npz'}}, {'terrain': 'no.npz'}, '--terrain no.npz',
        {'terrain_file': 'no.npz'},
    ), 'terrain', 'terrain file', '--terrain', 'terrain_file'),
    'effusion rate': (Inputs(
        {'vents': [CRATER | {'effusion_rate': -5.0}]}, {'effusion_rate': -5.0},
        '--effusion-rate -5',
    ), 'effusion_rate', 'vents[0].effusion_rate', '--effusion-rate'),
    'choice for a table': (Inputs(
        {'vents': [CRATER | {'effusion_rate': {'file': 'rates.csv', 'porosity': 2.0}}]},
        {'effusion_rate': 'rates.csv', 'porosity': 2.0},
        '--effusion-rate rates.csv --porosity 2',
    ), 'porosity', 'vents[0].effusion_rate.porosity', '--porosity'),
    'date': (Inputs(
        {'onset': 'spring'}, {'start': 'spring'}, '--start spring',
    ), 'start', 'scene.onset', '--start'),
    'material': (Inputs(
        {'lava': {'material': 'etna-basalt'}}, {'material': 'etna-basalt'},
        '--material etna-basalt',
    ), 'material', 'lava.material', '--material'),
    'thickness': (Inputs(
        {'emplaced_flows': [FLOW | {'thickness': 900.0}]},
        {'emplaced_flows': [FLOW | {'thickness': 900.0}]},
        '--emplaced-flow old.geojson --emplaced-thickness 900',
    ), 'emplaced_flows[0].thickness', 'scene.emplaced_flows[0].thickness',
       '--emplaced-thickness'),
    'grid of new ground': (Inputs(
        {'events': [LATER | {'terrain': 'wide.npz'}]},
        {'events': [LATER | {'terrain': 'wide.npz'}]}, '--terrain-at 2h wide.npz',
    ), 'events[0].terrain', 'scene.events[0].terrain', '--terrain-at[0].terrain'),
    'flow without a thickness': (Inputs(
        {'emplaced_flows': [{'file': 'old.geojson'}]},
        {'emplaced_flows': [{'file': 'old.geojson'}]}, '--emplaced-flow old.geojson',
    ), 'emplaced_flows[0].thickness', 'scene.emplaced_flows[0].thickness',
       '--emplaced-flow[0].thickness'),
    'name of the scene': (Inputs(
        None, {'path': 'no.yaml'}, 'no.yaml', {'scene': 'no.yaml'},
    ), 'scene', None, 'scene', 'scene'),
    'file of a case': (Inputs(
        None, {'path': 'full'}, 'full', {'scene': 'full'},
    ), 'case', None, 'case', 'case'),
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the scene file ``base.yaml`` and everything that the inputs name."""
    monkeypatch.chdir(tmp_path)
    place = {'resolution': 10.0, 'epsg': 32633, 'offset': CORNER}
    grids = {'ground': GROUND, 'later': GROUND + 2.0, 'wide': np.pad(GROUND, 3, mode='edge')}
    for name, elevation in grids.items():
        np.savez(f'{name}.npz', elevation=elevation, **place, source='a survey')
    Path('base.yaml').write_text(yaml.safe_dump(BASE))
    Path('vents.csv').write_text('name,x,y,q,temp,radius\nvent 0,500150,4180250,6,1400,20\n')
    Path('rates.csv').write_text(
        'start,end,q,error\n2026-03-01T06:00:00Z,2026-03-01T09:00:00Z,8,1\n'
        '2026-03-01T09:00:00Z,2026-03-01T18:00:00Z,4,1\n'
    )
    square = np.array([(0, 0), (60, 0), (60, 60), (0, 60), (0, 0)]) + 200.0
    write_features(tmp_path / 'old.geojson', feature('Polygon', [square + CORNER]))
    line = np.array([(50, 100), (250, 100)]) + CORNER
    write_features(tmp_path / 'dam.geojson', feature('LineString', line, height=9.0, width=20.0))
    write_case(tmp_path / 'valley', yaml=(
        'low_pass: 30\nstart: 1800\neffusion_rate: {start: 2021-09-19T14:10:00Z}\n'
        'events: [{time: 3600, terrain: elevation.asc}]\n'
    ))
    (tmp_path / 'full').mkdir()
    return tmp_path


def by_python(inputs: Inputs) -> Scene:
    return SceneSource(**{'path': 'base.yaml', **inputs.fields}).load().scene


def by_file(inputs: Inputs) -> Scene:
    Path('scene.yaml').write_text(yaml.safe_dump(BASE | inputs.keys))
    return SceneSource(path='scene.yaml').load().scene


def by_command(inputs: Inputs) -> Scene:
    words = inputs.words.split()
    if not words or words[0].startswith('--'):
        words = ['base.yaml', *words]
    args = parse_command_line(['effects', *words])
    try:
        return source_of(args).load().scene
    except LavaError as error:
        raise as_typed(error, args) from None


def by_node(inputs: Inputs) -> Scene:
    others = {'terrain_file': '', 'sea_level': NO_SEA, 'frame_id': 'map', 'resume': ''}
    return _given(None, {'scene': 'base.yaml', **others, **inputs.parameters}).scene


#: Readers, each with the part of the inputs that it reads.
READERS = (
    (by_python, 'fields'), (by_file, 'keys'), (by_command, 'words'), (by_node, 'parameters'),
)


@pytest.mark.parametrize('name', SAME)
def test_same_inputs_give_the_same_scene(name, folder):
    inputs = SAME[name]
    scenes = [read(inputs) for read, part in READERS if getattr(inputs, part) is not None]
    if name == 'case':
        scenes.append(load_case('valley').scene)
    assert len(scenes) > 1
    assert {identity_of(scene, {}) for scene in scenes} == {identity_of(scenes[0], {})}
    if name not in ('nothing more', 'elevation alone') and inputs.keys is not None:
        base = by_python(SAME['nothing more'])
        assert identity_of(base, {}) != identity_of(scenes[0], {})


@pytest.mark.parametrize('name', WRONG)
def test_same_wrong_inputs_give_the_same_refusal_in_the_words_of_the_user(name, folder):
    inputs, *words = WRONG[name]
    expected = set()
    for (read, part), word in zip(READERS, words, strict=False):
        if getattr(inputs, part) is None:
            continue
        with pytest.raises(LavaError) as caught:
            read(inputs)
        assert caught.value.field == word
        expected.add(caught.value.expected)
    assert len(expected) == 1


def test_a_scene_knows_its_files_and_the_warnings_about_them(folder):
    source = SceneSource(
        path='base.yaml', vents='vents.csv', events=[DAM], low_pass=20.0, insist=True,
        emplaced_flows=[FLOW],
    )
    Path('base.yaml').write_text(
        yaml.safe_dump(BASE | {'terrain': {'file': 'ground.npz', 'offset': [400.0, 0.0]}})
    )
    found = source.load()
    names = ['vents.csv', 'old.geojson', 'dam.geojson', 'base.yaml', 'ground.npz']
    assert [item['path'] for item in found.digests()] == names
    assert all(item['bytes'] == Path(item['path']).stat().st_size for item in found.digests())
    case = SceneSource(path='valley').load()
    names = {Path(name).name for name, _ in case.files}
    assert names == {'elevation.asc', 'vent.csv', 'effusion_rate.csv', 'case.yaml'}
    Path('base.yaml').write_text(
        'terrain: {file: ground.npz}\nvents: [{position: [150, 250], effusion_rate: 8}]\n'
    )
    assert SceneSource(path='base.yaml').load().remarks == ()
    (remark,) = SceneSource(path='base.yaml', terrain='later.npz').load().remarks
    assert 'positions of vents are now counted from the lower-left corner of a survey' in remark


def test_ground_of_an_emplaced_flow_remains_when_a_case_changes_the_ground(folder):
    x, y = VENT
    dam = f'{{line: [[{x}, {y - 300}], [{x + 60}, {y - 300}]], height: 10, width: 20}}'
    write_case(folder / 'dammed', yaml=f'events: [{{time: 3600, barrier: {dam}}}]\n')
    square = np.add([(0, 0), (60, 0), (60, 60), (0, 60), (0, 0)], (x + 100.0, y - 60.0))
    write_features(folder / 'wall.geojson', feature('Polygon', [square]))
    flows = [{'file': 'wall.geojson', 'thickness': 3.0, 'as': 'ground'}]
    bare, raised = (
        SceneSource(path='dammed', emplaced_flows=some, epsg=32633).load().scene
        for some in ([], flows)
    )
    for time in (0.0, 4000.0):
        added = raised.ground_at(time).elevation - bare.ground_at(time).elevation
        assert added.max() == pytest.approx(3.0, abs=1e-3) and (added > 1.0).sum() >= 4
    dammed = raised.ground_at(4000.0).elevation - raised.terrain.elevation
    assert dammed.max() == pytest.approx(10.0, abs=1e-2)
