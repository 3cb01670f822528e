# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The node refuses hostile messages, reports them, and keeps running."""

from collections import Counter
import itertools
import os
from pathlib import Path
import random
import re
import time

from hypothesis import settings
import pytest
from rcl_interfaces.srv import GetParameters
from rclpy.duration import Duration

from fuzz.messages import messages, TOPICS
from ros.conftest import start_flow
from waiting import wait_until

#: Maximum delay of a grid on a small, busy machine [s].
MAX_DELAY = 30.0


def _memory(node):
    pages = Path(f'/proc/{node.child.pid}/statm').read_text().split()[1]
    return int(pages) * os.sysconf('SC_PAGE_SIZE')


@pytest.mark.parametrize('seed', range(2))
def test_messages_are_valid_or_raise_lava_errors(seed):
    errors = [item.error() for item in itertools.islice(messages(seed), 400)]
    refused = [error for error in errors if error is not None]
    assert all(error.field for error in refused)
    assert 200 < len(refused) < 400


def test_node_in_this_process_refuses_hostile_messages(local):
    node = start_flow(local)
    for item in itertools.islice(messages(0), 200):
        node.deliver(node.node.resolve_topic_name(item.topic), item.data)
    # valid input clears the error, whatever terrain was accepted before
    node.publish('terrain_info', 'terrain', 'no_vents', 'vents')
    status = node.status_now('inputs', lambda status: int(status['rejected']) > 100)
    assert int(status['accepted']) >= 7
    node.status_now('simulation', lambda item: item['state'] == 'running')
    node.run(2.0)
    node.newest('height', condition=lambda newest: newest['height']['wet'] > 0)
    assert 'Traceback' not in node.log
    assert re.search(r'refused: .*, expected .*', node.log), node.log


@pytest.mark.skipif(settings.default.derandomize, reason='the fuzzers of make nightly run it')
def test_node_survives_hostile_messages(graph, figures):
    count = settings().max_examples
    seed = random.SystemRandom().randrange(10**9)
    print(f'seed {seed}')
    # replaced on success
    figures['messages'] = {'tried': count, 'failed': 1}
    # the vent emits its first particle after a minute
    node = graph.node(device='cpu', time_scale=60.0)
    publisher = graph.publisher()
    listener = graph.listener('height')
    publisher.publish('vents', 'terrain_info', 'terrain')
    listener.wait_for_topic('height', lambda grid: grid['wet'] > 0)
    before = listener.wait_for_status('inputs', lambda _: True)
    assert before['rejected'] == '0'
    memory = _memory(node)
    ways = publisher.publishers
    wait_until(lambda: all(ways[topic].get_subscription_count() for topic in TOPICS))
    kinds, bad, longest = Counter(), Counter(), 0.0
    for item in itertools.islice(messages(seed), count):
        ways[item.topic].publish(item.data)
        # a reader keeps only the last message of some topics, so it must have this one first
        assert ways[item.topic].wait_for_all_acked(Duration(seconds=MAX_DELAY))
        start = time.monotonic()
        publisher.ask(GetParameters, '/lava/get_parameters', names=['time_scale'])
        longest = max(longest, time.monotonic() - start)
        kinds[item.kind] += 1
        # the middleware pads messages to a multiple of four bytes
        sent = item._replace(data=item.data + bytes(-len(item.data) % 4))
        bad[item.topic] += sent.error() is not None
    # valid input clears the error, whatever terrain was accepted before
    publisher.publish('terrain_info', 'terrain', 'no_vents', 'vents')
    status = listener.wait_for_status(
        'inputs',
        # a message may be superseded before it is checked
        lambda status: sum(
            max(0, number - int(status.get(f'rejected.{topic}', 0)))
            for topic, number in bad.items()
        ) <= int(status['superseded']),
        timeout=MAX_DELAY,
    )
    publisher.call('reset')
    for _ in range(3):
        grid = listener.wait_for_topic(
            'height', lambda grid: grid['shape'] == [30, 40] and grid['wet'] > 0, timeout=MAX_DELAY
        )
    assert grid['resolution'] == 10.0
    states = {
        item['status']['lava: simulation']['state']
        for item in listener.seen
        if item['topic'] == 'diagnostics'
    }
    assert 'failed' not in states, (seed, node.log)
    assert node.child.poll() is None
    assert 'Traceback' not in node.log, (seed, node.log)
    assert re.search(r'refused: .*, expected .*', node.log), node.log
    grown = _memory(node) - memory
    assert node.end() == 0
    figures['messages'] = {
        'seed': str(seed),
        'tried': count,
        'failed': 0,
        'kinds': kinds,
        'bad_by_themselves': bad.total(),
        'refused': int(status['rejected']),
        'longest_s': round(longest, 3),
        'memory_grown_mb': round(grown / 1e6, 1),
    }
