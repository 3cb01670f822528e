# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The node of a bag: recordings of several nodes, by this package and by rosbag2."""

from collections.abc import Callable
import json
from pathlib import Path
from typing import Any
from unittest.mock import Mock

from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import String

from command_line import done, parser_of, refused
from lava_ros.bag import BagMessage, BagReader, BagWriter, LATCHED
from lava_ros.bag.recorded_node import RecordedNode, select_node
from lava_ros.bag.replay import Step
from lava_ros.cli.parser import COMMANDS
from lava_ros.clients import player
from lava_ros.errors import LavaError
from lava_ros.layers.recording import Recording
from lava_ros.products.arrivals import table_of
from lava_ros.products.export import export_bag
from lava_ros.products.run_page import read_run
from lava_ros.ros import diagnostics
from lava_ros.watch.frames import BagFrames
from recording import changed, GRIDS, merged, record

TEXT = 'std_msgs/msg/String'

#: Simulated times of two nodes whose maps have the same stamps [s].
TIMES = {'/etna/lava': (200.0, 400.0, 600.0), '/stromboli/lava': (1000.0, 1100.0, 1200.0)}

#: Commands that read the maps of one node, with their arguments and the file that they write.
NODE_COMMANDS: tuple[tuple[str, ...], ...] = (
    ('bag info',), ('map', '-o', 'out.html'), ('map', '-o', 'out.png'),
    ('map', '-o', 'out.gif', '--seconds', '0.5'), ('places', 'huts.csv'), ('export', '-o', 'out'),
    ('watch', '--port', '0'),
)


