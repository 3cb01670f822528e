# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Recordings of a killed process or on a full disk keep the written data."""

import resource
import signal
import time

from nav_msgs.msg import OccupancyGrid
import pytest

from lava_ros.bag import BagReader
from ros.graph_listener import line_of

#: Number of killed recordings, each at a different time in the period of a frame.
KILLS = 20

GRIDS = ('height', 'temperature', 'hazard')


def wait_for_messages(listener):
    """Wait until a bag has some frames and diagnostics, flushed with the next frame."""
    listener.status_now('recorder', lambda status: int(status['messages']) > 30)
    stamp_ns = listener.seen[-1]['stamp_ns']
    listener.wait_for_topic('height', lambda grid: grid['stamp_ns'] > stamp_ns)
    listener.wait_for_topic('height')


def start(graph, bag):
    """Start a node that records, with a publisher of its inputs and a listener to its maps."""
    where = {'bag_directory': str(bag), 'bag_root': str(bag.parent)}
    node = graph.node(device='cpu', time_scale=20.0, record=True, **where)
    publisher, listener = graph.publisher(), graph.listener(*GRIDS)
    publisher.publish('vents', 'terrain_info', 'terrain')
    listener.wait_for_topic('height', lambda grid: grid['wet'] > 0)
    wait_for_messages(listener)
    return node, publisher, listener


def recovered(graph, bag):
    """Return the output of `lava bag recover`, and its (topic, stamp, digest of cells)."""
    copy = bag.with_name(f'{bag.name}_recovered')
    process = graph.process('-m', 'lava_ros.cli.main', 'bag', 'recover', str(bag), '-o', str(copy))
    assert process.wait_for_end() == 0, process.log
    reader = BagReader(copy)
    assert not reader.recovered
    messages = []
    for item in reader.messages():
        topic = item.topic.removeprefix('/')
        is_grid = topic in GRIDS
        cells = line_of(topic, OccupancyGrid, bytes(item.data))['cells'] if is_grid else ''
        messages.append((topic, item.publish_ns, cells))
    lines = [process.line(5.0) for _ in range(2 + len(reader.topics))]
    return lines, messages


def received_grids(listener):
    listener.hear()
    return [
        (item['topic'], item['stamp_ns'], item['cells'])
        for item in listener.seen
        if item['topic'] in GRIDS
    ]


def check_kill(graph, node, listener, bag):
    """Kill a node that records; the bag lacks at most the current frame."""
    node.end(signal.SIGKILL)
    time.sleep(1.0)
    received = received_grids(listener)
    assert BagReader(bag).recovered
    lines, saved = recovered(graph, bag)
    assert lines[0].startswith(f'{len(saved)} messages'), lines
    heights = sum(topic == 'height' for topic, *_ in saved)
    assert any(line.split() == [str(heights), '/height'] for line in lines), lines
    assert lines[-1].endswith('the bag had been cut off')
    # messages before the recording are not part of it
    first = min(stamp for _, stamp, _ in saved)
    lost = [item for item in received if item[1] >= first and item not in set(saved)]
    last = max(stamp for _, stamp, _ in received)
    assert {stamp for _, stamp, _ in lost} <= {last}
    topics = [topic for topic, *_ in saved]
    assert topics[:4] == ['terrain_georeference', 'terrain', 'terrain_info', 'vents']
    assert set(topics) >= {*GRIDS, 'diagnostics'}


@pytest.mark.nightly
@pytest.mark.parametrize('index', range(KILLS))
def test_killed_recording_is_recovered(graph, tmp_path, index, trial):
    with trial('kills'):
        node, _, listener = start(graph, tmp_path / 'bag')
        time.sleep(0.5 + 0.01 * index)
        check_kill(graph, node, listener, tmp_path / 'bag')


@pytest.mark.nightly
@pytest.mark.parametrize('limit', ['any file', 'the file'])
def test_full_disk_stops_only_the_recording(graph, tmp_path, limit):
    bag = tmp_path / 'bag'
    node, publisher, listener = start(graph, bag)
    (file,) = bag.glob('*.mcap')
    # metadata.yaml has more than 1000 bytes, so it cannot be written either
    most = file.stat().st_size + 2000 if limit == 'the file' else 1000
    resource.prlimit(node.child.pid, resource.RLIMIT_FSIZE, (most, resource.RLIM_INFINITY))
    status = listener.wait_for_status('recorder', lambda status: status['level'] == 2)
    assert status['state'] == 'off'
    assert f'recording to {bag} stopped' in status['message']
    assert status['message'].endswith('; trying again')
    assert 'File too large' in status['message']
    node.wait_for_log('File too large')
    # later attempts have errors of their own
    errors = [line for line in node.log.splitlines() if '[ERROR]' in line and 'stopped' in line]
    assert len(errors) == 1, errors

    # not wet cells: their number is constant once lava has reached the border
    before = listener.status_now('simulation')
    status = listener.wait_for_status(
        'simulation',
        lambda status: float(status['simulated_time_s']) > float(before['simulated_time_s']),
    )
    # a lag on a busy machine is a warning
    assert status['state'] == 'running' and status['level'] < 2, status
    received = received_grids(listener)
    _, saved = recovered(graph, bag)
    assert {*GRIDS, 'terrain', 'diagnostics'} <= {topic for topic, *_ in saved}
    end = max(stamp for topic, stamp, _ in saved if topic in GRIDS)
    first = min(stamp for topic, stamp, _ in saved)
    assert {item for item in received if first <= item[1] < end} <= set(saved)

    # a later recording is possible; on request there are no more attempts in between
    publisher.call('record', False)
    assert not listener.status_now('recorder')['message'].endswith('; trying again')
    endless = resource.RLIM_INFINITY
    resource.prlimit(node.child.pid, resource.RLIMIT_FSIZE, (endless, endless))
    assert publisher.set(bag_directory=str(tmp_path / 'next'))['success']
    assert publisher.call('record', True)['success']
    wait_for_messages(listener)
    check_kill(graph, node, listener, tmp_path / 'next')
