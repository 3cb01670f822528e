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

"""Attachments of damaged files: the data that was written, or an error that says why not."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from lava_ros.bag import BagWriter, LATCHED
from lava_ros.bag.attachments import attachments_in, attachments_of
from lava_ros.bag.mcap_file import MAX_BLOCK_SIZE
from lava_ros.errors import LavaError

SECOND = 1_000_000_000
WRITTEN = {'first': b'lava ' * 8, 'second': bytes(range(50))}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A finished file with a message and two attachments."""
    with BagWriter(tmp_path / 'bag', custom_data={}) as writer:
        writer.write('/empty', 'std_msgs/msg/Empty', bytes(4), SECOND, qos=LATCHED)
        for index, (name, data) in enumerate(WRITTEN.items()):
            writer.attach(name, 'text/plain', data, (2 + index) * SECOND)
    return tmp_path / 'bag/bag_0.mcap'


@pytest.mark.parametrize(
    'damage',
    [lambda byte: byte ^ 1, lambda byte: byte ^ 128, lambda _: 255],
    ids=['lowest bit', 'highest bit', 'all bits'],
)
def test_no_damage_is_passed_over(path: Path, damage: Callable[[int], int]) -> None:
    """Whichever byte it strikes: data that is read is what was written, all else is an error."""
    whole = path.read_bytes()
    read = refused = 0
    for place in range(len(whole)):
        damaged = bytearray(whole)
        damaged[place] = damage(damaged[place])
        if damaged == whole:
            continue
        path.write_bytes(damaged)
        try:
            for item in attachments_in(path):
                assert item.read() in WRITTEN.values(), place
                read += 1
        except LavaError:
            refused += 1
    assert read > len(whole)
    assert refused > 100


def test_a_file_that_changes_meanwhile(path: Path) -> None:
    """One that is gone or shorter than it was, or a length that no memory holds, is an error."""
    first, second = attachments_in(path)
    assert first.read() == WRITTEN['first']
    with pytest.raises(LavaError, match=f'expected at most {MAX_BLOCK_SIZE}'):
        replace(first, length=MAX_BLOCK_SIZE + 1).read()
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
