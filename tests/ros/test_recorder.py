# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The bag: names, limits, what happens when it cannot be written."""

import os
import shutil

import pytest
from std_msgs.msg import String

from lava_ros.bag import BagReader, LATCHED
from lava_ros.errors import LavaError
from lava_ros.ros import codec
from lava_ros.ros.recorder import BagFolder, Recorder


def _write(recorder, text, stamp_ns=1):
    data = codec.serialise(String(data=text))
    recorder.write('/words', 'std_msgs/msg/String', data, stamp_ns, qos=LATCHED)
    return data


@pytest.fixture
def recorder(tmp_path):
    """A recorder whose bag is open."""
    result = Recorder()
    result.arm(tmp_path / 'bag')
    result.begin({})
    return result


def test_records_what_it_is_given(tmp_path):
    """The bytes in the bag are the bytes that were handed over, with QoS and description.

    An existing folder and a second recording are refused.
    """
    recorder = Recorder()
    assert recorder.status.state == 'off'
    with pytest.raises(LavaError, match='does not exist yet'):
        recorder.arm(tmp_path)
    recorder.arm(tmp_path / 'bag')
    assert recorder.status.state == 'armed'
    with pytest.raises(LavaError, match='one recording at a time'):
        recorder.arm(tmp_path / 'two')
    _write(recorder, 'too early')
    recorder.begin({'scene': 'old'})
    assert recorder.status.state == 'recording'
    data = _write(recorder, 'word', 42)
    recorder.describe({'scene': 'new'})
    recorder.flush()
    recorder.stop()
    recorder.stop()
    assert (recorder.status.state, recorder.status.messages) == ('off', 1)
    bag = BagReader(tmp_path / 'bag')
    (message,) = bag.messages()
    assert bytes(message.data) == data
    assert bag.custom_data == {'scene': 'new'}
    (topic,) = bag.topics.values()
    assert topic.qos.durability == 'transient_local'
    recorder.arm(tmp_path / 'two')


def test_a_folder_that_cannot_be_made_is_reported(tmp_path):
    """What is known at once is refused; an error at the bag's opening is a status."""
    (tmp_path / 'file').write_text('')
    recorder = Recorder()
    for name in ('file/bag', 300 * 'x', ''):
        with pytest.raises(LavaError, match='bag_directory'):
            recorder.arm(tmp_path / name)
    recorder.arm(tmp_path / 'later' / 'bag')
    (tmp_path / 'later').write_text('')
    recorder.begin({})
    assert recorder.status.state == 'off'
    assert 'cannot record to' in recorder.status.error


@pytest.mark.parametrize('step', ['write', 'flush'])
def test_a_full_disk_stops_the_recording(tmp_path, recorder, monkeypatch, step):
    """When a write fails, the recording ends and says why; writing on does nothing."""
    _write(recorder, 'kept')
    recorder.flush()

    def fail(*_args, **_options):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(recorder._writer, step, fail)
    _write(recorder, 'lost', 2)
    recorder.flush()
    assert recorder.status.state == 'off'
    assert 'No space left on device' in recorder.status.error
    _write(recorder, 'ignored', 3)
    assert [message.topic for message in BagReader(tmp_path / 'bag').messages()][:1] == ['/words']
    recorder.arm(tmp_path / 'next')
    assert recorder.status.error == ''


@pytest.mark.parametrize('is_flushed', [True, False])
@pytest.mark.parametrize(
    'fault', ['bag removed', 'bag replaced', 'file removed', 'parent replaced']
)
def test_a_bag_that_is_gone_is_reported(tmp_path, fault, is_flushed):
    """An open file takes all that is written, though nobody will ever find it."""
    bag, outside = tmp_path / 'bags' / 'bag', tmp_path / 'outside'
    outside.mkdir()
    recorder = Recorder()
    recorder.arm(bag)
    recorder.begin({})
    _write(recorder, 'kept')
    recorder.flush()
    assert recorder.status.error == ''
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
    assert recorder.status.state == 'off'
    assert 'was removed, moved or replaced' in recorder.status.error
    recorder.stop()
    assert list(outside.iterdir()) == []
    if 'replaced' in fault:
        (file,) = (tmp_path / 'moved').rglob('*.mcap')
        assert [message.topic for message in BagReader(file).messages()][:1] == ['/words']


