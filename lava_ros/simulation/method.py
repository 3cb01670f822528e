# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The choice between particles and cells for a scene.

The areas of both methods agree within their stated errors where cells have all effects that the
flow needs, except under a crust that stays in place. Cells take less time for lava that does not
freeze, and more time for lateral stress (docs/presets.md#particles-or-cells).
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import NamedTuple

from lava_ros.effects import EFFECTS
from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.carriers import AUTO
from lava_ros.simulation.selection import decide, effects_for

#: Why particles are better with some effects, by the attribute of ``Effect`` that these have.
_AGAINST_CELLS = {
    'freezes': 'cells take more time for lava that freezes',
    'is_lateral': 'cells take more time for lateral stress',
    'ages_in_place': 'lava that moves under a crust is more accurate as particles',
}


class MethodChoice(NamedTuple):
    """Carriers of the lava (``Accuracy.method``), and the reason in words; empty if given."""

    method: str
    reason: str = ''

    def text(self) -> str:
        """Return the choice and its reason."""
        return f'method: {self.method}, because {self.reason}'


def lacking_on_cells(effects: Iterable[str]) -> list[str]:
    """Return the names of the effects that cells do not have."""
    return [name for name in effects if EFFECTS[name].needs_particles]


def reason_against_cells(effects: Iterable[str]) -> str:
    """Return why particles are better with the named effects; empty if cells are."""
    names = list(effects)
    if lacking := lacking_on_cells(names):
        return f'cells have no {", ".join(lacking)}'
    for attribute, reason in _AGAINST_CELLS.items():
        if any(getattr(EFFECTS[name], attribute) for name in names):
            return reason
    return ''


def settled_method(
    method: str, scene: Scene, accuracy: Accuracy, forced: Mapping[str, bool] | None, *,
    horizon: float,
) -> MethodChoice:
    """Return a given method, or for ``auto`` the choice for a scene (``choose_method``)."""
    if method != AUTO:
        return MethodChoice(method)
    return choose_method(scene, accuracy, forced, horizon=horizon)


def choose_method(
    scene: Scene, accuracy: Accuracy, forced: Mapping[str, bool] | None, *, horizon: float
) -> MethodChoice:
    """Choose the carriers of the lava for a scene.

    Args:
        scene: The scene.
        accuracy: The resolution; its method does not matter.
        forced: Effects forced on or off, by name.
        horizon: Simulated duration [s].
    """
    on_cells = replace(accuracy, method='cells')
    effects = effects_for(scene, forced, accuracy=on_cells, horizon=horizon)
    decisions = decide(scene, forced, accuracy=on_cells, horizon=horizon)
    missed = [item.name for item in decisions if item.is_missed]
    if reason := reason_against_cells([*effects, *missed]):
        return MethodChoice('particles', reason)
    return MethodChoice('cells', 'the lava does not freeze, and cells take less time')
