# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Checkpoints and other attachments, which players ignore and a resumed node finds."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
import random

from mcap.reader import make_reader
import pytest
from rosbags.rosbag2 import Reader

from bag.conftest import GRID, MakeGrid, messages_of, SECOND, small_bag
from lava_ros.bag import BagReader, BagWriter, LATCHED
from lava_ros.bag.checkpoints import (
    attachments_in,
    attachments_of,
    checkpoint_at,
    checkpoints_of,
    NAME,
    newest_checkpoint,
)
from lava_ros.bag.records import MAX_RECORD_SIZE
from lava_ros.bag.recovery import recover
from lava_ros.errors import LavaError
from lava_ros.simulation.output.checkpoint import MEDIA_TYPE
from small_checkpoint import small_checkpoint

WRITTEN = {'first': b'lava ' * 8, 'second': bytes(range(50))}


def checkpoint(time: float) -> bytes:
    """Return a checkpoint with as many particles as seconds."""
    return small_checkpoint(time, int(time)).to_bytes()


@pytest.fixture
def directory(tmp_path: Path, make_grid: MakeGrid) -> Path:
    """Return a finished bag of 20 messages in two files, with a checkpoint after every fifth."""
    path = tmp_path / 'eruption'
    with BagWriter(path, custom_data={}) as writer:
        for second in range(20):
            if second == 10:
                writer.start_next_file()
            stamp = (100 + second) * SECOND
            writer.write('/hazard', GRID, make_grid(stamp), stamp, qos=LATCHED)
            if second % 5 == 4:
                writer.attach(NAME, MEDIA_TYPE, checkpoint(second + 1.0), stamp)
                writer.flush()
        writer.attach('notes.txt', 'text/plain', b'nothing of use', stamp)
    return path


def test_attachments_do_not_change_the_messages(directory: Path) -> None:
    ours = messages_of(BagReader(directory))
    assert len(ours) == 20
    with Reader(directory) as reader:
        theirs = [(conn.topic, stamp, bytes(data)) for conn, stamp, data in reader.messages()]
    assert theirs == ours
    with (directory / 'eruption_1.mcap').open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert sum(1 for _ in reader.iter_messages()) == 10
        found = [(item.name, item.media_type) for item in reader.iter_attachments()]
    assert found == [(NAME, MEDIA_TYPE)] * 2 + [('notes.txt', 'text/plain')]
    assert len(attachments_of(directory)) == 5
    listed = checkpoints_of(directory)
    assert [tuple(item) for item in listed] == [
        (5.0 * n, (99 + 5 * n) * SECOND, 5 * n, len(checkpoint(5.0 * n)), 'particles')
        for n in range(1, 5)
    ]
    assert checkpoints_of(directory / 'eruption_0.mcap') == listed[:2]
    found = [checkpoint_at(directory, time) for time in (4.0, 10.0, 19.0, 1e9)]
    assert [item and item.time for item in found] == [None, 10.0, 15.0, 20.0]
    newest = newest_checkpoint(directory)
    assert newest.checkpoint.to_bytes() == checkpoint(20.0)
    assert (newest.log_time_ns, newest.refused) == (119 * SECOND, ())


