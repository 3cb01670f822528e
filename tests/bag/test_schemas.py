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

"""Message definitions and hashes."""

from collections.abc import Iterator
import json
from pathlib import Path

import pytest
from rosbags.typesys import get_types_from_msg, get_typestore, Stores

from lava_ros.bag.schemas import message_schema
from lava_ros.errors import LavaError

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
def share(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The share directory of a prefix that AMENT_PREFIX_PATH names."""
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    yield tmp_path / 'share'


def define(share: Path, package: str, name: str, text: str) -> None:
    """Install a message type."""
    directory = share / package / 'msg'
    directory.mkdir(parents=True, exist_ok=True)
    (directory / f'{name}.msg').write_text(text)
    hashes = [{'type_name': f'{package}/msg/{name}', 'hash_string': f'RIHS01_{name}'}]
    (directory / f'{name}.json').write_text(json.dumps({'type_hashes': hashes}))


@pytest.mark.parametrize('name', TYPES)
def test_definitions_are_complete_and_hashes_right(name: str) -> None:
    """An independent implementation parses each text alone and computes the same hash from it."""
    schema = message_schema(name)
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema.text, name))
    assert store.hash_rihs01(name) == schema.type_hash
    headings = [part.split('\n', 1)[0] for part in schema.text.split(SEPARATOR)[1:]]
    assert len(headings) == len(set(headings))


def test_dependencies_come_once_in_rosbag2s_order() -> None:
    """An OccupancyGrid needs six other types, each depth first."""
    text = message_schema('nav_msgs/msg/OccupancyGrid').text
    assert [part.split('\n', 1)[0] for part in text.split(SEPARATOR)[1:]] == [
        'nav_msgs/MapMetaData',
        'builtin_interfaces/Time',
        'geometry_msgs/Pose',
        'geometry_msgs/Point',
        'geometry_msgs/Quaternion',
        'std_msgs/Header',
    ]


def test_every_kind_of_field_is_understood(share: Path) -> None:
    """Bounds, arrays, constants, defaults and comments do not hide a dependency or make one."""
    define(share, 'a_msgs', 'Leaf', 'uint8 value\n')
    define(share, 'b_msgs', 'Other', 'a_msgs/Leaf leaf\n')
    define(
        share,
        'a_msgs',
        'Root',
        '# Missing type\nuint8 LIMIT=3\nstring<=5 name "x # y"\nwstring<=2[<=4] words\n'
        'Leaf[<=3] leaves\n  b_msgs/msg/Other[2] others # Missing other\nfloat64[36] numbers\n',
    )
    text = message_schema('a_msgs/msg/Root').text
    assert [part.split('\n', 1)[0] for part in text.split(SEPARATOR)[1:]] == [
        'a_msgs/Leaf',
        'b_msgs/Other',
    ]


def test_the_ament_prefix_comes_first(share: Path) -> None:
    """A sourced workspace overrides what the interpreter has."""
    define(share, 'std_msgs', 'Empty', '# ours\n')
    schema = message_schema('std_msgs/msg/Empty')
    assert (schema.text, schema.type_hash) == ('# ours\n', 'RIHS01_Empty')


@pytest.mark.parametrize(
    'name', ['OccupancyGrid', 'nav_msgs/OccupancyGrid', '../msg/x', 'a/srv/B']
)
def test_names_of_other_things_are_refused(name: str) -> None:
    """Only full message type names are looked up."""
    with pytest.raises(LavaError, match='a name such as nav_msgs/msg/OccupancyGrid'):
        message_schema(name)


def test_a_type_that_is_not_installed_says_what_to_do(share: Path) -> None:
    """The message names the missing dependency, not only what was asked for."""
    define(share, 'a_msgs', 'Root', 'gone_msgs/Leaf leaf\n')
    with pytest.raises(LavaError, match=r'gone_msgs/msg/Leaf.*install gone_msgs'):
        message_schema('a_msgs/msg/Root')


def test_a_type_without_a_hash_is_refused(share: Path) -> None:
    """A package of a distribution without type hashes raises."""
    define(share, 'a_msgs', 'Root', 'uint8 x\n')
    (share / 'a_msgs' / 'msg' / 'Root.json').unlink()
    with pytest.raises(LavaError, match=r'Root\.json'):
        message_schema('a_msgs/msg/Root')
