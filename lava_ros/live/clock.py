# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The clock that simulated time follows: its steps, its jumps, and lost time."""

from collections.abc import Callable
import math
import time

from lava_ros.live.worker_status import WorkerStatus

#: Maximum step of a clock that is followed, and maximum lag of simulated time [s of the clock]. A
#: coarse /clock makes steps of seconds; a replay that skips hours makes a jump.
MAX_LAG = 60.0

#: Backward step below which a clock has not jumped [s]: simulated time waits for it.
JITTER = 1.0


class FollowedClock:
    """Measures how far a clock has advanced from one reading to the next.

    A clock that goes back, or ahead by more than ``MAX_LAG`` at once, has jumped. A jump is
    counted and not followed. While simulated time is held, only jumps back count. As in ROS, a
    clock that shows 0 has no valid time yet, and its first valid time is not a jump.

    Attributes:
        read: Returns the time of the clock [s].
        step: The newest advance of the clock [s].
        jump: The newest jump [s], negative where the clock went back, 0 before the first.
        jumps: Number of jumps.
        lost: Time of the clock that simulated time has not followed [s].
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        """Initialize from a function that returns the time [s]; ``start`` begins to follow it."""
        self.read = clock
        self._now = self._looked = 0.0
        self.step = self.jump = self.lost = 0.0
        self.jumps = 0

    def start(self) -> None:
        """Follow the clock, beginning at its current time."""
        self.elapse(is_held=True)
        self._now, self._looked = self.read(), time.monotonic()
        self.step = 0.0

    @property
    def unread(self) -> float:
        """Advance of the clock since the last reading [s], 0 before its first valid time."""
        return max(0.0, self.read() - self._now) if self._now else 0.0

    def elapse(self, *, is_held: bool = False) -> float:
        """Return the advance of the clock since the last reading [s], 0 at a jump.

        If simulated time ``is_held``, the advance is not followed, and only a jump back counts.
        """
        before, looked = self._now, self._looked
        now, self._looked = self.read(), time.monotonic()
        elapsed = now - before
        if -JITTER < elapsed <= 0.0 and now:
            return 0.0
        self._now = now
        if not before or (is_held and elapsed > 0.0):
            return 0.0
        # After a long computation a steady clock has advanced far, which is not a jump.
        if 0.0 < elapsed <= MAX_LAG + self._looked - looked:
            self.step = elapsed
            return elapsed
        self.note_jump(elapsed)
        return 0.0

    def note_jump(self, by: float) -> None:
        """Count a jump [s], which is not followed."""
        self.jump = by
        self.jumps += 1
        self.lost += max(0.0, by)


#: Wall time within which a simulated clock must advance [s]; a replay may be slow to start.
PATIENCE = 5.0

#: Wall time for which a warning about a jump of the clock, or about lost time, remains [s].
WARNING_TIME = 10.0

#: Minimum lost time of the clock that causes a warning [s]: a pause loses less.
MIN_LOST = 1.0


class ClockWatch:
    """Checks at intervals whether the clock moves and whether simulated time follows it."""

    def __init__(self) -> None:
        """Create a watch that has not read the clock yet."""
        self._seen: tuple[int, float] | None = None
        self._jumps, self._jumped = 0, -math.inf
        self._lost, self._losing = 0.0, -math.inf

    def warnings(
        self, stamp_ns: int, now: float, worker: WorkerStatus, *, is_simulated: bool
    ) -> dict[str, str]:
        """Return warnings about the clock.

        Args:
            stamp_ns: Time of the clock [ns], 0 before it is received.
            now: Wall time [s].
            worker: Status of the simulation that follows the clock.
            is_simulated: True if the time comes from the topic ``/clock``.

        Returns:
            Reasons why simulated time does not follow the clock, by kind: ``clock``, ``ahead``,
            ``back`` or ``lost``. Empty if it follows.
        """
        if self._seen is None or self._seen[0] != stamp_ns:
            self._seen = stamp_ns, now
        if worker.jumps != self._jumps:
            self._jumped = now if worker.jumps else -math.inf
            # the time lost by a jump causes no second warning
            self._jumps, self._lost = worker.jumps, worker.lost
        elif abs(worker.lost - self._lost) >= MIN_LOST:
            self._losing = now if worker.lost else -math.inf
            self._lost = worker.lost
        texts = {}
        if is_simulated and now - self._seen[1] >= PATIENCE:
            what = 'stands still' if stamp_ns else 'does not arrive'
            texts['clock'] = (
                f'/clock {what}, so simulated time stands still: publish it, as `lava ros replay` '
                'and `ros2 bag play --clock` do, or set use_sim_time to false'
            )
        if now - self._jumped < WARNING_TIME:
            where = 'ahead' if worker.jump > 0.0 else 'back'
            texts[where] = (
                f'the clock jumped {where} by {abs(worker.jump):.6g} s and simulated time did '
                f'not: it follows steps of up to {MAX_LAG:g} s ahead'
            )
        if now - self._losing < WARNING_TIME:
            texts['lost'] = (
                f'simulated time has lost {worker.lost:.4g} s of the clock: it can be at most '
                f'{MAX_LAG:g} s behind; a lower time_scale or a coarser preset loses less'
            )
        return texts
