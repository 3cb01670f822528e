# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The child process that computes forecasts: it receives requests and sends results.

The live simulation takes precedence: this process has a lower priority, and computes for a
fraction of the time (``RequestLoop``). As a separate process it cannot block the live simulation
through Python's global lock or graph capture, and cannot crash it.

Requests are the methods of ``Forecasting``. Replies are:

    progress           number; progress of the forecast and of the ensemble
    forecast           number, fields of ``Forecast``
    refused            number, reason
    ensemble_refused   reason

and those of ``live_ensemble``. A forecast starts before the ensemble from the same checkpoint;
then they alternate.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
import queue
import time
from typing import Any

from lava_ros.forecast.assimilation import Outline
from lava_ros.forecast.forecast_run import ForecastRun, N_FIRST_SAMPLES, N_SAMPLES
from lava_ros.forecast.live_ensemble import LiveEnsembles
from lava_ros.forecast.sampling import prepare_sampling
from lava_ros.processes.requests import (
    Answer,
    explain,
    NICENESS,
    REPORT_TIME,
    Request,
    RequestLoop,
    SLICE_WALL_TIME,
)
from lava_ros.simulation.output.checkpoint import Checkpoint


class Forecasting(RequestLoop):
    """Executes requests, and computes forecasts in slices."""

    niceness = NICENESS

    def __init__(self, requests: 'queue.SimpleQueue[Request]', answer: Answer) -> None:
        """Initialize without a forecast; arguments as for ``RequestLoop``."""
        super().__init__(requests, answer)
        self._ahead: ForecastRun | None = None
        self._ensembles = LiveEnsembles(answer)
        self._is_turn_of_ensemble = False
        self._number = 0
        self._reported = 0.0

    @property
    def is_busy(self) -> bool:
        """True while there is a forecast or an ensemble to compute."""
        return self._ahead is not None or self._ensembles.is_busy

    def share(self, share: float) -> None:
        """Set the maximum fraction of the time in which forecasts may compute."""
        super().share(share)
        self._ensembles.share(share)

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

    def take_slice(self) -> None:
        """Continue the forecast or the ensemble, and report progress."""
        ahead, ensembles = self._ahead, self._ensembles
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

    @contextmanager
    def _guarded(self, *, is_ensemble: bool = False) -> Iterator[None]:
        """On an error, cancel the forecast or the ensemble and report the reason."""
        try:
            yield
        except ChildProcessError:
            # a process of members has ended; the node starts this one and those again
            raise
        except Exception as error:
            if is_ensemble:
                self._ensembles.drop()
                self._answer('ensemble_refused', reason=explain(error))
            else:
                self._ahead = None
                self._answer('refused', number=self._number, reason=explain(error))
