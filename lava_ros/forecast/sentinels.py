# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Sentinels: the members of an ensemble whose flow is used to review its effects.

The choice of effects before the first step follows from the expected flow. Sentinels measure the
numbers of the effects that are off a few times on their way to the horizon. An effect that a
sentinel needs is switched on for all members, which run again from the start.

Which members are sentinels, and when they measure, depends on their index and the horizon alone.
The effects that are switched on are those of the sentinel with the lowest index that needs any,
and all sentinels measure again in the next run. The effects therefore do not depend on whether
members are added later or are present from the beginning.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
import logging
from typing import Any, TYPE_CHECKING

from lava_ros.effects import EFFECTS
from lava_ros.layers.numbers import duration
from lava_ros.simulation.selection import decide_by
from lava_ros.simulation.setup.review import called_for, watched_effects

if TYPE_CHECKING:
    from lava_ros.simulation.simulation import Simulation

_LOG = logging.getLogger(__name__)

#: Interval of the indices of sentinels, starting at member 0.
EVERY = 32

#: Maximum number of sentinels.
MAX_SENTINELS = 8

#: Times of the measurements, as fractions of the horizon: on a GPU each delays the other members
#: by 1 to 3 ms.
REVIEWS = (0.125, 0.5, 1.0)


@dataclass(frozen=True)
class CalledEffect:
    """An effect that was off and that the flow of a sentinel needs.

    Attributes:
        effect: Its name.
        number: The dimensionless number measured on the flow.
        threshold: The threshold, which the number exceeds.
        member: Index of the sentinel.
        time_s: Time from the start of the sentinel at which it measured the number [s].
    """

    effect: str
    number: float
    threshold: float
    member: int
    time_s: float

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> CalledEffect:
        """Create an object from plain data.

        Raises:
            KeyError, TypeError, ValueError: If the data do not describe an effect.
        """
        if values['effect'] not in EFFECTS:
            raise ValueError(values['effect'])
        numbers = {name: float(values[name]) for name in ('number', 'threshold', 'time_s')}
        return cls(effect=values['effect'], member=int(values['member']), **numbers)

    @property
    def reason(self) -> str:
        """Short reason why the effect is on."""
        symbol = EFFECTS[self.effect].symbol
        text = f'{symbol} = {self.number:.2g} > {self.threshold:.2g}'
        return f'{text} in member {self.member} at {duration(self.time_s)}'

def is_sentinel(index: int) -> bool:
    """Return True if the member with this index is a sentinel."""
    return index % EVERY == 0 and index < EVERY * MAX_SENTINELS


def find_called(
    simulation: Simulation, forced: Mapping[str, bool], *, member: int, start: float
) -> tuple[CalledEffect, ...]:
    """Measure the flow of a sentinel and find the effects that it needs.

    Args:
        simulation: The sentinel's simulation; its effects stay as they are.
        forced: Effects that the user forces on or off, by name.
        member: Index of the sentinel.
        start: Simulated time of its start [s].
    """
    watched = watched_effects(simulation.scene, simulation.effects, forced)
    scales = simulation.measure_scales() if watched else None
    if scales is None:
        return ()
    time = simulation.time - start
    decisions = decide_by(scales, forced, simulation.accuracy, names=watched)
    return tuple(
        CalledEffect(item.name, item.value, item.effect.threshold, member, time)
        for item in called_for(decisions, simulation.effects)
    )


def log_called(called: Iterable[CalledEffect]) -> None:
    """Log which effects are switched on for all members, and why."""
    for item in called:
        _LOG.info(
            '%s is switched on for all members from the start: %s', item.effect, item.reason
        )


class Sentinels:
    """The sentinels among some members, and the effects that completed sentinels need."""

    def __init__(self, indices: Iterable[int]) -> None:
        """Select the sentinels among the members with these indices."""
        self._running = set(filter(is_sentinel, indices))
        self._called: dict[int, tuple[CalledEffect, ...]] = {}

    @property
    def are_done(self) -> bool:
        """Return True if all sentinels have run."""
        return not self._running

    @property
    def called(self) -> tuple[CalledEffect, ...]:
        """The effects to switch on; none while a sentinel with a lower index still runs."""
        first = min(self._called, default=-1)
        if first < 0 or min(self._running, default=first) < first:
            return ()
        return self._called[first]

    def note(self, index: int, called: tuple[CalledEffect, ...]) -> None:
        """Record that a member has run, and which effects it needs."""
        self._running.discard(index)
        if called:
            self._called[index] = called
