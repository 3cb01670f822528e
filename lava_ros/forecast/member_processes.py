# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Processes that share the members of live ensembles on one GPU.

A short ensemble waits for Python, which makes its members one by one, and not for the GPU. The
child process of the forecasts therefore has children of its own, each with every n-th member. They
remain for the next ensemble. This module is both ends: ``MemberProcesses`` sends requests, which
are the methods of ``MemberRuns``, and a child replies

    footprint    number; a footprint
    progress     number; fraction of the samples that each member has taken, by its number
    refused      number, reason
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
import queue
import time
from typing import Any

from lava_ros.forecast.members import Plan, running
from lava_ros.forecast.probability import Footprint, footprint_of
from lava_ros.forecast.sampling import Member
from lava_ros.processes.requests import (
    Answer,
    ChildProcess,
    explain,
    REPORT_TIME,
    Request,
    RequestLoop,
    SLICE_WALL_TIME,
    with_reply,
)

#: Maximum wait for a footprint in a part of ``running`` [s].
_WAIT = 0.01

#: Maximum number of processes, and number of cores and free memory of the GPU [bytes] for each: it
#: keeps a core busy, and its kernels alone take about 0.6 GB.
_MAX_PROCESSES, _CORES, _MEMORY = 4, 4, 4 << 30


def run_in_parts(plan: Plan, members: Sequence[Member], **how: Any) -> Iterator[Footprint | None]:
    """Run members here in parts, as ``members.running``, but yield footprints."""
    for fields in running(plan, members, **how):
        yield None if fields is None else footprint_of(fields, plan)


def count_processes(device: str | None, method: str) -> int:
    """Return the number of processes that share members on a device; 1 is none but this one."""
    # the solver loads Warp
    from lava_ros.simulation.backend.threads import usable_cores
    from lava_ros.simulation.setup.defaults import device_of

    used = device_of(device, method)
    if not used.is_cuda:
        return 1
    return max(min(_MAX_PROCESSES, usable_cores() // _CORES, used.free_memory // _MEMORY), 1)


class MemberProcesses:
    """Child processes that run members side by side on one device."""

    def __init__(self, count: int) -> None:
        """Start some processes."""
        self._processes = [ChildProcess(f'{__name__}:MemberRuns') for _ in range(count)]
        self._number = 0

    def share(self, share: float) -> None:
        """Set the maximum fraction of the time in which each process may compute."""
        self._request('share', share=share)

    def running(
        self, plan: Plan, members: Sequence[Member], *, progress: dict[int, float], **how: Any
    ) -> Iterator[Footprint | None]:
        """Run members in parts, as ``members.running``.

        Args:
            plan: Plan of the members.
            members: The members.
            progress: Receives the fraction of the samples that each member has taken.
            how: Further arguments of ``members.running``.

        Yields:
            The footprint of a member that is finished, None if there is none yet.

        Raises:
            ValueError: If a member has no valid scene, or its simulation fails.
            ChildProcessError: If a process has ended.
        """
        self._number += 1
        left, count = len(members), len(self._processes)
        for rank, process in enumerate(self._processes):
            process.request(
                'run', number=self._number, plan=plan, members=members[rank::count],
                sharing=count, **how,
            )
        try:
            while left:
                yield None
                for process in with_reply(self._processes, _WAIT):
                    name, values = process.reply(0.0) or ('', {})
                    if values.get('number') != self._number:
                        # of an ensemble that was cancelled
                        continue
                    if name == 'refused':
                        raise ValueError(values['reason'])
                    progress.update(values.get('progress', {}))
                    if name == 'footprint':
                        left -= 1
                        progress[values['footprint'].index] = 1.0
                        yield values['footprint']
        finally:
            if left:
                with suppress(OSError):
                    self._request('cancel')

    def _request(self, name: str, **values: Any) -> None:
        for process in self._processes:
            process.request(name, **values)


class MemberRuns(RequestLoop):
    """Runs members in slices, in a child process."""

    def __init__(self, requests: 'queue.SimpleQueue[Request]', answer: Answer) -> None:
        """Initialize without members; arguments as for ``RequestLoop``."""
        super().__init__(requests, answer)
        self._running: Iterator[Footprint | None] | None = None
        self._number = 0
        self._progress: dict[int, float] = {}
        self._reported = 0.0

    @property
    def is_busy(self) -> bool:
        """True while there are members to run."""
        return self._running is not None

    def run(self, number: int, plan: Plan, members: Sequence[Member], **how: Any) -> None:
        """Replace the members by others; ``how`` are further arguments of ``members.running``."""
        self._number, self._progress = number, {}
        self._running = run_in_parts(plan, members, progress=self._progress, **how)

    def cancel(self) -> None:
        """Run no more members."""
        self._running = None

    def take_slice(self) -> None:
        """Run members for a slice, and send the footprints of those that are finished."""
        assert self._running is not None
        begun = time.monotonic()
        try:
            for footprint in self._running:
                if footprint is not None:
                    self._reply('footprint', footprint=footprint)
                if time.monotonic() - begun >= SLICE_WALL_TIME:
                    break
            else:
                self._running = None
        except Exception as error:
            self._running = None
            self._reply('refused', reason=explain(error))
        if begun - self._reported >= REPORT_TIME:
            self._reported = begun
            self._reply('progress', progress=self._progress)

    def _reply(self, name: str, **values: Any) -> None:
        self._answer(name, number=self._number, **values)
