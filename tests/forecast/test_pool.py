# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A process pool loses no job and leaves no process behind."""

from collections.abc import Callable
from contextlib import closing
from functools import partial
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

import pytest

from lava_ros.errors import LavaError
from lava_ros.forecast.pool import Pool, process_number

#: Maximum time until the end of a process is noticed [s].
PATIENCE = 60.0


def squared(job: int) -> tuple[int, int, int]:
    """Return the result of a job, and the number and id of its process."""
    return job**2, process_number(), os.getpid()


def dies_once(marks: Path, job: int) -> int:
    """Kill the process the first time that a job is done."""
    mark = marks / str(job)
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return job


def dies(job: int) -> int:
    """Kill the process that does job 2."""
    if job == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return job


def fails(job: int) -> int:
    raise LavaError('job', job, 'another')


def waits(pids: Path, job: int) -> None:
    """Never return."""
    (pids / str(os.getpid())).touch()
    time.sleep(3600.0)


def becomes(state: Callable[[], bool]) -> bool:
    """Return True if a state becomes true within the patience."""
    end = time.monotonic() + PATIENCE
    while not state() and time.monotonic() < end:
        time.sleep(0.01)
    return state()


def is_gone(pid: int) -> bool:
    """Return True if a process has ended, reaped or not."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()[0] == 'Z'
    except OSError:
        return True


def test_each_job_is_done_once() -> None:
    with closing(Pool(squared, 2)) as pool:
        first, second = dict(pool(range(20))), dict(pool(range(3)))
    assert {number: result[0] for number, result in first.items()} == {
        job: job**2 for job in range(20)
    }
    assert sorted(second) == [0, 1, 2]
    assert {result[1] for result in first.values()} <= {0, 1}
    pids = {result[2] for result in [*first.values(), *second.values()]}
    assert len(pids) <= 2 and os.getpid() not in pids


def test_jobs_of_a_dead_process_are_repeated(tmp_path: Path) -> None:
    with closing(Pool(partial(dies_once, tmp_path), 1)) as pool:
        assert sorted(pool(range(3))) == [(0, 0), (1, 1), (2, 2)]


def test_job_that_kills_its_process_is_named() -> None:
    done = []
    with closing(Pool(dies, 1)) as pool, pytest.raises(LavaError, match='ran the jobs 2 ended'):
        for number, _ in pool(range(3)):
            done.append(number)
    assert done == [0, 1]


def test_errors_keep_their_parts() -> None:
    with closing(Pool(fails, 1)) as pool, pytest.raises(LavaError) as caught:
        list(pool([7]))
    assert (caught.value.field, caught.value.value) == ('job', 7)


def is_blocked(signal_number: int) -> bool:
    """Return True if this process blocks a signal."""
    return signal_number in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_processes_ignore_ctrl_c() -> None:
    with closing(Pool(is_blocked, 1)) as pool:
        assert list(pool([signal.SIGINT, signal.SIGTERM])) == [(0, True), (1, False)]
    assert not is_blocked(signal.SIGINT)


@pytest.mark.parametrize('signal_number', [signal.SIGKILL, signal.SIGINT])
def test_processes_end_with_their_owner(signal_number: int, tmp_path: Path) -> None:
    code = f"""
from contextlib import closing
from functools import partial
from pathlib import Path
from lava_ros.forecast.pool import Pool
from test_pool import waits
with closing(Pool(partial(waits, Path({str(tmp_path)!r})), 2)) as pool:
    list(pool(range(2)))
"""
    path = os.pathsep.join(map(str, [Path(__file__).parent, *sys.path]))
    with subprocess.Popen(
        [sys.executable, '-c', code], env={**os.environ, 'PYTHONPATH': path},
        stderr=subprocess.DEVNULL,
    ) as owner:
        try:
            assert becomes(lambda: len(list(tmp_path.iterdir())) == 2)
            owner.send_signal(signal_number)
            assert owner.wait(PATIENCE) == -signal_number
        finally:
            owner.kill()
    assert all(becomes(partial(is_gone, int(path.name))) for path in tmp_path.iterdir())