@pytest.fixture(scope='module')
def single(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return the bag of each node."""
    folder = tmp_path_factory.mktemp('single')
    return {
        name: record(folder / name.split('/')[1], times, config=GRIDS)
        for name, times in TIMES.items()
    }


@pytest.fixture(scope='module')
def both(single: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording of both nodes without a description."""
    return merged(tmp_path_factory.mktemp('both') / 'bag', single)


@pytest.mark.parametrize('name', TIMES)
@pytest.mark.parametrize('by', [str, lambda name: name.rpartition('/')[0]])
def test_frames_are_those_of_the_named_node(
    both: Path, single: dict[str, Path], name: str, by: Callable[[str], str]
) -> None:
    recording, own = Recording(both, node=by(name)), Recording(single[name])
    assert (recording.node.name, recording.node.namespace) == (name, name.rpartition('/')[0])
    frames = list(recording.frames())
    assert [frame.time for frame in frames] == list(TIMES[name])
    for frame, expected in zip(frames, own.frames(), strict=True):
        assert frame.layers.keys() == expected.layers.keys()
        for source, layer in expected.layers.items():
            np.testing.assert_array_equal(frame.layers[source].values, layer.values)
    assert recording.frame_at().time == TIMES[name][-1]


def test_every_command_that_reads_maps_of_a_bag_has_the_option() -> None:
    having = {
        name for name in COMMANDS
        if {'bag', 'node'} <= {action.dest for action in parser_of(name)._actions}
    }
    # a replay needs no choice
    assert having == {*(name for name, *_ in NODE_COMMANDS), 'ros replay'}


@pytest.mark.parametrize('words', NODE_COMMANDS, ids=' '.join)
def test_command_reads_the_named_node(
    both: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    command, *arguments = words
    monkeypatch.chdir(tmp_path)
    server = Mock()
    monkeypatch.setattr('lava_ros.watch.server.Server', server)
    monkeypatch.setattr('signal.signal', lambda *_: None)
    (tmp_path / 'huts.csv').write_text('name,x,y\nhut,-47.5,95\n')
    names = '/etna/lava, /stromboli/lava'
    # the page shows the error, because a bag may still be recording
    if command != 'watch':
        if command == 'bag info':
            out = done(command, both)
            assert f'{names}; --node' in out and 'simulated ' not in out
        else:
            error = refused(command, both, *arguments)
            assert f'contains several nodes. Choose one: --node with one of {names}' in error
        error = refused(command, both, *arguments, '--node', '/vesuvius')
        assert error.startswith(f"lava {command}: --node is '/vesuvius'") and names in error
    out = done(command, both, *arguments, '--node', '/stromboli/lava')
    if command == 'watch':
        frames = server.call_args.args[0]
        frames.poll()
        assert frames.times == list(TIMES['/stromboli/lava'])
    if command == 'bag info':
        assert 'simulated  1200.000 s' in out


def contents(message: BagMessage) -> tuple[str, str]:
    """Return the topic, and the names of the statuses of diagnostics."""
    if message.topic != '/diagnostics':
        return message.topic, ''
    statuses = deserialize_message(message.data, DiagnosticArray).status
    return message.topic, str([status.name for status in statuses])


@pytest.mark.parametrize('name', TIMES)
@pytest.mark.parametrize('by', [str, lambda name: name.rpartition('/')[0]])
def test_replay_publishes_the_messages_of_the_named_node(
    both: Path, single: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    name: str, by: Callable[[str], str],
) -> None:
    own = merged(tmp_path / 'own', {name: single[name]})
    published = []
    publish = player._Player.publish

    def note(self: Any, step: Step) -> None:
        before = self.published
        publish(self, step)
        if step.message is not None and self.published > before:
            published.append((step.message.stamp_ns, *contents(step.message)))

    monkeypatch.setattr(player._Player, 'publish', note)
    count = player.play(BagReader(both), node=by(name), rate=1e9)
    expected = [(item.stamp_ns, *contents(item)) for item in BagReader(own).messages()]
    assert count == len(expected) and sorted(published) == sorted(expected)


@pytest.mark.parametrize(('chosen', 'expected'), [
    ('/lava', {'/terrain', '/lava/x', '/camera', '/diagnostics', '/tf'}),
    ('/etna/lava', {'/etna/terrain', '/diagnostics', '/tf'}),
    ('/etna/south/lava', {'/etna/south/terrain', '/etna/south/lava/x', '/diagnostics', '/tf'}),
])
def test_topics_of_a_node_are_those_of_the_innermost_namespace(
    tmp_path: Path, chosen: str, expected: set[str]
) -> None:
    names = ('/lava', '/etna/lava', '/etna/south/lava')
    topics = (
        '/terrain', '/lava/x', '/camera', '/etna/terrain', '/etna/south/terrain',
        '/etna/south/lava/x', '/tf',
    )
    with BagWriter(tmp_path / 'bag', custom_data={}) as writer:
        for topic in topics:
            writer.write(topic, TEXT, serialize_message(String()), 0, qos=LATCHED)
        for name in names:
            values = {'frame_stamp_ns': 0, 'simulated_time_s': 0.0}
            task = f'{name.strip("/")}: simulation'
            message = DiagnosticArray(status=[diagnostics.status(task, b'\0', '', values)])
            kind = 'diagnostic_msgs/msg/DiagnosticArray'
            writer.write('/diagnostics', kind, serialize_message(message), 0, qos=LATCHED)
    bag = BagReader(tmp_path / 'bag')
    selection = select_node(bag, chosen, player.SHARED_TOPICS)
    assert selection.topics == expected
    messages = [message for message in bag.messages() if selection.has(message)]
    assert sorted(message.topic for message in messages) == sorted(expected)


def test_replay_asks_for_a_node_of_the_bag(
    both: Path, single: dict[str, Path], tmp_path: Path
) -> None:
    own = BagReader(single['/etna/lava'])
    data = {**own.custom_data, **RecordedNode('/etna/lava', '/etna', {}).description}
    described = changed(own.path, tmp_path / 'bag', lambda _, message: message, data)
    for path, names in ((both, '/etna/lava, /stromboli/lava'), (described, '/etna/lava')):
        error = refused('ros', 'replay', path, '--node', '/vesuvius')
        assert error.startswith("lava ros replay: --node is '/vesuvius'") and names in error
    # all messages of a bag that describes a single node
    assert player.play(BagReader(described), node='/etna', rate=1e9) == own.message_count


@pytest.mark.parametrize('read', [
    lambda path, folder: Recording(path),
    lambda path, folder: export_bag(path, folder / 'out'),
    lambda path, folder: read_run(path),
    lambda path, folder: table_of(path, []),
])
def test_readers_ask_which_of_several_nodes(
    both: Path, tmp_path: Path, read: Callable[[Path, Path], Any]
) -> None:
    with pytest.raises(LavaError, match='--node with one of /etna/lava, /stromboli/lava'):
        read(both, tmp_path)
    assert not (tmp_path / 'out').exists()


def test_watched_bag_of_several_nodes_names_them(both: Path) -> None:
    frames = BagFrames(both)
    frames.poll()
    assert '--node with one of /etna/lava, /stromboli/lava' in frames.status.words


def test_two_nodes_of_one_namespace_are_told_apart(
    single: dict[str, Path], tmp_path: Path
) -> None:
    bags = {'/lava': single['/etna/lava'], '/lava2': single['/stromboli/lava']}
    path = merged(tmp_path / 'bag', bags)
    with pytest.raises(LavaError, match='--node with one of /lava, /lava2'):
        Recording(path)
    last = [Recording(path, node=name).timeline.moments[-1].time for name in bags]
    assert last == [600.0, 1200.0]


def test_times_are_those_of_the_only_node_with_maps(
    single: dict[str, Path], tmp_path: Path
) -> None:
    path = merged(tmp_path / 'bag', single)
    reader = BagReader(path)
    with BagWriter(tmp_path / 'one', custom_data={}) as writer:
        for item in reader.messages():
            kind = reader.topics[item.topic]
            if not item.topic.startswith('/stromboli'):
                writer.write(
                    item.topic, kind.message_type, item.data, item.stamp_ns, qos=kind.qos
                )
    recording = Recording(tmp_path / 'one')
    assert recording.node.name == '/etna/lava'
    assert [frame.time for frame in recording.frames()] == list(TIMES['/etna/lava'])


#: Topics that ``record`` writes and readers use: maps, terrain, vents and diagnostics.
TOPICS = ('height', 'temperature', 'hazard', 'terrain', 'terrain_info', 'vents', 'diagnostics')


@pytest.mark.parametrize('name', [*TOPICS, 'all'])
def test_described_topics_are_read_wherever_they_are(
    single: dict[str, Path], tmp_path: Path, name: str
) -> None:
    """Maps of a remapped topic are exported; a topic of that name of another node is not."""
    own = BagReader(single['/etna/lava'])
    moved = TOPICS if name == 'all' else (name,)
    topics = {topic: f'/a/b{index}' if topic in moved else f'/{topic}'
              for index, topic in enumerate(TOPICS)}
    data = {**own.custom_data, 'node': '/lava', 'topics': json.dumps(topics)}
    with BagWriter(tmp_path / 'bag', custom_data=data) as writer:
        for item in own.messages():
            kind = own.topics[item.topic]
            writer.write(
                topics[item.topic[1:]], kind.message_type, item.data, item.stamp_ns, qos=kind.qos
            )
    recording, expected = Recording(tmp_path / 'bag'), Recording(own.path)
    assert [frame.time for frame in recording.frames()] == list(TIMES['/etna/lava'])
    frame, known = recording.frame_at(), expected.frame_at()
    np.testing.assert_array_equal(frame.vents, known.vents)
    for source, layer in known.layers.items():
        np.testing.assert_array_equal(frame.layers[source].values, layer.values)
    files = [item.name for item in export_bag(tmp_path / 'bag', tmp_path / 'moved').files]
    assert files == [item.name for item in export_bag(own.path, tmp_path / 'plain').files]


@pytest.mark.parametrize('text', ['', '[]', '{', '{"height": 3}'])
def test_bag_with_a_malformed_description_is_read_by_its_namespace(
    single: dict[str, Path], tmp_path: Path, text: str
) -> None:
    own = BagReader(single['/etna/lava'])
    data = {**own.custom_data, 'node': '/lava', 'topics': text}
    path = changed(own.path, tmp_path / 'bag', lambda _, message: message, data)
    assert Recording(path).frame_at().time == 600.0


def test_bags_of_earlier_versions_are_read(tmp_path: Path) -> None:
    sample = Path(__file__).parents[2] / 'bags' / 'sample'
    data = dict(BagReader(sample).custom_data)
    # version 0.1.0 had no description of the topics
    del data['topics'], data['node']
    path = changed(sample, tmp_path / 'bag', lambda _, message: message, data)
    frames = list(Recording(path).frames())
    times = [frame.time for frame in Recording(sample).frames()]
    assert [frame.time for frame in frames] == times and times[-1] == 43200.0
    assert frames[-1].layers.keys() == {'thickness', 'temperature', 'hazard'}
