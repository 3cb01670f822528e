# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Arrival at places: topic, diagnostics, bag, and rejected files."""

import numpy as np
import pytest
import rasterio

from command_line import done
from lava_ros.bag import BagReader
from lava_ros.bag.decoding import Decoder, image_array
from ros.graph_publisher import elevation

#: Simulated time per time of the clock [s/s], and horizon of forecasts [s].
SCALE, HORIZON = 20.0, 400.0

SCENE = """
terrain: {file: slope.npz}
vents: [{position: [60.0, 155.0], discharge: 20.0, radius: 12.0}]
lava: {viscosity: 1.0e4}
uncertainty:
  discharge: {distribution: loguniform, low: 0.2, high: 5.0}
"""

#: Posts along the valley, map frame [m].
POSTS = {f'post {x}': (x, 152.0) for x in range(44, 400, 10)}

QUANTILES = ('p10', 'p50', 'p90')

#: Number of ensemble members, too few for early maps.
MEMBERS = 3

#: Easting and northing of the origin of the map [m].
CORNER = (500_000.0, 4_180_000.0)


@pytest.fixture
def folder(tmp_path):
    """Files of a scene and its places: posts, a road across the valley, a town off the map."""
    np.savez(
        tmp_path / 'slope.npz', elevation=elevation(), resolution=10.0, epsg=32633, offset=CORNER
    )
    (tmp_path / 'scene.yaml').write_text(SCENE, encoding='utf-8')
    rows = [f'{name},{500_000 + x},{4_180_000 + y},,' for name, (x, y) in POSTS.items()]
    rows += ['road,500115,4180005,500115,4180295', 'town,590000,4180000,,']
    (tmp_path / 'places.csv').write_text('\n'.join(['name,x,y,x_end,y_end', *rows]) + '\n')
    return tmp_path


def started(local, **parameters):
    node = local(
        scene='scene.yaml', spacing=0.0, time_scale=SCALE, places=['places.csv'], record=True,
        bag_directory='recorded', **parameters,
    )
    assert node.change('configure') and node.change('activate'), node.log
    node.status_now('simulation', lambda item: item['state'] == 'running')
    return node


def images(bag, topic):
    """Return the images of a topic in a bag by stamp [ns]."""
    decoder = Decoder(bag)

    def read(message):
        stamp = message.header.stamp
        pixels = image_array(message, topic).astype(np.float64)
        return stamp.sec * 10**9 + stamp.nanosec, pixels

    return dict(decoder.decode(item, read) for item in bag.messages({topic}))


def tables(bag):
    """Return each message of the topic in a bag: its stamp, and statuses by name of the place."""
    decoder = Decoder(bag)

    def read(message):
        stamp = message.header.stamp
        statuses = {
            item.name: {pair.key: pair.value for pair in item.values} for item in message.status
        }
        return stamp.sec * 10**9 + stamp.nanosec, statuses

    return [decoder.decode(item, read) for item in bag.messages({'/place_arrivals'})]


