# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The effects of a simulation: forced by the user, chosen from the scene, or found by a review.

The choice before the first step follows from the expected flow. From time to time the numbers of
the effects that are off are evaluated again, on the actual lava. An effect whose number exceeds
its threshold is switched on, and stays on.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
import math

from lava_ros.effects import EFFECTS, Effects, excluded_by, existing
from lava_ros.effects.scales import Scales
from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.selection import (
    decide,
    decide_by,
    Decision,
    effects_for,
    implied_effects,
)

#: Time of the first review as a fraction of the horizon; until half of it, each is at twice the
#: time of the one before.
FIRST = 1.0 / 128.0

#: Longest time between two reviews, as a fraction of the horizon, or of the time if that is more.
MAX_INTERVAL = 1.0 / 4.0


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


class EffectChoice:
    """The effects that are on, and the time of their next review.

    Attributes:
        forced: Effects that the user has forced on or off, by name; None if the user has given
            all of them, which then never change.
        horizon: Time span for the choice of effects and of the spacing [s].
        due: Simulated time of the next review [s]; infinite without one.
        largest: Largest number of each effect that reviews have measured, by name.
        since: Simulated time [s] at which a review has switched an effect on, by name.
        review_count: Number of reviews of a flow.
    """

    def __init__(self, effects: Effects | Mapping[str, bool] | None, horizon: float) -> None:
        """Store what the user has given, as for ``Simulation``."""
        self.forced = None if isinstance(effects, Effects) else dict(effects or {})
        self.horizon, self.due = horizon, math.inf
        self.largest: dict[str, float] = {}
        self.since: dict[str, float] = {}
        self.review_count = 0
        self._given = effects if isinstance(effects, Effects) else None
        self._watched: list[str] = []

    def all_forced(self, effects: Effects | None = None) -> dict[str, bool]:
        """Return all effects that are forced on or off, by name; by default those given."""
        if self.forced is not None:
            return self.forced
        fixed = self._given if effects is None else effects
        assert fixed is not None
        return {name: name in fixed for name in EFFECTS}

    def first(self, scene: Scene, accuracy: Accuracy) -> Effects:
        """Return the effects at the start.

        Raises:
            LavaError: If the user has given an effect that the formulation excludes.
        """
        if self.forced is None:
            assert self._given is not None
            asked = {name: True for name in self._given if not EFFECTS[name].is_default}
            return replace(self._given, **implied_effects(accuracy, asked))
        return effects_for(scene, self.forced, accuracy=accuracy, horizon=self.horizon)

    def updated(self, scene: Scene, accuracy: Accuracy, remaining: Iterable[str]) -> Effects:
        """Return the effects of a changed scene.

        Args:
            scene: The scene.
            accuracy: The resolution.
            remaining: Effects that stay on unless the user forces them off: they have shaped the
                lava.
        """
        assert self.forced is not None
        chosen = self.first(scene, accuracy)
        on = [name for name in chosen if name in self.forced]
        remaining = [name for name in remaining if self.forced.get(name, True)]
        for name in (*remaining, *chosen):
            if not any(excluded_by(name, other) for other in on):
                on.append(name)
        return replace(chosen, **{name: name in on for name in (*remaining, *chosen)})

    def schedule(
        self, scene: Scene, effects: Effects, time: float, *, is_due: bool = False
    ) -> None:
        """Schedule the next review after a simulated time [s], or at it if one ``is_due``."""
        self._watched = (
            [] if self.forced is None else watched_effects(scene, effects, self.forced)
        )
        self.due = math.inf
        if self._watched:
            self.due = time if is_due else next_review(time, self.horizon)

    def reviewed(
        self, scales: Scales, effects: Effects, accuracy: Accuracy, time: float,
        names: Iterable[str] | None = None,
    ) -> Effects:
        """Return the effects after a review, which switches on those above their thresholds.

        Args:
            scales: Scales of the current flow.
            effects: The effects that are on.
            accuracy: The resolution.
            time: Simulated time [s].
            names: The effects to review, by default those that are off and not forced.
        """
        names = self._watched if names is None else names
        decisions = decide_by(scales, self.forced or {}, accuracy, names=names)
        self.review_count += 1
        for item in decisions:
            if not math.isnan(item.value):
                self.largest[item.name] = max(self.largest.get(item.name, 0.0), item.value)
        found = [item.name for item in called_for(decisions, effects)]
        self.since |= dict.fromkeys(found, time)
        return replace(effects, **dict.fromkeys(found, True))

    def decisions(
        self, scene: Scene, effects: Effects, accuracy: Accuracy
    ) -> tuple[Decision, ...]:
        """Return the decision about each effect, with its number and its threshold."""
        decisions = decide(
            scene, self.all_forced(effects), accuracy=accuracy, horizon=self.horizon
        )
        return tuple(
            item.in_run(
                effects, self.largest.get(item.name, math.nan),
                self.since.get(item.name, math.nan),
            )
            for item in decisions
        )
