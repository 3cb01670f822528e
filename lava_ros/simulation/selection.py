# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The choice of effects: which physics a scene calls for, by dimensionless numbers.

Every effect has a number that says how much it changes the flow, taken at the scene's own scales,
and a threshold below which leaving it out costs less than the stated error.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
import math

import numpy as np

from lava_ros import validation
from lava_ros.effects import EFFECTS, Effects, excluded_by, existing
from lava_ros.effects.effect import Effect
from lava_ros.effects.laws import heat_loss
from lava_ros.effects.scales import Scales
from lava_ros.scene import Scene, Terrain
from lava_ros.simulation.accuracy import Accuracy, expected_thickness
from lava_ros.simulation.resolution import HORIZON as HORIZON
from lava_ros.simulation.resolution import resolution_of


@dataclass(frozen=True)
class Decision:
    """An effect, on or off, and why.

    Attributes:
        name: Its name.
        effect: What it declares: what decides.
        value: The number; NaN when the material has no such effect.
        is_on: Whether the effect is on.
        is_forced: Whether a user said so.
        rival: The effect beside which it cannot be on, though its number calls for it; or empty.
    """

    name: str
    effect: Effect
    value: float
    is_on: bool
    is_forced: bool = False
    rival: str = ''

    @property
    def reason(self) -> str:
        """Why, in a few words."""
        if self.is_forced:
            return 'forced'
        if math.isnan(self.value):
            return 'the material has none'
        if math.isinf(self.effect.threshold):
            return 'only when asked for'
        sign = '>' if self.value > self.effect.threshold else '<='
        text = f'{self.effect.symbol} = {self.value:.2g} {sign} {self.effect.threshold:.2g}'
        return f'{text}, but not beside {self.rival}' if self.rival else text


def scales_of(
    scene: Scene, *, accuracy: Accuracy | None = None, horizon: float = HORIZON
) -> Scales:
    """Take the scales of a scene up to a horizon [s]; the accuracy is automatic when left out."""
    lava, terrain = scene.lava, scene.terrain
    accuracy = accuracy or Accuracy()
    resolution = resolution_of(scene, accuracy, horizon=horizon)
    temperature = max(
        (vent.temperature for vent in scene.vents), default=lava.reference_temperature
    )
    viscosity = lava.viscosity_at(temperature)
    # at the vent, where lava is hottest; a given thickness stands for lava that has no vent
    thickness = expected_thickness(scene)
    if not scene.vents and accuracy.thickness:
        thickness = accuracy.thickness
    steepest, typical = slopes_of(terrain)
    x0, y0, x1, y1 = terrain.extent
    slope = max(typical, thickness / (0.5 * math.hypot(x1 - x0, y1 - y0)))
    return Scales(
        scene=scene,
        temperature=temperature,
        end_temperature=_cooled(scene, temperature, thickness, horizon),
        thickness=thickness,
        viscosity=viscosity,
        slope=slope,
        steepest=steepest,
        relief=float(np.nanmax(terrain.elevation) - np.nanmin(terrain.elevation)),
        speed=lava.density * scene.gravity * thickness**2 * slope / (3.0 * viscosity),
        width=resolution.width,
        kernel_radius=accuracy.ratio * resolution.spacing,
        spacing=resolution.spacing,
        horizon=horizon,
    )


def slopes_of(terrain: Terrain) -> tuple[float, float]:
    """Largest and median slope (rise over run) between neighbouring cells with data."""
    largest, middle = 0.0, []
    for axis in (0, 1):
        rise = np.abs(np.diff(terrain.elevation, axis=axis)) / terrain.resolution
        known = rise[np.isfinite(rise)]
        if known.size:
            largest = max(largest, float(known.max()))
            middle.append(float(np.median(known)))
    return largest, math.hypot(*middle)


def _cooled(scene: Scene, temperature: float, thickness: float, horizon: float) -> float:
    """Temperature [K] of a column at rest after a time [s] of radiation and convection."""
    lava, ambient = scene.lava, scene.ambient_temperature
    capacity = lava.density * lava.specific_heat * thickness
    loss = heat_loss(scene)
    for _ in range(200):
        excess = temperature - ambient
        if excess <= 0.0:
            break
        rate = loss(temperature) / (capacity * excess)
        temperature = ambient + excess * math.exp(-rate * horizon / 200)
    return temperature


def decide(
    scene: Scene,
    overrides: Mapping[str, bool] | None = None,
    *,
    accuracy: Accuracy | None = None,
    horizon: float = HORIZON,
) -> tuple[Decision, ...]:
    """Decide about every effect.

    Args:
        scene: The scene.
        overrides: Effects switched on or off whatever the scene says, by name.
        accuracy: The resolution; automatic when left out.
        horizon: How far ahead is looked [s].

    Raises:
        LavaError: An override names no effect.
    """
    forced = validation.keys('effects', overrides or {}, allowed=EFFECTS)
    horizon = validation.number('horizon', horizon, above=0.0, unit='s')
    scales = scales_of(scene, accuracy=accuracy, horizon=horizon)
    decisions: dict[str, Decision] = {}
    there = existing(scene)
    for name, effect in EFFECTS.items():
        if effect.number is not None:
            value = effect.number(scales) if name in there else math.nan
            is_on = bool(forced.get(name, value > effect.threshold))
            decisions[name] = Decision(name, effect, value, is_on, name in forced)
    _settle(decisions)
    return tuple(decisions.values())


def _settle(decisions: dict[str, Decision]) -> None:
    """Leave one on of those that exclude each other: a forced one, else the first of them.

    Two laws of the same thing, one of which replaces the other, are the material's: what forces
    the wrong one is refused.
    """
    on = [item for item in decisions.values() if item.is_on]
    kept: list[Decision] = []
    for item in sorted(on, key=lambda item: not item.is_forced):
        rivals = [
            other.name
            for other in kept
            if excluded_by(item.name, other.name) and item.name not in other.effect.replaces
        ]
        if rivals and not item.is_forced:
            decisions[item.name] = replace(item, is_on=False, rival=rivals[0])
        else:
            kept.append(item)


def effects_for(
    scene: Scene,
    overrides: Mapping[str, bool] | None = None,
    *,
    accuracy: Accuracy | None = None,
    horizon: float = HORIZON,
) -> Effects:
    """Choose the effects a scene calls for; arguments and errors as of ``decide``."""
    decisions = decide(scene, overrides, accuracy=accuracy, horizon=horizon)
    chosen = {item.name: item.is_on for item in decisions}
    return Effects(**{**dict.fromkeys(EFFECTS, False), **chosen, **(overrides or {})})
