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

"""How many cores may be used: in a container its share, not what its host has."""

import os

import pytest

from lava_ros.simulation.backend import cores


@pytest.fixture
def many(monkeypatch):
    """A host of 64 cores."""
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: set(range(64)), raising=False)


def put(root, **files):
    """Write files below a root, by their paths with __ for a slash and _dot_ for a dot."""
    for name, text in files.items():
        path = root / name.replace('__', '/').replace('_dot_', '.')
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding='utf-8')


def test_here():
    """At least one, and no more than the process is bound to."""
    assert 1 <= cores.usable_cores() <= len(os.sched_getaffinity(0))


def test_without_groups(many, tmp_path):
    """Where nothing says otherwise it is the cores that the process is bound to."""
    assert cores.usable_cores(tmp_path) == 64


@pytest.mark.parametrize(
    ('quota', 'expected'),
    [('max', 64), ('200000', 2), ('150000', 2), ('5000', 1), ('9900000', 64), ('nonsense', 64)],
)
def test_a_container(many, tmp_path, quota, expected):
    """``docker run --cpus``: of its group it sees the top."""
    put(
        tmp_path,
        proc__self__cgroup='0::/\n',
        sys__fs__cgroup__cpu_dot_max=f'{quota} 100000\n',
    )
    assert cores.usable_cores(tmp_path) == expected


def test_the_least_share_of_all_groups_holds(many, tmp_path):
    """A service in a slice has no more than the slice."""
    put(
        tmp_path,
        proc__self__cgroup='0::/lava.slice/node.service\n',
        **{
            'sys__fs__cgroup__lava.slice__cpu_dot_max': '300000 100000\n',
            'sys__fs__cgroup__lava.slice__node.service__cpu_dot_max': '800000 100000\n',
            'sys__fs__cgroup__other.slice__cpu_dot_max': '100000 100000\n',
        },
    )
    assert cores.usable_cores(tmp_path) == 3


@pytest.mark.parametrize(('quota', 'expected'), [('-1', 64), ('400000', 4)])
def test_the_first_version(many, tmp_path, quota, expected):
    """Of its controllers that of the CPU counts; a container's path is its host's."""
    put(
        tmp_path,
        proc__self__cgroup='5:memory:/docker/1f\n4:cpu,cpuacct:/docker/1f\n0::/\n',
        **{
            'sys__fs__cgroup__cpu,cpuacct__cpu.cfs_quota_us': f'{quota}\n',
            'sys__fs__cgroup__cpu,cpuacct__cpu.cfs_period_us': '100000\n',
        },
    )
    assert cores.usable_cores(tmp_path) == expected


def test_what_cannot_be_read_says_nothing(many, tmp_path):
    """Half a file, or no text at all."""
    put(tmp_path, proc__self__cgroup='0::/\nnonsense\n', sys__fs__cgroup__cpu_dot_max='100000\n')
    assert cores.usable_cores(tmp_path) == 64
    (tmp_path / 'proc/self/cgroup').write_bytes(b'\xff\xfe')
    assert cores.usable_cores(tmp_path) == 64
