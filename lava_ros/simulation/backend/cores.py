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

"""How many cores of a CPU this process may use."""

from collections.abc import Iterator
from itertools import product
import math
import os
from pathlib import Path

_ROOT = Path('/')

#: Where version 2 and version 1 keep a group's time and the period that it is of.
_FILES = (('cpu.max',), ('cpu.cfs_quota_us', 'cpu.cfs_period_us'))


def usable_cores(root: Path = _ROOT) -> int:
    """Count the cores that this process may use: those it is bound to, or its group's share.

    A container started with ``--cpus=2`` sees all cores of its host, and is stopped for the rest
    of each tenth of a second in which it has used them. Linux keeps such a share in control groups
    (``cpu.max`` of version 2, ``cpu.cfs_quota_us`` of version 1). Part of a core counts as one.

    Args:
        root: Where /proc and /sys are.
    """
    if hasattr(os, 'sched_getaffinity'):
        cores = len(os.sched_getaffinity(0))
    else:
        cores = os.cpu_count() or 1
    return max(1, min([cores, *map(math.ceil, _shares(root))]))


def _shares(root: Path) -> Iterator[float]:
    """Cores of each control group that holds this process and has a share [1]."""
    for folder, names in product(_groups(root), _FILES):
        try:
            texts = [(folder / name).read_text(encoding='ascii') for name in names]
            quota, period = ' '.join(texts).split()
        except (OSError, ValueError):
            continue
        # 'max', or -1, is as many as there are
        if quota.isdecimal() and period.isdecimal() and int(quota) > 0 and int(period) > 0:
            yield int(quota) / int(period)


def _groups(root: Path) -> Iterator[Path]:
    """The groups of this process and those above them, of both versions."""
    mounted = root / 'sys/fs/cgroup'
    try:
        lines = (root / 'proc/self/cgroup').read_text(encoding='utf-8').splitlines()
    except (OSError, ValueError):
        lines = []
    for line in lines:
        _, kinds, group = (*line.split(':', 2), '', '')[:3]
        if kinds in ('', 'cpu', 'cpu,cpuacct', 'cpuacct,cpu'):
            top = mounted / kinds
            # in a container the group itself is mounted at the top
            own = top / group.lstrip('/')
            yield from (folder for folder in (own, *own.parents) if folder.is_relative_to(top))
