# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Guard of background threads: an unexpected exception is reported, and the thread continues."""

from collections.abc import Callable
import logging
import threading
import time

from lava_ros.errors import LavaError

_LOG = logging.getLogger(__name__)

#: Pause of a thread after an unexpected exception, so that one that recurs does not use the CPU
#: [s].
PAUSE = 0.1

#: Wall time for which an unexpected exception is reported [s].
REPORT_TIME = 10.0


class Guard:
    """Runs the work of a background thread, and reports its unexpected exceptions.

    Attributes:
        name: Name of the thread in reports.
    """

    def __init__(self, name: str, *expected: type[Exception]) -> None:
        """Initialize without an exception; ``expected`` ones are not logged (``run``)."""
        self.name, self._expected = name, (LavaError, *expected)
        self._newest: tuple[str, float] | None = None

    @property
    def error(self) -> str:
        """Description of an exception of the last ``REPORT_TIME``, empty without one."""
        newest = self._newest
        is_recent = newest is not None and time.monotonic() - newest[1] < REPORT_TIME
        return newest[0] if newest is not None and is_recent else ''

    def run(
        self, work: Callable[[], None], on_error: Callable[[Exception], None] | None = None
    ) -> None:
        """Run ``work``, and handle an exception by ``on_error`` or, without it, by ``error``.

        An exception that is not expected is also logged with its traceback.
        """
        try:
            try:
                work()
            except Exception as error:
                if on_error is None:
                    raise
                if not isinstance(error, self._expected):
                    self._log(error)
                on_error(error)
        except Exception as error:
            self._newest = f'{self.name}: {type(error).__name__}: {error}', time.monotonic()
            self._log(error)
            threading.Event().wait(PAUSE)

    def _log(self, error: Exception) -> None:
        _LOG.error('%s: %s: %s', self.name, type(error).__name__, error, exc_info=error)