def test_finds_every_complete_checkpoint_of_a_truncated_file(directory: Path) -> None:
    """A checkpoint is found if its last byte is there, with or without the index."""
    path = directory / 'eruption_0.mcap'
    indexed = attachments_in(path)
    path.write_bytes(path.read_bytes()[:-1])
    assert attachments_in(path) == indexed
    assert [item.read() for item in indexed] == [checkpoint(5.0), checkpoint(10.0)]
    path = directory / 'eruption_1.mcap'
    data = path.read_bytes()
    ends = [item.offset + item.length for item in attachments_in(path)]
    (directory / 'metadata.yaml').unlink()
    places = {len(data) - 1, len(data) // 2, 7, 8, 9}
    places |= {end + near for end in ends for near in (-1, 0, 1)}
    places |= set(random.Random(5).sample(range(len(data)), 20))
    for place in sorted(places):
        path.write_bytes(data[:place])
        whole = [time for time, end in zip((15.0, 20.0), ends, strict=False) if end <= place]
        assert [item.time for item in checkpoints_of(directory)] == [5.0, 10.0, *whole], place
        assert newest_checkpoint(directory).checkpoint.time == max([10.0, *whole])


def test_raises_without_a_checkpoint(tmp_path: Path) -> None:
    with pytest.raises(LavaError, match='that exists'):
        newest_checkpoint(tmp_path / 'nothing')
    with pytest.raises(LavaError, match=r'with \.mcap files; this one has none'):
        newest_checkpoint(tmp_path)
    (tmp_path / 'text.mcap').write_text('not a bag at all')
    with pytest.raises(LavaError, match='this one has another format'):
        newest_checkpoint(tmp_path)
    with pytest.raises(LavaError, match='with a checkpoint in it; this one has none'):
        newest_checkpoint(small_bag(tmp_path / 'bag').path)
    with BagWriter(tmp_path / 'later', custom_data={}) as writer:
        later = bytearray(checkpoint(3.0))
        later[8] = 9
        writer.attach(NAME, MEDIA_TYPE, bytes(later), 1)
    with pytest.raises(LavaError, match=r'checkpoint\.version is 9'):
        newest_checkpoint(tmp_path / 'later')


def test_recovery_keeps_checkpoints(directory: Path, tmp_path: Path) -> None:
    path = directory / 'eruption_1.mcap'
    last = attachments_in(path)[1]
    end = last.offset + last.length
    path.write_bytes(path.read_bytes()[: end + 10])
    (directory / 'metadata.yaml').unlink()
    before = checkpoints_of(directory)
    assert recover(BagReader(directory), tmp_path / 'whole') == 20
    assert BagReader(tmp_path / 'whole').recovered is False
    assert checkpoints_of(tmp_path / 'whole') == before
    assert [len(attachments_in(item)) for item in BagReader(tmp_path / 'whole').files] == [2, 2]
    assert newest_checkpoint(tmp_path / 'whole').checkpoint.time == 20.0


def test_newest_checkpoint_is_the_last_one_after_a_jump_of_the_clock(tmp_path: Path) -> None:
    """The order is that of the file, not of the stamps."""
    with BagWriter(tmp_path / 'bag', custom_data={}) as writer:
        writer.write('/empty', 'std_msgs/msg/Empty', bytes(4), 50 * SECOND, qos=LATCHED)
        writer.attach(NAME, MEDIA_TYPE, checkpoint(4.0), 50 * SECOND)
        writer.attach(NAME, MEDIA_TYPE, checkpoint(6.0), 20 * SECOND)
    assert [item.time for item in checkpoints_of(tmp_path / 'bag')] == [4.0, 6.0]
    assert newest_checkpoint(tmp_path / 'bag').checkpoint.time == 6.0


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return a finished file with a message and two attachments."""
    with BagWriter(tmp_path / 'bag', custom_data={}) as writer:
        writer.write('/empty', 'std_msgs/msg/Empty', bytes(4), SECOND, qos=LATCHED)
        for index, (name, data) in enumerate(WRITTEN.items()):
            writer.attach(name, 'text/plain', data, (2 + index) * SECOND)
    return tmp_path / 'bag/bag_0.mcap'


@pytest.mark.parametrize(
    'step', [pytest.param(1, marks=pytest.mark.nightly), pytest.param(7, id='every seventh')]
)
@pytest.mark.parametrize('damage', [lambda byte: byte ^ 1, lambda byte: byte ^ 128, lambda _: 255])
def test_detects_damage_of_every_byte(
    path: Path, damage: Callable[[int], int], step: int
) -> None:
    whole = path.read_bytes()
    read = refused = 0
    # writing the whole file each time would be slow
    with path.open('r+b', buffering=0) as file:
        for place, byte in list(enumerate(whole))[::step]:
            file.seek(place)
            file.write(bytes([damage(byte)]))
            try:
                for item in attachments_in(path):
                    assert item.read() in WRITTEN.values(), place
                    read += 1
            except LavaError:
                refused += 1
            file.seek(place)
            file.write(bytes([byte]))
    assert read > len(whole) // step
    assert refused > 100 // step


def test_raises_when_a_file_has_changed(path: Path) -> None:
    first, second = attachments_in(path)
    assert first.read() == WRITTEN['first']
    with pytest.raises(LavaError, match=f'expected at most {MAX_RECORD_SIZE}'):
        replace(first, length=MAX_RECORD_SIZE + 1).read()
    path.write_bytes(path.read_bytes()[: second.offset + 20])
    assert first.read() == WRITTEN['first']
    with pytest.raises(LavaError, match=r"is '20 bytes', expected 102 bytes"):
        second.read()
    path.unlink()
    with pytest.raises(LavaError, match='a readable file'):
        first.read()
    with pytest.raises(LavaError, match='that exists'):
        attachments_of(path)
    path.mkdir()
    with pytest.raises(LavaError, match='a readable MCAP file'):
        attachments_in(path)
