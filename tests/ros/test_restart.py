# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Starts of a node whose predecessor was killed: the same run, or a new one."""

from pathlib import Path
import shutil
from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy

from lava_ros.bag import BagReader, BagWriter
from lava_ros.errors import LavaError
from lava_ros.live import restart
from lava_ros.live.restart import Progress, RestartFile
from ros.graph_publisher import elevation, Publisher
from ros.local_node import COARSE, PLAIN
from ros_domain import own_domain

#: Simulated seconds per second of the clock.
SCALE = COARSE['time_scale']

#: Time of the clock between the end of a node and the next start [s].
PAUSE = 30.0

SCENE = """
terrain: {{file: {terrain}}}
vents: [{{position: [60.0, 155.0], discharge: {discharge}, radius: 12.0}}]
lava: {{viscosity: {viscosity}}}
"""


def write_scene(folder, *, discharge=20.0, viscosity=5.0e5, rise=0.0):
    np.savez(folder / 'slope.npz', elevation=elevation() + rise, resolution=10.0)
    text = SCENE.format(terrain='slope.npz', discharge=discharge, viscosity=viscosity)
    (folder / 'scene.yaml').write_text(text)


def fail(*_args, **_options):
    raise OSError(28, 'No space left on device')


def end_recording(node, _):
    assert node.call('record', False)['success']
    node.run(2.0)


def fill_disk(node, patch):
    patch.setattr(BagWriter, 'flush', fail)
    patch.setattr(BagWriter, '_open_file', fail)
    patch.setattr(restart, 'replacing', fail)
    node.run(2.0)
    status = node.status_now('recorder', lambda item: 'newest maps' in item['message'])
    assert (status['level'], status['state']) == (2, 'off')
    assert 'No space left on device' in node.log


def jump(node, _):
    node.jump(node.now - 1000.0)
    node.worker.request_snapshot()
    node.run_commands()
    node.run(2.0)


def pause(node, _):
    assert node.call('pause', True)['success']
    node.status_now('simulation', lambda item: item['state'] == 'paused')
    node.jump(node.now + 50.0)


#: What happens before the end of the node.
MOMENTS = {
    'recording': lambda node, _: node.run(2.0),
    'recording ended': end_recording,
    'disk full': fill_disk,
    'clock jumped back': jump,
    'paused': pause,
    'on cells': lambda node, _: node.run(2.0),
}

#: Parameters of the node before and after its end, by the moment.
PARAMETERS = {'on cells': {'method': 'auto', 'effects_off': PLAIN}}


def start(local, folder, **parameters):
    given = {
        'scene': str(folder / 'scene.yaml'), 'record': True, 'bag_root': str(folder / 'bags'),
        'restart_token': 'one',
    }
    return local(**{**given, **parameters})


def activate(node):
    assert node.change('configure') and node.change('activate'), node.log
    node.run_commands()


def kill(node, folder):
    """Save the files as they are, and end the node; ``revive`` restores them."""
    node.status_now('recorder')
    shutil.copytree(folder / 'bags', folder / 'killed')
    found = SimpleNamespace(time=node.node.runtime._layers.shown.time, now=node.now)
    assert node.change('shutdown')
    return found


def revive(folder):
    shutil.rmtree(folder / 'bags')
    shutil.copytree(folder / 'killed', folder / 'bags')


@pytest.fixture(scope='module', params=MOMENTS)
def killed(request, module_local, tmp_path_factory):
    """A node that was killed after a moment; ``folder`` has its files."""
    folder = tmp_path_factory.mktemp('run')
    write_scene(folder)
    node = start(module_local, folder, **PARAMETERS.get(request.param, {}))
    activate(node)
    node.run(2.0)
    with pytest.MonkeyPatch.context() as patch:
        MOMENTS[request.param](node, patch)
        found = kill(node, folder)
    found.folder, found.moment = folder, request.param
    return found


@pytest.mark.parametrize('killed', ['recording'], indirect=True)
@pytest.mark.parametrize('token', ['other', ''])
def test_run_does_not_continue_with_another_token(local, killed, token):
    revive(killed.folder)
    node = start(local, killed.folder, restart_token=token)
    node.jump(killed.now + PAUSE)
    activate(node)
    assert 'resuming' not in node.log
    assert node.worker.view.origin is None and node.worker.session.time == 0.0


