# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Forecasts and ensembles of a node: maps, observed outlines, withdrawals, recording."""

from pathlib import Path

import numpy as np
import pytest

from lava_ros.bag import BagReader
from lava_ros.bag.decoding import Decoder
from lava_ros.errors import LavaError
from lava_ros.layers.layer_files import layers_from_dict
from lava_ros.ros import codec
from lava_ros.ros.forecast_topics import _threshold
from lava_ros.ros.parameters import Settings
from lava_ros.ros.publishers import published_layers
from ros.graph_publisher import elevation

CONFIGS = Path(__file__).parents[2] / 'msg_configs'

#: Simulated time per time of the clock [s/s].
SCALE = 20.0

HORIZON = 400.0

#: Simulated time after which the members' lava differs [s].
FLOWN = 100.0

MEMBERS = 5

SCENE = """
terrain: {file: slope.npz}
vents: [{position: [60.0, 155.0], discharge: 20.0, radius: 12.0}]
lava: {viscosity: 1.0e4}
uncertainty:
  discharge: {distribution: loguniform, low: 0.2, high: 5.0}
  position: {radius: 20.0}
"""

FORECASTS = ('arrival_time', 'arrival', 'arrival_class', 'peak_height', 'peak_temperature')

ENSEMBLES = (
    'inundation_probability', 'arrival_time_p10', 'arrival_time_p50', 'arrival_time_p90',
    'expected_peak_thickness',
)

GRIDS = ('arrival', 'peak_height', 'peak_temperature', 'inundation_probability')
IMAGES = ('arrival_time', *ENSEMBLES[1:])


@pytest.fixture(scope='module')
def node(module_local):
    """A node that makes forecasts and ensembles."""
    node = module_local(
        scene='scene.yaml', spacing=0.0, time_scale=SCALE, forecast_horizon=HORIZON / 3600.0,
        forecast_max_age=10.0 * HORIZON, ensemble_members=MEMBERS, places=['places.csv'],
    )
    ground = {'elevation': elevation(), 'epsg': 32633, 'offset': (5e5, 4.18e6)}
    np.savez(node.directory / 'slope.npz', resolution=10.0, **ground)
    (node.directory / 'places.csv').write_text('name,x,y\npost,500390,4180155\n')
    (node.directory / 'scene.yaml').write_text(SCENE, encoding='utf-8')
    assert node.change('configure') and node.change('activate'), node.log
    node.status_now('simulation', lambda item: item['state'] == 'running')
    return node


def wait_for_ensemble(node, condition=lambda _: True):
    """Return the status of a complete ensemble that fulfils a condition."""
    return node.status_now(
        'ensemble', lambda item: item.get('members') == str(MEMBERS) and condition(item)
    )


def next_forecast(node):
    """Return the arrival of the next forecast, advancing the clock until there is one."""
    before = node.newest('arrival')['arrival']['stamp_ns']

    def found():
        newest = node.newest('arrival')['arrival']
        if newest['stamp_ns'] > before:
            return newest
        # maps are due once a second of the clock
        if node.status_now('forecast')['progress'] == '':
            node.run(1.0)
        return None

    node.run(1.0)
    return node.wait_until(found)


def test_forecasts_are_published_with_their_age(node):
    newest = node.newest('arrival', 'arrival_time', 'peak_height', 'peak_temperature')
    assert newest['arrival']['shape'] == [30, 40]
    assert newest['arrival']['min'] == 0 and newest['arrival']['wet'] > 3
    assert 0.5 * HORIZON < newest['arrival_time']['max'] <= HORIZON
    assert newest['arrival_time']['encoding'] == '32FC1'
    assert newest['peak_height']['max'] > 0 and newest['peak_temperature']['max'] > 0
    forecasts = (next_forecast(node) for _ in range(20))
    # 100 where lava is at the start
    later = next(item for item in forecasts if item['max'] == 100)
    status = node.status_now('forecast')
    assert int(status['frame_stamp_ns']) >= later['stamp_ns']
    assert status['level'] == 0 and status['message'] == 'up to date'
    assert status['is_stale'] == 'false'
    assert float(status['horizon_s']) == HORIZON
    assert float(status['start_time_s']) > 0.0 and float(status['duration_s']) > 0.0
    # it passes with the clock, also within a time step
    simulation = node.status_now('simulation')
    now = float(simulation['simulated_time_s']) + float(simulation['age_s'])
    expected = now - float(status['start_time_s'])
    assert float(status['age_s']) == pytest.approx(expected, abs=0.01)
    assert node.map('arrival')['shape'] == [30, 40]


