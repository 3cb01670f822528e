# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Launches on all cores of a CPU.

Warp runs a CPU launch in the calling thread and releases Python's global lock. A launch over many
particles is therefore split into parts, which the caller and some helper threads take one by one.
Such a kernel takes as its last argument the first particle of the part and counts from it
(``compiled.counted_from``). It writes only values of its own particle, a maximum
(``compiled.raise_to``), or a mark. The result is then bitwise identical for any number of parts.

There is one thread for each core that the process may use, including the caller's;
``LAVA_THREADS`` in the environment overrides this. Programs that keep the cores busy with
processes give each of them one thread: ``use_threads``.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from functools import lru_cache, partial
from itertools import pairwise, product
import math
import os
from pathlib import Path
from queue import SimpleQueue
from threading import Lock, Thread
from typing import Any, Protocol

from lava_ros.errors import LavaError

#: Environment variable with the number of computing threads.
VARIABLE = 'LAVA_THREADS'

#: Minimum number of particles per part: about 0.3 ms of sums over neighbours, or of work on single
#: particles. A helper starts 0.1 ms after it is called, and only the launches of a single-threaded
#: stage are captured.
MIN_SUMS, MIN_MOVES = 2048, 16384

#: Parts per thread: a thread that is done early takes more, and each part costs 0.02 ms.
PARTS = 4

_ROOT = Path('/')

#: Files with a control group's quota and period, of cgroup versions 2 and 1.
_FILES = (('cpu.max',), ('cpu.cfs_quota_us', 'cpu.cfs_period_us'))

_asked: int | None = None


def use_threads(count: int | None) -> None:
    """Set the number of threads for CPU launches; None uses one per core.

    Raises:
        LavaError: If the number is below 1.
    """
    global _asked
    if count is not None and count < 1:
        raise LavaError('threads', count, 'at least 1')
    _asked = count


def threads() -> int:
    """Return the number of threads that a CPU launch uses.

    Raises:
        LavaError: If ``LAVA_THREADS`` is not a number of threads.
    """
    return _asked or _default(os.environ.get(VARIABLE, ''))


@lru_cache
def _default(text: str) -> int:
    if text:
        if not text.isdecimal() or int(text) < 1:
            raise LavaError(VARIABLE, text, 'a whole number, at least 1')
        return int(text)
    return usable_cores()


def usable_cores(root: Path = _ROOT) -> int:
    """Count the cores that this process may use, by its affinity and the quota of its group.

    A container started with ``--cpus=2`` lists all cores of its host, and is stopped for the rest
    of each 0.1 s in which it has used up its quota. Linux keeps the quota in control groups
    (``cpu.max`` of version 2, ``cpu.cfs_quota_us`` of version 1). Part of a core counts as one.
    ``root`` is the folder with /proc and /sys.
    """
    has_affinity = hasattr(os, 'sched_getaffinity')
    cores = len(os.sched_getaffinity(0)) if has_affinity else os.cpu_count() or 1
    return max(1, min([cores, *map(math.ceil, _quotas(root))]))


def _quotas(root: Path) -> Iterator[float]:
    """Yield the quota of each control group that holds this process and has one [cores]."""
    for folder, names in product(_groups(root), _FILES):
        try:
            texts = [(folder / name).read_text(encoding='ascii') for name in names]
            quota, period = ' '.join(texts).split()
        except (OSError, ValueError):
            continue
        # 'max' and -1 mean no limit
        if quota.isdecimal() and period.isdecimal() and int(quota) > 0 and int(period) > 0:
            yield int(quota) / int(period)


def _groups(root: Path) -> Iterator[Path]:
    """Yield the control groups of this process and their parents, of both versions."""
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


class Extent(Protocol):
    """The particles that a launch covers: their device, launches (graph.py) and number."""

    device: Any
    launches: Any

    @property
    def extent(self) -> int: ...  # noqa: D102


