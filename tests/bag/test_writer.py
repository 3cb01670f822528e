# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The bags we write, as readers that are not ours see them."""

from pathlib import Path

from mcap.reader import make_reader
from mcap.records import Metadata
from mcap.stream_reader import StreamReader
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2 import Reader
import yaml

from bag.conftest import Bag, GRID, MakeGrid, SECOND
from lava_ros.bag import BagReader, BagWriter, LATCHED, QosProfile
from lava_ros.bag.schemas import message_schema
from lava_ros.errors import LavaError


def test_rosbags_reads_the_same_bytes_and_qos(bag: Bag) -> None:
    """The rosbags reader finds every message, its time, the QoS, the hash and the counts."""
    directory, written = bag
    with Reader(directory) as reader:
        read = [(conn.topic, time, bytes(data)) for conn, time, data in reader.messages()]
        connections = {conn.topic: conn for conn in reader.connections}
        assert reader.message_count == len(written)
        assert (reader.start_time, reader.duration) == (100 * SECOND, 95 * SECOND // 10 + 1)
        assert reader.ros_distro == 'jazzy'
    assert read == written
    (hazard,) = connections['/hazard'].ext.offered_qos_profiles
    assert hazard.durability == QosDurability.TRANSIENT_LOCAL
    assert (hazard.reliability, hazard.depth) == (QosReliability.RELIABLE, 1)
    (points,) = connections['/points'].ext.offered_qos_profiles
    assert points.durability == QosDurability.VOLATILE
    assert points.reliability == QosReliability.BEST_EFFORT
    assert connections['/hazard'].digest == message_schema(GRID).type_hash
    assert (connections['/hazard'].msgcount, connections['/points'].msgcount) == (10, 20)


def test_rosbags_decodes_with_the_definitions_in_the_bag(bag: Bag) -> None:
    """A reader that knows no types at all decodes the grids from the schema in the file."""
    directory, _ = bag
    with AnyReader([directory]) as reader:
        for connection, time, data in reader.messages():
            if connection.topic == '/hazard':
                grid = reader.deserialize(data, connection.msgtype)
                assert grid.header.stamp.sec * SECOND + grid.header.stamp.nanosec == time
                expected = np.random.default_rng(time).integers(-1, 101, 2400)
                np.testing.assert_array_equal(grid.data, expected)


def test_the_file_has_summary_index_statistics_and_both_records(bag: Bag) -> None:
    """The raw MCAP reader finds all that rosbag2 and the mcap tool ask for."""
    directory, written = bag
    path = directory / 'eruption_0.mcap'
    with path.open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True)
        header = reader.get_header()
        summary = reader.get_summary()
        metadata = list(reader.iter_metadata())
        read = [(c.topic, m.log_time, m.data) for _, c, m in reader.iter_messages()]
    assert header.profile == 'ros2'
    assert read == written
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 30
    assert summary.statistics.chunk_count == len(summary.chunk_indexes) == 5
    assert all(item.compression == 'zstd' for item in summary.chunk_indexes)
    assert all(set(item.message_index_offsets) == {1, 2} for item in summary.chunk_indexes)
    assert {schema.encoding for schema in summary.schemas.values()} == {'ros2msg'}
    assert len(summary.schemas) == 1
    for channel in summary.channels.values():
        assert channel.message_encoding == 'cdr'
        assert isinstance(yaml.safe_load(channel.metadata['offered_qos_profiles']), list)
        assert channel.metadata['topic_type_hash'].startswith('RIHS01_')
    assert [item.name for item in metadata] == ['rosbag2', 'rosbag2']
    first, last = (yaml.safe_load(item.metadata['serialized_metadata']) for item in metadata)
    assert (first['version'], first['message_count']) == (9, 0)
    stored = yaml.safe_load((directory / 'metadata.yaml').read_text())
    assert last == stored['rosbag2_bagfile_information']
    with path.open('rb') as stream:
        second = list(zip(range(2), StreamReader(stream).records, strict=False))[1][1]
    assert isinstance(second, Metadata)


def test_metadata_yaml_is_as_rosbag2_writes_it(bag: Bag) -> None:
    """Keys, their order and the values of metadata.yaml are those of Jazzy's version 9."""
    directory, _ = bag
    document = yaml.safe_load((directory / 'metadata.yaml').read_text())
    assert list(document) == ['rosbag2_bagfile_information']
    data = document['rosbag2_bagfile_information']
    names = 'version storage_identifier duration starting_time message_count '
    names += 'topics_with_message_count compression_format compression_mode '
    names += 'relative_file_paths files custom_data ros_distro'
    assert ' '.join(data) == names
    span = {
        'starting_time': {'nanoseconds_since_epoch': 100 * SECOND},
        'duration': {'nanoseconds': 9_500_000_000},
        'message_count': 30,
    }
    assert data['files'] == [{'path': 'eruption_0.mcap', **span}]
    assert data['relative_file_paths'] == ['eruption_0.mcap']
    assert span.items() <= data.items()
    assert (data['version'], data['storage_identifier']) == (9, 'mcap')
    assert (data['compression_format'], data['compression_mode']) == ('', '')
    assert data['custom_data'] == {'scene': '{"gravity": 9.81}', 'note': 'a\nb'}
    topic = data['topics_with_message_count'][0]
    assert list(topic) == ['topic_metadata', 'message_count']
    names = 'name type serialization_format offered_qos_profiles type_description_hash'
    assert ' '.join(topic['topic_metadata']) == names
    assert topic['topic_metadata']['offered_qos_profiles'] == [LATCHED.to_dict()]


