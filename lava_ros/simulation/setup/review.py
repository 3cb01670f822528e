# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The review of effects while a simulation runs.

The choice before the first step follows from the expected flow. From time to time the numbers of
the effects that are off are evaluated again, on the actual lava. An effect whose number exceeds
its threshold is switched on, and stays on.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
import math

from lava_ros.effects import EFFECTS, Effects, excluded_by, existing
from lava_ros.scene import Scene
from lava_ros.simulation.selection import Decision

#: Time of the first review as a fraction of the horizon; until half of it, each is at twice the
#: time of the one before.
FIRST = 1.0 / 128.0

#: Longest time between two reviews, as a fraction of the horizon, or of the time if that is more.
MAX_INTERVAL = 1.0 / 4.0


@dataclass
class Review:
    """Results of the reviews of a simulation.

    Attributes:
        largest: Largest measured number of each effect, by name.
        since: Simulated time [s] at which a review has switched an effect on, by name.
        count: Number of reviews.
    """

    largest: dict[str, float] = field(default_factory=dict)
    since: dict[str, float] = field(default_factory=dict)
    count: int = 0

    def note(self, decisions: Iterable[Decision], effects: Effects) -> list[str]:
        """Add the decisions of a review about effects that are off.

        Args:
            decisions: The decisions.
            effects: The effects that are on.

        Returns:
            The names of the effects to switch on.
        """
        self.count += 1
        decisions = tuple(decisions)
        for item in decisions:
            if not math.isnan(item.value):
                self.largest[item.name] = max(self.largest.get(item.name, 0.0), item.value)
        return [item.name for item in called_for(decisions, effects)]


def called_for(decisions: Iterable[Decision], effects: Effects) -> list[Decision]:
    """Return the decisions for effects that are off and that no effect which is on excludes."""
    return [
        item
        for item in decisions
        if item.is_on
        and item.name not in effects
        and not any(excluded_by(item.name, other) for other in effects)
    ]


def next_review(time: float, horizon: float) -> float:
    """Return the time of the first review after a simulated time, both in s.

    The times depend on the horizon [s] alone.
    """
    # rounding must not find the same review twice
    passed, due = time / horizon * (1.0 + 1e-9), FIRST
    while due <= passed:
        due += min(due, MAX_INTERVAL * max(due, 1.0))
    return horizon * due


def watched_effects(scene: Scene, effects: Effects, forced: Mapping[str, bool]) -> list[str]:
    """Return the names of the effects that a review evaluates.

    This includes effects that exclude one that is on: their numbers give the error of leaving
    them out.
    """
    return [
        name
        for name in existing(scene)
        if EFFECTS[name].number is not None
        and math.isfinite(EFFECTS[name].threshold)
        and name not in effects
        and name not in forced
    ]
