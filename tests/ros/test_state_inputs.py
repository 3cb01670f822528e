# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Inputs that are state, from latched and volatile publishers, over DDS.

The node runs in the process of the test; each of its messages passes the middleware.
"""

from collections import Counter
from concurrent.futures import Future
from contextlib import contextmanager
from itertools import combinations, product
from unittest.mock import Mock

import numpy as np
import pytest
from rclpy.clock import Clock
from rclpy.qos import DurabilityPolicy

from lava_ros.errors import LavaError
from lava_ros.ros import codec, inputs, subscribers
from lava_ros.ros.parameters import Settings
from lava_ros.ros.subscribers import RepeatFilter
from ros.graph_publisher import CASES, outline, publication, Publisher
from ros_domain import own_domain

LATCHED, VOLATILE = DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE

#: A message of each input that is state, by its name in ``CASES``.
STATE = ('terrain', 'vents', 'terrain_info', 'terrain_cloud', 'georeference', 'outline')

#: The same for a slow test.
INPUTS = [*STATE[:2], *(pytest.param(case, marks=pytest.mark.nightly) for case in STATE[2:])]

#: Number of callbacks, or of short waits for one, after which no message is left.
IDLE = 12


@pytest.fixture
def taken(monkeypatch):
    """Count the messages that the node takes, by topic."""
    found, decode = Counter(), subscribers.decode

    def count(data, kind, topic, **options):
        found[topic] += 1
        return decode(data, kind, topic, **options)

    monkeypatch.setattr(subscribers, 'decode', count)
    return found


@contextmanager
def publisher(durability):
    made = Publisher(own_domain('local'), durability=durability)
    try:
        yield made
    finally:
        made.close()


def send(made, case):
    topic, make = CASES[case]
    made.publishers[topic].publish(make())


def settle(made, case, node):
    """Wait until a publisher has found the subscriptions of the node, and no message is left."""
    sender = made.publishers[CASES[case][0]]
    count = 2 if made.durability is LATCHED else 1
    node.wait_until(lambda: sender.get_subscription_count() == count)
    for _ in range(IDLE):
        node.spin()


def check(node, made, case, taken, expected):
    """Wait until the node has taken a number of messages, and check that it takes no more."""
    settle(made, case, node)
    topic = CASES[case][0]
    node.wait_until(lambda: taken[topic] >= expected)
    for _ in range(IDLE):
        node.spin()
    assert taken[topic] == expected, node.log


def start(local):
    node = local(forecast_horizon=1.0, ensemble_members=2)
    assert node.change('configure'), node.log
    return node


@pytest.mark.parametrize('durability', [LATCHED, VOLATILE], ids=['latched', 'volatile'])
@pytest.mark.parametrize('case', INPUTS)
def test_state_is_taken_once_from_a_publisher_at_any_time(local, taken, case, durability):
    # only a latched publisher repeats what it published before the node started
    repeated = int(durability is LATCHED)
    with publisher(durability) as early:
        send(early, case)
        node = start(local)
        check(node, early, case, taken, repeated)
        send(early, case)
        check(node, early, case, taken, repeated + 1)
        # the node starts again
        assert node.change('cleanup') and node.change('configure'), node.log
        count = 2 * repeated + 1
        check(node, early, case, taken, count)
        with publisher(durability) as second:
            settle(second, case, node)
            send(second, case)
            check(node, second, case, taken, count + 1)
            send(early, case)
            check(node, early, case, taken, count + 2)
    # the publisher starts again
    with publisher(durability) as late:
        settle(late, case, node)
        send(late, case)
        check(node, late, case, taken, count + 3)


@pytest.mark.parametrize('case', STATE)
@pytest.mark.parametrize('is_configured', [False, True], ids=['unconfigured', 'undiscovered'])
def test_state_latched_during_the_start_is_taken_once(local, taken, case, is_configured):
    topic = CASES[case][0]
    with publisher(LATCHED) as made:
        node = local(forecast_horizon=1.0, ensemble_members=2)
        if is_configured:
            assert node.change('configure'), node.log
            send(made, case)
        else:
            send(made, case)
            assert node.change('configure'), node.log
        assert taken[topic] == 0
        check(node, made, case, taken, 1)


def test_inputs_of_these_tests_are_all_that_are_state(local):
    node = start(local)
    found = Counter(item.topic_name.removeprefix('/') for item in node.node.subscriptions)
    tested = {CASES[case][0] for case in STATE}
    # grid_map_msgs is not on PyPI
    assert {topic for topic in found if found[topic] == 2} - {'terrain_grid'} == tested
    assert found.keys() - tested <= {'terrain_grid', 'clicked_point', 'clock', 'tf_static'}


def test_clicks_from_before_the_start_open_no_vent(local, taken):
    with publisher(LATCHED) as early:
        send(early, 'click')
        node = start(local)
        sender = early.publishers['clicked_point']
        node.wait_until(sender.get_subscription_count)
        early.publishers['vents'].publish(CASES['vents'][1]())
        node.wait_until(lambda: taken['vents'])
        for _ in range(IDLE):
            node.spin()
        assert taken['clicked_point'] == 0


def test_latched_outline_from_before_the_start_is_a_warning(local):
    node = start(local)
    message = outline()
    message.header.stamp = codec.time_message(round((node.now - 1.0) * 1e9))
    node.deliver('/observed_outline', message)
    status = node.status_now('inputs', lambda item: item['rejected'] == '1')
    assert status['level'] == 1
    assert 'after the start of the node' in status['last_error']


def deliveries(count):
    """Yield each order in which two subscriptions may deliver publications 1 to ``count``.

    Each delivers the last one, and any of the earlier ones in order.
    """
    series = [
        (*some, count) for size in range(count) for some in combinations(range(1, count), size)
    ]
    for latched, volatile in product(series, series):
        total = len(latched) + len(volatile)
        for places in combinations(range(total), len(latched)):
            left, right = iter(latched), iter(volatile)
            yield [
                ('transient_local', next(left)) if place in places else ('volatile', next(right))
                for place in range(total)
            ]


def test_newest_publication_holds_for_each_order_of_delivery():
    for order in deliveries(4):
        repeats, held = RepeatFilter(), []
        for way, number in order:
            if not repeats.is_repeat(way, publication(number)):
                held.append(number)
        assert held[-1] == 4, order
        # complete deliveries: each publication counts once
        if len(order) == 8:
            assert held == [1, 2, 3, 4], order


def test_node_warns_until_the_first_vents(local, monkeypatch):
    monkeypatch.setattr(subscribers, 'VENT_PATIENCE', 0.0)
    node = local()
    assert node.change('configure') and node.change('activate'), node.log
    node.status_now('simulation', lambda item: 'waiting for terrain' in item['message'])
    node.publish('terrain_info', 'terrain')
    status = node.status_now('inputs', lambda item: item['message'] == 'no vent yet')
    assert status['level'] == 1
    node.status_now('simulation', lambda item: item['state'] == 'running')
    node.run(1.0)
    text = 'no vent yet: waiting for a message on vents'
    node.wait_for_log(text)
    assert node.log.count(text) == 1, node.log
    node.publish('vents')
    status = node.status_now('inputs', lambda item: item['message'] != 'no vent yet')
    assert (status['level'], status['message']) == (0, 'all taken')
    # closed vents have been given
    node.publish('no_vents')
    # the first vents restart the simulation
    node.run_commands()
    node.run(1.0)
    assert node.status_now('inputs')['message'] == 'all taken'
    assert node.log.count(text) == 1, node.log


def test_no_warning_of_missing_vents_while_the_first_ones_start_the_simulation(monkeypatch):
    monkeypatch.setattr(subscribers, 'VENT_PATIENCE', 0.0)
    graph, worker, future = Mock(published=Counter()), Mock(latest=None), Future()
    graph.node.get_clock.return_value = Clock()
    graph.other_publishers.return_value = []
    worker.view.scene.vents, worker.set_vents.return_value = (), future
    received = subscribers.InputSubscribers(graph, worker, settings=Settings, steady=Clock())
    callbacks = {call.args[2]: call.args[3] for call in graph.create.call_args_list
                 if call.args[0] == 'subscription'}
    cloud = codec.point_cloud(
        dict.fromkeys(inputs.VENT_FIELDS, np.full(1, 900.0)), codec.header('map', 0)
    )
    info = {'source_timestamp': 1, 'publication_sequence_number': 1}
    callbacks['vents'](codec.serialise(cloud), info)
    worker.set_vents.assert_called_once()
    warn = graph.node.get_logger().warning
    assert received.status().message == 'all taken'
    warn.assert_not_called()
    future.set_exception(LavaError('vents.x', 900.0, 'a place on the terrain'))
    assert received.status().message.startswith('refused vents: vents.x is 900.0')
    warn.assert_called_once_with('no vent yet: waiting for a message on vents')


def test_no_vents_is_a_message_about_vents(local):
    node = local()
    assert node.change('configure'), node.log
    node.publish('terrain_info', 'terrain', 'no_vents')
    node.status_now('inputs', lambda item: item['accepted'] == '3')
    assert node.status_now('inputs')['message'] == 'all taken'
