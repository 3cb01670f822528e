# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The recorder: names, limits, and bags that cannot be written."""

import os
import shutil

import pytest

from lava_ros.bag import BagReader, LATCHED
from lava_ros.errors import LavaError
from lava_ros.live.recorder import BagFolder, Recorder


def _write(recorder, text, stamp_ns=1):
    data = bytes(4) + text.encode()
    recorder.write('/words', 'std_msgs/msg/String', data, stamp_ns, qos=LATCHED)
    return data


@pytest.fixture
def recorder(tmp_path):
    result = Recorder()
    result.arm(tmp_path / 'bag')
    result.describe({})
    return result


def test_bag_has_the_recorded_bytes_and_description(tmp_path):
    recorder = Recorder()
    assert recorder.state == 'off'
    with pytest.raises(LavaError, match='does not exist yet'):
        recorder.arm(tmp_path)
    recorder.arm(tmp_path / 'bag')
    assert recorder.state == 'armed'
    with pytest.raises(LavaError, match='one recording at a time'):
        recorder.arm(tmp_path / 'two')
    _write(recorder, 'too early')
    recorder.describe({'scene': 'old'})
    assert recorder.state == 'recording'
    data = _write(recorder, 'word', 42)
    recorder.describe({'scene': 'new'})
    recorder.flush()
    recorder.stop()
    recorder.stop()
    assert (recorder.state, recorder.messages) == ('off', 1)
    bag = BagReader(tmp_path / 'bag')
    (message,) = bag.messages()
    assert bytes(message.data) == data
    assert bag.custom_data == {'scene': 'new'}
    (topic,) = bag.topics.values()
    assert topic.qos.durability == 'transient_local'
    recorder.arm(tmp_path / 'two')


def test_invalid_folder_is_an_error(tmp_path):
    (tmp_path / 'file').write_text('')
    recorder = Recorder()
    for name in ('file/bag', 300 * 'x', ''):
        with pytest.raises(LavaError, match='bag_directory'):
            recorder.arm(tmp_path / name)
    recorder.arm(tmp_path / 'later' / 'bag')
    (tmp_path / 'later').write_text('')
    recorder.describe({})
    assert recorder.state == 'off'
    assert 'cannot record to' in recorder.error


@pytest.mark.parametrize('step', ['write', 'flush'])
def test_failed_write_stops_the_recording(tmp_path, recorder, monkeypatch, step):
    _write(recorder, 'kept')
    recorder.flush()

    def fail(*_args, **_options):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(recorder._writer, step, fail)
    _write(recorder, 'lost', 2)
    recorder.flush()
    assert recorder.state == 'off'
    assert 'No space left on device' in recorder.error
    _write(recorder, 'ignored', 3)
    assert [message.topic for message in BagReader(tmp_path / 'bag').messages()][:1] == ['/words']
    recorder.arm(tmp_path / 'next')
    assert recorder.error == ''


@pytest.mark.parametrize('is_flushed', [True, False])
@pytest.mark.parametrize(
    'fault', ['bag removed', 'bag replaced', 'file removed', 'parent replaced']
)
def test_removed_bag_is_reported(tmp_path, fault, is_flushed):
    bag, outside = tmp_path / 'bags' / 'bag', tmp_path / 'outside'
    outside.mkdir()
    recorder = Recorder()
    recorder.arm(bag)
    recorder.describe({})
    _write(recorder, 'kept')
    recorder.flush()
    assert recorder.error == ''
    if fault == 'bag removed':
        shutil.rmtree(bag)
    elif fault == 'file removed':
        (bag / 'bag_0.mcap').unlink()
    else:
        moved = bag if fault == 'bag replaced' else bag.parent
        moved.rename(tmp_path / 'moved')
        moved.symlink_to(outside)
    if is_flushed:
        _write(recorder, 'lost', 2)
        recorder.flush()
    else:
        recorder.stop()
    assert recorder.state == 'off'
    assert 'was removed, moved or replaced' in recorder.error
    recorder.stop()
    assert list(outside.iterdir()) == []
    if 'replaced' in fault:
        (file,) = (tmp_path / 'moved').rglob('*.mcap')
        assert [message.topic for message in BagReader(file).messages()][:1] == ['/words']


