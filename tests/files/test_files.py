# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Input and output files, YAML, and the data files of the package."""

from collections.abc import Callable
import errno
from io import BytesIO, TextIOWrapper
import json
import math
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
from typing import Any

import pytest
import yaml

from command_line import lava
from lava_ros.bag import BagReader, BagWriter
from lava_ros.bag.checkpoints import attachments_of
from lava_ros.cli.console import Printable
from lava_ros.errors import LavaError, MAX_EXPECTED_LENGTH, MAX_VALUE_LENGTH
from lava_ros.files import file_to_write, open_input, replacing, write_output
from lava_ros.files import resources as share
from lava_ros.files import yaml as yaml_files
from lava_ros.files.resources import share_path
from lava_ros.files.yaml import dump_yaml, parse_yaml, read_yaml
from lava_ros.hindcast.calibration import read_samples
from lava_ros.hindcast.case import load_case
from lava_ros.scene.effusion_rates import read_effusion_rates
from lava_ros.scene.features import ENDINGS, load_features
from lava_ros.scene.terrain_files import load_terrain
from lava_ros.verification.rows import read_csv
from recording import record

#: Readers of files of the user.
READERS: dict[str, Callable[[Path], Any]] = {
    'bag.mcap': BagReader,
    'one.mcap': attachments_of,
    'scene.yaml': lambda path: read_yaml('scene', path),
    'rates.csv': lambda path: read_effusion_rates('case', path),
    **{
        f'vents{ending}': lambda path: load_features('--vents', path) for ending in ENDINGS
    },
    'rows.csv': read_csv,
    'ground.tif': load_terrain,
    'ground.asc': load_terrain,
    'ground.npz': load_terrain,
}


@pytest.fixture
def alarm():
    """Fail a test that waits."""
    signal.signal(signal.SIGALRM, lambda *_: pytest.fail('waited for 5 s'))
    signal.alarm(5)
    yield
    signal.alarm(0)


@pytest.fixture
def bag(tmp_path):
    return record(tmp_path / 'bag', (200.0, 400.0))


@pytest.mark.parametrize('name', READERS)
def test_readers_reject_pipes_and_devices(name, tmp_path, alarm):
    os.mkfifo(tmp_path / name)
    with pytest.raises(LavaError):
        READERS[name](tmp_path / name)
    (tmp_path / name).unlink()
    (tmp_path / name).symlink_to('/dev/zero')
    with pytest.raises(LavaError):
        READERS[name](tmp_path / name)


def test_opens_only_regular_files_and_links_to_them(tmp_path, alarm):
    (tmp_path / 'file').write_text('here')
    (tmp_path / 'link').symlink_to('file')
    with open_input(tmp_path / 'link') as file:
        assert file.read() == b'here'
    for name in ('.', 'none', 'a\0b'):
        with pytest.raises(OSError):
            open_input(tmp_path / name)
    for name in ('elevation.asc', 'footprint.asc', 'vent.csv', 'effusion_rate.csv'):
        (tmp_path / name).write_text('')
    os.mkfifo(tmp_path / 'case.yaml')
    with pytest.raises(LavaError, match='case.yaml.*not a regular file'):
        load_case(tmp_path)
    assert read_samples(tmp_path / 'none.csv', [], []) == []


def test_file_to_write_checks_the_path_without_a_change(tmp_path, caplog, alarm):
    caplog.set_level('INFO')
    old = tmp_path / 'old.json'
    old.write_text('precious')
    assert file_to_write('--json', str(old)) == old
    assert file_to_write('--json', tmp_path / 'new.json', ('.json',)) == tmp_path / 'new.json'
    assert [path.name for path in tmp_path.iterdir()] == ['old.json']
    assert old.read_text() == 'precious'
    assert caplog.messages == [f'{old} exists and will be replaced']
    (tmp_path / 'file').write_text('')
    os.mkfifo(tmp_path / 'pipe')
    names = ['none/a.json', 'file/a.json', 'pipe', 'a\0b']
    for path in (tmp_path, Path('/dev/null'), *(tmp_path / name for name in names)):
        with pytest.raises(LavaError, match='^--json is .* a (writable file|file in a folder)'):
            file_to_write('--json', path)
    with pytest.raises(LavaError, match="bag.mcap', expected a file whose name ends with .json"):
        file_to_write('--json', tmp_path / 'bag.mcap', ('.json',))


