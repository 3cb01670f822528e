# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The child process that computes forecasts: it receives requests and sends results.

The live simulation takes precedence: this process lowers its own priority, and computes in short
slices with pauses in between, up to a maximum fraction of the time. As a separate process it
cannot block the live simulation through Python's global lock or graph capture, and cannot crash
it.

A request ("order") is the name of a method of ``Forecasting`` and its arguments, pickled. Replies
are:

    progress           number; progress of the forecast and of the ensemble
    forecast           number, fields of ``Forecast``
    refused            number, reason
    ensemble_refused   reason

and those of ``live_ensemble``. A forecast starts before the ensemble from the same checkpoint;
then they alternate. The process ends when the other end of its connection is closed.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from multiprocessing.connection import Connection
import os
import queue
import sys
import threading
import time
import traceback
from typing import Any

from lava_ros.forecast.assimilation import Outline
from lava_ros.forecast.forecast_run import ForecastRun, N_FIRST_SAMPLES, N_SAMPLES
from lava_ros.forecast.live_ensemble import Answer, LiveEnsembles
from lava_ros.forecast.sampling import prepare_sampling
from lava_ros.simulation.output.checkpoint import Checkpoint

#: Niceness of this process: it gets a tenth of a core that it shares with another process.
NICENESS = 10

#: Wall time of a slice, wall time between two reports of progress, and maximum pause [s].
SLICE_WALL_TIME, REPORT_TIME, _MAX_REST = 0.05, 0.5, 60.0

Order = tuple[str, dict[str, Any]]


class Forecasting:
    """Executes requests, and computes forecasts in slices."""

    def __init__(self, orders: queue.Queue[Order], answer: Answer) -> None:
        """Initialize without a forecast; ``answer`` is called with each reply to ``orders``."""
        self._orders = orders
        self._answer = answer
        self._ahead: ForecastRun | None = None
        self._ensembles = LiveEnsembles(answer)
        self._is_turn_of_ensemble = False
        self._number = 0
        self._share = 1.0
        self._next_slice = self._reported = 0.0

    def turn(self) -> None:
        """Execute the next request, or a slice if that is due first."""
        wait = max(0.0, self._next_slice - time.monotonic())
        is_idle = self._ahead is None and not self._ensembles.is_busy
        try:
            name, values = self._orders.get(timeout=None if is_idle else wait)
        except queue.Empty:
            self._take_slice()
        else:
            getattr(self, name)(**values)

    def share(self, share: float) -> None:
        """Set the maximum fraction of the time in which forecasts may compute."""
        self._share = share

    def prepare(self) -> None:
        """Load the libraries that ensembles need, which takes some time."""
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
        """Replace the forecast in progress by a new one from a checkpoint.

        ``number`` identifies the forecast, and ``how`` are further arguments of ``ForecastRun``.
        The first forecast of a scene (``is_first``) has fewer observations. ``ensemble`` has
        further arguments of ``LiveEnsembles.order``, None for no ensemble.
        """
        self._ahead, self._number = None, number
        if ensemble is not None:
            self._ensembles.order(checkpoint, number=number, **ensemble, **how)
        with self._guarded():
            # the first forecast should be early rather than precise
            samples = N_FIRST_SAMPLES if is_first else N_SAMPLES
            self._ahead = ForecastRun(checkpoint, samples=samples, **how)

    def outline(self, number: int, outline: Outline) -> None:
        """Weight the members of the ensembles by an observed outline."""
        self._ensembles.observe(number, outline)

    def cancel(self) -> None:
        """Cancel the forecast and the ensemble in progress."""
        self._ahead = None
        self._ensembles.drop()

    def _take_slice(self) -> None:
        begun, ahead, ensembles = time.monotonic(), self._ahead, self._ensembles
        # a forecast precedes an ensemble that has not started; then they alternate
        is_ensemble = ahead is None or bool(ensembles.current and self._is_turn_of_ensemble)
        self._is_turn_of_ensemble = not is_ensemble
        with self._guarded(is_ensemble=is_ensemble):
            if ahead is None or is_ensemble:
                ensembles.advance(SLICE_WALL_TIME)
            else:
                ahead.advance(SLICE_WALL_TIME)
                if ahead.is_done:
                    self._ahead = None
                    known = dict(vars(ahead.forecast()))
                    # the node already has the terrain
                    del known['terrain']
                    self._answer('forecast', number=self._number, **known)
        now = time.monotonic()
        if now - self._reported >= REPORT_TIME:
            self._reported = now
            self._answer(
                'progress',
                number=self._number,
                progress=self._ahead.progress if self._ahead else 1.0,
                ensemble=ensembles.current.progress if ensembles.current else 0.0,
            )
        rest = (now - begun) * (1.0 / self._share - 1.0)
        self._next_slice = now + min(rest, _MAX_REST)

    @contextmanager
    def _guarded(self, *, is_ensemble: bool = False) -> Iterator[None]:
        """On an error, cancel the forecast or the ensemble and report the reason."""
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
    """Execute requests until the connection closes."""
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
    status = 1
    try:
        while True:
            orders.put(node.recv())
    except (EOFError, OSError):
        # the node has closed the connection
        status = 0
    except Exception:
        traceback.print_exc()
    finally:
        # even in the middle of a step
        os._exit(status)


if __name__ == '__main__':
    main()
