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

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
import math

import numpy as np

from lava_ros import validation
from lava_ros.accuracy import Accuracy, expected_thickness
from lava_ros.effects import Effects
from lava_ros.lava import Lava, STEFAN_BOLTZMANN
from lava_ros.resolution import HORIZON as HORIZON
from lava_ros.resolution import resolution_of
from lava_ros.scene import Scene, Terrain

#: Slope of the side of what freezes, in thicknesses over kernel radii: a column freezes into a
#: quadratic B-spline at least 0.65 / 1.5 of the radius wide, and the step that a layer ends in,
#: smoothed with that, is as steep as its greatest value, 0.75 thicknesses over its width.
FROZEN_SIDE = 0.75 * 1.5 / 0.65

#: Share of the way to the solidus, cooled through up to the horizon, above which lava may freeze:
#: what is thinner than expected is colder.
FREEZES = 0.9

_NAMES = tuple(item.name for item in fields(Effects))


@dataclass(frozen=True)
class Scales:
    """The scales of a scene, from which every number is made.

    Attributes:
        lava: The material.
        gravity: Acceleration of gravity [m/s2].
        temperature: Temperature of the hottest vent, or the material's reference [K].
        ambient: Temperature of the air [K].
        end_temperature: What a column of the expected thickness has cooled to at the horizon [K].
        thickness: Expected thickness h [m].
        viscosity: Viscosity at ``temperature`` [Pa s].
        slope: Typical slope of the flow's surface, rise over run: that of the terrain, or the
            flow's thickness over its reach where that is more.
        steepest: Largest slope of the terrain.
        relief: Highest less lowest elevation [m].
        speed: Depth-averaged speed of a sheet of that thickness on that slope [m/s].
        width: Width of the flow [m], NaN without a discharge.
        kernel_radius: Radius of the smoothing kernel l [m].
        spacing: Distance of particles [m].
        horizon: How far ahead is looked [s].
    """

    lava: Lava
    gravity: float
    temperature: float
    ambient: float
    end_temperature: float
    thickness: float
    viscosity: float
    slope: float
    steepest: float
    relief: float
    speed: float
    width: float
    kernel_radius: float
    spacing: float
    horizon: float

    @property
    def warmth(self) -> float:
        """Temperature above that of the air [K], at least 1 K: lava without vents may be cold."""
        return max(self.temperature - self.ambient, 1.0)


@dataclass(frozen=True)
class Criterion:
    """What decides about an effect.

    Attributes:
        effect: Name of the effect, a field of ``Effects``.
        title: What it is, in a few words.
        symbol: The number, as a formula.
        number: Computes it; above ``threshold`` the effect is on.
        threshold: Where the effect begins to matter; infinite if it is only on when asked for.
        admits: What leaving the effect out below the threshold costs.
        source: Where threshold and cost are from.
        exists: Whether the material has such a thing at all.
    """

    effect: str
    title: str
    symbol: str
    number: Callable[[Scales], float]
    threshold: float
    admits: str
    source: str
    exists: Callable[[Lava], bool] = lambda lava: True


@dataclass(frozen=True)
class Decision:
    """An effect, on or off, and why.

    Attributes:
        criterion: What decides.
        value: The number; NaN when the material has no such effect.
        is_on: Whether the effect is on.
        is_forced: Whether a user said so.
        rival: The effect beside which it cannot be on, though its number calls for it; or empty.
    """

    criterion: Criterion
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
        if math.isinf(self.criterion.threshold):
            return 'only when asked for'
        sign = '>' if self.value > self.criterion.threshold else '<='
        text = f'{self.criterion.symbol} = {self.value:.2g} {sign} {self.criterion.threshold:.2g}'
        return f'{text}, but not beside {self.rival}' if self.rival else text


def scales_of(
    scene: Scene, *, accuracy: Accuracy | None = None, horizon: float = HORIZON
) -> Scales:
    """Take the scales of a scene.

    Args:
        scene: The scene.
        accuracy: The resolution; automatic when left out.
        horizon: How far ahead is looked [s].
    """
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
        lava=lava,
        gravity=scene.gravity,
        temperature=temperature,
        ambient=scene.ambient_temperature,
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
    for _ in range(200):
        square = temperature**2 + ambient**2
        loss = lava.emissivity * STEFAN_BOLTZMANN * square * (temperature + ambient)
        rate = (loss + lava.convection) / capacity
        temperature = ambient + (temperature - ambient) * math.exp(-rate * horizon / 200)
    return temperature


def _warmth(scales: Scales, share: float) -> float:
    """What a share of a column's heat matters: itself, or a third of what it does to viscosity.

    1 % of the number is 1 % of the temperature, or 3 % of the viscosity and of the speed.
    """
    lava = scales.lava
    change = share * scales.warmth
    colder = max(scales.temperature - change, scales.ambient)
    ratio = lava.viscosity_at(colder) / scales.viscosity
    return max(share, abs(math.log(ratio)) / 3.0)


