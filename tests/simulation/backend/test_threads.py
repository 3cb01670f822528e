# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""CPU launches in several threads; the number of usable cores."""

import os
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

from lava_ros.errors import LavaError
from lava_ros.simulation.backend import threads
from lava_ros.simulation.backend.compiled import quick_kernel, raise_to
from lava_ros.simulation.backend.graph import Launches
from lava_ros.simulation.backend.threads import usable_cores

#: Program that launches with helper threads, in its own process and in a fork.
ENDS = """
import os, sys
import numpy as np, warp as wp
from lava_ros.verification.benchmarks.effects import effect_sets, lava_field, STEP
from lava_ros.simulation.backend.threads import use_threads
use_threads(3)
def flown():
    simulation = lava_field(2000, effect_sets()['bare'], 'cpu')
    simulation.advance(STEP)
    return simulation.sample().position.tobytes()
here = flown()
child = os.fork()
if child == 0:
    os._exit(0 if flown() == here else 1)
sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.fixture(autouse=True)
def as_before():
    before = threads._asked
    yield
    threads.use_threads(before)


raised = raise_to(wp.float32)


@quick_kernel()
def count_visits(
    i: int,
    values: wp.array(dtype=wp.float32),
    visits: wp.array(dtype=wp.int32),
    most: wp.array(dtype=wp.float32),
):
    visits[i] += 1
    raised(most, 0, values[i])


def state_of(count):
    device = wp.get_device('cpu')
    return SimpleNamespace(device=device, extent=count, launches=Launches(device))


def visited(count, parts, min_items=1):
    """Visit every item with some threads; return the visits, the found and the true maximum."""
    threads.use_threads(parts)
    values = wp.array(np.random.default_rng(1).random(count), dtype=wp.float32, device='cpu')
    visits = wp.zeros(count, dtype=wp.int32, device='cpu')
    most = wp.zeros(1, dtype=wp.float32, device='cpu')
    threads.launch_over(state_of(count), count_visits, [values, visits, most], min_items=min_items)
    return visits.numpy(), most.numpy()[0], values.numpy().max()


@pytest.mark.parametrize('count', [1, 2, 7, 1000])
@pytest.mark.parametrize('parts', [1, 2, 5])
def test_every_item_is_visited_once(count, parts):
    visits, most, largest = visited(count, parts)
    assert (visits == 1).all()
    assert most == largest


def test_few_items_start_no_helper(monkeypatch):
    monkeypatch.setattr(threads, '_helpers', lambda: pytest.fail('a helper was called'))
    visits, *_ = visited(1000, 4, min_items=501)
    assert (visits == 1).all()


@pytest.mark.nightly
def test_process_with_helpers_can_fork_and_exit():
    run = subprocess.run(
        [sys.executable, '-c', ENDS], capture_output=True, text=True, timeout=120, check=False
    )
    assert run.returncode == 0, run.stderr


def test_number_of_threads_comes_from_cores_environment_or_program(monkeypatch):
    threads.use_threads(None)
    monkeypatch.delenv(threads.VARIABLE, raising=False)
    assert threads.threads() == usable_cores()
    monkeypatch.setenv(threads.VARIABLE, '3')
    assert threads.threads() == 3
    threads.use_threads(2)
    assert threads.threads() == 2


@pytest.mark.parametrize('text', ['0', '-1', 'two', '1.5'])
def test_rejects_an_invalid_number_of_threads(monkeypatch, text):
    threads.use_threads(None)
    monkeypatch.setenv(threads.VARIABLE, text)
    with pytest.raises(LavaError, match=threads.VARIABLE):
        threads.threads()
    with pytest.raises(LavaError, match='threads'):
        threads.use_threads(0)


def test_usable_cores_are_within_the_cpu_affinity():
    assert 1 <= usable_cores() <= len(os.sched_getaffinity(0))


def container_files(quota):
    """Return the cgroup v2 files of a container (``docker run --cpus``)."""
    return {'proc/self/cgroup': '0::/\n', f'{GROUPS}/cpu.max': f'{quota} 100000\n'}


def cgroup_v1_files(quota):
    """Return cgroup v1 files, where a container's path is that of its host."""
    return {
        'proc/self/cgroup': '5:memory:/docker/1f\n4:cpu,cpuacct:/docker/1f\n0::/\n',
        f'{GROUPS}/cpu,cpuacct/cpu.cfs_quota_us': f'{quota}\n',
        f'{GROUPS}/cpu,cpuacct/cpu.cfs_period_us': '100000\n',
    }


#: Folder of the control groups.
GROUPS = 'sys/fs/cgroup'

#: A service in a slice with a smaller quota.
SLICE = {
    'proc/self/cgroup': '0::/lava.slice/node.service\n',
    f'{GROUPS}/lava.slice/cpu.max': '300000 100000\n',
    f'{GROUPS}/lava.slice/node.service/cpu.max': '800000 100000\n',
    f'{GROUPS}/other.slice/cpu.max': '100000 100000\n',
}

#: A truncated file, and an empty one.
HALF = {'proc/self/cgroup': '0::/\nnonsense\n', f'{GROUPS}/cpu.max': '100000\n'}
BYTES = {**HALF, 'proc/self/cgroup': b'\xff\xfe'}


@pytest.mark.parametrize(
    ('files', 'expected'),
    [
        ({}, 64),
        (container_files('max'), 64),
        (container_files(200_000), 2),
        (container_files(150_000), 2),
        (container_files(5000), 1),
        (container_files(9_900_000), 64),
        (container_files('nonsense'), 64),
        (SLICE, 3),
        (cgroup_v1_files(-1), 64),
        (cgroup_v1_files(400_000), 4),
        (HALF, 64),
        (BYTES, 64),
    ],
)
def test_smallest_cgroup_quota_limits_the_usable_cores(monkeypatch, tmp_path, files, expected):
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: set(range(64)), raising=False)
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    assert usable_cores(tmp_path) == expected
