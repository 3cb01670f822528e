# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Nodes that resume from the bag of a killed node."""

from dataclasses import replace
from functools import lru_cache
import json
import os
import signal
import time

import numpy as np
import pytest
import yaml

from lava_ros.bag import BagReader, BagWriter
from lava_ros.bag.checkpoints import checkpoints_of, NAME, newest_checkpoint
from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.ros.parameters import constant_parameters, PARAMETERS
from lava_ros.ros.startup_inputs import overrides_from_checkpoint
from lava_ros.scene import constants_of, Scene, Terrain
from lava_ros.scene.lava import Lava
from lava_ros.simulation import Simulation
from lava_ros.simulation.output.checkpoint import Checkpoint, MEDIA_TYPE
from lava_ros.simulation.presets import preset_accuracy
from lava_ros.simulation.selection import HORIZON
from ros.conftest import QUICK_MODULE

pytestmark = pytest.mark.usefixtures('alone')


def numbers(status):
    """Return simulated time, emitted volume and steps of a status."""
    names = ('simulated_time_s', 'volume_emitted_m3', 'steps')
    return tuple(float(status[name]) for name in names)


def has_lava(status):
    return float(status.get('volume_emitted_m3', 0.0)) > 0.0


def test_node_resumes_from_the_bag_of_a_killed_node(graph, tmp_path):
    first_bag, second_bag = tmp_path / 'first', tmp_path / 'second'
    node = graph.node(
        device='cpu', time_scale=50.0, record=True, bag_directory=str(first_bag),
        checkpoint_period=1.0, preset='draft', effects_off=['cooling'], onset='2006-07-14T22:00Z',
    )
    publisher, listener = graph.publisher(), graph.listener('height')

    killed_ns = 0

    def wait_for(task, condition=lambda _: True):
        return listener.wait_for_status(task, condition, since_ns=killed_ns)

    publisher.publish('vents', 'terrain_info', 'terrain')
    recorder = wait_for('recorder', lambda item: float(item.get('checkpoint_time_s', 0.0)) > 100.0)
    seen_time, seen_volume, _ = numbers(wait_for('simulation', has_lava))
    discharge = seen_volume / seen_time
    node.end(signal.SIGKILL)
    killed_ns = time.time_ns()

    assert BagReader(first_bag).recovered
    found = newest_checkpoint(first_bag)
    checkpoint = found.checkpoint
    assert found.refused == ()
    assert checkpoint.time >= float(recorder['checkpoint_time_s'])
    assert checkpoint.forced == {'cooling': False}
    steps = Simulation.resume(checkpoint, device='cpu').steps

    node = graph.node(
        program=('-c', QUICK_MODULE.format('cli.main'), 'node', '--resume', str(first_bag)),
        device='cpu', time_scale=50.0, record=True, bag_directory=str(second_bag),
    )
    node.wait_for_log(f'resuming at {checkpoint.time:.3f} s simulated')
    reached = wait_for('simulation', lambda item: has_lava(item) and int(item['steps']) > steps)
    # both messages of the terrain, and the vents
    accepted = 0
    while accepted < 3:
        publisher.publish('vents')
        accepted = int(wait_for('inputs')['accepted'])
    enough = numbers(reached)[0] + 50.0
    later = wait_for('simulation', lambda item: numbers(item)[0] > enough)
    for item in (reached, later):
        moment, volume, _ = numbers(item)
        assert moment > checkpoint.time
        assert volume == pytest.approx(discharge * moment, rel=1e-9)
        assert float(item['volume_error']) < 1e-5
    assert wait_for('effects')['cooling'] == 'off: forced'
    listener.wait_for_topic('height', lambda grid: grid['stamp_ns'] > killed_ns)
    statuses = [
        item['status']['lava: simulation']
        for item in listener.seen
        if item['topic'] == 'diagnostics' and item['stamp_ns'] > killed_ns
    ]
    times = [numbers(status)[0] for status in statuses if has_lava(status)]
    assert min(times) >= checkpoint.time
    assert node.end(signal.SIGTERM) == 0

    assert 'Traceback' not in node.log
    assert not BagReader(second_bag).recovered
    stored = checkpoints_of(second_bag)
    assert checkpoint.time <= stored[0].time
    assert stored[-1].time >= numbers(later)[0]
    described = BagReader(second_bag).custom_data
    assert json.loads(described['resumed_from']) == {
        'bag': str(first_bag), 'time': checkpoint.time, 'stamp_ns': found.log_time_ns
    }
    assert described['onset'] == '2006-07-14T22:00:00Z'
    parameters = yaml.safe_load(described['parameters'])
    assert (parameters['preset'], parameters['effects_off']) == ('draft', ['cooling'])
    again = Simulation.resume(newest_checkpoint(second_bag).checkpoint, device='cpu')
    assert again.time == stored[-1].time
    assert again.budget().emitted == pytest.approx(discharge * again.time, rel=1e-9)
    assert again.budget().error < 1e-5


def test_node_that_cannot_resume_exits_with_2(graph, tmp_path):
    for name in ('empty', 'bag'):
        with BagWriter(tmp_path / name, custom_data={}) as writer:
            if name == 'bag':
                writer.attach(NAME, MEDIA_TYPE, checkpoint().to_bytes(), 1)
    nodes = [
        (graph.node(aside=True, resume=str(tmp_path / name), **parameters), words)
        for name, parameters, words in (
            ('empty', {}, 'this one has none'),
            ('bag', {'scene': 'a.yaml'}, "scene is 'a.yaml', expected no value with resume"),
            ('bag', {'device': 'cuda:99'}, "cannot resume: device is 'cuda:99'"),
        )
    ]
    for node, words in nodes:
        assert node.wait_for_end() == 2
        assert 'Traceback' not in node.log
        assert [line for line in node.log.splitlines() if words in line], node.log


