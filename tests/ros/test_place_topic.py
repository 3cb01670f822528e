# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Arrival at places: topic, diagnostics, bag, and rejected files."""

from pathlib import Path
import re

import numpy as np
import pytest
import yaml

from lava_ros.bag import BagReader
from lava_ros.bag.decoding import Decoder, image_array
from lava_ros.errors import LavaError
from lava_ros.ros.codec import nanoseconds
from lava_ros.ros.forecast_topics import load_places
from ros.graph_publisher import elevation

SCENE = """
terrain: {file: slope.npz, sea_level: -50}
vents: [{position: [60.0, 155.0], discharge: 20.0, radius: 12.0}]
lava: {viscosity: 1.0e4}
onset: 2026-11-27T05:30:00Z
"""

#: Posts along the valley, map frame [m].
POSTS = {f'post {x}': (x, 152.0) for x in range(44, 400, 10)}

QUANTILES = ('p10', 'p50', 'p90')


@pytest.fixture
def folder(tmp_path):
    """Files of a scene and its places: posts, a road across the valley, a town off the map."""
    place = {'epsg': 32633, 'offset': (500_000.0, 4_180_000.0)}
    np.savez(tmp_path / 'slope.npz', elevation=elevation(), resolution=10.0, **place)
    (tmp_path / 'scene.yaml').write_text(SCENE, encoding='utf-8')
    rows = [f'{name},{500_000 + x},{4_180_000 + y},,' for name, (x, y) in POSTS.items()]
    rows += ['road,500115,4180005,500115,4180295', 'town,590000,4180000,,']
    (tmp_path / 'places.csv').write_text('\n'.join(['name,x,y,x_end,y_end', *rows]) + '\n')
    return tmp_path


def started(local):
    node = local(
        scene='scene.yaml', spacing=0.0, places=['places.csv'], record=True,
        bag_directory='recorded',
    )
    assert node.change('configure') and node.change('activate'), node.log
    node.status_now('simulation', lambda item: item['state'] == 'running')
    return node


def read(bag, topic, values):
    """Return stamp [ns] and ``values`` of each message of a topic in a bag."""
    decoder = Decoder(bag)
    return [
        decoder.decode(item, lambda message: (nanoseconds(message.header.stamp), values(message)))
        for item in bag.messages({topic})
    ]


def statuses_of(message):
    return {item.name: {pair.key: pair.value for pair in item.values} for item in message.status}


def cell_of(place):
    return int(place[1] // 10.0), int(place[0] // 10.0)


def same(text, value):
    return np.isnan(value) if text == '' else np.float32(float(text)) == np.float32(value)


def test_arrivals_are_those_of_the_maps(local, folder):
    node = started(local)
    for _ in range(8):
        node.run(1.0)
    status = node.status_now('places')
    # reached places come first
    assert status['level'] == 2
    assert 'post' in status['message'] and 'lava arrived' in status['message']
    assert status['town'] == 'off the map: nothing is known'
    assert status['post 394'].startswith('no lava yet, and no forecast; the front is ')
    assert node.change('shutdown')
    bag = BagReader(folder / 'recorded')
    # terrain from topics would have the sea of the scene file
    parameters = yaml.safe_load(bag.custom_data['parameters'])
    assert parameters['sea_level'] == -50.0
    # the date of the scene file, without a value of the user for the parameter onset
    assert parameters['onset'] == '2026-11-27T05:30Z'
    assert bag.custom_data['onset'] == '2026-11-27T05:30:00Z'
    arrived = dict(read(bag, '/arrived', lambda image: image_array(image, 'arrived').copy()))
    found = read(bag, '/place_arrivals', statuses_of)
    assert len(found) > 3
    for stamp, statuses in found:
        for name, place in POSTS.items():
            value, item = arrived[stamp][cell_of(place)], statuses[name]
            assert all(same(item[f'arrival_{quantile}_s'], value) for quantile in QUANTILES)
            assert item['reached'] == str(not np.isnan(value)).lower()
            assert (item['front_distance_m'] == '0.0') == (not np.isnan(value))
            assert item['probability_percent'] == ('' if np.isnan(value) else '100.0')
        first = np.nanmin(arrived[stamp][:, 11], initial=np.inf)
        assert same(statuses['road']['arrival_p50_s'], first if first < np.inf else np.nan)
        assert statuses['town']['off_map_percent'] == '100.0'
        unknown = ('arrival_p50_s', 'probability_percent', 'reached')
        assert all(statuses['town'][key] == '' for key in unknown)
    _, last = found[-1]
    assert 3 < [last[name]['reached'] for name in POSTS].count('true') < len(POSTS)


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        (None, "places is 'places.csv', expected a file that exists"),
        ('name,east\nhut,5\n', 'the columns x,y'),
        ('name,x,y\nhut,here,5\n', 'line 2 (hut)'),
    ],
)
def test_rejects_bad_files_of_places(tmp_path, monkeypatch, text, words):
    monkeypatch.chdir(tmp_path)
    if text is not None:
        Path('places.csv').write_text(text)
    with pytest.raises(LavaError, match=re.escape(words)):
        load_places(['places.csv'])


def test_places_without_a_coordinate_system_are_only_an_error(local, folder):
    (folder / 'places.csv').write_text('name,lon,lat\nhut,15.0,37.7\n')
    np.savez(folder / 'slope.npz', elevation=elevation(), resolution=10.0)
    node = started(local)
    status = node.status_now('places', lambda item: item['level'] == 2)
    assert 'line 2 (hut)' in status['message']
    assert 'coordinates of the terrain, which has no coordinate system' in status['message']
    assert node.log.count('places cannot be located on this terrain') == 1
    node.run(1.0)
    assert node.status_now('simulation')['state'] == 'running'