def test_replaces_a_file_completely_or_not_at_all(tmp_path):
    path = tmp_path / 'a.txt'
    path.write_text('old')
    path.chmod(0o600)
    (tmp_path / 'link').symlink_to('a.txt')
    with pytest.raises(RuntimeError), replacing(tmp_path / 'link') as partial:
        partial.write_text('half')
        assert (partial.parent, partial.suffix) == (tmp_path, '.txt')
        raise RuntimeError
    assert path.read_text() == 'old'
    write_output('output', tmp_path / 'link', 'new')
    assert (path.read_text(), path.stat().st_mode & 0o777) == ('new', 0o600)
    assert sorted(item.name for item in tmp_path.iterdir()) == ['a.txt', 'link']


def test_does_not_write_through_links_at_old_temporary_names(bag, tmp_path):
    precious = tmp_path / 'precious'
    precious.write_text('precious')
    (tmp_path / '.run.html.partial').symlink_to(precious)
    assert lava('map', bag, '-o', tmp_path / 'run.html')[0] == 0
    with BagWriter(tmp_path / 'new', custom_data={}):
        (tmp_path / 'new/metadata.yaml.partial').symlink_to(precious)
    assert precious.read_text() == 'precious'
    assert b'<html' in (tmp_path / 'run.html').read_bytes()


def test_rejects_output_that_would_replace_its_input(bag, tmp_path):
    path = bag / 'bag_0.mcap'
    before = path.read_bytes()
    for command, option in (('bag info', '--json'), ('map', '-o')):
        status, _, message = lava(command, bag, option, path)
        assert (status, 'whose name ends with' in message) == (2, True)
    assert path.read_bytes() == before
    ground, huts = tmp_path / 'ground.tif', tmp_path / 'huts.csv'
    huts.write_text('name,x,y\nhut,0,0\n')
    scene = tmp_path / 'scene.json'
    scene.write_text('{}')
    (tmp_path / 'other.json').symlink_to(scene)
    for words in (
        ('barrier', ground, '--low-pass', 20, '-o', ground),
        ('effects', scene, '--json', tmp_path / 'other.json'),
        # of several values, and of an option that may be repeated
        ('places', bag, scene, huts, '-o', huts),
        ('map', bag, bag, '--places', huts, '--places', scene, '-o', scene),
    ):
        ground.write_text('precious')
        status, _, message = lava(*words)
        assert (status, 'expected a file other than' in message) == (2, True), message
        assert (ground.read_text(), scene.read_text()) == ('precious', '{}')
        assert huts.read_text().startswith('name,x,y')


def test_escapes_control_characters_of_a_bag_in_output(tmp_path):
    evil = 'a\x1b]0;title\x07\x9b31mb\udc80'
    source = BagReader(record(tmp_path / 'source', (200.0,)))
    data = {'scene': yaml.safe_dump({evil: [evil]}), 'version': evil, evil: evil}
    with BagWriter(tmp_path / 'bag', custom_data=data) as writer:
        for item in source.messages():
            topic = source.topics[item.topic]
            name = topic.name if 'diag' not in topic.name else '/x\x1b[2J' + topic.name
            writer.write(name, topic.message_type, item.data, item.stamp_ns, qos=topic.qos)
    for words in (
        ('bag info', tmp_path / 'bag'),
        ('bag info', tmp_path / 'bag', '--json', '-'),
        ('bag recover', tmp_path / 'bag', '-o', tmp_path / 'new'),
        ('bag info', tmp_path / evil),
    ):
        _, out, message = lava(*words)
        assert (out + message).replace('\n', '').isprintable()
        assert 'x1b' in out + message or '\\u001b' in out


