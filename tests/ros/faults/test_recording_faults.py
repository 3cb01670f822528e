# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Recording when the process is killed or the disk is full: what is written stays."""

from hashlib import sha256
import os
import resource
import signal
import time

import pytest

from lava_ros.bag import BagReader

#: How many recordings are killed, each at another moment in the period of a frame. With more than
#: one, as in `make nightly`, a disk is also full for the file alone.
KILLS = int(os.environ.get('LAVA_KILLS', '1'))

GRIDS = ('height', 'temperature', 'hazard')


pytestmark = pytest.mark.usefixtures('alone')


def wait_for_messages(listener):
    """Wait until a bag has some frames, and diagnostics: those are flushed with the next frame."""
    listener.status_now('recorder', lambda status: int(status['messages']) > 30)
    told = listener.seen[-1]['stamp_ns']
    listener.wait_for_topic('height', lambda grid: grid['stamp_ns'] > told)
    listener.wait_for_topic('height')


def start(graph, bag):
    """A node that records, with a publisher that has fed it and a listener that hears lava."""
    where = {'bag_directory': str(bag), 'bag_root': str(bag.parent)}
    node = graph.node(device='cpu', time_scale=20.0, record=True, **where)
    publisher, listener = graph.publisher(), graph.listener(*GRIDS)
    publisher.publish('vents', 'terrain_info', 'terrain')
    listener.wait_for_topic('height', lambda grid: grid['wet'] > 0)
    wait_for_messages(listener)
    return node, publisher, listener


def recovered(graph, bag):
    """What `lava recover` says and the messages (topic, stamp, digest) it has saved."""
    copy = bag.with_name(f'{bag.name}_recovered')
    process = graph.process('-m', 'lava_ros.cli.main', 'recover', str(bag), str(copy))
    assert process.wait_for_end() == 0, process.log
    reader = BagReader(copy)
    assert not reader.recovered
    messages = [
        (item.topic.removeprefix('/'), item.publish_ns, sha256(item.data).hexdigest())
        for item in reader.messages()
    ]
    said = [process.line(5.0) for _ in range(2 + len(reader.topics))]
    return said, messages


def heard_of(listener):
    """The grids that a listener has told of."""
    listener.hear()
    return [
        (item['topic'], item['stamp_ns'], item['sha256'])
        for item in listener.seen
        if item['topic'] in GRIDS
    ]


def check_kill(graph, node, listener, bag):
    """Kill a node that records into a bag; all is there but, at most, the frame at hand."""
    node.end(signal.SIGKILL)
    time.sleep(1.0)
    heard = heard_of(listener)
    assert BagReader(bag).recovered
    said, saved = recovered(graph, bag)
    assert said[0].startswith(f'{len(saved)} messages'), said
    heights = sum(topic == 'height' for topic, *_ in saved)
    assert any(line.split() == [str(heights), '/height'] for line in said), said
    assert said[-1].endswith('the bag had been cut off')
    # Messages of before the recording are none of it.
    first = min(stamp for _, stamp, _ in saved)
    lost = [item for item in heard if item[1] >= first and item not in set(saved)]
    last = max(stamp for _, stamp, _ in heard)
    assert {stamp for _, stamp, _ in lost} <= {last}
    topics = [topic for topic, *_ in saved]
    assert topics[:3] == ['terrain', 'terrain_info', 'vents']
    assert set(topics) >= {*GRIDS, 'diagnostics'}


@pytest.mark.parametrize('index', range(1, KILLS))
def test_a_killed_recording_is_recovered(graph, tmp_path, index, trial):
    """Whenever it is killed; once more after a full disk, which is what every run tries."""
    with trial('kills'):
        node, _, listener = start(graph, tmp_path / 'bag')
        time.sleep(0.5 + 0.01 * index)
        check_kill(graph, node, listener, tmp_path / 'bag')


@pytest.mark.parametrize('limit', ['any file', *['the file'] * (KILLS > 1)])
def test_a_full_disk(graph, tmp_path, limit, trial):
    """The node says so once, stops recording and goes on; what was written is recovered.

    A limit on the size of files stands in for the disk: unlike a small disk it needs no rights.
    """
    bag = tmp_path / 'bag'
    node, publisher, listener = start(graph, bag)
    (file,) = bag.glob('*.mcap')
    # A metadata.yaml has more than 1000 bytes: it cannot be written either.
    most = file.stat().st_size + 2000 if limit == 'the file' else 1000
    resource.prlimit(node.child.pid, resource.RLIMIT_FSIZE, (most, resource.RLIM_INFINITY))
    status = listener.wait_for_status('recorder', lambda status: status['level'] == 2)
    assert status['state'] == 'off'
    assert f'recording to {bag} stopped' in status['message']
    assert 'File too large' in status['message']
    node.wait_for_log('File too large')
    errors = [line for line in node.log.splitlines() if '[ERROR]' in line and 'recording' in line]
    assert len(errors) == 1, errors

    # not the wet cells: those grow no more once lava has come to the border
    before = listener.status_now('simulation')
    status = listener.wait_for_status(
        'simulation',
        lambda status: float(status['simulated_time_s']) > float(before['simulated_time_s']),
    )
    # a busy machine may be behind the clock, which is a warning
    assert status['state'] == 'running' and status['level'] < 2, status
    heard = heard_of(listener)
    _, saved = recovered(graph, bag)
    assert {*GRIDS, 'terrain', 'diagnostics'} <= {topic for topic, *_ in saved}
    # Frame by frame, with no gap before the place where it breaks off.
    end = max(stamp for topic, stamp, _ in saved if topic in GRIDS)
    first = min(stamp for topic, stamp, _ in saved)
    assert {item for item in heard if first <= item[1] < end} <= set(saved)

    # With room again the next recording works; the old bag is not touched.
    endless = resource.RLIM_INFINITY
    resource.prlimit(node.child.pid, resource.RLIMIT_FSIZE, (endless, endless))
    for name in ('next', 'last'):
        assert publisher.set(bag_directory=str(tmp_path / name))['success']
        assert publisher.call('record', True)['success']
        wait_for_messages(listener)
        if name == 'next':
            assert publisher.call('record', False)['success']
            assert not BagReader(tmp_path / 'next').recovered
    refused = publisher.set(bag_directory=str(tmp_path.parent / 'elsewhere'))
    assert not refused['success'] and 'bag_root' in refused['message']
    with trial('kills'):
        check_kill(graph, node, listener, tmp_path / 'last')
