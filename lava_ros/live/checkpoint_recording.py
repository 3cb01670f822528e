# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Recording of checkpoints in the bag of a live simulation."""

from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from dataclasses import dataclass
import os
import time

from lava_ros.bag.checkpoints import NAME
from lava_ros.live.recorder import Recorder
from lava_ros.live.restart import Progress
from lava_ros.simulation.output.checkpoint import MEDIA_TYPE, Summary, summary_of

#: Maximum number of periods for which a checkpoint is postponed until the bag has grown.
PATIENCE = 10.0

#: Number of periods between checkpoints after a change of scene or effects, which a restarted
#: process can only read from a checkpoint.
AFTER_CHANGE = 0.1


@dataclass(eq=False)
class CheckpointRecording:
    """Writes a checkpoint at the start of a recording, at intervals, and at its end.

    After a change of scene or effects the interval is ``AFTER_CHANGE`` times as long. If
    checkpoints would take up more than half of the bag, the next one is postponed, by at most
    ``PATIENCE`` periods. A checkpoint equal to the last one is not written. ``take`` requests a
    checkpoint, ``vents`` returns the publications on ``vents`` that it includes, and ``clock``
    returns wall time [s]. The open bag has ``count`` checkpoints, of which ``last`` is the newest,
    None before the first.

    Attributes:
        saved: Newest checkpoint of the run in any bag: its bag, simulated time, and ``vents``; at
            the start, the checkpoint of a killed process; None without one.
    """

    recorder: Recorder
    take: Callable[[], 'Future[bytes]']
    vents: Callable[[], tuple[tuple[int, int], ...]] = tuple
    saved: Progress | None = None
    clock: Callable[[], float] = time.monotonic

    def __post_init__(self) -> None:
        """Initialize without a checkpoint."""
        self.last: Summary | None = None
        self.count = 0
        self._directory = ''
        self._pending: Future[bytes] | None = None
        self._asked: float | None = None
        self._data, self._written = b'', 0
        self._changes = 0
        self._pending_vents: tuple[tuple[int, int], ...] = ()

    def poll(self, period: float, stamp_ns: int, *, changes: int = 0) -> str:
        """Write the requested checkpoint if it is ready, and request the next when it is due.

        Args:
            period: Wall time between checkpoints [s], 0 for none.
            stamp_ns: ROS time [ns].
            changes: Number of changes of scene and effects so far.

        Returns:
            The reason why a checkpoint could not be taken, empty without an error.
        """
        if not self._is_recording() or not period:
            return ''
        if self._pending is not None:
            return self._write(stamp_ns) if self._pending.done() else ''
        if self._is_due(period, is_changed=changes != self._changes):
            self._asked, self._changes = self.clock(), changes
            self._ask()
        return ''

    def finish(self, period: float, stamp_ns: int, *, timeout: float) -> str:
        """Write a last checkpoint before the bag closes, waiting at most ``timeout`` [s] for it.

        ``stamp_ns`` is the ROS time [ns]; ``period`` and the result are as in ``poll``.
        """
        if not self._is_recording() or not period:
            return ''
        self._ask()
        return self._write(stamp_ns, timeout)

    def _ask(self) -> None:
        self._pending_vents = self.vents()
        self._pending = self.take()

    def _is_recording(self) -> bool:
        directory = self.recorder.directory
        if not self.recorder.is_recording or directory != self._directory:
            self._pending = self._asked = self.last = None
            self._data, self._written, self.count = b'', 0, 0
        self._directory = directory
        return self.recorder.is_recording

    def _is_due(self, period: float, *, is_changed: bool) -> bool:
        if self._asked is None:
            return True
        waited = self.clock() - self._asked
        size = len(self._data)
        fits = 2 * (self._written + size) <= self.recorder.size + size
        wanted = AFTER_CHANGE * period if is_changed else period
        return waited >= wanted and (fits or waited >= PATIENCE * period)

    def _write(self, stamp_ns: int, timeout: float = 0.0) -> str:
        pending, self._pending = self._pending, None
        assert pending is not None
        try:
            data = pending.result(timeout)
        except FutureTimeoutError:
            return f'no checkpoint within {timeout:g} s'
        except Exception as error:
            return str(error)
        if data != self._data:
            self.recorder.attach(NAME, MEDIA_TYPE, data, stamp_ns)
            self._data = data
            self._written += len(data)
            self.last = summary_of(data)
            self.count += 1
        if self.last is not None and not self.recorder.error:
            bag = os.path.abspath(self.recorder.directory)
            self.saved = Progress(bag, self.last.time, vents=self._pending_vents)
        return ''
