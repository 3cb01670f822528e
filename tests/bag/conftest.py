# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Messages and bags for the tests, made without ROS."""

from collections.abc import Callable
import json
from pathlib import Path
import signal
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import get_typestore, Stores

from lava_ros.bag import BagReader, BagWriter, LATCHED, QosProfile

GRID = 'nav_msgs/msg/OccupancyGrid'
SECOND = 1_000_000_000

Messages = list[tuple[str, int, bytes]]
Bag = tuple[Path, Messages]
MakeGrid = Callable[[int], bytes]


def messages_of(reader: BagReader) -> Messages:
    """Return all messages of a reader."""
    return [(item.topic, item.stamp_ns, item.data) for item in reader.messages()]


#: Program that writes latched frames with the stamps 0, 1, 2, ... and prints each flushed stamp.
RECORDER = """
import json, sys
from lava_ros.bag import LATCHED, BagWriter
directory, size, topics, limits = sys.argv[1], *map(json.loads, sys.argv[2:])
writer = BagWriter(directory, custom_data={'scene': 'Etna'}, **limits)
for stamp in range(10**9):
    data = bytes([0, 1, 0, 0]) + stamp.to_bytes(8, 'little') * size
    for topic in topics:
        writer.write(topic, 'std_msgs/msg/Empty', data, stamp, qos=LATCHED)
    writer.flush()
    print(stamp, flush=True)
"""


def small_bag(directory: Path, *messages: tuple[int, bytes], **options: Any) -> BagReader:
    """Write a finished bag with messages (stamp, data) on the latched topic /a."""
    with BagWriter(directory, custom_data={}, **options) as writer:
        for stamp, data in messages:
            writer.write('/a', 'std_msgs/msg/Empty', data, stamp, qos=LATCHED)
    return BagReader(directory)


@pytest.fixture(scope='session')
def make_grid() -> MakeGrid:
    """Return a function that serialises an OccupancyGrid of 40 x 60 cells with a stamp [ns]."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    time = types['builtin_interfaces/msg/Time']
    pose = types['geometry_msgs/msg/Pose'](
        types['geometry_msgs/msg/Point'](-5.0, 7.0, 0.0),
        types['geometry_msgs/msg/Quaternion'](0.0, 0.0, 0.0, 1.0),
    )

    def make(stamp_ns: int) -> bytes:
        stamp = time(*divmod(stamp_ns, SECOND))
        cells = np.random.default_rng(stamp_ns).integers(-1, 101, 40 * 60).astype(np.int8)
        message = types[GRID](
            types['std_msgs/msg/Header'](stamp, 'map'),
            types['nav_msgs/msg/MapMetaData'](time(0, 0), 2.5, 60, 40, pose),
            cells,
        )
        return bytes(store.serialize_cdr(message, GRID))

    return make


@pytest.fixture
def bag(tmp_path: Path, make_grid: MakeGrid) -> Bag:
    """Return a finished bag and its messages: latched /hazard at 1 Hz, /points at 2 Hz."""
    directory = tmp_path / 'eruption'
    messages: Messages = []
    with BagWriter(directory, custom_data={'scene': '{"gravity": 9.81}', 'note': 'a\nb'}) as out:
        for half in range(20):
            stamp = 100 * SECOND + half * SECOND // 2
            if half % 2 == 0:
                messages.append(('/hazard', stamp, make_grid(stamp)))
                out.write('/hazard', GRID, messages[-1][2], stamp, qos=LATCHED)
            messages.append(('/points', stamp, make_grid(stamp + 1)))
            out.write(
                '/points', GRID, messages[-1][2], stamp, qos=QosProfile(reliability='best_effort')
            )
            if half % 4 == 3:
                out.flush()
    return directory, messages


@pytest.fixture
def killed_bag(tmp_path: Path) -> Callable[..., tuple[Path, int]]:
    """Return a function that kills a recorder and returns its bag and the last flushed stamp.

    Each message contains its stamp ``size`` times.
    """

    def kill(frames: int, *, size: int, topics: list[str], **limits: float) -> tuple[Path, int]:
        words = [json.dumps(item) for item in (size, topics, limits)]
        process = subprocess.Popen(
            [sys.executable, '-c', RECORDER, str(tmp_path / 'bag'), *words],
            stdout=subprocess.PIPE,
            text=True,
            cwd=Path(__file__).parents[2],
        )
        assert process.stdout is not None
        while int(process.stdout.readline()) < frames:
            pass
        process.send_signal(signal.SIGKILL)
        flushed = max([frames, *(int(line) for line in process.stdout.read().split())])
        process.wait()
        return tmp_path / 'bag', flushed

    return kill
