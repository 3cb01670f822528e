# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Ensemble forecasts of the live simulation, in the process of the node."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, replace
import math
import queue
from typing import Any

import numpy as np

from lava_ros.errors import LavaError, RefusalError
from lava_ros.forecast.assimilation import Mask, outline_on
from lava_ros.forecast.sampling import Posterior
from lava_ros.layers.forecast import EnsembleForecast
from lava_ros.layers.places import Places, places_on
from lava_ros.live.commands import finish
from lava_ros.live.session import Fork
from lava_ros.scene import Terrain
from lava_ros.scene.features import Feature
from lava_ros.simulation.accuracy import Accuracy, COVERED

#: Maximum number of (ROS time, simulated time) pairs kept to convert a stamp.
_MOMENTS = 512

@dataclass(frozen=True)
class ForecastRules:
    """Settings of forecasts and ensembles.

    Attributes:
        horizon: Simulated duration of a forecast [s].
        threshold: Lava has arrived where its thickness is at or above this value [m].
        max_age: Simulated time after which a forecast is stale [s].
        share: Maximum fraction of the time in which the device computes forecasts.
        max_particles: Maximum number of particles of a forecast.
        members: Number of ensemble members, 0 for no ensembles.
        time_scale: Simulated time per clock time [s/s].
        features: Places for which ensembles also predict arrival times.
        exact: Quantities that ensembles do not draw (``scene.uncertainty.QUANTITIES``).
    """

    horizon: float
    threshold: float
    max_age: float
    share: float
    max_particles: int
    members: int = 0
    time_scale: float = 1.0
    features: tuple[Feature, ...] = ()
    exact: tuple[str, ...] = ()

    def threshold_for(self, accuracy: Accuracy) -> float:
        """Return the threshold for a simulation [m]; the default, 0.1 m, selects its own."""
        is_usual = math.isclose(self.threshold, COVERED)
        return accuracy.inundation_threshold if is_usual else self.threshold


@dataclass(frozen=True)
class ForecastStatus:
    """The status of the forecasts or of the ensembles.

    Attributes:
        count: Number of forecasts, or of complete ensembles, so far.
        progress: Completed fraction of the horizon or of the members, None when idle.
        error: Reason why the last one failed, empty if it did not.
        share: Fraction of the time in which forecasts may currently compute.
        outlines: Number of outlines used to weight and draw the members of this scene.
        jaccard_mean: Mean agreement with the newest outline, 0 to 1; None without one.
        members_left: Effective number of members after the newest outline, near which the members
            of the next ensemble are drawn; None without an outline.
    """

    count: int = 0
    progress: float | None = None
    error: str = ''
    share: float = 0.0
    outlines: int = 0
    jaccard_mean: float | None = None
    members_left: float | None = None


