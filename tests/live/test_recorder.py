# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The recorder: names, limits, and bags that cannot be written."""

import shutil

import mcap.writer
import pytest

from lava_ros.bag import BagReader, LATCHED
from lava_ros.bag.checkpoints import attachments_of
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
    with pytest.raises(LavaError, match='Stop this recording first'):
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
    assert 'its path now contains a symbolic link' in recorder.error
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


def test_next_bag_of_a_name_has_a_number(tmp_path):
    given = tmp_path / 'bags/etna'
    given.mkdir(parents=True)
    folder = BagFolder('', str(given))
    assert folder.path(str(given)) == given
    assert folder.path(str(given), is_next=True).name == 'etna_2'
    (tmp_path / 'bags/etna_2').mkdir()
    assert folder.path(str(given), is_next=True).name == 'etna_3'
    assert folder.path(str(given.with_name('other')), is_next=True).name == 'other'
    assert folder.path(str(given.with_name('etna_2')), is_next=True).name == 'etna_2_2'


def test_nodes_in_a_shared_folder_have_different_restart_files(tmp_path):
    names = [
        BagFolder(str(tmp_path), '', node=node).restart_path(token).name
        for node in ('/lava', '/etna/lava') for token in ('one', 'two')
    ]
    assert names == [
        'restart_one.json', 'restart_two.json', 'restart_etna_lava_one.json',
        'restart_etna_lava_two.json',
    ]


@pytest.mark.parametrize('jump', [-1.0, -5.0, -1e9, 90_000.0, 1e9])
def test_log_times_continue_where_the_clock_jumps(tmp_path, recorder, jump):
    start = 2 * 10**18
    after = start + round(jump * 1e9)
    stamps = [start - 10**9, start, after, after + 10**8, after - 10**8, after + 10**9]
    for stamp_ns in stamps:
        _write(recorder, 'word', stamp_ns)
    recorder.attach('data', 'text/plain', b'data', after + 2 * 10**9)
    recorder.stop()
    messages = list(BagReader(tmp_path / 'bag').messages())
    assert [item.publish_ns for item in messages] == stamps
    # the step back by 0.1 s is not a jump
    expected = [0, 10**9, 10**9 + 1, 11 * 10**8 + 1, 11 * 10**8 + 1, 2 * 10**9 + 1]
    assert [item.stamp_ns - stamps[0] for item in messages] == expected
    (attached,) = attachments_of(tmp_path / 'bag')
    assert attached.log_time_ns - stamps[0] == 3 * 10**9 + 1


def test_gap_of_a_clock_that_does_not_jump_stays_in_the_bag(tmp_path, recorder):
    for stamp_ns in (10**9, 80_000 * 10**9):
        _write(recorder, 'word', stamp_ns)
    recorder.stop()
    assert BagReader(tmp_path / 'bag').duration_ns == 79_999 * 10**9


def test_bag_that_cannot_be_opened_leaves_nothing_behind(tmp_path, monkeypatch):
    def fail(*_args, **_options):
        raise OSError(28, 'No space left on device')

    recorder = Recorder()
    with monkeypatch.context() as patch:
        patch.setattr(mcap.writer.Writer, 'start', fail)
        recorder.arm(tmp_path / 'bag')
        recorder.describe({})
    assert 'No space left on device' in recorder.error
    assert list(tmp_path.iterdir()) == []
    recorder.arm(tmp_path / 'bag')
    recorder.describe({})
    assert recorder.state == 'recording'


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