def _steepness(scales: Scales) -> float:
    """Largest slope of the ground, which what freezes becomes a part of."""
    if scales.lava.solidus <= 0.0 or _freezing(scales) <= FREEZES:
        return scales.steepest
    return max(scales.steepest, FROZEN_SIDE * scales.thickness / scales.kernel_radius)


def _drop(scales: Scales) -> float:
    """Share of its heat that a column loses up to the horizon."""
    change = scales.temperature - scales.end_temperature
    return _warmth(scales, change / scales.warmth)


def _lateral(scales: Scales) -> float:
    """Thickness over half of the flow's width, at the viscosity between that of vent and horizon.

    Half of the width is the shortest wave of a flow; where the kernel is wider, or there is no
    discharge, it is the kernel's radius.
    """
    lava = scales.lava
    end = lava.viscosity_at(max(scales.end_temperature, lava.solidus))
    # lava a thousand times as stiff has all but stopped
    ratio = min(end / scales.viscosity, 1e3)
    # the expected thickness is as mu^(1/4), and the geometric mean is the square root of a product
    half = np.fmax(0.5 * scales.width, scales.kernel_radius)
    return float(scales.thickness * ratio**0.125 / half)


def _stiffening(scales: Scales) -> float:
    """Logarithm of the largest ratio of viscosities: by cooling, or of vents and reference."""
    lava = scales.lava
    end = lava.viscosity_at(scales.end_temperature) / lava.viscosity
    return max(abs(math.log(end)), abs(math.log(scales.viscosity / lava.viscosity)))


def _bingham(scales: Scales) -> float:
    lava = scales.lava
    weight = lava.density * scales.gravity * scales.thickness * scales.slope
    strength = max(
        lava.yield_strength_at(scales.temperature), lava.yield_strength_at(scales.end_temperature)
    )
    return strength / weight


def _relaxation(scales: Scales) -> float:
    """Relaxation time rho h^2 / (3 mu) of the speed over the time u covers the run-out h / s."""
    momentum = scales.lava.density * scales.speed * scales.thickness
    return momentum * scales.slope / (3.0 * scales.viscosity)


def _ground(scales: Scales) -> float:
    """Heat that a half-space takes up to the horizon over that of the column."""
    lava = scales.lava
    taken = 2.0 * lava.ground_conductivity * math.sqrt(
        scales.horizon / (math.pi * lava.ground_diffusivity)
    )
    share = taken / (lava.density * lava.specific_heat * scales.thickness)
    return _warmth(scales, min(share, 1.0))


def _conduction(scales: Scales) -> float:
    """Distance that heat goes up to the horizon over the distance of particles."""
    lava = scales.lava
    diffusivity = lava.conductivity / (lava.density * lava.specific_heat)
    return math.sqrt(diffusivity * scales.horizon) / scales.spacing


def _viscous_heating(scales: Scales) -> float:
    """Warming by a fall through the whole relief over the heat of the lava."""
    warming = scales.gravity * scales.relief / scales.lava.specific_heat
    return _warmth(scales, warming / scales.warmth)


def _latent(scales: Scales) -> float:
    lava = scales.lava
    if scales.end_temperature >= lava.liquidus:
        return 0.0
    return lava.latent_heat / (lava.specific_heat * scales.warmth)


def _freezing(scales: Scales) -> float:
    """How far towards the solidus a column cools up to the horizon."""
    lava = scales.lava
    above = max(scales.temperature - lava.solidus, 1.0)
    return (scales.temperature - scales.end_temperature) / above