def cell_of(place):
    return int(place[1] // 10.0), int(place[0] // 10.0)


def same(text, value):
    return np.isnan(value) if text == '' else np.float32(float(text)) == np.float32(value)


def test_arrivals_are_those_of_the_maps_and_the_geotiff(local, folder):
    node = started(local)
    for _ in range(8):
        node.run(1.0)
    node.status_now('places')
    assert node.change('shutdown')
    bag = BagReader(folder / 'recorded')
    arrived, found = images(bag, '/arrived'), tables(bag)
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
    reached = [name for name in POSTS if last[name]['reached'] == 'true']
    assert 3 < len(reached) < len(POSTS)
    done('export', 'recorded', '-o', 'maps', '--maps', 'arrival')
    done('places', 'recorded', 'places.csv', '-o', 'table.csv')
    table = np.genfromtxt('table.csv', delimiter=',', names=True, dtype=None, encoding='utf-8')
    run = dict(zip(table['name'], table['arrival_p50_s'], strict=True))
    with rasterio.open('maps/arrival.tif') as file:
        for name in reached:
            (value,) = next(file.sample([np.add(POSTS[name], CORNER)]))
            assert same(last[name]['arrival_p50_s'], float(value))
            assert run[name] == float(value)


def same_ensemble(seen):
    """Return the newest table of a complete ensemble with its maps, its stamp and start."""
    maps = {item['stamp_ns'] for item in seen if item['topic'] == 'arrival_time_p90'}
    starts = {
        float(status['start_time_s']): int(status['frame_stamp_ns'])
        for item in seen if item['topic'] == 'diagnostics'
        for status in [item['status']['lava: ensemble']]
        if status.get('members') == str(MEMBERS) and int(status['frame_stamp_ns']) in maps
    }
    for item in reversed(seen):
        if item['topic'] == 'place_arrivals' and item['status']:
            status = item['status']['town']
            start = float(status['forecast_start_s'])
            if status['forecast'] == 'ensemble' and start > 0.0 and start in starts:
                return item, starts[start], start
    return None


def test_ensemble_arrivals_are_those_of_the_quantile_maps(local, folder):
    node = started(
        local, forecast_horizon=HORIZON / 3600.0, forecast_max_age=10.0 * HORIZON,
        ensemble_members=MEMBERS,
    )
    node.run(2.0)
    # the next two ensembles start from this state
    assert node.call('pause', True)['success']
    found = None
    while found is None:
        node.jump(node.now + 1.0)
        node.status_now('ensemble', lambda item: item.get('members') == str(MEMBERS))
        node.status_now('places')
        found = same_ensemble(node.seen)
    line, stamp, start = found
    assert node.change('shutdown')
    bag = BagReader(folder / 'recorded')
    arrived = images(bag, '/arrived')[line['stamp_ns']]
    statuses, compared = line['status'], 0
    for quantile in QUANTILES:
        ahead = images(bag, f'/arrival_time_{quantile}')[stamp]
        for name, place in POSTS.items():
            now = arrived[cell_of(place)]
            expected = now if np.isfinite(now) else start + ahead[cell_of(place)]
            assert same(statuses[name][f'arrival_{quantile}_s'], expected), (name, quantile)
            compared += bool(np.isfinite(expected) and not np.isfinite(now))
    assert compared > 10
    likely = [float(statuses[name]['probability_percent']) for name in POSTS]
    assert likely[1] == 100.0 and likely[-1] < 100.0 and len(set(likely)) > 2
    lengths = [float(statuses['road'][f'inundated_length_{quantile}_m']) for quantile in QUANTILES]
    assert lengths[0] > lengths[2] >= 0.0


def test_diagnostics_list_reached_places_first(local, folder):
    node = started(local)
    node.run(4.0)
    status = node.status_now('places', lambda item: item['level'] == 2)
    assert 'post' in status['message'] and 'lava arrived' in status['message']
    assert status['town'] == 'off the map: nothing is known'
    assert status['post 394'].startswith('no lava yet, and no forecast; the front is ')


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        (None, "places is 'places.csv', expected a file that exists"),
        ('name,east\nhut,5\n', 'the columns x,y'),
        ('name,x,y\nhut,here,5\n', 'line 2 (hut)'),
    ],
)
def test_bad_file_prevents_configuration(local, folder, text, words):
    path = folder / 'places.csv'
    good = path.read_text()
    path.unlink()
    if text is not None:
        path.write_text(text)
    node = local(scene='scene.yaml', places=['places.csv'])
    assert not node.change('configure')
    assert words in node.log
    path.write_text(good)
    assert node.change('configure')


def test_places_without_a_coordinate_system_are_only_an_error(local, folder):
    (folder / 'places.csv').write_text('name,lon,lat\nhut,15.0,37.7\n')
    np.savez(folder / 'slope.npz', elevation=elevation(), resolution=10.0)
    node = started(local)
    status = node.status_now('places', lambda item: item['level'] == 2)
    assert 'line 2 (hut)' in status['message']
    assert 'coordinates of the terrain, which has no coordinate system' in status['message']
    assert node.log.count('places cannot be put on this terrain') == 1
    node.run(1.0)
    assert node.status_now('simulation')['state'] == 'running'
