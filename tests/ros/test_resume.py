# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Nodes that resume from the bag of a killed node."""

from dataclasses import asdict, replace
from functools import lru_cache
import json
import signal
import time

from nav_msgs.msg import OccupancyGrid
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
from ros.graph_listener import line_of
from ros.graph_publisher import LATCHED

#: Topics of the grids that are published by default.
GRIDS = ('height', 'temperature', 'hazard')


def numbers(status):
    """Return simulated time, emitted volume and steps of a status."""
    names = ('simulated_time_s', 'volume_emitted_m3', 'steps')
    return tuple(float(status[name]) for name in names)


def has_lava(status):
    return float(status.get('volume_emitted_m3', 0.0)) > 0.0


def test_process_resumes_from_the_bag_of_a_killed_process(graph, tmp_path):
    """Lifecycle, inputs, grids, late subscribers, bags and signals over the middleware."""
    first_bag, second_bag = tmp_path / 'first', tmp_path / 'second'
    node = graph.node(
        device='cpu', time_scale=50.0, autostart=False, record=True, bag_directory=str(first_bag),
        checkpoint_period=1.0, preset='draft', effects_off=['cooling'], onset='2006-07-14T22:00Z',
    )
    publisher, listener = graph.publisher(), graph.listener(*GRIDS)
    killed_ns = 0

    def wait_for(task, condition=lambda _: True):
        return listener.wait_for_status(task, condition, since_ns=killed_ns)

    assert publisher.state() == 'unconfigured'
    assert publisher.change('configure') and publisher.change('activate'), node.log
    publisher.publish('vents', 'terrain_info', 'terrain')
    recorder = wait_for('recorder', lambda item: float(item.get('checkpoint_time_s', 0.0)) > 100.0)
    seen_time, seen_volume, _ = numbers(wait_for('simulation', has_lava))
    discharge = seen_volume / seen_time
    assert publisher.call('pause', True)['success']
    last, late = listener.at_rest(*GRIDS), {}
    for topic, grid in last.items():
        place = [grid[name] for name in ('frame_id', 'shape', 'resolution', 'origin')]
        assert place == ['map', [30, 40], 10.0, [0.0, 0.0]]
        assert grid['min'] == 0 and 0 < grid['max'] <= 100
        publisher.node.create_subscription(
            OccupancyGrid, topic,
            lambda data, topic=topic: late.update({topic: line_of(topic, OccupancyGrid, data)}),
            LATCHED, raw=True,
        )
    publisher.spin_until(lambda: late == last)
    # Warp prints a warning if there is no GPU
    assert not [line for line in node.log.splitlines() if line.startswith('Warp ')]
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
        program=('-c', QUICK_MODULE.format('cli.main'), 'ros', 'node', '--resume', str(first_bag)),
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
    assert node.end(signal.SIGTERM) == 0
    assert 'stopped' in node.log.splitlines()[-1]
    assert 'Traceback' not in node.log

    bag = BagReader(second_bag)
    assert not bag.recovered
    stored = checkpoints_of(second_bag)
    assert checkpoint.time <= stored[0].time
    assert stored[-1].time >= numbers(later)[0]
    assert json.loads(bag.custom_data['resumed_from']) == {
        'bag': str(first_bag), 'time': checkpoint.time, 'stamp_ns': found.log_time_ns
    }
    assert bag.custom_data['onset'] == '2006-07-14T22:00:00Z'
    parameters = yaml.safe_load(bag.custom_data['parameters'])
    assert (parameters['preset'], parameters['effects_off']) == ('draft', ['cooling'])
    again = Simulation.resume(newest_checkpoint(second_bag).checkpoint, device='cpu')
    assert again.time == stored[-1].time
    assert again.budget().emitted == pytest.approx(discharge * again.time, rel=1e-9)
    assert again.budget().error < 1e-5
    recorded = [
        line_of(item.topic.removeprefix('/'), OccupancyGrid, bytes(item.data))
        for item in bag.messages({f'/{topic}' for topic in GRIDS})
    ]
    listener.hear()
    received = [
        item for item in listener.seen
        if item['topic'] in GRIDS and killed_ns < item['stamp_ns'] <= bag.end_ns
    ]
    assert {item['topic'] for item in received} == set(GRIDS)
    assert all(item in recorded for item in received)


@pytest.mark.parametrize(
    ('bag', 'parameter', 'words'),
    [
        ('empty', 'device:=cpu', 'this one has none'),
        ('bag', 'scene:=a.yaml', 'scene does not apply with resume'),
        ('bag', 'device:=cuda:99', "cannot resume: device is 'cuda:99'"),
    ],
)
def test_node_that_cannot_resume_exits_with_2(run_program, tmp_path, bag, parameter, words):
    with BagWriter(tmp_path / bag, custom_data={}) as writer:
        if bag == 'bag':
            writer.attach(NAME, MEDIA_TYPE, checkpoint().to_bytes(), 1)
    status, stderr = run_program(
        '--ros-args', '-p', f'resume:={tmp_path / bag}', '-p', parameter
    )
    assert status == 2
    assert 'Traceback' not in stderr
    assert words in stderr


@lru_cache
def _standard():
    scene = Scene(Terrain(np.zeros((5, 5)), 10.0), lava=Lava.paper(viscosity=1234.5))
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
    cells = replace(forced, forced={}, accuracy=replace(forced.accuracy, method='cells'))
    result = overrides_from_checkpoint(cells, known, known)
    assert (result['method'], result['preset'], result['spacing']) == ('cells', 'fine', 3.0)
    # the next start or reset chooses again
    assert 'method' not in overrides_from_checkpoint(cells, {**known, 'method': 'auto'}, known)


def test_frame_is_that_of_the_bag():
    one = checkpoint()
    known = defaults(one.scene.lava)
    found = overrides_from_checkpoint(one, known, known, frame_id='odom')
    assert found == {'frame_id': 'odom'}
    with pytest.raises(LavaError, match="^frame_id is 'world', expected 'odom' as in the checkpo"):
        overrides_from_checkpoint(one, {**known, 'frame_id': 'world'}, known, frame_id='odom')


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('lava.viscosity', 100.0),
        ('lava.crust', True),
        ('effects_on', ['crust']),
        ('effects_off', ['steep']),
        ('horizon', 1.0),
        ('preset', 'draft'),
        ('method', 'cells'),
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
    assert isinstance(own, Checkpoint) and own.effects == Effects(**asdict(own.effects))
    known = defaults(own.scene.lava)
    given = {**known, 'preset': 'draft', 'spacing': 1.0}
    assert overrides_from_checkpoint(own, given, known) == {}
