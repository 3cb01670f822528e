# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Files that are read and written, YAML, and where the shared ones are."""

from collections.abc import Callable
import errno
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
from lava_ros.errors import LavaError, LONGEST_EXPECTED, LONGEST_VALUE
from lava_ros.files import file_to_write, open_input, replacing, write_output
from lava_ros.files import resources as share
from lava_ros.files import yaml as yaml_files
from lava_ros.files.resources import share_path
from lava_ros.files.yaml import parse_yaml, read_yaml
from lava_ros.hindcast.calibration import read_trials
from lava_ros.hindcast.case import load_case
from lava_ros.scene.effusion_rates import read_effusion_rates
from lava_ros.scene.features import ENDINGS, load_features
from lava_ros.scene.terrain_files import load_terrain
from lava_ros.verification.rows import read_csv
from recording import record

#: What reads a file that a user names.
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
    """End what hangs."""
    signal.signal(signal.SIGALRM, lambda *_: pytest.fail('it waits'))
    signal.alarm(5)
    yield
    signal.alarm(0)


@pytest.fixture
def bag(tmp_path):
    """A small bag."""
    return record(tmp_path / 'bag', (200.0, 400.0))


@pytest.mark.parametrize('name', READERS)
def test_what_may_never_end_is_refused(name, tmp_path, alarm):
    """Nobody writes into a pipe: to open it would be to wait for ever; a device has no end."""
    os.mkfifo(tmp_path / name)
    with pytest.raises(LavaError):
        READERS[name](tmp_path / name)
    (tmp_path / name).unlink()
    (tmp_path / name).symlink_to('/dev/zero')
    with pytest.raises(LavaError):
        READERS[name](tmp_path / name)


def test_only_regular_files_are_opened(tmp_path, alarm):
    """Links to them as well; a name that is none is an error of the system like others.

    A case with a pipe in it is refused; without a table a calibration begins.
    """
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
    assert read_trials(tmp_path / 'none.csv', [], []) == []


def test_a_file_to_write_is_left_as_it_is(tmp_path, caplog, alarm):
    """What is there stays, nothing is made, and only what is there is said.

    A folder, a file in a folder that is missing, one in a file, a pipe and a device are refused.
    """
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
        with pytest.raises(LavaError, match='^--json is .* a file to write'):
            file_to_write('--json', path)
    with pytest.raises(LavaError, match="bag.mcap', expected a file whose name ends with .json"):
        file_to_write('--json', tmp_path / 'bag.mcap', ('.json',))


def test_a_file_is_replaced_as_a_whole(tmp_path):
    """Or stays, when something fails; its rights and a link to it stay, too."""
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


def test_links_where_a_file_is_written_are_not_followed(bag, tmp_path):
    """Somebody has put them where a report and a bag's metadata used to be begun."""
    precious = tmp_path / 'precious'
    precious.write_text('precious')
    (tmp_path / '.run.html.partial').symlink_to(precious)
    assert lava('report', bag, '-o', tmp_path / 'run.html')[0] == 0
    with BagWriter(tmp_path / 'new', custom_data={}):
        (tmp_path / 'new/metadata.yaml.partial').symlink_to(precious)
    assert precious.read_text() == 'precious'
    assert b'<html' in (tmp_path / 'run.html').read_bytes()


@pytest.mark.parametrize(
    ('command', 'option', 'name'),
    [('report', '-o', 'a.html'), ('plot', '-o', 'a.png'), ('info', '--json', 'a.json')],
)
def test_what_is_replaced_is_said(command, option, name, bag, tmp_path, monkeypatch):
    """Once something is there."""
    monkeypatch.setattr('lava_ros.pages.pictures.draw_sheet', lambda *_, **__: None)
    path = tmp_path / name
    for is_there in (False, True):
        status, _, said = lava(command, bag, option, path)
        assert status == 0
        assert (f'{path} exists and will be replaced' in said) == is_there
        path.touch()


def test_an_input_is_not_written_over(bag, tmp_path):
    """Whatever it is called, and also by another of its names."""
    path = bag / 'bag_0.mcap'
    before = path.read_bytes()
    for command, option in (('info', '--json'), ('report', '-o'), ('plot', '-o')):
        status, _, said = lava(command, bag, option, path)
        assert (status, 'whose name ends with' in said) == (2, True)
    assert path.read_bytes() == before
    ground = tmp_path / 'ground.tif'
    scene = tmp_path / 'scene.json'
    scene.write_text('{}')
    (tmp_path / 'other.json').symlink_to(scene)
    for words in (
        ('barrier', ground, '--low-pass', 20, '-o', ground),
        ('effects', scene, '--json', tmp_path / 'other.json'),
    ):
        ground.write_text('precious')
        status, _, said = lava(*words)
        assert (status, 'expected another file than' in said) == (2, True), said
        assert (ground.read_text(), scene.read_text()) == ('precious', '{}')