def test_an_empty_bag_is_a_bag(tmp_path: Path) -> None:
    """A recording without messages is read by others too."""
    BagWriter(tmp_path / 'empty', custom_data={}).close()
    with Reader(tmp_path / 'empty') as reader:
        assert reader.message_count == 0
        assert list(reader.messages()) == []


def test_log_time_never_decreases(tmp_path: Path, make_grid: MakeGrid) -> None:
    """A stamp that goes back is logged at the latest time; it stays as publish time and inside."""
    with BagWriter(tmp_path / 'bag', custom_data={}) as writer:
        for stamp in (5, 9, 2, 10):
            writer.write('/hazard', GRID, make_grid(stamp), stamp, qos=LATCHED)
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as stream:
        messages = [item[2] for item in make_reader(stream).iter_messages(log_time_order=False)]
    assert [item.log_time for item in messages] == [5, 9, 9, 10]
    assert [item.publish_time for item in messages] == [5, 9, 2, 10]
    assert messages[2].data == make_grid(2)


def test_an_existing_directory_is_left_alone(tmp_path: Path) -> None:
    """Nothing is overwritten, and the message says what to do."""
    (tmp_path / 'kept').write_text('mine')
    with pytest.raises(LavaError, match='choose another name'):
        BagWriter(tmp_path, custom_data={})
    with pytest.raises(LavaError, match=r'bag is .*kept'):
        BagWriter(tmp_path / 'kept' / 'bag', custom_data={})
    assert [item.name for item in tmp_path.iterdir()] == ['kept']


def test_a_bag_is_finished_once_also_after_an_error(tmp_path: Path, make_grid: MakeGrid) -> None:
    """What was written before an exception is kept; a second close changes nothing."""
    with pytest.raises(KeyError), BagWriter(tmp_path / 'bag', custom_data={}) as writer:
        writer.write('/hazard', GRID, make_grid(0), 0, qos=LATCHED)
        raise KeyError
    before = (tmp_path / 'bag' / 'bag_0.mcap').read_bytes()
    writer.close()
    assert (tmp_path / 'bag' / 'bag_0.mcap').read_bytes() == before
    with Reader(tmp_path / 'bag') as reader:
        assert reader.message_count == 1
    with pytest.raises(LavaError, match='this one is closed'):
        writer.write('/hazard', GRID, make_grid(1), 1, qos=LATCHED)
    with pytest.raises(LavaError, match='this one is closed'):
        writer.flush()


@pytest.mark.parametrize(
    ('change', 'field'),
    [
        ({'topic': 'hazard'}, 'topic'),
        ({'topic': '/'}, 'topic'),
        ({'message_type': 'OccupancyGrid'}, 'message_type'),
        ({'message_type': 'gone_msgs/msg/Gone'}, 'message_type'),
        ({'data': b''}, 'data'),
        ({'stamp_ns': -1}, 'stamp_ns'),
        ({'stamp_ns': 1.5}, 'stamp_ns'),
        ({'topic': '/known', 'message_type': 'std_msgs/msg/Empty'}, 'message on /known'),
        ({'topic': '/known', 'qos': QosProfile()}, 'message on /known'),
    ],
)
def test_messages_that_do_not_fit_are_refused(
    tmp_path: Path, make_grid: MakeGrid, change: dict[str, object], field: str
) -> None:
    """A wrong argument raises, names itself and leaves the bag as it was."""
    good = {'topic': '/hazard', 'message_type': GRID, 'data': make_grid(0), 'stamp_ns': 0}
    good['qos'] = LATCHED
    with BagWriter(tmp_path / 'bag', custom_data={}) as writer:
        writer.write(**{**good, 'topic': '/known'})
        with pytest.raises(LavaError) as caught:
            writer.write(**{**good, **change})
        assert caught.value.field == field
    with Reader(tmp_path / 'bag') as reader:
        assert [item.topic for item in reader.connections] == ['/known']
        assert reader.message_count == 1


def test_custom_data_can_change(tmp_path: Path, make_grid: MakeGrid) -> None:
    """The newest description is in the file after a flush, and in metadata.yaml at the end."""
    with pytest.raises(LavaError, match=r"custom_data\['rate'\] is 3"):
        BagWriter(tmp_path / 'bag', custom_data={'rate': 3})  # type: ignore[dict-item]
    with BagWriter(tmp_path / 'bag', custom_data={'a': '1'}) as writer:
        writer.write('/hazard', GRID, make_grid(0), 0, qos=LATCHED)
        writer.set_custom_data({'b': '2'})
        writer.flush()
        reader = BagReader(tmp_path / 'bag')
        assert (reader.recovered, reader.custom_data) == (True, {'b': '2'})
        assert len(list(reader.messages())) == 1
        with pytest.raises(LavaError, match='custom_data'):
            writer.set_custom_data({'b': 2})  # type: ignore[dict-item]
    with Reader(tmp_path / 'bag') as other:
        assert len(list(other.messages())) == 1
    stored = yaml.safe_load((tmp_path / 'bag' / 'metadata.yaml').read_text())
    assert stored['rosbag2_bagfile_information']['custom_data'] == {'b': '2'}
    assert BagReader(tmp_path / 'bag' / 'bag_0.mcap').custom_data == {'b': '2'}