@pytest.mark.parametrize(('encoding', 'shown'), [
    ('utf-8', 'Öræfi ☃ km²'),
    ('latin-1', r'Öræfi \u2603 km²'),
    ('ascii', r'\xd6r\xe6fi \u2603 km\xb2'),
])
def test_escapes_what_the_encoding_of_the_output_lacks(encoding, shown):
    raw = TextIOWrapper(BytesIO(), encoding=encoding, write_through=True)
    print('Öræfi ☃ km²', end='', file=Printable(raw))  # type: ignore[type-var]
    assert raw.buffer.getvalue().decode(encoding) == shown  # type: ignore[attr-defined]


def test_full_disk_is_an_error_and_leaves_no_file(bag, tmp_path):
    """Some libraries, such as GDAL, only print that they have failed."""
    commands = [('export', 'maps'), ('map', 'a.png'), ('map', 'a.html')]
    code = 'import resource, sys; from lava_ros.cli.main import main;'
    code += 'resource.setrlimit(resource.RLIMIT_FSIZE, (64, 64));'
    code += f'print([main([word, {str(bag)!r}, "-o", name]) for word, name in {commands}])'
    (tmp_path / 'out').mkdir()
    words = [sys.executable, '-B', '-c', code]
    done = subprocess.run(
        words, capture_output=True, text=True, timeout=300, cwd=tmp_path / 'out',
        env=os.environ | {'PYTHONPATH': str(Path(__file__).parents[2])},
    )
    assert done.stdout == '[2, 2, 2]\n', done.stderr
    for _, name in commands:
        assert re.search(f'{re.escape(name)}.*File too large', done.stderr), done.stderr
    assert [item for item in (tmp_path / 'out').rglob('*') if item.is_file()] == []


