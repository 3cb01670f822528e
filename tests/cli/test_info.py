# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava bag info` and `lava bag recover`."""

from dataclasses import replace
import json
import math
from pathlib import Path
from typing import Any

import pytest

from command_line import done, lava, refused
from lava_ros.bag import BagReader, BagWriter, LATCHED
from lava_ros.bag.checkpoints import NAME
from lava_ros.cli.console import with_units
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.carriers import count_key, COUNTED, METHODS
from lava_ros.simulation.output.budget import VolumeBudget
from lava_ros.simulation.output.checkpoint import MEDIA_TYPE
import recording
from small_checkpoint import small_checkpoint

SCENE = {
    'terrain': {'shape': [100, 200], 'resolution': 5.0, 'offset': [178980.625, 8138910.4375]},
    'vents': [{'position': [10.0, 20.0], 'discharge': 35.5, 'name': 'summit'}],
    'gravity': 9.81,
}


@pytest.fixture
def bag(tmp_path):
    """Record a bag of three messages with a scene."""
    data = {'scene': json.dumps(SCENE), 'device': 'cuda:0'}
    with BagWriter(tmp_path / 'bag', custom_data=data) as writer:
        for second in range(3):
            writer.write('/hazard', 'std_msgs/msg/Empty', bytes(5), second * 10**9, qos=LATCHED)
            writer.flush()
    return tmp_path / 'bag'


def info(path: Path) -> tuple[list[str], dict[str, Any]]:
    """Return the lines and the JSON that `lava bag info` prints about a bag, finished or not."""
    plain = json.loads(done('bag info', path, '--incomplete', '--json', '-'))
    return done('bag info', path, '--incomplete').splitlines(), plain


def test_info_lists_the_contents_of_a_bag(bag):
    lines = [' '.join(line.split()) for line in info(bag)[0]]
    assert '/hazard std_msgs/msg/Empty 3 reliable transient_local' in lines
    assert 'duration 2.000 s' in lines
    assert 'recording finished' in lines
    assert 'terrain: shape [100, 200], resolution 5, offset [178980.625, 8138910.4375]' in lines
    assert 'position [10, 20], discharge 35.5, name summit' in lines
    assert 'device: cuda:0' in lines


def test_info_as_json(bag, tmp_path):
    done('bag', 'info', bag, '--json', tmp_path / 'info.json')
    data = json.loads((tmp_path / 'info.json').read_text())
    assert data['scene'] == SCENE
    assert data['topics'][0]['qos']['durability'] == 'transient_local'
    assert (data['message_count'], data['finished'], data['duration_s']) == (3, True, 2.0)
    assert info(bag)[1] == data
    refused('bag', 'info', bag, '--json', tmp_path / 'gone' / 'info.json')


def test_truncated_bag_is_described_and_recovered(bag, tmp_path):
    path = bag / 'bag_0.mcap'
    path.write_bytes(path.read_bytes()[:-50])
    (bag / 'metadata.yaml').unlink()
    for options, expected in (((), 1), (('--incomplete',), 0)):
        status, out, error = lava('bag', 'info', bag, *options)
        assert status == expected and 'recording  cut off' in out
        assert f'{bag} was cut off' in error and 'lava bag recover' in error
    assert '3 messages' in done('bag', 'recover', bag, '-o', tmp_path / 'whole')
    assert not BagReader(tmp_path / 'whole').recovered
    assert 'choose another name' in refused('bag', 'recover', bag, '-o', tmp_path / 'whole')
    # cut off within the first chunk
    path.write_bytes(path.read_bytes()[:100])
    status, *texts = lava('bag', 'recover', bag, '-o', tmp_path / 'empty')
    assert status == 1 and 'no message' in ''.join(map(str, texts))


