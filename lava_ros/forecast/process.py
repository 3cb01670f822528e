# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The process that computes forecasts: it receives orders and sends forecasts.

The live simulation has priority: this process lowers its own priority, and works in short slices
with rests between them, for no more than its share of the time. As a process of its own it does
not hold up the live simulation by Python's lock or the capture of a graph, nor end it by a crash.

An order is the name of a method of ``Forecasting`` and its arguments, pickled. Answers are:

    progress           number; progress of the look ahead and of the ensemble
    forecast           number, fields of ``Forecast``
    refused            number, reason
    ensemble_refused   reason

and those of ``live_ensemble``. A look ahead starts before the ensemble from the same checkpoint;
then they take turns. The process ends when the other end of its connection is closed.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from multiprocessing.connection import Connection
import os
import queue
import sys
import threading
import time
from typing import Any

from lava_ros.forecast.assimilation import Outline
from lava_ros.forecast.live_ensemble import Answer, LiveEnsembles
from lava_ros.forecast.lookahead import FIRST_LOOKS, LookAhead, LOOKS
from lava_ros.forecast.sampling import prepare_sampling
from lava_ros.simulation.checkpoint import Checkpoint

#: Niceness of this process: it gets a tenth of a core that it shares with another one.
NICENESS = 10

#: Wall time of a slice, wall time between two reports of progress, and longest rest [s].
SLICE_WALL_TIME, REPORT_TIME, _LONGEST_REST = 0.05, 0.5, 60.0

Order = tuple[str, dict[str, Any]]


class Forecasting:
    """Takes orders, and computes forecasts in slices."""

    def __init__(self, orders: queue.Queue[Order], answer: Answer) -> None:
        """Start without a forecast; ``answer`` is called with every result of ``orders``."""
        self._orders = orders
        self._answer = answer
        self._ahead: LookAhead | None = None
        self._ensembles = LiveEnsembles(answer)
        self._is_turn_of_ensemble = False
        self._number = 0
        self._share = 1.0
        self._next_slice = self._reported = 0.0

    def turn(self) -> None:
        """Wait for an order, no longer than until the next slice is due; then take one."""
        wait = max(0.0, self._next_slice - time.monotonic())
        is_idle = self._ahead is None and not self._ensembles.is_busy
        try:
            name, values = self._orders.get(timeout=None if is_idle else wait)
        except queue.Empty:
            self._take_slice()
        else:
            getattr(self, name)(**values)

    def share(self, share: float) -> None:
        """Set the largest share of the time that forecasts may compute, from now on."""
        self._share = share

    def prepare(self) -> None:
        """Load the libraries that ensembles need, which takes a while."""
        with self._guarded(is_ensemble=True):
            prepare_sampling()

    def fork(
        self,
        number: int,
        checkpoint: Checkpoint,
        *,
        is_first: bool,
        ensemble: Mapping[str, Any] | None,
        **how: Any,
    ) -> None:
        """Start a look ahead from a checkpoint, in place of the one in progress.

        ``number`` is that of the forecast, and ``how`` are further arguments of ``LookAhead``. The
        first forecast of a scene (``is_first``) takes fewer looks. ``ensemble`` has further
        arguments of ``LiveEnsembles.order``, None for no ensemble.
        """
        self._ahead, self._number = None, number
        if ensemble is not None:
            self._ensembles.order(checkpoint, number=number, **ensemble, **how)
        with self._guarded():
            # the first forecast is rather soon than precise
            looks = FIRST_LOOKS if is_first else LOOKS
            self._ahead = LookAhead(checkpoint, looks=looks, **how)

    def outline(self, number: int, outline: Outline) -> None:
        """Weigh the members of the ensembles by an observed outline."""
        self._ensembles.observe(number, outline)

    def cancel(self) -> None:
        """Give up the look ahead and the ensemble in progress."""
        self._ahead = None
        self._ensembles.drop()

    def _take_slice(self) -> None:
        begun, ahead, ensembles = time.monotonic(), self._ahead, self._ensembles
        # a look ahead goes before an ensemble that has not begun; then they take turns
        is_ensemble = ahead is None or bool(ensembles.at_hand and self._is_turn_of_ensemble)
        self._is_turn_of_ensemble = not is_ensemble
        with self._guarded(is_ensemble=is_ensemble):
            if ahead is None or is_ensemble:
                ensembles.advance(SLICE_WALL_TIME)
            else:
                ahead.advance(SLICE_WALL_TIME)
                if ahead.is_done:
                    self._ahead = None
                    known = dict(vars(ahead.forecast()))
                    # the node has the terrain already
                    del known['terrain']
                    self._answer('forecast', number=self._number, **known)
        now = time.monotonic()
        if now - self._reported >= REPORT_TIME:
            self._reported = now
            self._answer(
                'progress',
                number=self._number,
                progress=self._ahead.progress if self._ahead else 1.0,
                ensemble=ensembles.at_hand.progress if ensembles.at_hand else 0.0,
            )
        rest = (now - begun) * (1.0 / self._share - 1.0)
        self._next_slice = now + min(rest, _LONGEST_REST)

    @contextmanager
    def _guarded(self, *, is_ensemble: bool = False) -> Iterator[None]:
        """Give up the look ahead, or the ensemble, where something is wrong with it; tell why."""
        try:
            yield
        except OSError:
            # the node has closed the connection
            raise
        except Exception as error:
            name = '' if isinstance(error, ValueError) else f'{type(error).__name__}: '
            if is_ensemble:
                self._ensembles.drop()
                self._answer('ensemble_refused', reason=f'{name}{error}')
            else:
                self._ahead = None
                self._answer('refused', number=self._number, reason=f'{name}{error}')


def main() -> None:
    """Take orders until there are no more."""
    os.nice(NICENESS)
    node = Connection(int(sys.argv[1]))
    orders: queue.Queue[Order] = queue.Queue()
    threading.Thread(target=_read, args=(node, orders), daemon=True).start()
    forecasting = Forecasting(orders, lambda name, **values: node.send((name, values)))
    try:
        while True:
            forecasting.turn()
    except OSError:
        sys.exit(0)


def _read(node: Connection, orders: queue.Queue[Order]) -> None:
    try:
        while True:
            orders.put(node.recv())
    finally:
        # in the middle of a step as well
        os._exit(0)


if __name__ == '__main__':
    main()