class EnsembleForecasts:
    """Requests ensembles, receives their maps, and forwards observed outlines.

    Only the forecaster's thread may call methods other than ``observe``.
    """

    def __init__(self) -> None:
        """Initialize without an ensemble."""
        self.latest: EnsembleForecast | None = None
        self.status = ForecastStatus()
        # observed outlines that wait to be sent to the process
        self._waiting: queue.SimpleQueue[tuple[Mask, float, Future[str]]] = queue.SimpleQueue()
        self._sent: dict[int, Future[str]] = {}
        self._number = 0
        self._current: int | None = None
        self._requested: tuple[int, float] | None = None
        self._is_refused = False
        self._changes: int | None = None
        self._terrain: Terrain | None = None
        self._moments: deque[tuple[float, float]] = deque(maxlen=_MOMENTS)
        self._posterior: Posterior | None = None
        self._places: tuple[Terrain, Places | None] | None = None

    @property
    def is_busy(self) -> bool:
        """True while an ensemble is being computed."""
        return self._current is not None

    def observe(self, mask: Mask, clock: float) -> 'Future[str]':
        """Accept a mask of lava observed at ROS time ``clock`` [s]; any thread may call this.

        When the members have been weighted, the future contains a sentence about that, or a
        LavaError.
        """
        done: Future[str] = Future()
        self._waiting.put((mask, clock, done))
        return done

    def is_wanted(self, changes: int, time: float) -> bool:
        """Return True if no ensemble is being computed or has been requested for this state."""
        if self._is_refused and changes == self._changes:
            # it would fail again until something changes
            return False
        return self._current is None and (changes, time) != self._requested

    def request(self, fork: Fork, number: int, rules: ForecastRules) -> dict[str, Any] | None:
        """Return the ensemble part of the request for forecast ``number``, or None."""
        self._note(fork)
        if not rules.members or not self.is_wanted(fork.changes, fork.checkpoint.time):
            return None
        self._current = number
        self._requested = fork.changes, fork.checkpoint.time
        self._put_status(progress=0.0)
        return {
            'members': rules.members,
            'changes': fork.changes,
            'stamp_ns': round(fork.clock * 1e9),
            'posterior': self._posterior,
            'outlines': self.status.outlines,
            'exact': rules.exact,
            'places': self._places_on(rules.features, fork.checkpoint.scene.terrain),
        }

    def _places_on(self, features: tuple[Feature, ...], terrain: Terrain) -> Places | None:
        """Locate places on a terrain; None without places, or if their topic reports an error."""
        if features and (self._places is None or self._places[0] is not terrain):
            self._places = terrain, None
            with suppress(LavaError):
                self._places = terrain, places_on(features, terrain)
        return None if self._places is None else self._places[1]

    def send(
        self, request: Callable[..., None], *, changes: int, time_scale: float, now: float
    ) -> None:
        """Send the waiting outlines to the process, unless the scene has just changed.

        ``now`` is the simulated time [s].
        """
        while changes == self._changes and not self._waiting.empty():
            mask, clock, done = self._waiting.get()
            assert self._terrain is not None
            try:
                # a paused or slow simulation has not reached this time yet
                time = min(now, self._time_at(clock, time_scale))
                outline = outline_on(self._terrain, mask, time)
            except LavaError as error:
                finish(done, error)
                continue
            self._number += 1
            self._sent[self._number] = done
            request('outline', number=self._number, outline=outline)

    def handle_reply(self, name: str, **values: Any) -> bool:
        """Process a reply of the child process; return True if ``latest`` has changed."""
        if name == 'progress' and self._current is not None:
            self._put_status(progress=values['ensemble'])
        elif name == 'ensemble_refused':
            self._current, self._is_refused = None, True
            self._put_status(progress=None, error=values['reason'])
        elif name == 'outline_refused':
            self._complete(values['number'], values['error'])
        elif name == 'weighed':
            self._note_weights(**values)
        return name == 'ensemble' and self._accept(**values)

    def _note_weights(
        self, number: int, posterior: Posterior, outlines: int, jaccard_mean: float,
        effective_before: float,
    ) -> None:
        self._posterior, left = posterior, posterior.effective_members
        # new members justify an ensemble even from the same state
        self._requested = None
        self._put_status(outlines=outlines, jaccard_mean=jaccard_mean, members_left=left)
        self._complete(
            number,
            result=f'of {len(posterior.parents)} members that counted like {effective_before:.1f} '
            f'of equal weight, {left:.1f} are left; the next ensemble draws new ones near them',
        )

    def cancel(self, reason: str) -> None:
        """Discard the current ensemble; the child process discards it too, or has ended."""
        self._current = self._requested = None
        self._put_status(progress=None)
        waiting = list(self._sent.values())
        self._sent = {}
        while not self._waiting.empty():
            waiting.append(self._waiting.get()[-1])
        for done in waiting:
            problem = f'The observed outline was not used: {reason}'
            finish(done, RefusalError('observed_outline', problem, 'Publish it again later'))

    def _note(self, fork: Fork) -> None:
        if fork.changes != self._changes:
            # observations and errors apply to one scene only
            self._changes = fork.changes
            self._moments.clear()
            self._posterior, self._is_refused = None, False
            self._put_status(outlines=0, jaccard_mean=None, members_left=None, error='')
        self._terrain = fork.checkpoint.scene.terrain
        if self._moments and fork.clock < self._moments[-1][0]:
            # the clock went back: earlier stamps may mean either time
            self._moments.clear()
        self._moments.append((fork.clock, fork.checkpoint.time))

    def _time_at(self, clock: float, time_scale: float) -> float:
        """Convert a clock time: interpolate between forks, extrapolate with ``time_scale``."""
        clocks, times = zip(*self._moments, strict=True)
        if clock <= clocks[0]:
            raise LavaError(
                'observed_outline.header.stamp',
                f'{clocks[0] - clock:.1f} s before the first forecast of this scene',
                'a time after it',
            )
        if clock >= clocks[-1]:
            return float(times[-1] + (clock - clocks[-1]) * time_scale)
        return float(np.interp(clock, clocks, times))

    def _accept(self, number: int, changes: int, *, is_done: bool, **values: Any) -> bool:
        """Replace ``latest``, unless the reply belongs to an earlier scene."""
        if changes != self._changes:
            return False
        assert self._terrain is not None
        self.latest = EnsembleForecast(
            terrain=self._terrain, is_done=is_done, changes=changes, **values
        )
        self._put_status(error='')
        if is_done and number == self._current:
            self._current = None
            self._put_status(progress=None, count=self.status.count + 1)
        return True

    def _complete(
        self, number: int, error: LavaError | None = None, *, result: str = ''
    ) -> None:
        """Complete the future of an outline, with the error if it was not used."""
        done = self._sent.pop(number, None)
        if done is not None:
            finish(done, error, result=result)

    def _put_status(self, **changes: Any) -> None:
        self.status = replace(self.status, **changes)
