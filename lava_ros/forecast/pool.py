# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A pool of child processes that run jobs."""

from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import Any, Generic, TypeVar

from lava_ros.errors import RefusalError
from lava_ros.processes.requests import ChildProcess, RequestLoop, with_reply

#: Number of processes that may end during a job before it is assumed to end them.
DEATHS = 3

Job = TypeVar('Job')
Result = TypeVar('Result')

# in a process of a pool: its number
_number = 0


class Pool(Generic[Job, Result]):
    """Processes that run jobs one at a time, and end with the pool or with this process."""

    def __init__(self, work: Callable[[Job], Result], processes: int) -> None:
        """Set the function, which is pickled, and the number of processes; start none yet."""
        self._work = work
        self._count = processes
        # with their numbers
        self._processes: dict[ChildProcess, int] = {}

    def __call__(self, jobs: Sequence[Job]) -> Iterator[tuple[int, Result]]:
        """Run jobs; yield the number and the result of each in order of completion.

        The job of a process that dies is repeated. Errors of the work are raised.

        Raises:
            LavaError: If processes repeatedly die during the same job.
        """
        waiting, deaths = deque(range(len(jobs))), Counter[int]()
        running: dict[ChildProcess, int] = {}

        def feed() -> None:
            while waiting and len(running) < self._count:
                idle = (item for item in self._processes if item not in running)
                process = next(idle, None) or self._start()
                running[process] = job = waiting.popleft()
                # `reply` raises the error that says why the process has ended
                with suppress(ChildProcessError):
                    process.request('run', job=jobs[job])

        try:
            feed()
            while running:
                for process in with_reply(list(running), None):
                    job = running[process]
                    try:
                        _, values = process.reply(0.0) or ('', {})
                    except ChildProcessError as error:
                        self._end([process])
                        deaths[job] += 1
                        if deaths[job] > DEATHS:
                            problem = f'{deaths[job]} processes ended while they ran job {job}'
                            remedy = 'Check the memory, or use fewer workers'
                            raise RefusalError('jobs', f'{problem}: {error}', remedy) from error
                        waiting.appendleft(running.pop(process))
                        feed()
                    else:
                        del running[process]
                        # before the caller works on the result
                        feed()
                        yield job, values['result']
        finally:
            # after an error
            self._end(list(running))

    def close(self) -> None:
        """End the processes, even during a job."""
        self._end(list(self._processes))

    def _start(self) -> ChildProcess:
        number = min({*range(self._count)} - {*self._processes.values()})
        process = ChildProcess(f'{__name__}:Jobs')
        self._processes[process] = number
        with suppress(ChildProcessError):
            process.request('begin', work=self._work, number=number)
        return process

    def _end(self, processes: Sequence[ChildProcess]) -> None:
        for process in processes:
            self._processes.pop(process, None)
            process.end()


class Jobs(RequestLoop):
    """Runs jobs, in a child process."""

    def begin(self, work: Callable[[Any], Any], number: int) -> None:
        """Set the function, and the number of this process."""
        from lava_ros.simulation.backend.threads import use_threads

        global _number
        use_threads(1)
        self._work, _number = work, number

    def run(self, job: Any) -> None:
        """Run a job."""
        self._answer('done', result=self._work(job))


def process_number() -> int:
    """Return the number of this process in its pool, starting at 0."""
    return _number