def test_later_link_in_the_path_is_not_followed(tmp_path):
    deep, outside = tmp_path / 'deep', tmp_path / 'outside'
    deep.mkdir()
    outside.mkdir()
    recorder = Recorder()
    recorder.arm(deep / 'bag')
    deep.rmdir()
    deep.symlink_to(outside)
    recorder.describe({})
    assert recorder.state == 'off'
    assert 'a link has come into its path' in recorder.error
    assert list(outside.iterdir()) == []


@pytest.fixture
def here(tmp_path, monkeypatch):
    (tmp_path / 'outside').mkdir()
    (tmp_path / 'here' / 'bags').mkdir(parents=True)
    (tmp_path / 'here' / 'bags' / 'link').symlink_to(tmp_path / 'outside')
    monkeypatch.chdir(tmp_path / 'here')
    return tmp_path


def test_names_of_bags_are_inside_the_root(here):
    given, root = here / 'outside' / 'bag', here / 'outside'
    assert BagFolder('', '').path('').parent.name == 'bags'
    assert BagFolder('', str(given)).path('').parent == given.parent
    assert BagFolder(str(here), '').path('').parent == here
    folder = BagFolder('', '')
    for name in ('bags/one', 'bags/two/three', str(here / 'here' / 'bags' / 'four')):
        assert str(folder.path(name)) == name
    folder = BagFolder(str(root), 'bags/first')
    assert str(folder.path('bags/first')) == 'bags/first'
    assert folder.path(str(root / 'second')) == root / 'second'
    with pytest.raises(LavaError, match='outside'):
        folder.path('bags/third')


@pytest.mark.parametrize(
    'name',
    [
        '/etc/lava', 'one', 'bags', 'bags/../one', '../outside/bag', 'bags/link/bag',
        'bags/link/../outside/bag', 'bags/\0',
    ],
)
def test_rejects_names_outside_the_root(here, name):
    with pytest.raises(LavaError, match='bag_directory'):
        BagFolder('', '').path(name)


@pytest.fixture
def written(tmp_path):
    def write(name, seconds):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True, parents=True)
        path.touch()
        os.utime(path, (seconds, seconds))

    return write


def test_bags_since_a_time_are_listed_newest_first(tmp_path, written):
    for name, seconds in {
        'bags/old/old_0.mcap': 50.0, 'bags/new/new_0.mcap': 40.0, 'bags/new/new_1.mcap': 300.0,
        'bags/first/first_0.mcap': 100.0, 'bags/notes/notes.txt': 400.0,
        'beside/given/given_0.mcap': 200.0,
    }.items():
        written(name, seconds)
    root, given = tmp_path / 'bags', tmp_path / 'beside/given'

    def found(since, given=''):
        folder = BagFolder(str(root), str(given), since=since)
        return [path.name for path in folder.written()]

    assert found(0.0) == []
    assert found(100.0) == ['new', 'first']
    assert found(100.0, given) == ['new', 'given', 'first']
    assert found(500.0) == []
    assert BagFolder(str(tmp_path / 'none'), '', since=1.0).written() == []


def test_restarted_node_does_not_overwrite_the_given_bag(tmp_path, written):
    given = tmp_path / 'bags/etna'
    written('bags/etna/etna_0.mcap', 100.0)
    assert BagFolder('', str(given), since=101.0).path(str(given)) == given
    assert BagFolder('', str(given)).path(str(given)) == given
    folder = BagFolder('', str(given), since=100.0)
    assert folder.path(str(given)).name == 'etna_2'
    (tmp_path / 'bags/etna_2').mkdir()
    assert folder.path(str(given)).name == 'etna_3'
    folder = BagFolder('', str(given))
    assert folder.path(str(given), is_next=True).name == 'etna_3'
    assert folder.path(str(given.with_name('other')), is_next=True).name == 'other'
    assert folder.path(str(given.with_name('etna_2')), is_next=True).name == 'etna_2_2'


def test_bags_in_a_shared_folder_have_different_names(here):
    root = here / 'outside'
    for node, end in (('/lava', ''), ('/etna/lava', '_etna_lava')):
        folder = BagFolder(str(root), '', node=node)
        first = folder.path('')
        first.mkdir()
        second = folder.path('')
        assert first.name.removesuffix(end).count('_') == 0
        assert second not in (first, here)
        assert not second.exists()
