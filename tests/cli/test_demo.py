# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava demo` and `lava forecast-demo`, and the processes that commands start."""

import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from types import SimpleNamespace
from typing import Any

from matplotlib.image import imread
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
import yaml

from cli.calls import refused
from lava_ros.cli import ros
from lava_ros.cli.ros import Child, ChildError, SHOWN_LINES
from lava_ros.errors import LavaError
from ros_domain import own_domain

ROOT = Path(__file__).parents[2]


def start(directory: Path, *words: str, command: str = 'demo') -> subprocess.Popen[str]:
    """Start a command on the CPU, as in a shell without a terminal."""
    return subprocess.Popen(
        [sys.executable, '-m', 'lava_ros.cli.main', command, '--device', 'cpu', *words],
        cwd=directory,
        env=os.environ | {'PYTHONPATH': str(ROOT), 'PYTHONUNBUFFERED': '1'},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def run(directory: Path, *words: str, command: str = 'demo') -> tuple[str, dict[str, Any]]:
    """Run a command to its end: what it printed, and its result."""
    demo = start(directory, *words, '--json', 'out.json', command=command)
    output, errors = demo.communicate(timeout=400)
    assert demo.returncode == 0, output + errors
    return output, json.loads((directory / 'out.json').read_text())


def test_a_domain_in_use_is_not_free(monkeypatch):
    """Whoever is in it would hear the demo, and the demo whoever is in it."""
    busy = own_domain()
    chosen = SimpleNamespace(sample=lambda *_: [busy])
    monkeypatch.setattr(ros.random, 'SystemRandom', lambda: chosen)
    with pytest.raises(LavaError, match='--domain'):
        ros.domain_of(None)


def test_the_demo_runs_again(tmp_path):
    """It leaves a bag others can read, a picture and a table, and replaces its own earlier bag."""
    output, result = run(tmp_path, '--duration', '900', '--max-speed', '300')
    assert 'volume emitted' in output
    assert result == json.loads((tmp_path / 'bags/demo/demo.json').read_text())
    assert result['simulated_time'] == pytest.approx(900.0)
    # three vents with 100 m3/s together
    assert result['volume_emitted'] == pytest.approx(100.0 * 900.0)
    parts = result['volume_held'] + result['volume_left'] + result['volume_frozen']
    assert parts == pytest.approx(result['volume_emitted'], rel=1e-5)
    # a busy machine is slower than it is allowed to be; never faster
    assert 0.0 < result['speed'] < 330.0
    assert result['particles'] > 10
    assert result['inundated_area_m2'] >= result['standing_area_m2'] > 1000.0
    assert result['height_maps_received'] >= 2
    assert imread(tmp_path / 'bags/demo/demo.png').shape[2] in (3, 4)
    with AnyReader([tmp_path / 'bags/demo']) as reader:
        counts = {item.topic: item.msgcount for item in reader.connections}
    assert counts['/terrain'] >= 1
    assert counts['/vents'] >= 1
    assert min(counts[name] for name in ('/height', '/temperature', '/hazard')) >= 2
    # again, of a discharge that changes, which gives its integral at any speed
    np.savez(tmp_path / 'a.npz', elevation=np.zeros((40, 40)), resolution=10.0)
    vent = {'position': [200.0, 200.0], 'discharge': [[0.0, 30.0], [600.0, 0.0]], 'radius': 20.0}
    scene = {'terrain': {'file': 'a.npz'}, 'vents': [vent], 'gravity': 3.7}
    (tmp_path / 'scene.yaml').write_text(yaml.safe_dump(scene))
    words = ['--scene', 'scene.yaml', '--duration', '3600', '--max-speed', '100000']
    _, result = run(tmp_path, *words)
    assert result['volume_emitted'] == pytest.approx(18_000.0, rel=1e-9)
    with AnyReader([tmp_path / 'bags/demo']) as reader:
        held = {item.topic: item.msgcount for item in reader.connections}
    assert held['/terrain'] and held['/vents']


def test_what_no_demo_made_is_not_touched(tmp_path, monkeypatch):
    """A folder that is not an earlier demo's stays, whatever is in it; so does one in vain."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'mine').mkdir()
    for names in (('metadata.yaml', 'a_0.mcap'), ('demo.json', 'notes.txt')):
        for name in names:
            (tmp_path / 'mine' / name).write_text('precious')
        assert 'that an earlier demo made' in refused('demo', '--output', 'mine')
    assert len(list((tmp_path / 'mine').iterdir())) == 4
    # a result that cannot be written is named before an earlier demo is removed
    (tmp_path / 'mine/notes.txt').unlink()
    assert '--json is' in refused('demo', '--output', 'mine', '--json', 'none/out.json')
    assert (tmp_path / 'mine/demo.json').exists()


def test_a_node_that_cannot_work_is_an_error_with_its_log(tmp_path):
    """A device that does not exist ends the demo with status 1 and the node's own words."""
    demo = start(tmp_path, '--device', 'cuda:77', '--duration', '600')
    _, errors = demo.communicate(timeout=300)
    assert demo.returncode == 1
    assert 'the node' in errors
    assert 'cuda:77' in errors
    assert 'Traceback' not in errors


def test_ctrl_c_leaves_a_finished_bag_and_no_processes(tmp_path):
    """An interrupted demo ends its children, and its bag is whole and may be replaced."""
    demo = start(tmp_path, '--duration', '7200')
    assert demo.stdout is not None
    line = ''
    deadline = time.monotonic() + 300.0
    while 'particles' not in line and time.monotonic() < deadline:
        line = demo.stdout.readline()
    assert 'particles' in line
    demo.send_signal(signal.SIGINT)
    _, errors = demo.communicate(timeout=300)
    assert demo.returncode == 130, errors
    assert 'Traceback' not in errors
    assert (tmp_path / 'bags/demo/demo.json').is_file()
    with AnyReader([tmp_path / 'bags/demo']) as reader:
        assert reader.message_count > 0
    running = subprocess.run(['ps', '-eo', 'args'], capture_output=True, text=True, check=True)
    assert str(tmp_path) not in running.stdout


def test_what_is_seen_narrows_the_forecast(tmp_path):
    """Forecasts come over DDS; after the outline less is undecided, and what is said is truer."""
    words = ('--members', '6', '--speed', '200', '--picture', 'out.png')
    output, result = run(tmp_path, *words, command='forecast-demo')
    assert 'a forecast of when lava comes' in output
    # how soon it is depends on the machine; the order does not
    assert 0.0 < result['forecast_after_s'] < result['all_members_after_s']
    assert result['members_effective'] < result['members'] == 6
    before, after = result['before'], result['after']
    for key in ('mean_entropy_bits', 'undecided_m2', 'brier_score'):
        assert 0.0 <= after[key] < before[key], key
    assert imread(tmp_path / 'out.png').shape[2] in (3, 4)


#: A program that says that it is there, and does something when it is asked to end.
PROGRAM = """
import signal, sys, time
signal.signal(signal.SIGINT, {})
print('\\n'.join(f'line {{number}}' for number in range(100)), flush=True)
time.sleep(60)
"""

ENDS_WELL, FAILS = (PROGRAM.format(f'lambda *_: sys.exit({status})') for status in (0, 3))
STUBBORN = PROGRAM.format('signal.SIG_IGN')


@pytest.fixture
def child_of(tmp_path):
    """Starts a child of a program's text, and waits until it has said something."""

    def begin(text: str) -> Child:
        (tmp_path / 'a_program.py').write_text(text)
        log = tmp_path / 'a.log'
        env = os.environ | {'PYTHONPATH': str(tmp_path)}
        child = Child('program', 'a_program', log=log, env=env)
        end = time.monotonic() + 120.0
        while not log.read_text():
            assert time.monotonic() < end
            time.sleep(0.01)
        return child

    return begin


def test_a_child_that_follows(child_of):
    """It ends when it is asked to; asking again does no harm."""
    child = child_of(ENDS_WELL)
    child.check()
    child.stop()
    assert child.end() == 0
    with pytest.raises(ChildError, match=r'the program ended by itself with status 0; its log'):
        child.check()


@pytest.mark.parametrize(
    ('program', 'what', 'status'),
    [(STUBBORN, 'did not end within 0.2 s', -9), (FAILS, 'ended with status 3', 3)],
)
def test_a_child_that_does_not_end_well(program, what, status, child_of):
    """One that does not follow is killed; the error has the last lines of its log."""
    child = child_of(program)
    with pytest.raises(ChildError) as caught:
        child.stop(0.2 if program == STUBBORN else 20.0)
    first, *lines = str(caught.value).splitlines()
    assert first == f'the program {what}; its log ends with'
    assert lines == [f'    line {number}' for number in range(100 - SHOWN_LINES, 100)]
    assert child.end(0.2) == status


#: A command with a child, which says whether it was ended.
COMMAND = """
import os
from pathlib import Path
import signal
import sys
import time
from lava_ros.cli.ros import Child
# whoever runs the tests may ignore it, as nohup does
signal.signal(signal.SIGHUP, signal.SIG_DFL)
child = Child('program', 'a_program', log=Path('a.log'), env=os.environ)
try:
    while not Path('a.log').read_text():
        time.sleep(0.01)
    os.kill(os.getpid(), getattr(signal, sys.argv[1]))
    time.sleep(60.0)
finally:
    print('child', child.end(), flush=True)
"""


@pytest.mark.parametrize('name', ['SIGTERM', 'SIGHUP'])
def test_children_end_with_their_command(tmp_path, name):
    """One that is told to end, or loses its terminal, ends its children first."""
    (tmp_path / 'a_program.py').write_text(ENDS_WELL)
    (tmp_path / 'command.py').write_text(COMMAND)
    env = os.environ | {'PYTHONPATH': f'{ROOT}{os.pathsep}{tmp_path}'}
    ended = subprocess.run(
        [sys.executable, 'command.py', name],
        cwd=tmp_path,
        env=env,
        stdout=subprocess.PIPE,
        text=True,
        timeout=300.0,
        check=False,
    )
    assert ended.stdout == 'child 0\n'
    assert ended.returncode == 128 + getattr(signal, name)
