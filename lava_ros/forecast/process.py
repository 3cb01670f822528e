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

"""The process of the forecasts: `python -m lava_ros.forecast.process`, orders in, forecasts out.

The live simulation goes first: this process is nice, works in short slices, and rests between them
so that it computes for no more than its share of the time. It has a Warp of its own,
so neither Python's lock nor a graph that is being captured is in anyone's way, and what makes it
fail ends a forecast, not an eruption.

Orders (``wire``), of which the newest fork replaces what is at hand:

    {order: fork, number, horizon, threshold, device, max_particles, share}, a checkpoint
    {order: share, share}
    {order: cancel}

Answers: {answer: progress, number, progress}, {answer: forecast, number, ...} with arrival,
thickness and temperature, {answer: refused, number, reason}. It ends with its standard input.
"""

from collections.abc import Callable, Mapping
import os
import queue
import signal
import sys
import threading
import time
from typing import Any, IO

from lava_ros.checkpoint import from_bytes
from lava_ros.forecast import wire
from lava_ros.forecast.lookahead import LookAhead

#: How much this process yields to others: a core that it has to share with one of them gives it a
#: tenth.
NICENESS = 10

#: Wall time of a slice [s].
SLICE_WALL_TIME = 0.05

#: Wall time between two reports of progress [s].
REPORT_TIME = 0.5

#: Longest rest after a slice [s], that of a step of seconds.
_LONGEST_REST = 60.0

Order = tuple[dict[str, Any], bytes]
Answer = Callable[..., None]


class Forecasting:
    """Takes orders, one slice of a forecast after the other."""

    def __init__(self, orders: 'queue.Queue[Order]', answer: Answer) -> None:
        """Begin without a forecast.

        Args:
            orders: What to do.
            answer: Takes a header and perhaps a body.
        """
        self._orders = orders
        self._answer = answer
        self._ahead: LookAhead | None = None
        self._number = 0
        self._share = 1.0
        self._next_slice = 0.0
        self._reported = 0.0

    def turn(self) -> None:
        """Wait for an order, no longer than until the next slice is due; then take one."""
        wait = max(0.0, self._next_slice - time.monotonic())
        try:
            self._take(*self._orders.get(timeout=None if self._ahead is None else wait))
            return
        except queue.Empty:
            pass
        begun = time.monotonic()
        self._guarded(self._advance)
        now = time.monotonic()
        rest = (now - begun) * (1.0 / self._share - 1.0)
        self._next_slice = now + min(rest, _LONGEST_REST)

    def _take(self, header: dict[str, Any], body: bytes) -> None:
        self._share = float(header.get('share', self._share))
        if header['order'] == 'share':
            return
        self._ahead = None
        if header['order'] == 'fork':
            self._number = header['number']
            self._guarded(lambda: self._fork(header, body))

    def _fork(self, header: Mapping[str, Any], body: bytes) -> None:
        self._ahead = LookAhead(
            from_bytes(body),
            horizon=header['horizon'],
            threshold=header['threshold'],
            device=header['device'] or None,
            max_particles=header['max_particles'],
        )

    def _advance(self) -> None:
        ahead = self._ahead
        assert ahead is not None
        ahead.advance(SLICE_WALL_TIME)
        if ahead.is_done:
            self._ahead = None
            self._tell(ahead)
        elif time.monotonic() - self._reported >= REPORT_TIME:
            self._reported = time.monotonic()
            answer = {'answer': 'progress', 'number': self._number, 'progress': ahead.progress}
            self._answer(answer)

    def _tell(self, ahead: LookAhead) -> None:
        forecast = ahead.forecast()
        header = {
            'answer': 'forecast',
            'number': self._number,
            'shape': forecast.arrival.shape,
            'duration': forecast.duration,
            'particle_count': forecast.particle_count,
        }
        body = wire.packed(forecast.arrival, forecast.thickness, forecast.temperature)
        self._answer(header, body)

    def _guarded(self, action: Callable[[], None]) -> None:
        try:
            action()
        except OSError:
            # nobody listens any more
            raise
        except Exception as error:
            self._ahead = None
            name = '' if isinstance(error, ValueError) else f'{type(error).__name__}: '
            self._answer(
                {'answer': 'refused', 'number': self._number, 'reason': f'{name}{error}'}
            )


def main() -> None:
    """Take orders until there are no more."""
    # Ctrl+C in a terminal goes to the node, which closes the pipe.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(NICENESS)
    # Compilers and drivers write where they please: the pipe gets an end of its own.
    output = os.fdopen(os.dup(1), 'wb')
    os.dup2(2, 1)
    orders: queue.Queue[Order] = queue.Queue()
    threading.Thread(target=_read, args=(sys.stdin.buffer, orders), daemon=True).start()
    forecasting = Forecasting(orders, lambda *message: wire.write(output, *message))
    try:
        while True:
            forecasting.turn()
    except OSError:
        sys.exit(0)


def _read(stream: IO[bytes], orders: 'queue.Queue[Order]') -> None:
    try:
        while (order := wire.read(stream)) is not None:
            orders.put(order)
    finally:
        # in the middle of a step as well
        os._exit(0)


if __name__ == '__main__':
    main()