def launch_over(
    state: Extent, kernel: Any, arguments: Sequence[Any], *, min_items: int = MIN_SUMS,
    lanes: int = 1, ahead: int = 0, count: int | None = None,
) -> None:
    """Launch a kernel over the particles of a state, or ``count`` other items, such as cells.

    ``min_items`` is the minimum number of particles per part, ``lanes`` the number of threads that
    share a particle, and ``ahead`` the number of threads before those of the particles: one
    block, on a GPU only.
    """
    is_over_particles = count is None
    if count is None:
        # the first thread does the work that is done once, even if it has no particle
        count = ahead + max(1, state.extent) * lanes
    # captured launches run in one thread, and a GPU schedules its own
    is_whole = state.launches.is_capturing or state.device.is_cuda
    workers = 1 if is_whole else min(threads(), count // (min_items * lanes))
    if workers < 2:
        state.launches(
            kernel, arguments, dim=count, block_dim=ahead or None,
            is_over_particles=is_over_particles,
        )
        return
    parts = min(PARTS * workers, count // min_items)
    ends = [count * n // parts for n in range(parts + 1)]
    record = partial(state.launches.packed, kernel, [*arguments, 0], dim=1)
    _Job(record, pairwise(ends)).compute(workers - 1)


def is_alone(state: Extent) -> bool:
    """Return True if one thread runs a whole stage, so that its launches can be captured."""
    return state.device.is_cuda or state.extent < 2 * MIN_SUMS or threads() < 2


class _Job:
    """A launch in parts, which threads take one by one."""

    def __init__(self, record: Callable[[], Any], parts: Iterable[tuple[int, int]]) -> None:
        """Store a function that records the launch, and the first item and end of each part."""
        self._record: Any = record
        self._whole: Any = None
        self._parts = deque(parts)
        self._lock = Lock()
        self._is_open = False
        self._inside = 0
        self._is_left = Lock()
        self._is_left.acquire()
        self._error: BaseException | None = None

    def compute(self, helpers: int) -> None:
        """Compute parts until none is left, and wait for those that helpers have taken.

        Raises:
            BaseException: If a part raises; then not all parts have been computed.
        """
        try:
            with self._lock:
                # helpers start while the launch is recorded
                _helpers().call(helpers, self)
                self._whole = self._record()
                self._is_open = True
            self._take_parts()
        finally:
            with self._lock:
                self._is_open = False
                self._parts.clear()
                waits = self._inside > 0
            if waits:
                self._wait()
            # a late helper must not keep the arrays alive
            self._whole = self._record = None
        if self._error is not None:
            raise self._error

    def help(self) -> None:
        """Compute parts until none is left; return at once if the job is done."""
        with self._lock:
            if not self._is_open:
                return
            self._inside += 1
        try:
            self._take_parts()
        except BaseException as error:
            self._error = error
            self._parts.clear()
        finally:
            with self._lock:
                self._inside -= 1
                if not self._is_open and self._inside == 0:
                    self._is_left.release()

    def _wait(self) -> None:
        """Wait for the helpers, even if interrupted: otherwise they would continue to write."""
        try:
            self._is_left.acquire()
        except BaseException:
            self._is_left.acquire()
            raise

    def _take_parts(self) -> None:
        own = copy(self._whole)
        own.params = list(own.params)
        own.fwd_args = list(own.fwd_args)
        last = len(own.fwd_args) - 1
        while True:
            try:
                first, end = self._parts.popleft()
            except IndexError:
                return
            own.set_dim(end - first)
            own.set_param_at_index(last, first)
            own.launch()


class _Helpers:
    """Threads that wait for jobs until the process ends."""

    def __init__(self) -> None:
        self._jobs: SimpleQueue[_Job] = SimpleQueue()
        self._count = 0

    def call(self, count: int, job: _Job) -> None:
        """Queue a job for some helpers; start threads as needed."""
        while self._count < count:
            self._count += 1
            name = f'lava helper {self._count}'
            Thread(target=self._work, name=name, daemon=True).start()
        for _ in range(count):
            self._jobs.put(job)

    def _work(self) -> None:
        while True:
            # a local variable would keep the job's arrays alive until the next job
            self._jobs.get().help()


@lru_cache(maxsize=1)
def _helpers() -> _Helpers:
    return _Helpers()


if hasattr(os, 'register_at_fork'):
    # a forked child has no helper threads
    os.register_at_fork(after_in_child=_helpers.cache_clear)
