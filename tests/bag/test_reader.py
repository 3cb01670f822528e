# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Reading of complete, truncated, damaged and foreign bags."""

from pathlib import Path
import struct
import tracemalloc

from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
import pytest
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import get_typestore, Stores

from bag.conftest import Bag, GRID, messages_of, SECOND, small_bag
from fuzz.bags import chunk, data_section, joined
from lava_ros.bag import BagReader, LATCHED, QosProfile
from lava_ros.bag import metadata as bag_metadata
from lava_ros.bag.checkpoints import attachments_of
from lava_ros.bag.records import FRAME
from lava_ros.errors import LavaError


def write_foreign(path: Path, stamps: list[int], **options: object) -> None:
    """Write an MCAP file with one message per stamp, alternating between two channels."""
    with path.open('wb') as stream:
        writer = Writer(stream, **options)
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/Empty', 'ros2msg', b'')
        channels = [writer.register_channel('/foreign', 'cdr', schema) for _ in range(2)]
        for index, stamp in enumerate(stamps):
            data = b'\x00\x01\x00\x00' + bytes([stamp])
            writer.add_message(channels[index % 2], stamp, data, stamp)
        writer.finish()


def test_reads_what_was_written(bag: Bag) -> None:
    directory, written = bag
    reader = BagReader(directory)
    assert messages_of(reader) == written
    assert not reader.recovered
    assert (reader.start_ns, reader.end_ns) == (100 * SECOND, 109_500_000_000)
    assert reader.custom_data == {'scene': '{"gravity": 9.81}', 'note': 'a\nb'}
    assert list(reader.topics) == ['/hazard', '/points']
    assert reader.topics['/hazard'].qos == LATCHED
    assert reader.topics['/points'].qos == QosProfile(reliability='best_effort')
    assert reader.topics['/hazard'].message_type == GRID
    assert [topic.count for topic in reader.topics.values()] == [10, 20]
    assert reader.message_count == 30
    assert reader.size == (directory / 'eruption_0.mcap').stat().st_size
    # the record in the file repeats metadata.yaml
    alone = BagReader(directory / 'eruption_0.mcap')
    assert messages_of(alone) == written
    assert alone.custom_data == reader.custom_data


def test_selects_messages_by_topic_and_time(bag: Bag) -> None:
    directory, written = bag
    reader = BagReader(directory)
    start = 104 * SECOND
    some = [(item.topic, item.stamp_ns) for item in reader.messages(['/hazard'], start)]
    assert some == [(t, s) for t, s, _ in written if t == '/hazard' and s >= start]
    assert list(reader.messages(['/nothing'])) == []
    assert list(reader.messages(start_ns=10**12)) == []
    for before in (100 * SECOND + 1, 103 * SECOND, 104 * SECOND + 1, 10**12):
        expected = {item[0]: item for item in written if item[1] < before}
        found = reader.newest(['/hazard', '/points', '/nothing'], before)
        assert {item.topic: (item.topic, item.stamp_ns, item.data) for item in found} == expected
        assert [item.stamp_ns for item in found] == sorted(item.stamp_ns for item in found)
    assert reader.newest(['/hazard'], 100 * SECOND) == []