def test_command_ends_with_one_error_when_the_disk_is_full(monkeypatch, tmp_path):
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, 'No space left on device')

    monkeypatch.setattr('numpy.savez', full)
    status, _, message = lava('ros', 'demo', '--output', tmp_path / 'demo', '--device', 'cpu')
    assert status == 2
    assert 'lava ros demo: no room is left: [Errno 28] No space left on device' in message


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Move the package out of its checkout, with an empty prefix and without ament."""
    package = tmp_path / 'lib/site-packages/lava_ros'
    package.mkdir(parents=True)
    monkeypatch.setattr(share, '__file__', str(package / 'resources.py'))
    monkeypatch.setattr(sys, 'prefix', str(tmp_path / 'prefix'))
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    return tmp_path


def install(prefix: Path) -> Path:
    path = prefix / 'share/lava_ros/msg_configs/default.yaml'
    path.parent.mkdir(parents=True)
    path.write_text('layers: {}\n')
    return path


def test_searches_ament_prefixes_before_that_of_pip(installed, monkeypatch):
    path = install(installed / 'prefix')
    assert share_path('msg_configs/default.yaml') == path
    path = install(installed / 'overlay')
    install(installed / 'underlay')
    prefixes = f'{installed / "empty"}:{installed / "overlay"}:{installed / "underlay"}'
    monkeypatch.setenv('AMENT_PREFIX_PATH', prefixes)
    assert share_path('msg_configs/default.yaml') == path
    # the package.xml of another package in the parent folder is not that of a checkout
    root = installed / 'lib/site-packages'
    (root / 'package.xml').write_text('<package><name>other</name></package>')
    (root / 'msg_configs').mkdir()
    (root / 'msg_configs/default.yaml').write_text('')
    assert share_path('msg_configs/default.yaml') == path
    with pytest.raises(LavaError, match=r'msg_configs/none\.yaml') as caught:
        share_path('msg_configs/none.yaml')
    assert str(installed / 'prefix/share/lava_ros/msg_configs/none.yaml') in str(caught.value)


def find(name: str, folder: str = 'msg_configs') -> Path:
    return share.find_file(name, folder, field='which', expected='a file')


def test_error_lists_the_searched_places(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(LavaError) as caught:
        find('nothing.yaml')
    message = str(caught.value)
    assert message.startswith(
        f"which is 'nothing.yaml', expected a file; looked for {tmp_path / 'nothing.yaml'}, "
    )
    assert 'msg_configs/nothing.yaml' in message
    for name in ('../msg_configs/default.yaml', './default.yaml', str(tmp_path / 'default.yaml')):
        with pytest.raises(LavaError) as caught:
            find(name)
        assert str(caught.value).count('default.yaml') == 2


#: YAML of 350 bytes with 9 to the 9th values.
BOMB = 'a: &a [x, x, x, x, x, x, x, x, x]\n' + ''.join(
    f'{name}: &{name} [{", ".join([f"*{inner}"] * 9)}]\n'
    for inner, name in zip('abcdefgh', 'bcdefghi', strict=True)
)


def test_reads_yaml_up_to_a_size(tmp_path, monkeypatch):
    data = parse_yaml('scene', 'a: &a {x: 1}\nb: [*a, *a]\nc: {<<: *a, y: 2}\nd: 2001-02-03\n')
    assert data['b'] == [{'x': 1}, {'x': 1}]
    assert data['c'] == {'x': 1, 'y': 2}
    assert str(data['d']) == '2001-02-03'
    assert parse_yaml('scene', '') is None
    monkeypatch.setattr(yaml_files, 'MAX_BYTES', 100)
    assert parse_yaml('scene', ' ' * 99 + '1') == 1
    with pytest.raises(LavaError, match='at most 100 bytes'):
        parse_yaml('scene', ' ' * 100 + '1')
    (tmp_path / 'long.yaml').write_text(' ' * 100 + '1')
    with pytest.raises(LavaError, match=r"long.yaml', expected .* \(at most 100 bytes\)"):
        read_yaml('scene', tmp_path / 'long.yaml')


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        (BOMB, '500000 values, those of an alias counted each time, in line 6, column'),
        ('a: &a [*a]', 'an alias inside the value that it refers to in line 1, column 8'),
        ('a: *b', "undefined alias 'b' in line 1, column 4"),
        ('a: ' + '[' * 5000 + ']' * 5000, '50 levels of lists and mappings in line 1, column 53'),
        ('- &a0 []\n' + ''.join(f'- &a{i + 1} [*a{i}]\n' for i in range(60)), '50 levels'),
        ('a: 1\nb: !!timestamp 2001-99-99', 'a value that is not of type timestamp in line 2, '),
        ('!!int x', 'not of type int'),
        ('!!python/object/apply:os.getcwd []', 'python/object'),
        ('9' * 4301, 'a number of more than 100 characters in line 1, column 1'),
        ('0x' + 'f' * 60_000, 'a number of more than 100 characters'),
        ('a: 1\nb: {c: 1, c: 2}', 'the key c twice in line 2, column 11'),
        ('? [a]\n: b', 'unhashable key'),
        ('a\0', 'unacceptable character'),
        ('{not: [yaml', "',' or ']'"),
        ('!' + 'q' * 5000 + ' x', '...'),
    ],
    ids=lambda item: item[:20],
)
def test_rejects_unsafe_or_invalid_yaml(text, reason):
    with pytest.raises(LavaError) as caught:
        parse_yaml('scene', text)
    assert caught.value.field == 'scene'
    assert reason in caught.value.expected
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 3 * MAX_VALUE_LENGTH


@pytest.mark.parametrize(('text', 'field', 'typed', 'expected'), [
    ('discharge: 010', '.discharge', '010', '10, or text in quotes: YAML 1.1 reads it as 8'),
    ('- {x: [1, 0512345]}', '[0].x[1]', '0512345', '512345, .* as 169189 .line 1, column 11'),
    ('a: 0x1F', '.a', '0x1F', '31, or text in quotes'),
    ('a: 1\nduration: 1:30', '.duration', '1:30', 'a number such as 90, .*line 2, column 11'),
    ('fill_holes: yes', '.fill_holes', 'yes', 'true, or text'),
    ('Off: 1', '', 'Off', 'false, or text'),
    ('a: &x 010\nb: *x', '.a', '010', '10, or text'),
])
def test_rejects_values_that_yaml_1_1_reads_differently(text, field, typed, expected):
    with pytest.raises(LavaError, match=expected) as caught:
        parse_yaml('scene', text)
    assert (caught.value.field, caught.value.value) == ('scene' + field, typed)


@pytest.mark.parametrize(('text', 'value'), [
    ('"010"', '010'), ("'no'", 'no'), ('010.5', 10.5), ('08', '08'), ('1_000', 1000),
    ('0', 0), ('0.5', 0.5), ('True', True), ('2021-09-19', '2021-09-19'), ('~', None),
    ('2021-09-19T14:00:00Z', '2021-09-19T14:00:00Z'), ('!!int 010', 8),
])
def test_reads_quoted_text_decimals_and_dates_as_written(text, value):
    assert parse_yaml('scene', f'a: {text}') == {'a': value}


@pytest.mark.parametrize(('text', 'value'), [
    ('1e3', 1000.0), ('1.0e9', 1e9), ('1E+3', 1000.0), ('-1e-3', -0.001), ('+1.5e2', 150.0),
    ('.5', 0.5), ('-.5', -0.5), ('.5e1', 5.0), ('5.', 5.0), ('5.e1', 50.0), ('0e0', 0.0),
    ('010e1', 100.0), ('-0.0', -0.0), ('.inf', math.inf), ('-.INF', -math.inf), ('1', 1),
    ('+12', 12), ('1_000.5', 1000.5),
    # no numbers of YAML 1.2, or text in this package
    ('0o17', '0o17'), ('08', '08'), ('e3', 'e3'), ('1e', '1e'), ('1e3.5', '1e3.5'), ('.', '.'),
    ('1.2.3', '1.2.3'), ('1e+', '1e+'), ('--1.0', '--1.0'), ('1 000', '1 000'), ('1e3 m', '1e3 m'),
    ('"1e3"', '1e3'), ("'.5'", '.5'), ('!!str 1.0e9', '1.0e9'),
])
def test_reads_floats_of_yaml_1_2(text, value):
    for whole, expected in (
        (f'a: {text}', {'a': value}), (f'- [{text}]', [[value]]), (f'a: &x {text}\nb: *x', None)
    ):
        found = parse_yaml('scene', whole)
        expected = expected or {'a': value, 'b': value}
        # the numbers have their text
        assert (found, json.dumps(found)) == (expected, json.dumps(expected))


@pytest.mark.parametrize('text', [
    '1e3', '1.0e9', '-.5', '5.', '.5', '1E+3', '010', '0x1F', '1:30', 'yes', 'No', 'null', '~', '',
    '2021-09-19', '0o17', '08', '1_000', '<<', '.inf', '.nan', '=', 'a: b', '# no', ' padded ',
    'höhe', '😀', 'x\udc80', 'two\nlines', 1e3, 1e-7, 1e16, 1.5e300, -0.0, 5, True, None,
], ids=repr)
def test_dumped_data_are_read_as_the_same_data(text):
    data = {'name': text, 'listed': [text, {'deep': text}]}
    for options in ({}, {'allow_unicode': True, 'width': 2**31 - 1}):
        found = parse_yaml('scene', dump_yaml(data, **options))
        assert (found, json.dumps(found)) == (data, json.dumps(data))
    if isinstance(text, str):
        # the readers of other programs are of YAML 1.1
        assert yaml.safe_load(dump_yaml(data)) == data


@pytest.mark.parametrize('name', ['none.yaml', '.', 'a\0b', 'x' * 5000, 'latin.yaml'])
def test_error_names_an_unreadable_yaml_file(tmp_path, name):
    (tmp_path / 'latin.yaml').write_bytes(b'# \xe9')
    with pytest.raises(LavaError, match='expected a readable YAML file') as caught:
        read_yaml('scene', tmp_path / name)
    assert len(str(caught.value)) < MAX_EXPECTED_LENGTH + 2 * MAX_VALUE_LENGTH


def test_no_other_module_reads_or_writes_yaml():
    package = Path(yaml_files.__file__).parents[1]
    users = [path.name for path in package.rglob('*.py') if 'yaml.load(' in path.read_text()]
    assert users == ['yaml.py']
    others = re.compile(r'yaml\.(safe_load|safe_dump|dump)\(')
    found = [path.name for path in package.rglob('*.py') if others.search(path.read_text())]
    assert found == ['yaml.py']
