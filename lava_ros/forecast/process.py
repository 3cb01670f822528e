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

    {order: fork, number, horizon, threshold, device, max_particles, share, is_first}, a
        checkpoint; with members above 0, changes, deadline, agreement and outlines for an
        ensemble as well
    {order: outline, number, time, shape}, where lava was seen and what was observed
    {order: share, share}
    {order: cancel}
    {order: prepare}, for ensembles: what takes a while to load is then there

Answers: {answer: progress, number, progress, ensemble}, {answer: forecast, number, ...} with
arrival, thickness and temperature, {answer: refused, number, reason}, and those of
``live_ensemble``. A look ahead comes before the ensemble from the same moment; from then on they
take turns. It ends with its standard input.
"""

from collections.abc import Callable, Mapping
import os
import queue
import signal
import sys
import threading
import time
from typing import Any, IO

from lava_ros.errors import LavaError
from lava_ros.forecast import wire
from lava_ros.forecast.assimilation import Outline
from lava_ros.forecast.live_ensemble import LiveEnsembles
from lava_ros.forecast.lookahead import FIRST_LOOKS, LookAhead, LOOKS
from lava_ros.forecast.sampling import prepare_sampling
from lava_ros.simulation.checkpoint import from_bytes

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
        self._ensembles = LiveEnsembles(answer)
        self._is_turn_of_ensemble = False
        self._number = 0
        self._share = 1.0
        self._next_slice = 0.0
        self._reported = 0.0

    def turn(self) -> None:
        """Wait for an order, no longer than until the next slice is due; then take one."""
        wait = max(0.0, self._next_slice - time.monotonic())
        try:
            is_idle = self._ahead is None and not self._ensembles.is_busy
            self._take(*self._orders.get(timeout=None if is_idle else wait))
            return
        except queue.Empty:
            pass
        begun = time.monotonic()
        self._advance()
        now = time.monotonic()
        if now - self._reported >= REPORT_TIME:
            self._report(now)
        rest = (now - begun) * (1.0 / self._share - 1.0)
        self._next_slice = now + min(rest, _LONGEST_REST)

    def _take(self, header: dict[str, Any], body: bytes) -> None:
        self._share = float(header.get('share', self._share))
        if header['order'] == 'share':
            return
        if header['order'] == 'prepare':
            self._guarded(prepare_sampling, self._refuse_ensemble)
            return
        if header['order'] == 'outline':
            self._observe(header, body)
            return
        self._ahead = None
        if header['order'] == 'cancel':
            self._ensembles.drop()
            return
        self._number = header['number']
        if header.get('members'):
            self._ensembles.order(header, body)
        self._guarded(lambda: self._fork(header, body), self._refuse)

    def _fork(self, header: Mapping[str, Any], body: bytes) -> None:
        self._ahead = LookAhead(
            from_bytes(body),
            horizon=header['horizon'],
            threshold=header['threshold'],
            # soon rather than to the minute where nothing is known yet
            looks=FIRST_LOOKS if header.get('is_first') else LOOKS,
            device=header['device'] or None,
            max_particles=header['max_particles'],
        )

    def _observe(self, header: Mapping[str, Any], body: bytes) -> None:
        cells = wire.unpacked_masks(body, header['shape'])
        try:
            outline = Outline(header['time'], *cells)
        except LavaError as error:
            self._ensembles.refuse(header['number'], error)
            return
        self._ensembles.observe(header['number'], outline)

    def _advance(self) -> None:
        ahead, ensembles = self._ahead, self._ensembles
        # its own look ahead is ahead of an ensemble that has not begun; later ones take turns
        if ahead is None or (ensembles.has_begun and self._is_turn_of_ensemble):
            self._is_turn_of_ensemble = False
            self._guarded(lambda: ensembles.advance(SLICE_WALL_TIME), self._refuse_ensemble)
        else:
            self._is_turn_of_ensemble = True
            self._guarded(lambda: self._look_ahead(ahead), self._refuse)

    def _look_ahead(self, ahead: LookAhead) -> None:
        ahead.advance(SLICE_WALL_TIME)
        if ahead.is_done:
            self._ahead = None
            self._tell(ahead)

    def _report(self, now: float) -> None:
        self._reported = now
        self._answer(
            {
                'answer': 'progress',
                'number': self._number,
                'progress': self._ahead.progress if self._ahead is not None else 1.0,
                'ensemble': self._ensembles.progress,
            }
        )

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

    def _refuse(self, reason: str) -> None:
        self._ahead = None
        self._answer({'answer': 'refused', 'number': self._number, 'reason': reason})

    def _refuse_ensemble(self, reason: str) -> None:
        self._ensembles.drop()
        self._answer({'answer': 'ensemble refused', 'reason': reason})

    @staticmethod
    def _guarded(action: Callable[[], None], refuse: Callable[[str], None]) -> None:
        try:
            action()
        except OSError:
            # nobody listens any more
            raise
        except Exception as error:
            name = '' if isinstance(error, ValueError) else f'{type(error).__name__}: '
            refuse(f'{name}{error}')


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