def test_reads_the_complete_chunks_of_a_truncated_file(bag: Bag, tmp_path: Path) -> None:
    directory, written = bag
    path = directory / 'eruption_0.mcap'
    data = path.read_bytes()
    with path.open('rb') as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    ends = [item.chunk_start_offset + item.chunk_length for item in summary.chunk_indexes]
    cut = tmp_path / 'cut.mcap'
    places = {8, 9, 30, len(data) - 1, len(data) - 9, len(data) - 30, len(data) // 2}
    places |= {end + step for end in ends for step in (-1, 0, 1)}
    for place in sorted(places):
        cut.write_bytes(data[:place])
        reader = BagReader(cut)
        assert reader.recovered
        whole = sum(end <= place for end in ends)
        assert messages_of(reader) == written[: 6 * whole], place


def test_file_cut_off_in_an_uncompressed_chunk_is_not_damaged(tmp_path: Path) -> None:
    """A chunk of `ros2 bag record` contains schemas and channels as bytes of the file."""
    whole = tmp_path / 'whole.mcap'
    write_foreign(whole, [*range(12)], compression=CompressionType.NONE, chunk_size=200)
    data = whole.read_bytes()
    with whole.open('rb') as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    ends = [item.chunk_start_offset + item.chunk_length for item in summary.chunk_indexes]
    counts = set()
    for place in range(8, ends[-1] + 1):
        (tmp_path / 'cut.mcap').write_bytes(data[:place])
        reader = BagReader(tmp_path / 'cut.mcap')
        assert reader.recovered and not reader.damage, place
        assert not attachments_of(tmp_path / 'cut.mcap'), place
        counts.add(reader.message_count)
    # only the messages of the complete chunks are read
    assert counts == {0, 3, 9, 12}


@pytest.mark.parametrize('options', [
    {},
    {'chunk_size': 20},
    {'compression': CompressionType.LZ4, 'chunk_size': 40},
    {'compression': CompressionType.NONE, 'index_types': IndexType.NONE},
    {'use_chunking': False},
    {'use_statistics': False},
])
def test_sorts_messages_by_log_time(tmp_path: Path, options: dict[str, object]) -> None:
    stamps = [5, 3, 9, 1, 7, 7, 2]
    write_foreign(tmp_path / 'a.mcap', stamps, **options)
    reader = BagReader(tmp_path / 'a.mcap')
    assert [item.data[4] for item in reader.messages()] == sorted(stamps)
    assert not reader.recovered
    assert reader.message_count == len(stamps)
    assert (reader.start_ns, reader.end_ns) == (1, 9)
    assert reader.topics['/foreign'].qos == QosProfile()
    for before, stamp in ((9, 7), (6, 5)):
        (newest,) = reader.newest(['/foreign'], before)
        assert newest.stamp_ns == stamp


def test_reads_a_split_bag_without_metadata(tmp_path: Path) -> None:
    for index, name in enumerate(['b_0.mcap', 'b_2.mcap', 'b_10.mcap']):
        write_foreign(tmp_path / name, [10 * index, 10 * index + 1])
    reader = BagReader(tmp_path)
    assert [item.stamp_ns for item in reader.messages()] == [0, 1, 10, 11, 20, 21]
    assert [item.name for item in reader.files] == ['b_0.mcap', 'b_2.mcap', 'b_10.mcap']
    assert reader.message_count == 6
    assert [item.stamp_ns for item in reader.newest(['/foreign'], 11)] == [10]


def test_reads_a_bag_of_the_rosbags_library(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    with RosbagsWriter(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.set_custom_data('who', 'rosbags')
        connection = writer.add_connection('/text', 'std_msgs/msg/String', typestore=store)
        text = store.types['std_msgs/msg/String']('hot')
        data = bytes(store.serialize_cdr(text, 'std_msgs/msg/String'))
        writer.write(connection, 7, data)
    reader = BagReader(tmp_path / 'bag')
    assert messages_of(reader) == [('/text', 7, data)]
    assert reader.custom_data == {'who': 'rosbags'}


def test_memory_is_bounded_by_chunks(tmp_path: Path) -> None:
    """Reading 80 MB of messages, finished or truncated, takes a few chunks of memory."""
    block = bytes([0, 1, 0, 0]) + bytes(1_000_000)
    (path,) = small_bag(tmp_path / 'bag', *((stamp, block) for stamp in range(80))).files
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(path.read_bytes()[:-100])
    for item in (path, cut):
        tracemalloc.start()
        assert sum(1 for _ in BagReader(item).messages()) == 80
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 40e6


def test_refuses_a_chunk_beyond_the_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('lava_ros.bag.records.MAX_CHUNK_SIZE', 4000)
    with pytest.raises(LavaError, match='bytes at once, more than 4000'):
        list(small_bag(tmp_path / 'bag', (0, bytes(5000))).messages())


@pytest.mark.parametrize(('compression', 'claimed', 'count'), [
    ('lz4', 1000, 1), ('zstd', 2**40, 1), ('zstd', 1000, 12), ('lz4', 2**22, 1),
    ('lz4', 2**22, 12), ('zstd', 2**22, 12),
])
def test_decompression_bombs_do_not_exceed_the_memory_limit(
    tmp_path: Path, compression: str, claimed: int, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Chunks that expand to far more than their size are read within the limit, or refused."""
    monkeypatch.setattr('lava_ros.bag.records.MAX_CHUNK_SIZE', 2**22)
    monkeypatch.setattr('lava_ros.bag.mcap_file.MAX_HELD', 2**23)
    (path,) = small_bag(tmp_path / 'bag', (0, bytes(100))).files
    records = data_section(path)
    size = 2**22 - 31 if claimed == 2**22 else 2**26
    message = FRAME.pack(Opcode.MESSAGE, 22 + size) + struct.pack('<HIQQ', 1, 0, 0, 0)
    bomb = chunk(message + bytes(size), compression=compression, size=claimed)
    bombs = [(int(Opcode.CHUNK), bomb)] * count
    path.write_bytes(joined([*records, *bombs], b''))
    assert path.stat().st_size < 5e6
    tracemalloc.start()
    try:
        reader = BagReader(path)
        if claimed == 2**22 and count > 1:
            with pytest.raises(LavaError, match='at most 8388608 bytes of messages at one time'):
                list(reader.messages())
        else:
            assert len(list(reader.messages())) == 1 + (claimed == 2**22)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(reader.damage) == (0 if claimed == 2**22 else count)
    assert peak < 6 * 2**22


def write_tiny(path: Path, payload: int, *, chunks: int = 2, size: int = 2**21) -> int:
    """Write compressed chunks of messages of one time; return their number."""
    with path.open('wb') as stream:
        writer = Writer(stream, chunk_size=size, compression=CompressionType.ZSTD)
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/Empty', 'ros2msg', b'')
        channel = writer.register_channel('/a', 'cdr', schema)
        count = chunks * size // (31 + payload)
        for _ in range(count):
            writer.add_message(channel, 1, bytes(payload), 1)
        writer.finish()
    return count


@pytest.mark.parametrize('is_cut', [False, True])
@pytest.mark.parametrize('payload', [0, 4, 100])
def test_memory_is_a_small_multiple_of_the_unpacked_size(
    tmp_path: Path, payload: int, is_cut: bool
) -> None:
    """An object for each tiny message would take a hundred times its bytes."""
    path = tmp_path / 'tiny.mcap'
    count = write_tiny(path, payload, size=2**19)
    if is_cut:
        path.write_bytes(path.read_bytes()[:-50])
    tracemalloc.start()
    try:
        reader = BagReader(path)
        found = sum(1 for _ in reader.messages())
        assert reader.newest(['/a'], 2)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert found == reader.message_count == count
    assert peak < 4 * 2**20


@pytest.mark.parametrize('payload', [0, 4, 100])
def test_limit_of_memory_counts_whole_messages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, payload: int
) -> None:
    monkeypatch.setattr('lava_ros.bag.mcap_file.MAX_HELD', 2**22 - 2**16)
    path = tmp_path / 'tiny.mcap'
    write_tiny(path, payload)
    with pytest.raises(LavaError, match='at most 4128768 bytes of messages at one time'):
        list(BagReader(path).messages())


@pytest.mark.parametrize('is_reindexed', [False, True])
def test_raises_for_messages_that_rosbag2_has_compressed(
    tmp_path: Path, is_reindexed: bool
) -> None:
    """The metadata.yaml of `ros2 bag reindex` states no compression, only the file does."""
    text = bag_metadata.to_text({'storage_identifier': 'mcap', 'compression_mode': 'MESSAGE'})
    with (tmp_path / 'a_0.mcap').open('wb') as stream:
        writer = Writer(stream)
        writer.start('ros2')
        writer.add_metadata(bag_metadata.RECORD, {'serialized_metadata': text})
        writer.finish()
    if is_reindexed:
        files = [bag_metadata.FileRecord('a_0.mcap')]
        data = {bag_metadata.ROOT: bag_metadata.describe(files, [], {})}
        (tmp_path / 'metadata.yaml').write_text(bag_metadata.to_text(data), encoding='utf-8')
    with pytest.raises(LavaError, match=r"^compression_mode of .*a_0.mcap is 'MESSAGE', expected"):
        BagReader(tmp_path)


@pytest.mark.parametrize(('name', 'data', 'message'), [
    ('gone', None, 'a bag directory or an .mcap file that exists'),
    ('bag/a', b'', 'this one has none'),
    ('bag', b'', 'this one is empty'),
    ('bag', b'SQLite format 3', 'this one has another format'),
    ('bag/metadata.yaml', b'{', 'metadata written by rosbag2'),
    ('bag/metadata.yaml', b'a: 1', 'metadata written by rosbag2'),
    ('bag/metadata.yaml', b'%storage_identifier: sqlite3}', 'mcap; `ros2 bag convert`'),
    ('bag/metadata.yaml', b'%storage_identifier: mcap, compression_mode: FILE}', '^comp'),
    (
        'bag/metadata.yaml',
        b'%storage_identifier: mcap, relative_file_paths: [gone_0.mcap]}',
        'an MCAP file that exists',
    ),
])
def test_raises_for_a_path_that_is_not_a_bag(
    tmp_path: Path, name: str, data: bytes | None, message: str
) -> None:
    (tmp_path / name).parent.mkdir(exist_ok=True)
    if data is not None:
        (tmp_path / name).write_bytes(data.replace(b'%', b'rosbag2_bagfile_information: {'))
    with pytest.raises(LavaError, match=message):
        BagReader(tmp_path / 'bag')
