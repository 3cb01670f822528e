# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A process pool loses no job and leaves no process behind."""

from contextlib import closing
from functools import partial
import os
from pathlib import Path
import signal
import time

import pytest

from lava_ros.errors import LavaError
from lava_ros.forecast.pool import Pool, process_number
from waiting import wait_until


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


def numbered(marks: Path, job: int) -> int:
    """Kill the process of job 0 in job 1, and return the number of the process."""
    pid, again = marks / 'pid', marks / 'again'
    if job == 1:
        wait_until(pid.exists)
        os.kill(int(pid.read_text()), signal.SIGKILL)
        wait_until(again.exists)
    elif pid.exists():
        again.touch()
    else:
        (marks / 'new').write_text(str(os.getpid()))
        (marks / 'new').rename(pid)
        time.sleep(3600.0)
    return process_number()


def marked(marks: Path, job: int) -> int:
    (marks / str(job)).touch()
    return job


def test_process_has_the_next_job_before_its_result_is_used(tmp_path: Path) -> None:
    with closing(Pool(partial(marked, tmp_path), 1)) as pool:
        results = pool(range(2))
        assert next(results) == (0, 0)
        wait_until((tmp_path / '1').exists)
        assert list(results) == [(1, 1)]


def test_jobs_of_a_dead_process_are_repeated(tmp_path: Path) -> None:
    with closing(Pool(partial(dies_once, tmp_path), 1)) as pool:
        assert sorted(pool(range(3))) == [(0, 0), (1, 1), (2, 2)]


def test_dead_process_is_replaced_by_one_of_its_number(tmp_path: Path) -> None:
    with closing(Pool(partial(numbered, tmp_path), 2)) as pool:
        assert sorted(pool(range(2))) == [(0, 0), (1, 1)]


def test_job_that_kills_its_process_is_named() -> None:
    done = []
    text = '4 processes ended while they ran job 2: .*signal 9'
    with closing(Pool(dies, 1)) as pool, pytest.raises(LavaError, match=text):
        for number, _ in pool(range(3)):
            done.append(number)
    assert done == [0, 1]


def test_pool_is_usable_after_an_error() -> None:
    with closing(Pool(fails, 2)) as pool:
        for job in (7, 8):
            with pytest.raises(LavaError) as caught:
                list(pool([job, job]))
            assert (caught.value.field, caught.value.value) == ('job', job)


def test_pool_is_usable_after_some_results() -> None:
    with closing(Pool(squared, 2)) as pool:
        for job in range(3):
            # the other jobs are not finished
            results = pool([job, 7, 7, 7])
            next(results)
            results.close()  # type: ignore[attr-defined]
        assert sorted(number for number, _ in pool(range(3))) == [0, 1, 2]