@pytest.mark.parametrize('clock', ['on', 'an hour back'])
def test_run_continues_with_its_token(local, killed, clock):
    revive(killed.folder)
    node = start(local, killed.folder, **PARAMETERS.get(killed.moment, {}))
    node.jump(killed.now + (PAUSE if clock == 'on' else -3600.0))
    activate(node)
    worker = node.worker
    assert 'resuming at' in node.log
    assert worker.view.origin is not None
    assert worker.view.accuracy.method == ('cells' if killed.moment == 'on cells' else 'particles')
    is_held = killed.moment == 'paused'
    expected = killed.time + (PAUSE * SCALE if clock == 'on' and not is_held else 0.0)
    if killed.moment == 'disk full' and clock != 'on':
        # the progress since could not be written, and the clock does not tell it
        expected = 0.0
    if not is_held:
        node.wait_until(lambda: not worker.status.is_catching_up)
    # a time step may end later
    node.wait_until(lambda: worker.session.time >= expected - worker.view.step)
    assert worker.session.time <= killed.time + PAUSE * SCALE + worker.view.step
    assert worker.status.lost == 0.0
    # a warning says that the time since the maps is unknown
    has_jumped = clock != 'on' and not is_held
    if has_jumped:
        # the thread may read the clock later
        node.wait_until(lambda: worker.status.jumps)
    assert worker.status.jumps == has_jumped
    status = node.status_now('simulation', lambda item: 'simulated_time_s' in item)
    assert ('the clock jumped back by' in status['message']) is has_jumped
    assert ('the clock jumped back by' in node.log) is has_jumped
    assert (status['state'] == 'paused') is is_held
    is_recording = killed.moment != 'recording ended'
    state = 'recording' if is_recording else 'off'
    node.status_now('recorder', lambda item: item['state'] == state)


def test_run_goes_on_after_each_of_several_ends(local, tmp_path):
    """A restarted node is killed before it has caught up, and with its recording off."""
    write_scene(tmp_path)
    node = start(local, tmp_path, record=False)
    activate(node)
    node.run(1.0)
    assert node.call('save')['success']
    reached = 0.0
    for _ in range(3):
        # two time steps
        node.run(4.0)
        found = kill(node, tmp_path)
        assert found.time > reached
        reached = found.time
        revive(tmp_path)
        shutil.rmtree(tmp_path / 'killed')
        node = start(local, tmp_path, record=False)
        node.jump(found.now + 1.0)
        activate(node)
        node.wait_until(lambda: node.worker.session.time >= reached)  # noqa: B023
        node.wait_until(lambda: node.node.runtime._layers.shown is not None)  # noqa: B023
    assert len(list((tmp_path / 'bags').glob('*/*.mcap'))) == 1


def test_run_ends_with_its_node(local, tmp_path):
    write_scene(tmp_path)
    node = start(local, tmp_path)
    activate(node)
    node.run(4.0)
    (file,) = (tmp_path / 'bags').glob('restart_one.json')
    (bag,) = (tmp_path / 'bags').glob('*/')
    node.wait_until(lambda: RestartFile(file).read().time > 0.0)
    assert RestartFile(file).read().bag == str(bag)
    assert BagReader(bag).custom_data['restart_token'] == 'one'
    assert node.change('deactivate') and node.change('cleanup')
    assert not file.exists()
    activate(node)
    assert 'resuming' not in node.log


@pytest.mark.parametrize(
    ('name', 'changed'),
    [
        ('vents', {'discharge': 40.0}), ('lava', {'viscosity': 1.0e6}), ('terrain', {'rise': 1.0}),
        ('frame_id', {}),
    ],
)
def test_other_inputs_are_a_new_run(local, tmp_path, name, changed):
    write_scene(tmp_path)
    node = start(local, tmp_path)
    activate(node)
    node.run(1.0)
    found = kill(node, tmp_path)
    revive(tmp_path)
    write_scene(tmp_path, **changed)
    more = {'frame_id': 'world'} if name == 'frame_id' else {}
    again = start(local, tmp_path, **more)
    again.jump(found.now + 1.0)
    activate(again)
    assert again.worker.view.origin is None
    warnings = [line for line in again.log.splitlines() if 'not resuming' in line]
    assert len(warnings) == 1 and f': {name} differ from' in warnings[0], again.log
    (vent,) = again.worker.view.scene.vents
    assert vent.discharge == changed.get('discharge', 20.0)


