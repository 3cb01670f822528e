# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A pool of local processes that receive jobs only through private pipes."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
import multiprocessing
from multiprocessing.connection import Connection
import os
import signal
import threading
from typing import Any, Generic, TypeVar

from lava_ros.errors import RefusalError

#: Number of rounds with a dead process and no finished job after which the jobs are assumed to end
#: it.
DEATHS = 3

Job = TypeVar('Job')
Result = TypeVar('Result')

_SPAWN = multiprocessing.get_context('spawn')

# in a worker process: the function that runs a job, and the number of the process
_work: Callable[[Any], Any]
_number = 0


class Pool(Generic[Job, Result]):
    """Processes that run jobs one at a time, and end with the pool or with this process."""

    def __init__(self, work: Callable[[Job], Result], processes: int) -> None:
        """Set the function, which is pickled, and the number of processes; start none yet."""
        self._work = work
        self._processes = processes
        self._executor: ProcessPoolExecutor | None = None
        self._lifelines: tuple[Connection, ...] = ()

    def __call__(self, jobs: Sequence[Job]) -> Iterator[tuple[int, Result]]:
        """Run jobs; yield the number and the result of each in order of completion.

        The jobs of a process that dies are repeated. Errors of the work are raised.

        Raises:
            LavaError: If processes die and no job ends.
        """
        left = dict(enumerate(jobs))
        deaths = 0
        while left:
            before = len(left)
            executor = self._started()
            try:
                with interrupts_withheld():
                    running = {executor.submit(_do, job): item for item, job in left.items()}
            except BrokenProcessPool:
                running = {}
            for future in as_completed(list(running)):
                number = running.pop(future)
                if not isinstance(future.exception(), BrokenProcessPool):
                    result = future.result()
                    del left[number]
                    yield number, result
            if left:
                self.close()
                deaths = deaths + 1 if len(left) == before else 0
            if deaths > DEATHS:
                numbers = ', '.join(map(str, list(left)[: self._processes]))
                problem = f'Processes that ran the jobs {numbers} ended {deaths} times'
                raise RefusalError('jobs', problem, 'Check the memory, or use fewer workers')

    def close(self) -> None:
        """End the processes, even during a job."""
        for end in self._lifelines:
            end.close()
        self._lifelines = ()
        if self._executor is not None:
            self._executor.shutdown(cancel_futures=True)
            self._executor = None

    def _started(self) -> ProcessPoolExecutor:
        if self._executor is None:
            numbers = _SPAWN.SimpleQueue()
            for number in range(self._processes):
                numbers.put(number)
            self._lifelines = _SPAWN.Pipe(duplex=False)
            self._executor = ProcessPoolExecutor(
                self._processes,
                mp_context=_SPAWN,
                initializer=_begin,
                initargs=(self._work, numbers, self._lifelines[0]),
            )
        return self._executor


@contextmanager
def interrupts_withheld() -> Iterator[None]:
    """Block Ctrl+C in processes that are started here, including their start-up.

    They inherit the blocked signal. The parent process receives it and ends them.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def process_number() -> int:
    """Return the number of this process in its pool, starting at 0."""
    return _number


def _begin(work: Callable[[Any], Any], numbers: Any, lifeline: Connection) -> None:
    from lava_ros.simulation.backend.threads import use_threads

    global _work, _number
    threading.Thread(target=_end_with, args=(lifeline,), daemon=True).start()
    use_threads(1)
    _work, _number = work, numbers.get()


def _end_with(lifeline: Connection) -> None:
    try:
        # nothing is ever sent; the connection only ends
        lifeline.recv()
    finally:
        os._exit(1)


def _do(job: Any) -> Any:
    return _work(job)
