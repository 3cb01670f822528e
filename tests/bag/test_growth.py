# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Work that grows with the size of a bag, and not with its square."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer
import pytest

from lava_ros.bag import BagReader
from lava_ros.bag.decoding import Moment, Timeline
from lava_ros.bag.records import iter_records
from lava_ros.cli.info import info
from lava_ros.layers.recording import Recording
from operations import growth

START = 10**18


def timeline_of(count: int) -> Timeline:
    """Return the timeline of a recording at 1 Hz with a clock that loops after 5 s."""
    numbers = [
        SimpleNamespace(stamp_ns=START + index * 10**9, publish_ns=START + index % 5 * 10**9)
        for index in range(count)
    ]
    bag: Any = SimpleNamespace(messages=lambda topics: numbers)
    decoder: Any = SimpleNamespace(decode=lambda message, take: [
        Moment(message.publish_ns, 1e-9 * (message.stamp_ns - START), {}, '/lava')
    ])
    return Timeline(bag, decoder, is_own=True)


def test_times_of_a_looping_clock_continue() -> None:
    timeline = timeline_of(20)
    assert [moment.stamp_ns - START for moment in timeline.moments] == [
        index * 10**9 for index in range(20)
    ]
    assert timeline.last_run == timeline.moments
    # a stamp is of the loop in which its message was logged
    stamp = START + 1_500_000_000
    for loop in range(4):
        now = timeline.ros_time(stamp, stamp + loop * 5 * 10**9 + 10**8)
        assert timeline.time_at(now) == pytest.approx(5.0 * loop + 1.5)


def build(folder: Path, count: int) -> Callable[[], object]:
    return lambda: timeline_of(count).of('/lava')


def time_frames(folder: Path, count: int) -> Callable[[], object]:
    timeline = timeline_of(count)
    return lambda: [timeline.time_at(moment.stamp_ns) for moment in timeline.moments]


def progress(folder: Path, count: int) -> Callable[[], object]:
    recording: Any = SimpleNamespace(timeline=timeline_of(count))
    frames: list[Any] = [SimpleNamespace(time=float(index)) for index in range(count)]
    return lambda: [Recording.progress_at(recording, frame) for frame in frames]


def damaged(folder: Path, count: int) -> Path:
    """Write a bag in which every second of its chunks is damaged."""
    path = folder / f'{count}.mcap'
    with path.open('wb') as stream:
        writer = Writer(stream, chunk_size=60, compression=CompressionType.NONE)
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/Empty', 'ros2msg', b'')
        channel = writer.register_channel('/a', 'cdr', schema)
        for stamp in range(2 * count):
            writer.add_message(channel, stamp, bytes(60), stamp)
        writer.finish()
    data = bytearray(path.read_bytes())
    view: Any = bytes(data)
    chunks = [end for opcode, _, end in iter_records(view) if opcode == Opcode.CHUNK]
    for end in chunks[::2]:
        data[end - 1] ^= 1
    path.write_bytes(data)
    return path


def open_damaged(folder: Path, count: int) -> Callable[[], object]:
    path = damaged(folder, count)
    return lambda: BagReader(path)


def describe_damaged(folder: Path, count: int) -> Callable[[], object]:
    args: Any = SimpleNamespace(bag=str(damaged(folder, count)), node=None, json=None)
    return lambda: info.run(args)


@pytest.mark.parametrize(('make', 'size'), [
    (build, 200), (time_frames, 200), (progress, 200), (open_damaged, 50),
    (describe_damaged, 150),
])
def test_work_is_linear_in_the_length_of_a_bag(
    tmp_path: Path, make: Callable[[Path, int], Callable[[], object]], size: int
) -> None:
    assert growth(lambda count: make(tmp_path, count), size) < 2.2


def test_every_damaged_place_is_described(tmp_path: Path) -> None:
    reader = BagReader(damaged(tmp_path, 5))
    parts = [text for text in reader.damage if text.startswith('a chunk record is damaged')]
    assert len(parts) == 5 and reader.message_count == 5
    assert '(before 0.000 s of its messages)' in parts[0]
    assert '(after 0.000 s and before 0.000 s of its messages)' in parts[1]