@pytest.mark.parametrize('damage', ['file', 'no bag', 'no checkpoint', 'no scene'])
def test_run_that_cannot_be_resumed_starts_again(local, tmp_path, damage):
    write_scene(tmp_path)
    parameters = {'checkpoint_period': 0.0} if damage == 'no checkpoint' else {}
    node = start(local, tmp_path, **parameters)
    activate(node)
    node.run(1.0)
    found = kill(node, tmp_path)
    revive(tmp_path)
    file = tmp_path / 'bags/restart_one.json'
    # without checkpoints a run cannot be resumed
    assert file.exists() is (damage != 'no checkpoint')
    if damage == 'file':
        file.write_text(file.read_text()[:-9])
    elif damage == 'no bag':
        shutil.rmtree(RestartFile(file).read().bag)
    elif damage == 'no scene':
        (tmp_path / 'scene.yaml').unlink()
    again = start(local, tmp_path)
    again.jump(found.now + 1.0)
    activate(again)
    if damage == 'no scene':
        # the checkpoint has it
        assert 'cannot be compared with' in again.log and again.worker.view.origin is not None
        return
    assert again.worker.view.origin is None
    assert ('cannot resume' in again.log) is (damage != 'no checkpoint')


def test_latched_vents_do_not_close_a_vent_opened_since(local, tmp_path):
    """The publisher of the vents lives on, and each start receives its message again."""
    np.savez(tmp_path / 'slope.npz', elevation=elevation(), resolution=10.0)
    feed = Publisher(own_domain('local'), durability=DurabilityPolicy.TRANSIENT_LOCAL)
    given = {'scene': '', 'terrain_file': str(tmp_path / 'slope.npz')}
    try:
        node = start(local, tmp_path, **given)
        activate(node)
        feed.publish('vents')
        node.wait_until(lambda: len(node.worker.view.scene.vents) == 1)
        node.publish('click')
        node.wait_until(lambda: len(node.worker.view.scene.vents) == 2)
        node.run(1.0)
        assert node.call('save')['success']
        found = kill(node, tmp_path)
        revive(tmp_path)
        again = start(local, tmp_path, **given)
        again.jump(found.now + 1.0)
        activate(again)
        assert len(again.worker.view.scene.vents) == 2
        sender = feed.publishers['vents']
        again.wait_until(lambda: sender.get_subscription_count() == 2)
        for _ in range(20):
            again.spin()
        again.run_commands()
        assert [vent.name for vent in again.worker.view.scene.vents][1:] == ['click 1']
        # a new message replaces all
        feed.publish('vents')
        again.wait_until(lambda: len(again.worker.view.scene.vents) == 1)
    finally:
        feed.close()


@pytest.mark.parametrize('token', ['a b', '../etna', 'x' * 65])
def test_token_that_is_no_file_name_is_refused(local, tmp_path, token):
    node = local(restart_token=token)
    assert not node.change('configure')
    assert f'restart_token is {token!r}'[:40] in node.log
    assert 'letters, digits, dots, hyphens and underscores' in node.log


@pytest.mark.parametrize('text', ['', '{', '[]', '{"bag": "x"}', '{"vents": 1, "given": {}}'])
def test_damaged_restart_file_is_an_error(tmp_path, text):
    file = RestartFile(tmp_path / 'restart_one.json')
    assert file.read() is None
    file.path.write_text(text)
    with pytest.raises(LavaError, match='restart file'):
        file.read()


def test_restart_file_is_replaced_whole(tmp_path, monkeypatch):
    file = RestartFile(tmp_path / 'restart_one.json')
    progress = Progress('bags/x', 1.5, 2.5, 10**18 + 1, given={'lava': 'ab'}, vents=((1, 2),))
    file.write(progress)
    assert file.read() == progress
    with monkeypatch.context() as patch:
        patch.setattr(Path, 'write_text', fail)
        file.write(Progress('bags/y'))
    assert 'cannot be written: No space left on device' in file.error
    assert file.read() == progress
    assert [path.name for path in tmp_path.iterdir()] == ['restart_one.json']
    file.write(Progress('bags/y'))
    assert file.error == '' and file.read() == Progress('bags/y')
    file.remove()
    assert file.read() is None
