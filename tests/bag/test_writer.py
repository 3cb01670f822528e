# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Written bags of one or several files, as other readers read them."""

from collections.abc import Callable
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

from bag.conftest import Bag, GRID, MakeGrid, Messages, SECOND
from lava_ros.bag import BagReader, BagWriter, LATCHED, QosProfile
from lava_ros.bag.recovery import recover
from lava_ros.bag.replay import schedule
from lava_ros.bag.schemas import message_schema
from lava_ros.errors import LavaError


def test_rosbags_reads_what_was_written(bag: Bag) -> None:
    directory, written = bag
    with AnyReader([directory]) as reader:
        read = [(conn.topic, time, bytes(data)) for conn, time, data in reader.messages()]
        assert read == written
        hazard, points = sorted(reader.connections, key=lambda item: item.topic)
        assert reader.message_count == len(written)
        assert (reader.start_time, reader.duration) == (100 * SECOND, 95 * SECOND // 10 + 1)
        assert isinstance(reader.readers[0], Reader) and reader.readers[0].ros_distro == 'jazzy'
        for _, time, data in reader.messages([hazard]):
            grid = reader.deserialize(data, hazard.msgtype)
            assert grid.header.stamp.sec * SECOND + grid.header.stamp.nanosec == time
            expected = np.random.default_rng(time).integers(-1, 101, 2400)
            np.testing.assert_array_equal(grid.data, expected)
    (offer,) = hazard.ext.offered_qos_profiles
    assert offer.durability == QosDurability.TRANSIENT_LOCAL
    assert (offer.reliability, offer.depth) == (QosReliability.RELIABLE, 1)
    (offer,) = points.ext.offered_qos_profiles
    assert offer.durability == QosDurability.VOLATILE
    assert offer.reliability == QosReliability.BEST_EFFORT
    assert hazard.digest == message_schema(GRID).type_hash
    assert (hazard.msgcount, points.msgcount) == (10, 20)


def test_the_file_has_summary_index_statistics_and_both_records(bag: Bag) -> None:
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


def test_metadata_yaml_has_the_format_of_rosbag2(bag: Bag) -> None:
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


def test_log_time_never_decreases(tmp_path: Path, make_grid: MakeGrid) -> None:
    """An earlier stamp is logged at the latest time; its publish time is unchanged."""
    with BagWriter(tmp_path / 'bag', custom_data={}) as writer:
        for stamp in (5, 9, 2, 10):
            writer.write('/hazard', GRID, make_grid(stamp), stamp, qos=LATCHED)
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as stream:
        messages = [item[2] for item in make_reader(stream).iter_messages(log_time_order=False)]
    assert [item.log_time for item in messages] == [5, 9, 9, 10]
    assert [item.publish_time for item in messages] == [5, 9, 2, 10]
    assert messages[2].data == make_grid(2)
    stamps = [1000 * SECOND, *(second * SECOND for second in range(40))]
    with BagWriter(tmp_path / 'split', custom_data={}, max_size=20_000) as writer:
        for stamp in stamps:
            writer.write('/hazard', GRID, make_grid(stamp), stamp, qos=LATCHED)
            writer.flush()
        assert writer.file_count > 2
    found = list(BagReader(tmp_path / 'split').messages())
    assert [item.publish_ns for item in found] == stamps
    assert {item.stamp_ns for item in found} == {1000 * SECOND}


def test_refuses_an_existing_directory(tmp_path: Path) -> None:
    (tmp_path / 'kept').write_text('mine')
    with pytest.raises(LavaError, match='choose another name'):
        BagWriter(tmp_path, custom_data={})
    with pytest.raises(LavaError, match=r'bag is .*kept'):
        BagWriter(tmp_path / 'kept' / 'bag', custom_data={})
    for limits in ({'max_size': -1}, {'max_duration': -1.0}, {'max_duration': float('nan')}):
        with pytest.raises(LavaError, match=next(iter(limits))):
            BagWriter(tmp_path / 'new', custom_data={}, **limits)
    assert [item.name for item in tmp_path.iterdir()] == ['kept']


def test_finishes_the_bag_once_also_after_an_error(tmp_path: Path, make_grid: MakeGrid) -> None:
    BagWriter(tmp_path / 'empty', custom_data={}).close()
    with Reader(tmp_path / 'empty') as reader:
        assert (reader.message_count, list(reader.messages())) == (0, [])
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


@pytest.mark.parametrize(('change', 'field'), [
    ({'topic': 'hazard'}, 'topic'),
    ({'topic': '/'}, 'topic'),
    ({'message_type': 'OccupancyGrid'}, 'message_type'),
    ({'message_type': 'gone_msgs/msg/Gone'}, 'message_type'),
    ({'data': b''}, 'data'),
    ({'stamp_ns': -1}, 'stamp_ns'),
    ({'stamp_ns': 1.5}, 'stamp_ns'),
    ({'topic': '/known', 'message_type': 'std_msgs/msg/Empty'}, 'message on /known'),
    ({'topic': '/known', 'qos': QosProfile()}, 'message on /known'),
])
def test_write_raises_for_invalid_arguments(
    tmp_path: Path, make_grid: MakeGrid, change: dict[str, object], field: str
) -> None:
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


def test_frequent_changes_of_the_description_do_not_fill_the_bag(
    tmp_path: Path, make_grid: MakeGrid
) -> None:
    """Descriptions take less than half of the file; an attachment follows the newest one."""
    path = tmp_path / 'bag' / 'bag_0.mcap'
    with BagWriter(tmp_path / 'bag', custom_data={'scene': ''}) as writer:
        for number in range(200):
            writer.write('/hazard', GRID, make_grid(number), number, qos=LATCHED)
            writer.set_custom_data({'scene': f'{number} {2000 * "x"}'})
            writer.flush()
        size = writer.size
        writer.attach('state', 'text/plain', b'1', 0)
        writer.flush()
        assert BagReader(tmp_path / 'bag').custom_data['scene'].startswith('199 ')
    with path.open('rb') as stream:
        # the last two belong to the attachment and to the end of the file
        *described, _, last = [
            len(str(item.metadata)) for item in StreamReader(stream).records
            if isinstance(item, Metadata)
        ]
    assert last > 2000 and 0.2 * size < sum(described) < 0.5 * size


VOLATILE = QosProfile()


def record(
    directory: Path, make_grid: MakeGrid, frames: int = 25, **limits: float
) -> Messages:
    """Write terrain once, and a latched and a volatile grid per second; return the messages."""
    written = [('/terrain', 100 * SECOND, make_grid(1))]
    with BagWriter(directory, custom_data={'scene': 'Etna'}, **limits) as writer:
        writer.write('/terrain', GRID, written[0][2], 100 * SECOND, qos=LATCHED)
        for second in range(100, 100 + frames):
            for topic, qos in (('/hazard', LATCHED), ('/points', VOLATILE)):
                data = make_grid(second * SECOND + len(topic))
                written.append((topic, second * SECOND, data))
                writer.write(topic, GRID, data, second * SECOND, qos=qos)
            writer.flush()
    return written


def without_repeats(reader: BagReader) -> Messages:
    """Return the messages except repeated ones, which were published before they were logged."""
    return [
        (item.topic, item.stamp_ns, item.data)
        for item in reader.messages()
        if item.publish_ns == item.stamp_ns
    ]


@pytest.fixture
def split(tmp_path: Path, make_grid: MakeGrid) -> Bag:
    """Return a bag of three files of up to 10 s, and its messages without repeats."""
    return tmp_path / 'bag', record(tmp_path / 'bag', make_grid, max_duration=10.0)


def test_splits_a_bag_by_duration(split: Bag) -> None:
    directory, written = split
    reader = BagReader(directory)
    assert [item.name for item in reader.files] == ['bag_0.mcap', 'bag_1.mcap', 'bag_2.mcap']
    assert without_repeats(reader) == written
    document = yaml.safe_load((directory / 'metadata.yaml').read_text())
    data = document['rosbag2_bagfile_information']
    assert data['relative_file_paths'] == ['bag_0.mcap', 'bag_1.mcap', 'bag_2.mcap']
    # a new file repeats the terrain, but not the hazard map, which is in its first frame
    for index, (start, seconds, count) in enumerate([(100, 9, 21), (110, 9, 21), (120, 4, 11)]):
        assert data['files'][index] == {
            'path': f'bag_{index}.mcap',
            'starting_time': {'nanoseconds_since_epoch': start * SECOND},
            'duration': {'nanoseconds': seconds * SECOND},
            'message_count': count,
        }
    assert data['message_count'] == len(written) + 2
    assert data['duration']['nanoseconds'] == 24 * SECOND
    counts = {
        item['topic_metadata']['name']: item['message_count']
        for item in data['topics_with_message_count']
    }
    assert counts == {'/terrain': 3, '/hazard': 25, '/points': 25}
    dues = list(schedule(reader, start_offset=15.5))
    assert sorted(due.message.topic for due in dues if due.at == 0.0) == ['/hazard', '/terrain']
    assert [due.at for due in dues] == sorted(due.at for due in dues)
    assert len([due for due in dues if due.message.topic == '/points']) == 9


def test_rosbags_reads_a_split_bag(split: Bag, tmp_path: Path) -> None:
    directory, written = split
    with AnyReader([directory]) as reader:
        read = [(conn.topic, time, bytes(data)) for conn, time, data in reader.messages()]
    assert len(read) == len(written) + 2 and set(written) <= set(read)
    for path in sorted(directory.glob('*.mcap')):
        alone = tmp_path / path.stem
        alone.mkdir()
        (alone / path.name).write_bytes(path.read_bytes())
        source = BagReader(alone)
        assert not source.recovered
        assert set(source.topics) == {'/terrain', '/hazard', '/points'}
        assert source.custom_data == {'scene': 'Etna'}
        first = next(source.messages())
        assert (first.topic, first.data) == ('/terrain', written[0][2])
        assert first.publish_ns == 100 * SECOND


def test_splits_a_bag_by_size(tmp_path: Path, make_grid: MakeGrid) -> None:
    record(tmp_path / 'one', make_grid, max_size=0, max_duration=0.0)
    assert [item.name for item in BagReader(tmp_path / 'one').files] == ['one_0.mcap']
    written = record(tmp_path / 'bag', make_grid, frames=40, max_size=30_000)
    reader = BagReader(tmp_path / 'bag')
    files = reader.contents
    assert len(files) > 3
    assert all(item.finished and item.message_count for item in files)
    for item in files[:-1]:
        assert 30_000 <= item.size < 45_000
    assert without_repeats(reader) == written
    for path in reader.files[1:]:
        messages = list(reader.messages(file=path))
        assert [item.topic for item in messages[:3]] == ['/terrain', '/hazard', '/points']
        assert len({item.stamp_ns for item in messages[:3]}) == 1


def test_large_latched_messages_do_not_fill_the_disk(tmp_path: Path, make_grid: MakeGrid) -> None:
    noise = b''.join(make_grid(seed) for seed in range(40))
    with BagWriter(tmp_path / 'bag', custom_data={}, max_size=10_000) as writer:
        writer.write('/terrain', GRID, noise, 0, qos=LATCHED)
        for second in range(1, 200):
            writer.write('/points', GRID, make_grid(second), second, qos=VOLATILE)
            writer.flush()
        assert writer.file_count < 10
    reader = BagReader(tmp_path / 'bag')
    assert len(without_repeats(reader)) == 200
    assert reader.size < 3 * (200 + 40) * 2000


def test_recovered_bag_has_the_same_files_and_messages(split: Bag, tmp_path: Path) -> None:
    """An empty last file, left by a writer killed between two files, is ignored."""
    directory, written = split
    (directory / 'metadata.yaml').unlink()
    last = directory / 'bag_2.mcap'
    last.write_bytes(last.read_bytes()[:-500])
    source = BagReader(directory)
    assert source.recovered
    assert [item.finished for item in source.contents] == [True, True, False]
    done: list[float] = []
    count = recover(source, tmp_path / 'new', on_progress=lambda _, part: done.append(part))
    assert count == len(list(source.messages()))
    assert done == sorted(done) and (done[0], done[-1]) == (0.0, 1.0)
    result = BagReader(tmp_path / 'new')
    assert not result.recovered
    assert (result.topics, result.custom_data) == (source.topics, source.custom_data)
    for old, new in zip(source.files, result.files, strict=True):
        assert list(source.messages(file=old)) == list(result.messages(file=new))
    with Reader(tmp_path / 'new') as reader:
        assert reader.message_count == result.message_count
    for size in (5, 0):
        last.write_bytes(last.read_bytes()[:size])
        source = BagReader(directory)
        assert source.recovered
        assert without_repeats(source) == written[:41]


@pytest.mark.parametrize(
    ('size', 'limits', 'files'), [(500, {'max_duration': 50e-9}, 5), (2000, {}, 1)]
)
def test_killed_writer_leaves_every_flushed_message(
    killed_bag: Callable[..., tuple[Path, int]], size: int, limits: dict[str, float], files: int
) -> None:
    topics = ['/height', '/hazard']
    directory, flushed = killed_bag(220, size=size, topics=topics, **limits)
    assert not (directory / 'metadata.yaml').exists()
    reader = BagReader(directory)
    assert len(reader.files) >= files
    assert (reader.recovered, reader.custom_data) == (True, {'scene': 'Etna'})
    assert reader.topics['/hazard'].qos == LATCHED
    assert len(list(reader.messages())) == reader.message_count
    for topic in topics:
        messages = [item for item in reader.messages([topic]) if item.publish_ns == item.stamp_ns]
        assert [item.stamp_ns for item in messages] == list(range(len(messages)))
        assert len(messages) >= flushed + 1
        for item in messages:
            assert item.data[4:] == item.stamp_ns.to_bytes(8, 'little') * size


def test_error_between_two_files_keeps_the_finished_ones(
    tmp_path: Path, make_grid: MakeGrid
) -> None:
    writer = BagWriter(tmp_path / 'bag', custom_data={}, max_duration=1.0)
    writer.write('/hazard', GRID, make_grid(0), 0, qos=LATCHED)
    (tmp_path / 'bag' / 'bag_1.mcap').mkdir()
    with pytest.raises(OSError):
        writer.write('/hazard', GRID, make_grid(1), SECOND, qos=LATCHED)
    with pytest.raises(LavaError, match='an open bag'):
        writer.write('/hazard', GRID, make_grid(1), SECOND, qos=LATCHED)
    writer.close()
    with Reader(tmp_path / 'bag') as reader:
        assert reader.message_count == 1
