# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The child process that measures the numerical error of a live simulation.

Its request is the method ``measure`` of ``PartnerRuns``. It replies ``measured`` with the
``error``, or ``refused`` with the ``reason``.
"""

from collections.abc import Generator
import queue
import threading
import time
from typing import Any

from lava_ros.forecast.partner_runs import measuring
from lava_ros.processes.requests import Answer, explain, NICENESS, Request, RequestLoop
from lava_ros.simulation.numerical_error import NumericalError


class PartnerRuns(RequestLoop):
    """Measures an error in slices, in a fraction of one core's time."""

    niceness, max_rest = NICENESS, threading.TIMEOUT_MAX

    def __init__(self, requests: 'queue.SimpleQueue[Request]', answer: Answer) -> None:
        """Initialize without partner runs; arguments as for ``RequestLoop``."""
        super().__init__(requests, answer)
        self._running: Generator[None, None, NumericalError] | None = None

    @property
    def is_busy(self) -> bool:
        """True while there are partner runs."""
        return self._running is not None

    def clock(self) -> float:
        """Return the time of all threads [s]."""
        return time.process_time()

    def measure(self, share: float, **run: Any) -> None:
        """Start a measurement; ``run`` has the arguments of ``partner_runs.measuring``."""
        self.share(share)
        self._running = measuring(clock=self.clock, **run)

    def take_slice(self) -> None:
        """Continue the partner runs, and reply at their end."""
        assert self._running is not None
        try:
            next(self._running)
        except StopIteration as end:
            self._running = None
            self._answer('measured', error=end.value)
        except Exception as error:
            self._running = None
            self._answer('refused', reason=explain(error))