def test_outlines_weight_the_ensembles_and_are_recorded(node):
    assert node.call('reset')['success']
    node.run_commands()
    assert node.set(bag_directory='bags/forecasts')['success']
    assert node.call('record', True)['success']
    status = wait_for_ensemble(node, lambda item: item['is_stale'] == 'false')
    assert float(status['start_time_s']) < FLOWN
    assert status['level'] == 0 and status['message'] == f'{MEMBERS} of {MEMBERS} members'
    assert float(status['horizon_s']) == HORIZON and float(status['duration_s']) > 0.0
    assert float(status['members_effective']) == MEMBERS
    found = node.newest(
        *ENSEMBLES,
        condition=lambda newest: (
            newest['inundation_probability']['min'] == 0
            and newest['inundation_probability']['max'] == 100
        ),
    )
    place = node.newest(
        'place_arrivals',
        # the first ensemble of a scene also publishes the maps of its first members
        condition=lambda newest: (
            newest['place_arrivals']['status']['post']['members'] == str(MEMBERS)
        ),
    )['place_arrivals']['status']['post']
    assert place['forecast'] == 'ensemble'
    assert float(place['probability_percent']) < 100.0
    for name in ENSEMBLES:
        assert found[name]['shape'] == [30, 40]
        assert name not in IMAGES or found[name]['encoding'] == '32FC1'

    node.run(FLOWN / SCALE)
    node.publish('outline_of_tomorrow')
    node.wait_for_log('observed_outline refused: observed_outline.header.stamp')
    node.publish('outline')
    sharper = node.status_now('ensemble', lambda item: item['outlines'] == '1')
    assert 0.0 < float(sharper['jaccard_mean']) < 1.0
    assert float(sharper['members_left_by_outline']) < MEMBERS - 0.5
    node.wait_for_log(f'of {MEMBERS} members that counted like {MEMBERS}.0 of equal weight, ')
    # new members are drawn near those that are left
    ensembles = int(sharper['ensembles'])
    wait_for_ensemble(
        node,
        lambda item: int(item['ensembles']) > ensembles
        and float(item['members_effective']) == MEMBERS,
    )
    next_forecast(node)
    next_forecast(node)
    assert node.call('record', False)['success']
    bag = BagReader(node.directory / 'bags/forecasts')
    names = {f'/{topic}' for topic in (*FORECASTS, *ENSEMBLES, 'observed_outline')}
    assert names <= set(bag.topics)
    assert 'source: arrival' in bag.custom_data['forecast_config']
    decoder = Decoder(bag)
    found = [
        (codec.nanoseconds(decoder.decode(item).header.stamp), item.publish_ns)
        for item in bag.messages({'/arrival'})
    ]
    assert len(found) >= 2
    # some time after their stamp
    assert all(stamp <= recorded for stamp, recorded in found)
    assert [recorded for _, recorded in found] == sorted(recorded for _, recorded in found)


def test_forecasts_are_withdrawn_when_the_scene_changes(node):
    wait_for_ensemble(node)
    node.newest('arrival', 'arrival_time')
    topics = {*GRIDS, 'arrival_time'}
    node.hear()
    node.publish('click')
    while topics:
        gone = node.wait(lambda item: item['topic'] in topics and item['max'] == -1)
        topics.remove(gone['topic'])
    for what in ('forecast', 'ensemble'):
        node.wait_for_log(f'{what} withdrawn: the scene or the effects have changed')
    node.run(2.0)
    node.wait_for_topic('arrival', lambda item: item['max'] > -1)
    # paused: a forecast does not age
    assert node.call('pause', True)['success']
    node.jump(node.now + 30.0)
    still = node.status_now(
        'forecast', lambda item: item['progress'] == '' and item['age_s'] == '0'
    )
    assert still['is_stale'] == 'false'
    assert node.call('pause', False)['success']