def test_a_terminal_is_not_told_what_a_bag_says(tmp_path):
    """Escapes in names and texts are shown, in what is printed and in what is said."""
    evil = 'a\x1b]0;title\x07\x9b31mb\udc80'
    source = BagReader(record(tmp_path / 'source', (200.0,)))
    data = {'scene': yaml.safe_dump({evil: [evil]}), 'version': evil, evil: evil}
    with BagWriter(tmp_path / 'bag', custom_data=data) as writer:
        for item in source.messages():
            topic = source.topics[item.topic]
            name = topic.name if 'diag' not in topic.name else '/x\x1b[2J' + topic.name
            writer.write(name, topic.message_type, item.data, item.stamp_ns, qos=topic.qos)
    for words in (
        ('info', tmp_path / 'bag'),
        ('info', tmp_path / 'bag', '--json', '-'),
        ('recover', tmp_path / 'bag', tmp_path / 'new'),
        ('info', tmp_path / evil),
    ):
        _, out, said = lava(*words)
        assert (out + said).replace('\n', '').isprintable()
        assert 'x1b' in out + said or '\\u001b' in out


def test_a_full_disk_is_an_error_and_leaves_nothing(bag, tmp_path):
    """No file that says it is there and is not: GDAL, among others, only prints that it failed."""
    commands = {'export': 'maps', 'plot': 'a.png', 'report': 'a.html'}
    code = 'import resource, sys; from lava_ros.cli.main import main;'
    code += 'resource.setrlimit(resource.RLIMIT_FSIZE, (64, 64));'
    code += f'print([main([word, {str(bag)!r}, "-o", name]) for word, name in {commands}.items()])'
    (tmp_path / 'out').mkdir()
    words = [sys.executable, '-B', '-c', code]
    done = subprocess.run(
        words, capture_output=True, text=True, timeout=300, cwd=tmp_path / 'out',
        env=os.environ | {'PYTHONPATH': str(Path(__file__).parents[2])},
    )
    assert done.stdout == '[2, 2, 2]\n', done.stderr
    for name in commands.values():
        assert re.search(f'{re.escape(name)}.*File too large', done.stderr), done.stderr
    assert [item for item in (tmp_path / 'out').rglob('*') if item.is_file()] == []


def test_a_disk_that_fills_up_ends_any_command_with_a_sentence(monkeypatch, tmp_path):
    """Also where what is written is the demo's own."""

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, 'No space left on device')

    monkeypatch.setattr('numpy.savez', full)
    status, _, said = lava('demo', '--output', tmp_path / 'demo', '--device', 'cpu')
    assert status == 2
    assert 'lava demo: no room is left: [Errno 28] No space left on device' in said


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """The package as if it were installed: not in a checkout, an empty prefix, no ament."""
    package = tmp_path / 'lib/site-packages/lava_ros'
    package.mkdir(parents=True)
    monkeypatch.setattr(share, '__file__', str(package / 'resources.py'))
    monkeypatch.setattr(sys, 'prefix', str(tmp_path / 'prefix'))
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    return tmp_path


def put(prefix: Path) -> Path:
    """Install a data file into a prefix."""
    path = prefix / 'share/lava_ros/msg_configs/default.yaml'
    path.parent.mkdir(parents=True)
    path.write_text('layers: {}\n')
    return path


def test_ament_comes_before_pip(installed, monkeypatch):
    """An ament prefix wins over pip's; the first prefix that has the file wins.

    The error names the file and every place that was looked at.
    """
    path = put(installed / 'prefix')
    assert share_path('msg_configs/default.yaml') == path
    path = put(installed / 'overlay')
    put(installed / 'underlay')
    prefixes = f'{installed / "empty"}:{installed / "overlay"}:{installed / "underlay"}'
    monkeypatch.setenv('AMENT_PREFIX_PATH', prefixes)
    assert share_path('msg_configs/default.yaml') == path
    # another package's beside lava_ros/ does not make a checkout
    root = installed / 'lib/site-packages'
    (root / 'package.xml').write_text('<package><name>other</name></package>')
    (root / 'msg_configs').mkdir()
    (root / 'msg_configs/default.yaml').write_text('')
    assert share_path('msg_configs/default.yaml') == path
    with pytest.raises(LavaError, match=r'msg_configs/none\.yaml') as caught:
        share_path('msg_configs/none.yaml')
    assert str(installed / 'prefix/share/lava_ros/msg_configs/none.yaml') in str(caught.value)


def find(name: str, folder: str = 'msg_configs') -> Path:
    """Find a file of the user or of the package."""
    return share.find_file(name, folder, field='which', expected='a file')


@pytest.mark.parametrize(
    ('folder', 'name'),
    [('msg_configs', 'default.yaml'), ('msg_configs', 'forecast.yaml'), ('examples', 'etna.yaml')],
)
def test_a_file_of_the_user_comes_first(tmp_path, monkeypatch, folder, name):
    """A path is taken as it is; a name without such a file is looked for in the package."""
    monkeypatch.chdir(tmp_path)
    found = find(name, folder)
    assert found.parent.name == folder and found.is_file()
    (tmp_path / name).write_text('layers: {}')
    assert find(name, folder) == Path(name)