@pytest.mark.nightly
def test_node_resumes_after_each_of_several_kills(graph, tmp_path):
    scene = tmp_path / 'scene.yaml'
    scene.write_text(
        'terrain: {file: st_helens.npz}\n'
        'vents: [{position: [4050.0, 3300.0], discharge: 60.0, radius: 30.0}]\n'
    )
    bags = tmp_path / 'bags'
    with BagWriter(bags / 'before', custom_data={}) as writer:
        writer.attach(NAME, MEDIA_TYPE, checkpoint().to_bytes(), 1)
    os.utime(bags / 'before/before_0.mcap', (1.0, 1.0))
    since = time.time() - 1.0
    with BagWriter(bags / 'other', custom_data={}) as writer:
        writer.attach(NAME, MEDIA_TYPE, checkpoint().to_bytes(), 1)
    (bags / 'damaged').mkdir()
    (bags / 'damaged/damaged_0.mcap').write_bytes(b'no bag')
    listener = graph.listener()
    kept = []
    for number, period in enumerate((0.0, 0.5, 0.5, 0.5), 1):
        started_ns = time.time_ns()
        node = graph.node(
            device='cpu',
            scene=str(scene),
            time_scale=50.0,
            preset='draft',
            # as if ~/record had started the third bag: the recording continues
            record=number < 4,
            bag_directory=str(bags / 'first'),
            checkpoint_period=period,
            resume_since=since,
        )

        def wait_for(task, condition, since_ns=started_ns):
            return listener.wait_for_status(task, condition, timeout=120.0, since_ns=since_ns)

        status = wait_for('simulation', has_lava)
        moment, volume, _ = numbers(status)
        assert volume == pytest.approx(60.0 * moment, rel=1e-6)
        bag = 'first' if number == 1 else f'first_{number}'
        assert wait_for('recorder', lambda item: item['bag'])['bag'] == str(bags / bag)
        if number > 2:
            # checkpoints exist in the second and later bags
            assert f'in {bags / kept[-1][0]}' in node.log
            # the first status may be that of the checkpoint itself
            assert moment >= kept[-1][1]
        else:
            # the first bag had none
            assert 'resuming at' not in node.log
        assert ('this one has none' in node.log) is (number == 2)
        if number > 1:
            recorder = wait_for(
                'recorder',
                lambda item, enough=moment + 100.0: (
                    float(item.get('checkpoint_time_s', 0.0)) > enough
                ),
            )
            kept.append((bag, float(recorder['checkpoint_time_s'])))
        node.end(signal.SIGKILL)
    assert sorted(path.name for path in bags.iterdir()) == [
        'before', 'damaged', 'first', 'first_2', 'first_3', 'first_4', 'other'
    ]


@lru_cache
def _standard():
    scene = Scene(Terrain(np.zeros((5, 5)), 10.0), lava=Lava(viscosity=1234.5))
    accuracy = preset_accuracy('standard')
    return Simulation(scene, accuracy=accuracy, effects={}, device='cpu').checkpoint()


def checkpoint(**changes):
    """Return a checkpoint of a flat scene without vents, at the standard preset."""
    return replace(_standard(), **changes)


def defaults(lava):
    """Return the defaults of the parameters for a material."""
    specs = PARAMETERS + constant_parameters({**constants_of(None), 'lava': lava})
    return {spec.name: spec.default for spec in specs}


def test_omitted_parameters_are_those_of_the_checkpoint():
    one = checkpoint()
    known = defaults(one.scene.lava)
    assert overrides_from_checkpoint(one, known, known) == {}
    forced = checkpoint(
        forced={'inertia': True, 'crust': False}, horizon=2.0 * HORIZON,
        accuracy=replace(preset_accuracy('fine', spacing=3.0), thickness=1.7),
    )
    result = overrides_from_checkpoint(forced, known, known)
    assert result == {
        'effects_on': ['inertia'], 'effects_off': ['crust'], 'horizon': HORIZON / 1800.0,
        'preset': 'fine', 'spacing': 3.0,
    }
    assert overrides_from_checkpoint(forced, {**known, **result}, known) == {}


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('lava.viscosity', 100.0),
        ('lava.crust', True),
        ('effects_on', ['crust']),
        ('effects_off', ['steep']),
        ('horizon', 1.0),
        ('preset', 'draft'),
        ('spacing', 4.0),
    ],
)
def test_rejects_parameters_that_contradict_the_checkpoint(name, value):
    one = checkpoint(forced={'crust': False, 'inertia': True})
    known = defaults(one.scene.lava)
    assert known[name] != value
    changed = overrides_from_checkpoint(one, {**known, name: value}, known, is_restart=True)
    assert changed[name] != value
    with pytest.raises(LavaError, match=f'^{name} is .* as in the checkpoint, or no value'):
        overrides_from_checkpoint(one, {**known, name: value}, known)


def test_accuracy_without_a_preset_is_kept():
    own = checkpoint(accuracy=replace(preset_accuracy('standard', spacing=5.0), ratio=4.5))
    assert isinstance(own, Checkpoint) and own.effects == Effects(**vars(own.effects))
    known = defaults(own.scene.lava)
    given = {**known, 'preset': 'draft', 'spacing': 1.0}
    assert overrides_from_checkpoint(own, given, known) == {}