@pytest.mark.parametrize('method', METHODS)
def test_info_lists_checkpoints(method, tmp_path):
    with BagWriter(tmp_path / 'bag', custom_data={}) as writer:
        for count in range(7):
            checkpoint = replace(
                small_checkpoint(100.0 * count, count), accuracy=Accuracy(method=method)
            )
            writer.attach(NAME, MEDIA_TYPE, checkpoint.to_bytes(), count * 10**9)
    lines, report = info(tmp_path / 'bag')
    start = next(index for index, line in enumerate(lines) if line.startswith('checkpoints  7, '))
    assert lines[start].endswith('; resume takes the newest')
    assert lines[start + 1] == '  at 600.000 s simulated, 6.000 s, 6 ' + COUNTED[method]
    stored = report['checkpoints']
    assert [item['time_s'] for item in stored] == [100.0 * count for count in range(7)]
    assert stored[6][count_key(method)] == 6
    assert stored[6]['size_bytes'] == len(checkpoint.to_bytes())


def test_info_warns_of_a_volume_that_is_nan(tmp_path, monkeypatch):
    lost = VolumeBudget(10.0, math.nan)
    made = recording.snapshot_at
    monkeypatch.setattr(recording, 'snapshot_at', lambda *of: replace(made(*of), budget=lost))
    lines, report = info(recording.record(tmp_path / 'bag'))
    assert 'volumes' in lines
    expected = '  warning: Volume was not conserved: an unknown part'
    assert any(line.startswith(expected) for line in lines)
    assert len(report['simulation']['warnings']) == 1


CHANGES = [
    {'stamp_ns': 1, 'time': 0.0, 'effects': {'steep': 'on: slope = 0.8 > 0.12'}},
    {'stamp_ns': 9, 'time': 60.0, 'effects': {'steep': 'off: forced'}},
]
ORIGIN = {'bag': 'bags/first', 'time': 1234.5, 'stamp_ns': 7}


@pytest.mark.parametrize(('name', 'value', 'shown'), [
    ('effects', CHANGES, [
        'effects', '  steep            on: slope = 0.8 > 0.12', '  changed at 60.0 s',
        '  steep            off: forced',
    ]),
    ('resumed_from', ORIGIN, ['resumed    at 1234.500 s simulated, from bags/first']),
])
def test_info_shows_effects_and_the_source_of_a_resumed_run(name, value, shown, tmp_path):
    BagWriter(tmp_path / 'bag', custom_data={name: json.dumps(value)}).close()
    lines, report = info(tmp_path / 'bag')
    place = lines.index(shown[0])
    assert lines[place : place + len(shown)] == shown
    assert 'custom data' not in lines
    assert report[name] == with_units(value, s='time')


@pytest.mark.parametrize(('name', 'text'), [
    *(('effects', text) for text in ('[1', '[1]', '{}', '[{"time": 0}]')),
    *(('resumed_from', text) for text in ('[1]', '{"bag": 1, "time": 2}', 'a bag')),
    ('scene', '[Etna'),
])
def test_info_shows_unreadable_data_as_shortened_text(name, text, tmp_path):
    data = {name: text, 'long': 'x ' * 100}
    BagWriter(tmp_path / 'bag', custom_data=data).close()
    lines, report = info(tmp_path / 'bag')
    assert f'  {name}: {text}' in lines and report[name] is None
    # the first line has the path
    assert max(map(len, lines[1:])) < 100


def test_info_lists_each_file(tmp_path):
    with BagWriter(tmp_path / 'bag', custom_data={}, max_duration=2.0) as writer:
        for second in range(5):
            writer.write('/hazard', 'std_msgs/msg/Empty', bytes(5), second * 10**9, qos=LATCHED)
            writer.flush()
    last = tmp_path / 'bag' / 'bag_2.mcap'
    last.write_bytes(last.read_bytes()[:-50])
    lines, report = info(tmp_path / 'bag')
    assert lines[1].startswith('files      3, ')
    shown = [line for line in lines if line.startswith('  bag_')]
    assert [line.split(',')[0].strip() for line in shown] == [
        'bag_0.mcap', 'bag_1.mcap', 'bag_2.mcap'
    ]
    assert '2.000 to 3.000 s, 2 messages' in shown[1]
    assert [line.endswith('cut off') for line in shown] == [False, False, True]
    assert [item['finished'] for item in report['files']] == [True, True, False]
    assert [item['message_count'] for item in report['files']] == [2, 2, 1]
