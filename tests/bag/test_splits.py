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

"""Bags of several files: where they are split, what each file starts with, what is cut off."""

from collections.abc import Callable
from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
import yaml

from bag.conftest import GRID, MakeGrid, Messages, SECOND
from lava_ros.bag import BagReader, BagWriter, LATCHED, QosProfile
from lava_ros.bag.recovery import recover
from lava_ros.bag.replay import schedule
from lava_ros.errors import LavaError

VOLATILE = QosProfile()


def record(
    directory: Path, make_grid: MakeGrid, frames: int = 25, **limits: float
) -> Messages:
    """Write terrain once, and each second a frame of a latched and a volatile grid."""
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
    """What was written: a repeated message was published before it is logged."""
    return [
        (item.topic, item.stamp_ns, item.data)
        for item in reader.messages()
        if item.publish_ns == item.stamp_ns
    ]


def test_a_bag_is_split_by_duration(tmp_path: Path, make_grid: MakeGrid) -> None:
    """Each file lasts as long as it may; metadata.yaml lists every file with its own numbers."""
    written = record(tmp_path / 'bag', make_grid, max_duration=10.0)
    reader = BagReader(tmp_path / 'bag')
    assert [item.name for item in reader.files] == ['bag_0.mcap', 'bag_1.mcap', 'bag_2.mcap']
    assert without_repeats(reader) == written
    document = yaml.safe_load((tmp_path / 'bag' / 'metadata.yaml').read_text())
    data = document['rosbag2_bagfile_information']
    assert data['relative_file_paths'] == ['bag_0.mcap', 'bag_1.mcap', 'bag_2.mcap']
    # The terrain again, and not the hazard, which the new file's first frame brings anyway.
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


def test_others_read_a_split_bag(tmp_path: Path, make_grid: MakeGrid) -> None:
    """The rosbags readers find every message, in the whole bag and in each file by itself."""
    written = record(tmp_path / 'bag', make_grid, max_duration=10.0)
    with Reader(tmp_path / 'bag') as reader:
        assert reader.message_count == len(written) + 2
        times = [time for _, time, _ in reader.messages()]
        assert times == sorted(times)
    with AnyReader([tmp_path / 'bag']) as reader:
        read = {(conn.topic, time, bytes(data)) for conn, time, data in reader.messages()}
    assert set(written) <= read
    for path in sorted((tmp_path / 'bag').glob('*.mcap')):
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
        recover(source, tmp_path / f'{path.stem}_bag')
        with AnyReader([tmp_path / f'{path.stem}_bag']) as reader:
            for connection, _, data in reader.messages():
                grid = reader.deserialize(data, connection.msgtype)
                assert grid.info.width == 60


def test_a_bag_is_split_by_size(tmp_path: Path, make_grid: MakeGrid) -> None:
    """A file that has reached the size gets no further frame, and no frame is divided."""
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
    """A terrain larger than the size is not repeated for each frame."""
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


def test_without_limits_there_is_one_file(tmp_path: Path, make_grid: MakeGrid) -> None:
    """Zero is no limit, and a limit below is refused."""
    record(tmp_path / 'bag', make_grid, max_size=0, max_duration=0.0)
    assert [item.name for item in BagReader(tmp_path / 'bag').files] == ['bag_0.mcap']
    for limits in ({'max_size': -1}, {'max_duration': -1.0}, {'max_duration': float('nan')}):
        with pytest.raises(LavaError, match=next(iter(limits))):
            BagWriter(tmp_path / 'new', custom_data={}, **limits)
        assert not (tmp_path / 'new').exists()


def test_a_clock_that_jumps_back_is_split_by_size(tmp_path: Path, make_grid: MakeGrid) -> None:
    """Log time stands still then; files are still divided, and time never decreases."""
    stamps = [1000 * SECOND, *(second * SECOND for second in range(40))]
    with BagWriter(tmp_path / 'bag', custom_data={}, max_size=20_000) as writer:
        for stamp in stamps:
            writer.write('/hazard', GRID, make_grid(stamp), stamp, qos=LATCHED)
            writer.flush()
        assert writer.file_count > 2
    messages = list(BagReader(tmp_path / 'bag').messages())
    assert [item.publish_ns for item in messages] == stamps
    assert {item.stamp_ns for item in messages} == {1000 * SECOND}


def test_a_replay_from_the_middle_has_the_latched_maps(
    tmp_path: Path, make_grid: MakeGrid
) -> None:
    """A start offset in the second file gives terrain and hazard at once, and what follows."""
    record(tmp_path / 'bag', make_grid, max_duration=10.0)
    dues = list(schedule(BagReader(tmp_path / 'bag'), start_offset=15.5))
    at_once = [due.message.topic for due in dues if due.at == 0.0]
    assert sorted(at_once) == ['/hazard', '/terrain']
    assert [due.at for due in dues] == sorted(due.at for due in dues)
    assert len([due for due in dues if due.message.topic == '/points']) == 9


def test_a_recovered_bag_has_the_same_files(tmp_path: Path, make_grid: MakeGrid) -> None:
    """Recovery keeps the files, every message in them, and both of its times."""
    record(tmp_path / 'bag', make_grid, max_duration=10.0)
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    last = tmp_path / 'bag' / 'bag_2.mcap'
    last.write_bytes(last.read_bytes()[:-500])
    source = BagReader(tmp_path / 'bag')
    assert source.recovered
    assert [item.finished for item in source.contents] == [True, True, False]
    shares: list[float] = []
    count = recover(source, tmp_path / 'new', on_progress=lambda _, share: shares.append(share))
    assert count == len(list(source.messages()))
    assert shares == sorted(shares) and (shares[0], shares[-1]) == (0.0, 1.0)
    result = BagReader(tmp_path / 'new')
    assert not result.recovered
    assert (result.topics, result.custom_data) == (source.topics, source.custom_data)
    for old, new in zip(source.files, result.files, strict=True):
        assert list(source.messages(file=old)) == list(result.messages(file=new))
    with Reader(tmp_path / 'new') as reader:
        assert reader.message_count == result.message_count


@pytest.mark.parametrize('size', [0, 5])
def test_a_file_that_was_hardly_begun_does_not_matter(
    tmp_path: Path, make_grid: MakeGrid, size: int
) -> None:
    """A writer killed between two files leaves a last one with nothing in it."""
    written = record(tmp_path / 'bag', make_grid, max_duration=10.0)
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    last = tmp_path / 'bag' / 'bag_2.mcap'
    last.write_bytes(last.read_bytes()[:size])
    reader = BagReader(tmp_path / 'bag')
    assert reader.recovered
    assert without_repeats(reader) == written[:41]


@pytest.mark.parametrize(
    ('size', 'limits', 'files'), [(500, {'max_duration': 50e-9}, 5), (2000, {}, 1)]
)
def test_killed_writers_leave_every_flushed_message(
    killed_bag: Callable[..., tuple[Path, int]], size: int, limits: dict[str, float], files: int
) -> None:
    """After kill -9 the finished files and what was flushed of the last one are there."""
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


def test_an_error_between_two_files_leaves_the_finished_ones(
    tmp_path: Path, make_grid: MakeGrid
) -> None:
    """When the next file cannot be opened the bag can still be closed, and is complete."""
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
