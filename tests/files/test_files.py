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

"""Files that users name: what is opened, what is replaced, and what is printed of them."""

from collections.abc import Callable
import errno
import os
from pathlib import Path
import signal
import subprocess
import sys
from typing import Any

import pytest
import yaml

from command_line import lava
from lava_ros.bag import BagReader, BagWriter
from lava_ros.bag.checkpoints import attachments_of
from lava_ros.errors import LavaError
from lava_ros.files import file_to_write, open_input, replacing, write_output
from lava_ros.files.yaml import read_yaml
from lava_ros.hindcast.calibration import read_trials
from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.tables import read_rates
from lava_ros.scene.terrain_files import load_terrain
from lava_ros.verification.rows import read_csv
from recording import record

#: What reads a file that a user names.
READERS: dict[str, Callable[[Path], Any]] = {
    'bag.mcap': BagReader,
    'one.mcap': attachments_of,
    'scene.yaml': lambda path: read_yaml('scene', path),
    'rates.csv': read_rates,
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


@pytest.mark.parametrize('kind', ['pipe', 'device'])
@pytest.mark.parametrize('name', READERS)
def test_what_may_never_end_is_refused(name, kind, tmp_path, alarm):
    """Nobody writes into a pipe: to open it would be to wait for ever."""
    if kind == 'pipe':
        os.mkfifo(tmp_path / name)
    else:
        (tmp_path / name).symlink_to('/dev/zero')
    with pytest.raises(LavaError):
        READERS[name](tmp_path / name)


def test_a_case_with_pipes_is_refused(tmp_path, alarm):
    """Each of its files."""
    for name in ('elevation.asc', 'footprint.asc', 'vent.csv', 'effusion_rate.csv'):
        (tmp_path / name).write_text('')
    os.mkfifo(tmp_path / 'case.yaml')
    with pytest.raises(LavaError, match='case.yaml.*no regular file'):
        load_case(tmp_path)


def test_only_regular_files_are_opened(tmp_path, alarm):
    """Links to them as well; a name that is none is an error of the system like others."""
    (tmp_path / 'file').write_text('here')
    (tmp_path / 'link').symlink_to('file')
    with open_input(tmp_path / 'link') as file:
        assert file.read() == b'here'
    for name in ('.', 'none', 'a\0b'):
        with pytest.raises(OSError):
            open_input(tmp_path / name)


def test_a_table_that_is_missing_is_no_table(tmp_path):
    """A calibration begins."""
    assert read_trials(tmp_path / 'none.csv', [], []) == []


def test_a_file_to_write_is_left_as_it_is(tmp_path, caplog):
    """What is there stays, nothing is made, and only what is there is said."""
    caplog.set_level('INFO')
    old = tmp_path / 'old.json'
    old.write_text('precious')
    assert file_to_write('--json', str(old)) == old
    assert file_to_write('--json', tmp_path / 'new.json', ('.json',)) == tmp_path / 'new.json'
    assert [path.name for path in tmp_path.iterdir()] == ['old.json']
    assert old.read_text() == 'precious'
    assert caplog.messages == [f'{old} is there and will be replaced']


def test_a_file_that_cannot_be_written_is_refused(tmp_path, alarm):
    """A folder, a file in a folder that is missing, one in a file, a pipe, a device."""
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
    'words', [('report', '-o', 'a.html'), ('plot', '-o', 'a.png'), ('info', '--json', 'a.json')]
)
def test_what_is_replaced_is_said(words, bag, tmp_path):
    """Once something is there."""
    command, option, name = words
    path = tmp_path / name
    for is_there in (False, True):
        status, _, said = lava(command, bag, option, path)
        assert status == 0
        assert (f'{path} is there and will be replaced' in said) == is_there


@pytest.mark.parametrize(
    ('command', 'option'), [('info', '--json'), ('report', '-o'), ('plot', '-o')]
)
def test_a_bag_is_not_written_over(command, option, bag):
    """Nor any other file of a kind that is not made here."""
    path = bag / 'bag_0.mcap'
    before = path.read_bytes()
    status, _, said = lava(command, bag, option, path)
    assert (status, 'whose name ends with' in said) == (2, True)
    assert path.read_bytes() == before


def test_an_input_is_not_written_over(tmp_path):
    """Whatever it is called, and also by another of its names."""
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


@pytest.mark.parametrize(
    ('command', 'name'), [('export', 'maps'), ('plot', 'a.png'), ('report', 'a.html')]
)
def test_a_full_disk_is_an_error_and_leaves_nothing(command, name, bag, tmp_path):
    """No file that says it is there and is not: GDAL, among others, only prints that it failed."""
    code = 'import resource, sys; from lava_ros.cli.main import main;'
    code += 'resource.setrlimit(resource.RLIMIT_FSIZE, (64, 64)); sys.exit(main(sys.argv[1:]))'
    place = tmp_path / 'out'
    place.mkdir()
    words = [sys.executable, '-B', '-c', code, command, str(bag), '-o', str(place / name)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stdout) == (2, '')
    assert 'File too large' in done.stderr and str(place) in done.stderr
    assert [item for item in place.rglob('*') if item.is_file()] == []


def test_a_disk_that_fills_up_ends_any_command_with_a_sentence(monkeypatch, tmp_path):
    """Also where what is written is the demo's own."""

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, 'No space left on device')

    monkeypatch.setattr('lava_ros.cli.ros.np.savez', full)
    status, _, said = lava('demo', '--output', tmp_path / 'demo', '--device', 'cpu')
    assert status == 2
    assert 'lava demo: no room is left: [Errno 28] No space left on device' in said