#: Every criterion, in the order in which they are shown.
CRITERIA: tuple[Criterion, ...] = (
    Criterion(
        'steep', 'thickness along steep slopes', 'slope', _steepness,
        math.tan(math.radians(5.0)), 'up to 1.5 % of the speed: 1 - cos^4',
        'docs/MODEL.md, steep slopes; the sides of frozen lava count',
    ),
    Criterion(
        'yielding', 'yield strength', 'Bingham number', _bingham, 0.01,
        '1.5 % of the speed: 3/2 of the number', 'exact sheet, verification/exact/rheology.py',
        lambda lava: lava.yield_strength > 0.0,
    ),
    Criterion(
        'power_law', 'strain rate as a power of stress', '|n - 1|',
        lambda scales: abs(scales.lava.flow_index - 1.0), 0.0, 'nothing', 'identity at n = 1',
        lambda lava: lava.flow_index != 1.0,
    ),
    Criterion(
        'arrhenius', 'viscosity by temperature (Arrhenius)', 'ln of the viscosity ratio',
        _stiffening, 0.03, '3 % of the speed', 'speed is as 1 / mu',
        lambda lava: lava.arrhenius > 0.0 and not lava.is_vft,
    ),
    Criterion(
        'vft', 'viscosity by temperature (VFT)', 'B', lambda scales: scales.lava.vft_b, 0.0,
        'nothing: it is the viscosity', 'Giordano et al. 2008',
        lambda lava: lava.is_vft,
    ),
    Criterion(
        'crystals', 'crystals stiffen lava', 'crystal fraction at the horizon',
        lambda scales: scales.lava.crystal_fraction(scales.end_temperature), 0.01,
        '4 % of the speed: 2.5 fraction / 0.6', 'Einstein-Roscoe',
        lambda lava: lava.crystal_law != 'none' and lava.crystals > 0.0,
    ),
    Criterion(
        'inertia', 'inertia', 'relaxation over run-out time', _relaxation, 0.1,
        '2 % of the front: a fifth of the number', 'point source on a slope with and without',
    ),
    Criterion(
        'green', 'lateral viscous stress, as a sum', 'h / l', _lateral, math.inf,
        'nothing: helmholtz is the better form', 'docs/benchmarks/choice_lateral.csv',
    ),
    Criterion(
        'helmholtz', 'lateral viscous stress, solved', 'h / half-width', _lateral, 0.25,
        '5 % of the speed of the shortest waves, (pi h / 2 l)^2 / 3; 1.4 % of a footprint',
        'docs/accuracy, lateral stress; docs/benchmarks/choice_lateral.csv',
    ),
    Criterion(
        'cooling', 'radiation and convection', 'heat lost', _drop, 0.01,
        '1 % of the temperature or 3 % of the speed', 'column at rest',
        lambda lava: (lava.emissivity > 0.0 or lava.convection > 0.0) and not lava.crust,
    ),
    Criterion(
        'crust', 'radiation from a crust', 'heat lost by a bare surface', _drop, 0.01,
        '1 % of the temperature or 3 % of the speed', 'column at rest',
        lambda lava: lava.crust and (lava.emissivity > 0.0 or lava.convection > 0.0),
    ),
    Criterion(
        'ground', 'heat into the ground', 'heat taken', _ground, 0.01,
        '1 % of the temperature or 3 % of the speed', 'half-space, verification/exact/heat.py',
        lambda lava: lava.ground_conductivity > 0.0,
    ),
    Criterion(
        'viscous_heating', 'viscous heating', 'heat of the fall', _viscous_heating, 0.01,
        '1 % of the temperature or 3 % of the speed', 'energy of the fall',
    ),
    Criterion(
        'latent_heat', 'latent heat', 'L / c over the heat', _latent, 0.01,
        '1 % of the temperature', 'heat balance',
        lambda lava: lava.latent_heat > 0.0,
    ),
    Criterion(
        'conduction', 'heat from column to column', 'reach of heat over spacing', _conduction, 0.3,
        '1 % of a step in temperature two spacings away', 'error function',
        lambda lava: lava.conductivity > 0.0,
    ),
    Criterion(
        'solidification', 'columns that freeze become ground', 'share of the way to the solidus',
        _freezing, FREEZES, 'nothing freezes before the horizon', 'column at rest',
        lambda lava: lava.solidus > 0.0,
    ),
)


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
    forced = validation.keys(
        'effects', {} if overrides is None else overrides, allowed=_NAMES
    )
    horizon = validation.number('horizon', horizon, above=0.0, unit='s')
    scales = scales_of(scene, accuracy=accuracy, horizon=horizon)
    decisions: dict[str, Decision] = {}
    for criterion in CRITERIA:
        name = criterion.effect
        value = criterion.number(scales) if criterion.exists(scene.lava) else math.nan
        is_on = bool(forced.get(name, value > criterion.threshold))
        decisions[name] = Decision(criterion, value, is_on, name in forced)
    _settle(decisions)
    return tuple(decisions.values())


def _settle(decisions: dict[str, Decision]) -> None:
    """Leave one on of those that exclude each other: a forced one, else the first of them.

    The lateral stress is part of the local balance, which inertia replaces; the Green's function
    and the solve are two forms of it.
    """
    rivals = [decisions[name] for name in ('inertia', 'green', 'helmholtz')]
    on = [item for item in rivals if item.is_on]
    first = next((item for item in on if item.is_forced), on[0] if on else None)
    for item in on:
        name = item.criterion.effect
        if item is not first and not item.is_forced and first is not None:
            rival = first.criterion.effect
            decisions[name] = replace(item, is_on=False, rival=rival)


def effects_for(
    scene: Scene,
    overrides: Mapping[str, bool] | None = None,
    *,
    accuracy: Accuracy | None = None,
    horizon: float = HORIZON,
) -> Effects:
    """Choose the effects a scene calls for; arguments and errors as of ``decide``."""
    decisions = decide(scene, overrides, accuracy=accuracy, horizon=horizon)
    chosen = {item.criterion.effect: item.is_on for item in decisions}
    return Effects(**{**dict.fromkeys(_NAMES, False), **chosen, **(overrides or {})})
