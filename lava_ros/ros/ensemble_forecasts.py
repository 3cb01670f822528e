# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Ensembles of the live simulation, from the node's side. No rclpy in here."""

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
from lava_ros.maps.forecast import EnsembleForecast, Forecast
from lava_ros.maps.places import Places, places_on
from lava_ros.ros.session import Fork
from lava_ros.ros.worker_status import finish
from lava_ros.scene import Terrain
from lava_ros.scene.features import Feature

#: Moments that are remembered to find the simulated time of a stamp.
_MOMENTS = 512

#: What is published of the time to come.
Ahead = TypeVar('Ahead', Forecast, EnsembleForecast)


@dataclass(frozen=True, eq=False)
class Live(Generic[Ahead]):
    """A forecast or the maps of an ensemble, and what they are of.

    They start at a ROS time [ns], after so many changes of scene or effects.
    """

    shown: Ahead
    stamp_ns: int
    changes: int


@dataclass(frozen=True)
class ForecastRules:
    """How forecasts and ensembles are to be made.

    Attributes:
        horizon: How far ahead to look [s].
        threshold: Thickness from which on lava has arrived [m].
        max_age: Simulated time after which a forecast is stale [s].
        share: Largest share of the time that the device computes forecasts.
        max_particles: Most particles of a forecast.
        members: Members of an ensemble beside it, 0 for none.
        deadline: Wall time for a forecast and its ensemble [s], 0 for any.
        time_scale: Simulated time per time of the clock [s/s].
        features: Places where ensembles also tell when lava arrives.
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
        progress: Share of the horizon or of the members that is done, None when at rest.
        error: Why the last one failed, empty if it did not.
        share: Share of the time that forecasts may compute now.
        outlines: Number of outlines by which the members of this scene have been weighed.
        jaccard_mean: Mean agreement with the newest outline, 0 to 1; None without one.
    """

    count: int = 0
    progress: float | None = None
    error: str = ''
    share: float = 0.0
    outlines: int = 0
    jaccard_mean: float | None = None


class _Seen(NamedTuple):
    """An outline on its way."""

    mask: Mask
    clock: float
    done: 'Future[None]'


class EnsembleForecasts:
    """Orders ensembles, takes their maps, and passes on what has been seen.

    All but ``observe`` is for the forecaster's thread.
    """

    def __init__(self) -> None:
        """Begin without any."""
        self.latest: Live[EnsembleForecast] | None = None
        self.status = AheadStatus()
        self._seen: queue.SimpleQueue[_Seen] = queue.SimpleQueue()
        self._sent: dict[int, Future[None]] = {}
        self._number = 0
        self._at_hand: int | None = None
        self._ordered: tuple[int, float] | None = None
        self._is_refused = False
        self._changes: int | None = None
        self._terrain: Terrain | None = None
        self._moments: deque[tuple[float, float]] = deque(maxlen=_MOMENTS)
        self._agreement: list[float] | None = None
        self._places: tuple[Terrain, Places | None] | None = None

    @property
    def is_busy(self) -> bool:
        """Whether an ensemble is at hand."""
        return self._at_hand is not None

    def observe(self, mask: Mask, clock: float) -> 'Future[None]':
        """Take a mask of where lava was observed at ``clock``, in ROS time [s], from any thread.

        The future is done when the members have been weighed, or holds the LavaError why not.
        """
        done: Future[None] = Future()
        self._seen.put(_Seen(mask, clock, done))
        return done

    def is_wanted(self, changes: int, time: float) -> bool:
        """Whether there is neither an ensemble at hand nor one of this state."""
        # one that was refused would fail again, until something changes
        may_be = not self._is_refused or changes != self._changes
        return may_be and self._at_hand is None and (changes, time) != self._ordered

    def order(self, fork: Fork, number: int, rules: ForecastRules) -> dict[str, Any] | None:
        """The part of the order for forecast ``number`` that asks for an ensemble, or None."""
        self._note(fork)
        if not rules.members or not self.is_wanted(fork.changes, fork.checkpoint.time):
            return None
        self._at_hand = number
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
        """Put places on a terrain; None without any, or where their topic reports an error."""
        if features and (self._places is None or self._places[0] is not terrain):
            self._places = terrain, None
            with suppress(LavaError):
                self._places = terrain, places_on(features, terrain)
        return None if self._places is None else self._places[1]

    def send(self, order: Callable[..., None], *, changes: int, time_scale: float) -> None:
        """Send waiting outlines to the process, unless the scene has just changed."""
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
        """Take an answer of the process, and return whether ``latest`` has changed."""
        if name == 'progress' and self._at_hand is not None:
            self._put(progress=values['ensemble'])
        elif name == 'ensemble_refused':
            self._at_hand, self._is_refused = None, True
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
        """Forget what is at hand: the process does so, too, or has ended."""
        self._at_hand = self._ordered = None
        self._put(progress=None)
        waiting = list(self._sent.values())
        self._sent = {}
        while not self._seen.empty():
            waiting.append(self._seen.get().done)
        for done in waiting:
            finish(done, LavaError('observed_outline', reason, 'an ensemble to be weighed'))

    def _note(self, fork: Fork) -> None:
        if fork.changes != self._changes:
            # what is known of one scene says nothing of another
            self._changes = fork.changes
            self._moments.clear()
            self._agreement, self._is_refused = None, False
            self._put(outlines=0, jaccard_mean=None, error='')
        self._terrain = fork.checkpoint.scene.terrain
        self._moments.append((fork.clock, fork.checkpoint.time))

    def _time_at(self, clock: float, time_scale: float) -> float:
        """Simulated time at a time of the clock: evenly between two forks, after them by scale."""
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
        # of another scene
        if changes != self._changes:
            return False
        assert self._terrain is not None
        ensemble = EnsembleForecast(terrain=self._terrain, is_done=is_done, **values)
        self.latest = Live(ensemble, stamp_ns, changes)
        self._put(error='')
        if is_done and number == self._at_hand:
            self._at_hand = None
            self._put(progress=None, count=self.status.count + 1)
        return True

    def _end(self, number: int, error: LavaError | None = None) -> None:
        """Complete the future of an outline, with the error if it was not used."""
        done = self._sent.pop(number, None)
        if done is not None:
            finish(done, error)

    def _put(self, **changes: Any) -> None:
        self.status = replace(self.status, **changes)
