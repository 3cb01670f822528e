# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Counts of accepted and refused messages, and rate limits of requests."""

from collections import Counter
from collections.abc import Callable
import threading
import time

from diagnostic_msgs.msg import DiagnosticStatus

from lava_ros.errors import LavaError, RefusalError
from lava_ros.ros import diagnostics

#: Time after which an unchanged error of a topic is logged again [s].
LOG_INTERVAL = 60.0

#: Rate limits by name of the service or of the group of parameters: a burst of requests, and the
#: time after which one more is allowed [s]. A reset or a change of effects may compile kernels and
#: so delay the simulation; bags use disk space.
LIMITS = {'reset': (5, 2.0), 'effects': (5, 2.0), 'record': (5, 10.0), 'save': (5, 10.0)}


class Allowance:
    """Counts requests and refuses those beyond ``LIMITS``."""

    def __init__(
        self,
        refused: Callable[[str, LavaError], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Allow the full number of calls of each limit.

        Args:
            refused: Called with the name and the error of each refused request.
            clock: Returns wall time [s].
        """
        self._refused = refused
        self._clock = clock
        self._left = {name: (float(calls), clock()) for name, (calls, _) in LIMITS.items()}

    def take(self, name: str) -> None:
        """Count a request.

        Args:
            name: Key of ``LIMITS``.

        Raises:
            LavaError: If there are too many such requests.
        """
        calls, period = LIMITS[name]
        left, counted = self._left[name]
        now = self._clock()
        left = min(float(calls), left + (now - counted) / period)
        is_allowed = left >= 1.0
        self._left[name] = left - is_allowed, now
        if not is_allowed:
            problem = f'Too many requests: at most {calls} at once and one more every {period:g} s'
            self.refuse(name, RefusalError(name, problem, 'Try again later'))

    def refuse(self, name: str, error: LavaError) -> None:
        """Report the error of a refused request, and raise it."""
        self._refused(name, error)
        raise error


class InputLog:
    """Counts accepted and refused messages by topic. All methods are thread-safe."""

    def __init__(self) -> None:
        """Initialize all counts to zero."""
        self._lock = threading.Lock()
        self._accepted = self._superseded = self._arrived = 0
        self._rejected: Counter[str] = Counter()
        # by topic: number of the newest message with a result, and whether it was refused
        self._newest: dict[str, tuple[int, bool]] = {}
        self._last_error = ''
        self._logged: dict[str, tuple[str, float]] = {}

    def arrive(self) -> int:
        """Return a number for a message whose result may come later than a newer message's."""
        with self._lock:
            self._arrived += 1
            return self._arrived

    def accept(self, topic: str, number: int | None = None) -> None:
        """Count an accepted message: the newest, or the one with a number."""
        with self._lock:
            self._accepted += 1
            self._judge(topic, number, is_bad=False)
            self._logged.pop(topic, None)

    def supersede(self, topic: str, number: int | None = None) -> None:
        """Record a valid message that a newer one replaced before the simulation used it.

        The newer message may be from another topic: point clouds and images are both terrain.
        """
        with self._lock:
            self._superseded += 1
            self._judge(topic, number, is_bad=False)

    def downgrade(self, topic: str) -> None:
        """Reduce the topic's error to a warning, because no later message would clear it."""
        with self._lock:
            self._newest[topic] = self._newest[topic][0], False

    def reject(self, topic: str, error: LavaError, number: int | None = None) -> bool:
        """Count a refused message (the newest, or ``number``); return True if it is to be logged.

        An unchanged error of a topic is logged once per ``LOG_INTERVAL``.
        """
        with self._lock:
            self._rejected[topic] += 1
            self._judge(topic, number, is_bad=True)
            self._last_error = f'{topic}: {error}'
            now, text = time.monotonic(), str(error)
            last_text, last_time = self._logged.get(topic, ('', 0.0))
            if text == last_text and now - last_time < LOG_INTERVAL:
                return False
            self._logged[topic] = (text, now)
            return True

    def _judge(self, topic: str, number: int | None, *, is_bad: bool) -> None:
        if number is None:
            self._arrived += 1
            number = self._arrived
        if number >= self._newest.get(topic, (0, False))[0]:
            self._newest[topic] = number, is_bad

    def has_accepted(self, topic: str) -> bool:
        """Return True if the newest message of a topic is valid."""
        with self._lock:
            return not self._newest.get(topic, (0, True))[1]

    def status(self, warning: str = '') -> DiagnosticStatus:
        """Return ERROR if a topic's newest message was refused, WARN if an earlier one was.

        A ``warning`` is a WARN, too.
        """
        with self._lock:
            rejected, last_error = self._rejected.total(), self._last_error
            level, message = diagnostics.OK, 'all taken'
            if any(is_bad for _, is_bad in self._newest.values()):
                level, message = diagnostics.ERROR, f'refused {last_error}'
            elif warning or rejected:
                level, message = diagnostics.WARN, warning or f'{rejected} refused so far'
            values = {
                'accepted': self._accepted,
                'rejected': rejected,
                'superseded': self._superseded,
                'last_error': last_error,
                **{f'rejected.{topic}': count for topic, count in self._rejected.items()},
            }
        return diagnostics.status('inputs', level, message, values)
