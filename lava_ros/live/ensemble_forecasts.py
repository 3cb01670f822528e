# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Ensemble forecasts of the live simulation, on the side of the node."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, replace
import queue
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.forecast.assimilation import Mask, outline_on
from lava_ros.live.session import Fork
from lava_ros.live.worker_status import finish
from lava_ros.maps.forecast import EnsembleForecast, Forecast
from lava_ros.maps.places import Places, places_on
from lava_ros.scene import Terrain
from lava_ros.scene.features import Feature

#: Maximum number of (ROS time, simulated time) pairs kept to convert a stamp.
_MOMENTS = 512

#: A forecast or the maps of an ensemble.
Ahead = TypeVar('Ahead', Forecast, EnsembleForecast)


@dataclass(frozen=True, eq=False)
class Live(Generic[Ahead]):
    """A forecast or the maps of an ensemble, with the state from which they start.

    ``stamp_ns`` is the ROS time of that state [ns], ``changes`` its count of changes of scene or
    effects.
    """

    shown: Ahead
    stamp_ns: int
    changes: int


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
        deadline: Maximum wall time of a forecast and its ensemble [s], 0 for no limit.
        time_scale: Simulated time per clock time [s/s].
        features: Places for which ensembles also predict arrival times.
    """

    horizon: float
    threshold: float
    max_age: float
    share: float
    max_particles: int
    members: int = 0
    deadline: float = 0.0
    time_scale: float = 1.0
    features: tuple[Feature, ...] = ()


@dataclass(frozen=True)
class AheadStatus:
    """The status of the forecasts or of the ensembles.

    Attributes:
        count: Number of forecasts, or of complete ensembles, so far.
        progress: Completed fraction of the horizon or of the members, None when idle.
        error: Reason why the last one failed, empty if it did not.
        share: Fraction of the time in which forecasts may currently compute.
        outlines: Number of outlines used to weight the members of this scene.
        jaccard_mean: Mean agreement with the newest outline, 0 to 1; None without one.
    """

    count: int = 0
    progress: float | None = None
    error: str = ''
    share: float = 0.0
    outlines: int = 0
    jaccard_mean: float | None = None


class _Seen(NamedTuple):
    """An observed outline that waits to be sent to the process."""

    mask: Mask
    clock: float
    done: 'Future[None]'


class EnsembleForecasts:
    """Requests ensembles, receives their maps, and forwards observed outlines.

    Only the forecaster's thread may call methods other than ``observe``.
    """

    def __init__(self) -> None:
        """Initialize without an ensemble."""
        self.latest: Live[EnsembleForecast] | None = None
        self.status = AheadStatus()
        self._seen: queue.SimpleQueue[_Seen] = queue.SimpleQueue()
        self._sent: dict[int, Future[None]] = {}
        self._number = 0
        self._current: int | None = None
        self._ordered: tuple[int, float] | None = None
        self._is_refused = False
        self._changes: int | None = None
        self._terrain: Terrain | None = None
        self._moments: deque[tuple[float, float]] = deque(maxlen=_MOMENTS)
        self._agreement: list[float] | None = None
        self._places: tuple[Terrain, Places | None] | None = None

    @property
    def is_busy(self) -> bool:
        """True while an ensemble is being computed."""
        return self._current is not None

    def observe(self, mask: Mask, clock: float) -> 'Future[None]':
        """Accept a mask of lava observed at ROS time ``clock`` [s]; any thread may call this.

        The future completes when the members have been weighted, or contains a LavaError.
        """
        done: Future[None] = Future()
        self._seen.put(_Seen(mask, clock, done))
        return done

    def is_wanted(self, changes: int, time: float) -> bool:
        """Return True if no ensemble is being computed or has been requested for this state."""
        # a refused ensemble would fail again until something changes
        may_be = not self._is_refused or changes != self._changes
        return may_be and self._current is None and (changes, time) != self._ordered

    def order(self, fork: Fork, number: int, rules: ForecastRules) -> dict[str, Any] | None:
        """Return the ensemble part of the request for forecast ``number``, or None."""
        self._note(fork)
        if not rules.members or not self.is_wanted(fork.changes, fork.checkpoint.time):
            return None
        self._current = number
        self._ordered = fork.changes, fork.checkpoint.time
        self._put(progress=0.0)
        return {
            'members': rules.members,
            'changes': fork.changes,
            'stamp_ns': round(fork.clock * 1e9),
            'deadline': rules.deadline or None,
            'agreement': self._agreement,
            'outlines': self.status.outlines,
            'places': self._places_on(rules.features, fork.checkpoint.scene.terrain),
        }

    def _places_on(self, features: tuple[Feature, ...], terrain: Terrain) -> Places | None:
        """Locate places on a terrain; None without places, or if their topic reports an error."""
        if features and (self._places is None or self._places[0] is not terrain):
            self._places = terrain, None
            with suppress(LavaError):
                self._places = terrain, places_on(features, terrain)
        return None if self._places is None else self._places[1]

    def send(self, order: Callable[..., None], *, changes: int, time_scale: float) -> None:
        """Send the waiting outlines to the process, unless the scene has just changed."""
        while changes == self._changes and not self._seen.empty():
            seen = self._seen.get()
            assert self._terrain is not None
            try:
                time = self._time_at(seen.clock, time_scale)
                outline = outline_on(self._terrain, seen.mask, time)
            except LavaError as error:
                finish(seen.done, error)
                continue
            self._number += 1
            self._sent[self._number] = seen.done
            order('outline', number=self._number, outline=outline)

    def hear(self, name: str, **values: Any) -> bool:
        """Process a reply of the child process; return True if ``latest`` has changed."""
        if name == 'progress' and self._current is not None:
            self._put(progress=values['ensemble'])
        elif name == 'ensemble_refused':
            self._current, self._is_refused = None, True
            self._put(progress=None, error=values['reason'])
        elif name == 'outline_refused':
            self._end(values['number'], values['error'])
        elif name == 'weighed':
            self._agreement = values['agreement']
            self._put(outlines=values['outlines'], jaccard_mean=values['jaccard_mean'])
            self._end(values['number'])
        elif name == 'ensemble':
            return self._take(**values)
        return False

    def drop(self, reason: str) -> None:
        """Discard the current ensemble; the child process discards it too, or has ended."""
        self._current = self._ordered = None
        self._put(progress=None)
        waiting = list(self._sent.values())
        self._sent = {}
        while not self._seen.empty():
            waiting.append(self._seen.get().done)
        for done in waiting:
            finish(done, LavaError('observed_outline', reason, 'an ensemble to be weighed'))

    def _note(self, fork: Fork) -> None:
        if fork.changes != self._changes:
            # observations and errors apply to one scene only
            self._changes = fork.changes
            self._moments.clear()
            self._agreement, self._is_refused = None, False
            self._put(outlines=0, jaccard_mean=None, error='')
        self._terrain = fork.checkpoint.scene.terrain
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

    def _take(
        self, number: int, stamp_ns: int, changes: int, *, is_done: bool, **values: Any
    ) -> bool:
        # the reply belongs to an earlier scene
        if changes != self._changes:
            return False
        assert self._terrain is not None
        ensemble = EnsembleForecast(terrain=self._terrain, is_done=is_done, **values)
        self.latest = Live(ensemble, stamp_ns, changes)
        self._put(error='')
        if is_done and number == self._current:
            self._current = None
            self._put(progress=None, count=self.status.count + 1)
        return True

    def _end(self, number: int, error: LavaError | None = None) -> None:
        """Complete the future of an outline, with the error if it was not used."""
        done = self._sent.pop(number, None)
        if done is not None:
            finish(done, error)

    def _put(self, **changes: Any) -> None:
        self.status = replace(self.status, **changes)
