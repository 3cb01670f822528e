# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Message definitions, QoS profiles and decoding of grids."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from nav_msgs.msg import OccupancyGrid
import numpy as np
import pytest
from rosbags.typesys import get_types_from_msg, get_typestore, Stores
import yaml

from lava_ros.bag import BagMessage, Topic
from lava_ros.bag.decoding import Decoder, Grid, read_grid
from lava_ros.bag.qos import (
    INFINITE_NS,
    LATCHED,
    merge,
    profiles_from_yaml,
    profiles_to_yaml,
    QosProfile,
)
from lava_ros.bag.schemas import message_schema
from lava_ros.errors import LavaError
from lava_ros.ros import codec

SEPARATOR = '\n' + '=' * 80 + '\nMSG: '

TYPES = [
    'diagnostic_msgs/msg/DiagnosticArray',
    'nav_msgs/msg/MapMetaData',
    'nav_msgs/msg/OccupancyGrid',
    'sensor_msgs/msg/Image',
    'sensor_msgs/msg/PointCloud2',
    'std_msgs/msg/Empty',
    'visualization_msgs/msg/MarkerArray',
]


@pytest.fixture
def share(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the share directory of a prefix in AMENT_PREFIX_PATH."""
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    return tmp_path / 'share'


def headings(name: str) -> list[str]:
    """Return the names of the dependencies in the definition of a type."""
    parts = message_schema(name).text.split(SEPARATOR)[1:]
    return [part.split('\n', 1)[0] for part in parts]


def define(share: Path, package: str, name: str, text: str) -> None:
    """Install a message type."""
    directory = share / package / 'msg'
    directory.mkdir(parents=True, exist_ok=True)
    (directory / f'{name}.msg').write_text(text)
    hashes = [{'type_name': f'{package}/msg/{name}', 'hash_string': f'RIHS01_{name}'}]
    (directory / f'{name}.json').write_text(json.dumps({'type_hashes': hashes}))


@pytest.mark.parametrize('name', TYPES)
def test_definitions_are_complete_and_hashes_correct(name: str) -> None:
    """Another implementation computes the same hash from the text alone."""
    schema = message_schema(name)
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema.text, name))
    assert store.hash_rihs01(name) == schema.type_hash
    assert len(headings(name)) == len(set(headings(name)))
    # six dependencies, each once and depth first, as rosbag2 writes them
    assert headings('nav_msgs/msg/OccupancyGrid') == [
        'nav_msgs/MapMetaData',
        'builtin_interfaces/Time',
        'geometry_msgs/Pose',
        'geometry_msgs/Point',
        'geometry_msgs/Quaternion',
        'std_msgs/Header',
    ]


def test_finds_dependencies_among_installed_definitions(share: Path) -> None:
    define(share, 'a_msgs', 'Leaf', 'uint8 value\n')
    define(share, 'b_msgs', 'Other', 'a_msgs/Leaf leaf\n')
    text = '# Missing type\nuint8 LIMIT=3\nstring<=5 name "x # y"\nwstring<=2[<=4] words\n'
    text += 'Leaf[<=3] leaves\n  b_msgs/msg/Other[2] others # Missing other\nfloat64[36] numbers\n'
    define(share, 'a_msgs', 'Root', text)
    assert headings('a_msgs/msg/Root') == ['a_msgs/Leaf', 'b_msgs/Other']
    define(share, 'std_msgs', 'Empty', '# ours\n')
    schema = message_schema('std_msgs/msg/Empty')
    assert (schema.text, schema.type_hash) == ('# ours\n', 'RIHS01_Empty')
    define(share, 'c_msgs', 'Root', 'gone_msgs/Leaf leaf\n')
    with pytest.raises(LavaError, match=r'gone_msgs/msg/Leaf.*install gone_msgs'):
        message_schema('c_msgs/msg/Root')
    (share / 'a_msgs/msg/Leaf.json').unlink()
    with pytest.raises(LavaError, match=r'Leaf\.json'):
        message_schema('a_msgs/msg/Leaf')


@pytest.mark.parametrize(
    'name', ['OccupancyGrid', 'nav_msgs/OccupancyGrid', '../msg/x', 'a/srv/B']
)
def test_raises_for_a_name_that_is_not_a_message_type(name: str) -> None:
    with pytest.raises(LavaError, match='a name such as nav_msgs/msg/OccupancyGrid'):
        message_schema(name)


#: Keys, order, words and infinite durations as rosbag2 in Jazzy writes them.
WRITTEN = """
- history: keep_last
  depth: 1
  reliability: reliable
  durability: transient_local
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: automatic
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false
"""


def test_reads_writes_and_merges_qos_profiles() -> None:
    (item,) = yaml.safe_load(profiles_to_yaml([LATCHED]))
    (expected,) = yaml.safe_load(WRITTEN)
    assert list(item.items()) == list(expected.items())
    profile = QosProfile(depth=3, reliability='best_effort', deadline=1_500_000_000)
    assert profiles_from_yaml(profiles_to_yaml([profile, LATCHED])) == (profile, LATCHED)
    time = '{sec: 0, nsec: 0}'
    (profile,) = profiles_from_yaml(
        f'- {{history: 3, depth: 0, reliability: 2, durability: 1, deadline: {time}, '
        f'lifespan: {time}, liveliness: 1, liveliness_lease_duration: {time}, '
        'avoid_ros_namespace_conventions: false}'
    )
    assert (profile.reliability, profile.durability) == ('best_effort', 'transient_local')
    assert (profile.history, profile.depth, profile.deadline) == ('keep_last', 10, 0)
    weak = QosProfile(reliability='best_effort')
    assert merge([weak, LATCHED]) == QosProfile(durability='transient_local')
    assert merge([weak, weak]) == weak
    assert merge([]) == QosProfile(deadline=INFINITE_NS)


NOT_PROFILES = ['a: 1', '- 1', '- {history: keep_last}', '[', '- {history: 9}', '- 2001-99-99']
NOT_PROFILES += [profiles_to_yaml([LATCHED]).replace('sec: 9223372036', 'sec: x')]


@pytest.mark.parametrize('text', NOT_PROFILES)
def test_raises_for_an_invalid_qos_profile(text: str) -> None:
    with pytest.raises(LavaError, match='offered_qos_profiles'):
        profiles_from_yaml(text)
    with pytest.raises(LavaError, match=r'qos\.durability is .latched., expected one of'):
        QosProfile(durability='latched')


def message(frame_id: str = 'map') -> BagMessage:
    """Return a bag message with a grid of 3 rows and 5 columns."""
    grid = OccupancyGrid()
    grid.header.frame_id = frame_id
    grid.info.resolution, grid.info.width, grid.info.height = 2.5, 5, 3
    grid.info.origin.position.x, grid.info.origin.position.y = -7.0, 1e6
    grid.data = list(range(-1, 14))
    return BagMessage('/height', 1, 1, codec.serialise(grid))


def read(item: BagMessage) -> Grid:
    """Decode a grid with the definition of its type."""
    schema = message_schema('nav_msgs/msg/OccupancyGrid')
    topic = Topic(item.topic, schema, LATCHED, 1)
    bag: Any = SimpleNamespace(path='bag', topics={item.topic: topic})
    return read_grid(Decoder(bag), item)


def test_reads_a_grid_with_any_frame_name_and_byte_order() -> None:
    """The length of the name changes the alignment of the fields after it."""
    names = ('', 'm', 'ma', 'map', 'odom', 'a/long/frame')
    found = [read(message(name)) for name in names]
    body = bytearray(message().data)
    body[1] = 0
    # Stamp, length of the name, load time, resolution, width, height; pose; count of cells.
    sizes = dict.fromkeys((0, 4, 8, 16, 20, 24, 28, 32, 96), 4)
    for start, size in {**sizes, **dict.fromkeys(range(40, 96, 8), 8)}.items():
        body[4 + start : 4 + start + size] = body[4 + start : 4 + start + size][::-1]
    for grid in (*found, read(message()._replace(data=bytes(body)))):
        np.testing.assert_array_equal(grid.cells, np.arange(-1, 14).reshape(3, 5))
        assert grid.cells.dtype == np.int8
        assert (grid.resolution, grid.origin) == (2.5, (-7.0, 1e6))


def test_raises_for_a_truncated_grid() -> None:
    whole = message()
    # serialisation pads the end to four bytes
    for length in range(len(whole.data) - 3):
        with pytest.raises(LavaError, match='message on /height'):
            read(whole._replace(data=whole.data[:length]))
    grid = OccupancyGrid()
    grid.info.width, grid.info.height, grid.data = 4, 4, [0] * 15
    with pytest.raises(LavaError, match='a nav_msgs/msg/OccupancyGrid'):
        read(BagMessage('/height', 1, 1, codec.serialise(grid)))
