# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The choice between particles and cells for a scene.

The areas of both methods agree within their stated errors where cells have all effects that the
flow needs. Cells take less time for lava that does not freeze; for lava that does, particles reach
the same scores in less time (docs/presets.md#particles-or-cells).
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

from lava_ros.effects import EFFECTS
from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.selection import decide, effects_for

#: Choice of the method by the flow.
AUTO = 'auto'


class MethodChoice(NamedTuple):
    """Carriers of the lava (``Accuracy.method``), and the reason in words."""

    method: str
    reason: str


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
    forced = forced or {}
    decisions = decide(
        scene, forced, accuracy=replace(accuracy, method='cells'), horizon=horizon
    )
    lacking = [name for name, is_on in forced.items() if is_on and EFFECTS[name].needs_particles]
    lacking += [item.name for item in decisions if item.is_missed]
    if lacking:
        return MethodChoice('particles', f'cells have no {", ".join(lacking)}')
    effects = effects_for(
        scene, forced, accuracy=replace(accuracy, method='cells'), horizon=horizon
    )
    if effects.any('freezes'):
        return MethodChoice('particles', 'cells take more time for lava that freezes')
    return MethodChoice('cells', 'the lava does not freeze, and cells take less time')