def test_a_file_that_is_not_found(tmp_path, monkeypatch):
    """The error lists where it was looked for; a path is not looked for in the package."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(LavaError) as caught:
        find('nothing.yaml')
    said = str(caught.value)
    assert said.startswith(
        f"which is 'nothing.yaml', expected a file; looked for {tmp_path / 'nothing.yaml'}, "
    )
    assert 'msg_configs/nothing.yaml' in said
    for name in ('../msg_configs/default.yaml', './default.yaml', str(tmp_path / 'default.yaml')):
        with pytest.raises(LavaError) as caught:
            find(name)
        assert str(caught.value).count('default.yaml') == 2


#: 350 bytes that stand for 9 to the 9th values.
BOMB = 'a: &a [x, x, x, x, x, x, x, x, x]\n' + ''.join(
    f'{name}: &{name} [{", ".join([f"*{inner}"] * 9)}]\n'
    for inner, name in zip('abcdefgh', 'bcdefghi', strict=True)
)


def test_what_is_read(tmp_path, monkeypatch):
    """What people write by hand, aliases and merged keys; no long text, and no long file."""
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
        ('a: 1\nb: !!timestamp 2001-99-99', 'a value that is not of type timestamp in line 2, column 4'),
        ('!!timestamp x', 'no timestamp'),
        ('!!int x', 'no int'),
        ('!!int ""', 'no int'),
        ('!!bool x', 'no bool'),
        ('!!float x', 'no float'),
        ('!!python/object/apply:os.getcwd []', 'python/object'),
        ('9' * 4301, 'a number of more than 100 characters in line 1, column 1'),
        ('0x' + 'f' * 60_000, 'a number of more than 100 characters'),
        ('1:30' + ':30' * 1000, 'a number of more than 100 characters'),
        ('a: 1\nb: {c: 1, c: 2}', 'the key c twice in line 2, column 11'),
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


@pytest.mark.parametrize(
    ('text', 'field', 'typed', 'expected'),
    [
        ('discharge: 010', '.discharge', '010', '10, or text in quotes: YAML 1.1 reads it as 8'),
        ('- {x: [1, 0512345]}', '[0].x[1]', '0512345', '512345, .* as 169189 .line 1, column 11'),
        ('a: -0_7', '.a', '-0_7', '-7, or text'),
        ('a: 00', '.a', '00', '0, or text'),
        ('a: 0x1F', '.a', '0x1F', '31, or text in quotes'),
        ('a: 0b11', '.a', '0b11', '3, or text in quotes'),
        ('a: 1\nduration: 1:30', '.duration', '1:30', 'a number such as 90, .*line 2, column 11'),
        ('a: 12:30.5', '.a', '12:30.5', 'a number such as 90'),
        ('fill_holes: yes', '.fill_holes', 'yes', 'true, or text'),
        ('name: NO', '.name', 'NO', 'false, or text'),
        ('Off: 1', '', 'Off', 'false, or text'),
        ('a: &x 010\nb: *x', '.a', '010', '10, or text'),
    ],
)
def test_yaml_refuses_what_version_1_1_reads_otherwise(text, field, typed, expected):
    """The error has the field, the value as it is written, and what to write instead."""
    with pytest.raises(LavaError, match=expected) as caught:
        parse_yaml('scene', text)
    assert (caught.value.field, caught.value.value) == ('scene' + field, typed)


@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('"010"', '010'), ("'no'", 'no'), ('010.5', 10.5), ('08', '08'), ('1_000', 1000),
        ('0', 0), ('0.5', 0.5), ('True', True), ('2021-09-19', '2021-09-19'), ('~', None),
        ('2021-09-19T14:00:00Z', '2021-09-19T14:00:00Z'), ('!!int 010', 8),
    ],
)
def test_yaml_reads_what_is_written(text, value):
    """Text in quotes, decimal numbers, true and false are themselves; dates stay text."""
    assert parse_yaml('scene', f'a: {text}') == {'a': value}


@pytest.mark.parametrize('name', ['none.yaml', '.', 'a\0b', 'x' * 5000, 'latin.yaml'])
def test_files_that_cannot_be_read(tmp_path, name):
    """The error names the file."""
    (tmp_path / 'latin.yaml').write_bytes(b'# \xe9')
    with pytest.raises(LavaError, match='expected a readable YAML file') as caught:
        read_yaml('scene', tmp_path / name)
    assert len(str(caught.value)) < LONGEST_EXPECTED + 2 * LONGEST_VALUE


def test_nothing_else_reads_yaml():
    """PyYAML's own loaders have no bounds."""
    package = Path(yaml_files.__file__).parents[1]
    users = [path.name for path in package.rglob('*.py') if 'yaml.load(' in path.read_text()]
    assert users == ['yaml.py']
    assert not [path for path in package.rglob('*.py') if 'yaml.safe_load' in path.read_text()]
