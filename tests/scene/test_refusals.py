# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""One error names the invalid key of a scene file."""

import numpy as np
import pytest

from geodata import feature, write_features, write_raster, write_scene
from lava_ros.errors import LavaError
from lava_ros.scene import scene_from_yaml
from lava_ros.scene.terrain_files import TERRAIN_OPTIONS

#: Lower-left corner of the ground: 30 x 24 cells of 20 m.
CORNER = (500_000.0, 4_180_000.0)
GROUND = 300.0 - 0.1 * np.mgrid[0:30, 0:24][0] * 20.0
PLACE = {'epsg': 32633, 'offset': CORNER}

AT = 'vents: [{position: [240, 100], radius: 30, '
FLOW, FIRST, RATE = 'scene.emplaced_flows[0]', 'scene.events[0]', 'vents[0].effusion_rate'

#: A distribution and a class of eruptions.
UNIFORM = '{distribution: uniform, low: 3600, high: 86400}'
NORMAL = '{distribution: normal, mean: 0, deviation: 15}'

#: Part of a scene file, the name of the invalid value, and words of the error.
REFUSED = [
    ('terrain: [1, 2', 'scene', 'a readable YAML file'),
    ('- terrain', 'scene', 'a mapping'),
    ('terrain: {}', 'scene.terrain.file', 'required'),
    ('volcano: Etna', 'scene.volcano', 'unknown key'),
    ('lava: {stickiness: 3}', 'scene.lava.stickiness', 'unknown key'),
    ('vents: 3', 'vents', 'a list of vents'),
    ('vents: [{discharge: 5}]', 'vents[0].position', 'required'),
    ('vents: [{position: [500240, 4180100], discharge: 5}]', 'vents[0].position',
     'as easting and northing (the key projected), it would be on the terrain'),
    (AT + 'discharge: 5, end: [500240, 4180100]}]', 'vents[0].end',
     'as easting and northing (the key projected_end), it would be on the terrain'),
    (AT + 'discharge: 5, effusion_rate: 5}]', RATE, 'and discharge exclude each other'),
    (AT + 'effusion_rate: {file: rates.csv, porosity: }}]', f'{RATE}.porosity', 'is missing'),
    ('onset:', 'scene.onset', 'is missing, expected a value; to leave it out'),
    *((f'terrain: {{file: ground.npz, {name}: }}', f'scene.terrain.{name}', 'is missing')
      for name in TERRAIN_OPTIONS),
    (AT + 'name: a}]', RATE, 'is missing, expected a value'),
    ('vents: [{position: [240, 100], radius: 5e-324, discharge: 5}]', 'vents[0].radius',
     'is 5e-324, expected a finite number above 0'),
    (AT + 'effusion_rate: many}]', RATE, "is 'many', expected a finite number"),
    (AT + 'effusion_rate: {gaps: zero}}]', f'{RATE}.file', 'is missing'),
    (AT + 'effusion_rate: {file: a.csv}}]', RATE, "a.csv', expected a file"),
    (AT + 'effusion_rate: {file: rates.csv, gap: 1}}]', f'{RATE}.gap', 'unknown key'),
    (AT + 'effusion_rate: {file: rates.csv, start: now}}]', f'{RATE}.start', 'a date such'),
    (AT + 'effusion_rate: {file: rates.csv, gaps: none}}]', f'{RATE}.gaps', 'interpolate'),
    (AT + 'effusion_rate: {file: rates.csv, porosity: 1}}]', f'{RATE}.porosity', 'below 1'),
    ('emplaced_flows: [{file: a.geojson}]', f'{FLOW}.thickness', 'a thickness [m]'),
    ('emplaced_flows: [{file: a.geojson, thickness: -2}]', f'{FLOW}.thickness', 'above 0'),
    ('emplaced_flows: [{file: a.geojson, thickness: 900}]', f'{FLOW}.thickness', 'at most 500 m'),
    ('emplaced_flows: [{file: flow.tif, thickness: 2}]', f'{FLOW}.file', 'whose name ends with'),
    ('emplaced_flows: [{file: flow.tif, as: rock}]', f'{FLOW}.as', 'one of lava, ground'),
    ('emplaced_flows: [{file: flow.tif, as: ground, temperature: 1300}]', f'{FLOW}.temperature',
     'does not apply to ground'),
    ('emplaced_flows: [{file: flow.tif, temperature: 1e9}]', f'{FLOW}.temperature', 'at most'),
    ('emplaced_flows: [{file: none.tif}]', f'{FLOW}.file', 'none.tif'),
    ('emplaced_flows: [{file: 3}]', f'{FLOW}.file', 'the name of a file'),
    ('emplaced_flows: [{files: a.tif}]', f'{FLOW}.files', 'unknown key'),
    ('events: [{time: 1}]', FIRST, 'one of terrain, barrier, barriers'),
    ('events: [{time: -1, terrain: ground.npz}]', 'events[0].time', 'at least 0'),
    ('events: [{time: 9, terrain: ground.npz}, {time: 9, terrain: ground.npz}]',
     'scene.events[1].time', 'a time after the event before'),
    ('events: [{time: 9, terrain: other.npz}]', f'{FIRST}.terrain',
     'the grid of the previous ground: 30 x 24 ... -tr'),
    ('events: [{time: 9, terrain: north.npz}]', f'{FIRST}.terrain',
     'EPSG:32634 ... EPSG:32633 (gdalwarp -t_srs EPSG:32633 -tr 20 20 -te 5'),
    ('events: [{time: 9, terrain: hole.npz}]', 'vents[0].position', 'on the terrain'),
    ('events: [{time: 9, barriers: 4}]', f'{FIRST}.barriers', 'the name of a file'),
    *((f'uncertainty: {text}', f'uncertainty{field}', words) for text, field, words in (
        ('[]', '', 'a mapping'),
        ('{discharg: {}}', '.discharg', 'unknown key'),
        ('{discharge: 1.5}', '.discharge', 'a mapping with distribution'),
        ('{discharge: {distribution: gamma}}', '.discharge.distribution', 'one of normal'),
        ('{discharge: {distribution: lognormal, median: 1}}', '.discharge.factor', 'required'),
        ('{viscosity: {distribution: normal, mean: 1, deviation: 0.1}}',
         '.viscosity.distribution', "is 'normal', expected a distribution of factors"),
        ('{effusion_rate: {distribution: normal, mean: 1, deviation: 1, limits: [-1, 2]}}',
         '.effusion_rate.limits', 'is (-1, 2), expected a distribution of factors'),
        ('{viscosity: {distribution: uniform, low: 2, high: 1}}', '.viscosity.high', 'above low'),
        ('{viscosity: {distribution: triangular, low: 1, mode: 3, high: 2}}', '.viscosity.mode',
         'from low'),
        ('{temperature: {distribution: uniform, low: -9, high: 9, limits: [0, 1]}}',
         '.temperature.limits', 'unknown key'),
        ('{temperature: {distribution: normal, mean: 0, deviation: 1, limits: [20, 30]}}',
         '.temperature.limits', '0.1 % of the distribution'),
        ('{position: {deviation: 10, radius: 10}}', '.position', 'either deviation or radius'),
        ('{position: {radius: -1}}', '.position.radius', 'at least 0'),
        ('{terrain: {deviation: 1}}', '.terrain.correlation', 'required'),
        ('{eruption: {}}', '.eruption', 'a list of classes'),
        ('{eruption: [{probability: 1}]}', '.eruption[0].duration', 'required'),
        (f'{{eruption: [{{probability: 1, duration: {UNIFORM}, volume: {NORMAL}}}]}}',
         '.eruption[0].volume.distribution', "is 'normal', expected a distribution of values"),
    )),
]


