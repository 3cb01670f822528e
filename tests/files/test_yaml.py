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

"""The one reader of YAML: what it takes, and what it refuses before it grows."""

from pathlib import Path

import pytest

from lava_ros.errors import LavaError, LONGEST_EXPECTED, LONGEST_VALUE
from lava_ros.files import yaml as yaml_files
from lava_ros.files.yaml import parse_yaml, read_yaml
from lava_ros.scene import scene_from_yaml

#: 350 bytes that stand for 9 to the 9th values.
BOMB = 'a: &a [x, x, x, x, x, x, x, x, x]\n' + ''.join(
    f'{name}: &{name} [{", ".join([f"*{inner}"] * 9)}]\n'
    for inner, name in zip('abcdefgh', 'bcdefghi', strict=True)
)


def test_aliases_and_merged_keys_are_values():
    """What people write by hand is read as before."""
    data = parse_yaml('scene', 'a: &a {x: 1}\nb: [*a, *a]\nc: {<<: *a, y: 2}\nd: 2001-02-03\n')
    assert data['b'] == [{'x': 1}, {'x': 1}]
    assert data['c'] == {'x': 1, 'y': 2}
    assert str(data['d']) == '2001-02-03'
    assert parse_yaml('scene', '') is None


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        (BOMB, '500000 values, those behind aliases counted each time, in line 6, column'),
        ('a: &a [*a]', 'an alias inside of what it names in line 1, column 8'),
        ('a: *b', "undefined alias 'b' in line 1, column 4"),
        ('a: ' + '[' * 5000 + ']' * 5000, '50 levels of lists and mappings in line 1, column 53'),
        ('- &a0 []\n' + ''.join(f'- &a{i + 1} [*a{i}]\n' for i in range(60)), '50 levels'),
        ('a: 1\nb: 2001-99-99', 'a value that is no timestamp in line 2, column 4'),
        ('!!timestamp x', 'no timestamp'),
        ('!!int x', 'no int'),
        ('!!int ""', 'no int'),
        ('!!bool x', 'no bool'),
        ('!!float x', 'no float'),
        ('!!python/object/apply:os.getcwd []', 'python/object'),
        ('9' * 4301, 'a number of more than 100 characters in line 1, column 1'),
        ('0x' + 'f' * 60_000, 'a number of more than 100 characters'),
        ('1:30' + ':30' * 1000, 'a number of more than 100 characters'),
        ('? [a]\n: b', 'unhashable key'),
        ('a\0', 'unacceptable character'),
        ('{not: [yaml', "',' or ']'"),
        ('!' + 'q' * 5000 + ' x', '...'),
    ],
    ids=lambda item: item[:20],
)
def test_what_is_refused(text, reason):
    """Each is one error of one line, with the place and the reason."""
    with pytest.raises(LavaError) as caught:
        parse_yaml('scene', text)
    assert caught.value.field == 'scene'
    assert reason in caught.value.expected
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 3 * LONGEST_VALUE


def test_long_texts_are_not_parsed(tmp_path, monkeypatch):
    """Neither a text nor a file."""
    monkeypatch.setattr(yaml_files, 'MOST_BYTES', 100)
    assert parse_yaml('scene', ' ' * 99 + '1') == 1
    with pytest.raises(LavaError, match='at most 100 bytes'):
        parse_yaml('scene', ' ' * 100 + '1')
    (tmp_path / 'long.yaml').write_text(' ' * 100 + '1')
    with pytest.raises(LavaError, match=r"long.yaml', expected .* \(at most 100 bytes\)"):
        read_yaml('scene', tmp_path / 'long.yaml')


@pytest.mark.parametrize('name', ['none.yaml', '.', 'a\0b', 'x' * 5000, 'latin.yaml'])
def test_files_that_cannot_be_read(tmp_path, name):
    """The error names the file."""
    (tmp_path / 'latin.yaml').write_bytes(b'# \xe9')
    with pytest.raises(LavaError, match='expected a readable YAML file') as caught:
        read_yaml('scene', tmp_path / name)
    assert len(str(caught.value)) < LONGEST_EXPECTED + 2 * LONGEST_VALUE


def test_a_scene_of_aliases_is_refused_at_once(tmp_path):
    """Where its values stand behind keys that a scene has, it is the text that is refused."""
    keys = ['viscosity', 'density', 'solidus', 'crystals', 'packing', 'liquidus', 'vft_a', 'vft_b']
    lines = [f'  {keys[0]}: &k0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n']
    for index, key in enumerate(keys[1:]):
        lines.append(f'  {key}: &k{index + 1} [{", ".join([f"*k{index}"] * 10)}]\n')
    (tmp_path / 'scene.yaml').write_text('lava:\n' + ''.join(lines) + 'gravity: *k7\n')
    with pytest.raises(LavaError, match='those behind aliases'):
        scene_from_yaml(tmp_path / 'scene.yaml')


def test_nothing_else_reads_yaml():
    """PyYAML's own loaders have no bounds."""
    package = Path(yaml_files.__file__).parents[1]
    users = [path.name for path in package.rglob('*.py') if 'yaml.load(' in path.read_text()]
    assert users == ['yaml.py']
    assert not [path for path in package.rglob('*.py') if 'yaml.safe_load' in path.read_text()]