def test_latched_maps_are_not_from_the_future_after_the_clock_went_back(node):
    topics = ('hazard', 'height', *GRIDS, *IMAGES, 'place_arrivals')
    wait_for_ensemble(node, lambda item: item['is_stale'] == 'false')
    assert node.call('pause', True)['success']
    node.status_now('forecast', lambda item: item['progress'] == '' and item['age_s'] == '0')
    jumps = int(node.status_now('simulation')['clock_jumps'])
    # twice, so that the maps of the first jump are also published again
    for back in (500.0, 300.0):
        before = node.newest(*topics)
        node.jump(node.now - back)
        now_ns, jumps = round(node.now * 1e9), jumps + 1
        assert all(item['stamp_ns'] > now_ns for item in before.values())
        found = node.newest(
            *topics,
            condition=lambda newest: all(
                item['stamp_ns'] <= now_ns for item in newest.values()  # noqa: B023
            ),
        )
        # the forecasts still apply
        assert found['hazard']['stamp_ns'] == found['arrival']['stamp_ns'] == now_ns
        assert min(item['stamp_ns'] for item in found.values()) > now_ns - 100 * 10**9
        assert found['arrival']['max'] > -1 and found['inundation_probability']['max'] > -1
        for task in ('forecast', 'ensemble', 'simulation'):
            node.status_now(task, lambda item: int(item['frame_stamp_ns']) <= now_ns)  # noqa: B023
        node.status_now('simulation', lambda item: item['clock_jumps'] == str(jumps))  # noqa: B023
    assert node.call('pause', False)['success']


def test_inactive_node_has_no_latched_forecast(node):
    wait_for_ensemble(node, lambda item: item['is_stale'] == 'false')
    node.newest(*GRIDS, condition=lambda newest: all(item['max'] > -1 for item in newest.values()))
    assert node.change('deactivate'), node.log
    # no change of the scene could withdraw them now
    withdrawn = node.newest(
        *GRIDS, 'place_arrivals',
        condition=lambda newest: all(newest[name]['max'] == -1 for name in GRIDS),
    )
    assert withdrawn['place_arrivals']['status']['post']['forecast'] == 'none'
    for task in ('forecast', 'ensemble'):
        status = node.status_now(task)
        assert status['message'] == 'stale, withdrawn: the node is not active'
    assert node.change('activate'), node.log
    node.newest('arrival', condition=lambda newest: newest['arrival']['max'] > -1)
    wait_for_ensemble(node, lambda item: item['is_stale'] == 'false')


def _refusal(settings, msg_config='default.yaml', forecast_config='forecast.yaml'):
    with pytest.raises(LavaError) as caught:
        published_layers(
            CONFIGS / msg_config, CONFIGS / forecast_config, settings=Settings(**settings)
        )
    return str(caught.value)


def test_rejects_layer_files_that_do_not_fit():
    assert "layers.height.source is 'thickness'" in _refusal({}, forecast_config='default.yaml')
    assert "layers.arrival_time.source is 'arrival'" in _refusal({}, msg_config='forecast.yaml')
    assert 'layers_off' in _refusal({'layers_off': ('arrivals',)})
    layers = published_layers(
        CONFIGS / 'default.yaml', CONFIGS / 'forecast.yaml',
        settings=Settings(layers_off=('arrival',)),
    )
    assert {layer.topic for layer in layers if layer.is_forecast} == {*FORECASTS} - {'arrival'}


def test_rejects_different_arrival_thresholds():
    arrival = {'source': 'arrival', 'message': 'sensor_msgs/Image'}
    thresholds = {'a': {**arrival, 'threshold': 0.01}, 'b': {**arrival, 'threshold': 0.5}}
    with pytest.raises(LavaError, match=r'forecast_config is \[0.01, 0.5\], expected one thresh'):
        _threshold(layers_from_dict({'layers': thresholds}))