def test_a_link_that_comes_before_the_first_map_is_not_followed(tmp_path):
    """The place of the bag is that of when it was chosen and checked."""
    deep, outside = tmp_path / 'deep', tmp_path / 'outside'
    deep.mkdir()
    outside.mkdir()
    recorder = Recorder()
    recorder.arm(deep / 'bag')
    deep.rmdir()
    deep.symlink_to(outside)
    recorder.begin({})
    assert recorder.status.state == 'off'
    assert 'a link has come into its path' in recorder.status.error
    assert list(outside.iterdir()) == []


def test_a_bag_is_split(tmp_path):
    """With a limit the recording goes on in new files, which the status counts."""
    recorder = Recorder()
    recorder.arm(tmp_path / 'bag', max_duration=10.0)
    recorder.begin({'scene': 'Etna'})
    for second in range(25):
        _write(recorder, f'word {second}', second * 10**9)
        recorder.flush()
    assert recorder.status.files == 3
    assert recorder.status.messages == 25
    recorder.stop()
    assert len(BagReader(tmp_path / 'bag').files) == 3
    recorder.arm(tmp_path / 'next')
    assert (recorder.status.files, recorder.status.messages) == (0, 0)


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A working directory with a folder outside of it and a link to that."""
    (tmp_path / 'outside').mkdir()
    (tmp_path / 'here' / 'bags').mkdir(parents=True)
    (tmp_path / 'here' / 'bags' / 'link').symlink_to(tmp_path / 'outside')
    monkeypatch.chdir(tmp_path / 'here')
    return tmp_path


def test_names_of_bags(here):
    """Without one it is the time, in the root: the given folder, that of the given bag, or bags/.

    Names inside the root are relative to the working directory, or absolute.
    """
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
def test_names_outside_the_root_are_refused(here, name):
    """Whether by an absolute path, by .., or by a link."""
    with pytest.raises(LavaError, match='bag_directory'):
        BagFolder('', '').path(name)


@pytest.fixture
def written(tmp_path):
    """Writes files of bags at a system time [s]."""

    def write(name, seconds):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True, parents=True)
        path.touch()
        os.utime(path, (seconds, seconds))

    return write


def test_bags_written_since_a_time_are_found(tmp_path, written):
    """The newest first, by the newest file of each, in the root and next to the given bag."""
    for name, seconds in {
        'bags/old/old_0.mcap': 50.0,
        'bags/new/new_0.mcap': 40.0,
        'bags/new/new_1.mcap': 300.0,
        'bags/first/first_0.mcap': 100.0,
        'bags/notes/notes.txt': 400.0,
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


def test_a_restarted_node_does_not_overwrite_the_bag_that_was_given(tmp_path, written):
    """It adds a number; a bag from before remains an error."""
    given = tmp_path / 'bags/etna'
    written('bags/etna/etna_0.mcap', 100.0)
    assert BagFolder('', str(given), since=101.0).path(str(given)) == given
    assert BagFolder('', str(given)).path(str(given)) == given
    folder = BagFolder('', str(given), since=100.0)
    assert folder.path(str(given)).name == 'etna_2'
    (tmp_path / 'bags/etna_2').mkdir()
    assert folder.path(str(given)).name == 'etna_3'


def test_nodes_that_share_a_folder(here):
    """Bags named by the time never meet: not of two nodes, nor two of one node in one second."""
    root = here / 'outside'
    for node, end in (('/lava', ''), ('/etna/lava', '_etna_lava')):
        folder = BagFolder(str(root), '', node=node)
        first = folder.path('')
        first.mkdir()
        second = folder.path('')
        assert first.name.removesuffix(end).count('_') == 0
        assert second not in (first, here)
        assert not second.exists()