@pytest.mark.parametrize(('text', 'field', 'words'), REFUSED)
def test_error_names_the_invalid_key(text, field, words, tmp_path):
    holed = GROUND.copy()
    holed[3:8, 10:14] = np.nan
    grounds = {'other': GROUND[1:], 'north': GROUND, 'hole': holed}
    for name, heights in grounds.items():
        place = {**PLACE, 'epsg': 32634 if name == 'north' else 32633}
        np.savez(tmp_path / f'{name}.npz', elevation=heights, resolution=20.0, **place)
    (tmp_path / 'rates.csv').write_text('date,q\n2021-09-19,4\n2021-09-20,8\n')
    square = np.array([(0, 0), (100, 0), (100, 100), (0, 100), (0, 0)]) + 200.0
    write_features(tmp_path / 'a.geojson', feature('Polygon', [square + CORNER]))
    flow = np.zeros((30, 24), np.float32)
    flow[10:15, 10:15] = 3.0
    write_raster(tmp_path / 'flow.tif', flow, cell=20.0, north_west=(500_000.0, 4_180_600.0))
    vents = '' if text.startswith('vents') else f'\n{AT}discharge: 10}}]\n'
    path = write_scene(tmp_path, GROUND, 20.0, text + vents, **PLACE)
    if text.lstrip('- ').startswith('terrain'):
        path.write_text(text)
    with pytest.raises(LavaError) as caught:
        scene_from_yaml(path)
    assert caught.value.field == field
    assert all(word in str(caught.value) for word in words.split(' ... ')), str(caught.value)
