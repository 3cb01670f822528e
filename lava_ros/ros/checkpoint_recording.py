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

"""Puts checkpoints into the bag, from which ``resume`` goes on. No rclpy in here."""

from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from dataclasses import dataclass
import time

from lava_ros.bag.checkpoints import NAME
from lava_ros.checkpoint import MEDIA_TYPE, summary_of
from lava_ros.ros.recorder import Recorder

#: Periods that a checkpoint waits at most for the bag to grow.
PATIENCE = 10.0


@dataclass(frozen=True)
class LastCheckpoint:
    """What a status says of the newest checkpoint in the bag.

    Attributes:
        time: Simulated time [s].
        size: Its size [bytes].
        count: Checkpoints in the bag.
    """

    time: float
    size: int
    count: int


class CheckpointRecording:
    """Writes a checkpoint at a recording's start, from time to time, and at its end.

    A checkpoint that is due waits while it would make checkpoints take more than half of the bag,
    for ``PATIENCE`` periods at most. One that is the same as the last is not written.
    """

    def __init__(
        self,
        recorder: Recorder,
        take: Callable[[], 'Future[bytes]'],
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Write nothing yet.

        Args:
            recorder: The bag.
            take: Asks for a checkpoint's bytes.
            clock: Wall time [s].
        """
        self._recorder = recorder
        self._take = take
        self._clock = clock
        self._directory = ''
        self._pending: Future[bytes] | None = None
        self._asked: float | None = None
        self._data = b''
        self._written = 0
        self._last: LastCheckpoint | None = None

    @property
    def last(self) -> LastCheckpoint | None:
        """The newest checkpoint in the bag, None without one."""
        return self._last

    def poll(self, period: float, stamp_ns: int) -> str:
        """Write what has been taken since, and ask for the next one when it is due.

        Args:
            period: Wall time from one checkpoint to the next [s]; 0: none.
            stamp_ns: ROS time [ns].

        Returns:
            Why a checkpoint could not be taken, empty when nothing went wrong.
        """
        if not self._is_recording() or not period:
            return ''
        if self._pending is not None:
            return self._write(stamp_ns) if self._pending.done() else ''
        if self._is_due(period):
            self._asked = self._clock()
            self._pending = self._take()
        return ''

    def finish(self, period: float, stamp_ns: int, *, timeout: float) -> str:
        """Write a last checkpoint before the bag is closed.

        Args:
            period: As for ``poll``.
            stamp_ns: ROS time [ns].
            timeout: How long to wait for it [s].

        Returns:
            Why there is none, empty when nothing went wrong.
        """
        if not self._is_recording() or not period:
            return ''
        self._pending = self._take()
        return self._write(stamp_ns, timeout)

    def _is_recording(self) -> bool:
        directory = self._recorder.status.directory
        if not self._recorder.is_recording or directory != self._directory:
            self._forget()
        self._directory = directory
        return self._recorder.is_recording

    def _forget(self) -> None:
        self._pending = self._asked = self._last = None
        self._data = b''
        self._written = 0

    def _is_due(self, period: float) -> bool:
        if self._asked is None:
            return True
        waited = self._clock() - self._asked
        size = len(self._data)
        fits = 2 * (self._written + size) <= self._recorder.size + size
        return waited >= period and (fits or waited >= PATIENCE * period)

    def _write(self, stamp_ns: int, timeout: float = 0.0) -> str:
        pending, self._pending = self._pending, None
        assert pending is not None
        try:
            data = pending.result(timeout)
        except FutureTimeoutError:
            return f'no checkpoint within {timeout:g} s'
        except CancelledError:
            return 'the simulation ended before its checkpoint'
        except Exception as error:
            return str(error)
        if data != self._data:
            self._recorder.attach(NAME, MEDIA_TYPE, data, stamp_ns)
            self._data = data
            self._written += len(data)
            count = 1 if self._last is None else self._last.count + 1
            self._last = LastCheckpoint(summary_of(data).time, len(data), count)
        return ''
