# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The choice of effects: the physics that a scene requires, by dimensionless numbers.

Every effect has a number that measures its influence on the flow, evaluated at the scene's own
scales, and a threshold below which leaving it out costs less than the stated error.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial
import math
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.effects import compatible, EFFECTS, Effects, excluded_by, reasons_without
from lava_ros.effects.column import normal_thickness
from lava_ros.effects.effect import Effect
from lava_ros.effects.heat import heat_loss
from lava_ros.effects.laws import Rheology
from lava_ros.effects.scales import Columns, Scales
from lava_ros.errors import LavaError
from lava_ros.scene import Scene, Terrain
from lava_ros.simulation.accuracy import Accuracy, expected_thickness, FORMULATIONS
from lava_ros.simulation.flow_kind import kind_of, TUBE_FED
from lava_ros.simulation.resolution import estimated_effects
from lava_ros.simulation.resolution import HORIZON as HORIZON
from lava_ros.simulation.setup.course import Course, course_of

#: Points of the cooling of columns at rest, and the last excess over the first.
_COOLING_POINTS, _MIN_EXCESS = 200, 1e-4

#: Minimum area of a flow that has left its vent, over the squared width of its course.
MIN_EXTENT = 0.4

#: Minimum emitted fraction of the volume at the horizon for numbers of a running simulation. Less
#: lava is not yet the flow, except where a single column decides.
MIN_EMITTED = 0.1

#: Heat flux of lava that loses none [W/m2].
_MIN_FLUX = 1e-12


@dataclass(frozen=True)
class Decision:
    """Decision about an effect, with its reason.

    Attributes:
        name: Name of the effect.
        effect: Its declaration, with number and threshold.
        value: The number; NaN if the material has no such effect.
        is_on: True if the effect is on.
        is_forced: True if a user has forced the decision.
        rival: Effect that excludes this one though its number is above the threshold; or empty.
        formulation: Formulation that switches the effect on or off; or empty.
        is_lacking: True if the method of the accuracy has no such effect, and no user forces it.
        measured: Largest number that the reviews of a run have measured; NaN before the first.
        since: Simulated time at which a run has switched it on [s]; NaN unless it was off at
            first.
        missing: Reason why the scene has no such effect, or empty; ``value`` is then NaN.
    """

    name: str
    effect: Effect
    value: float
    is_on: bool
    is_forced: bool = False
    rival: str = ''
    formulation: str = ''
    is_lacking: bool = False
    measured: float = math.nan
    since: float = math.nan
    missing: str = ''

    @property
    def largest(self) -> float:
        """Largest number, expected or measured while the effect was off."""
        return float(np.fmax(self.value, self.measured))

    @property
    def is_missed(self) -> bool:
        """True if the flow needs the effect, and the method does not have it."""
        return self.is_lacking and self.largest > self.effect.threshold

    @property
    def cost(self) -> float:
        """Maximum fraction of the inundated area that omitting the effect changes; 0 if it is on.

        It is also 0 if the scene has no such effect, and for effects that are on only by request.
        """
        return self.effect.cost * self._excess

    @property
    def thickness_cost(self) -> float:
        """Maximum fraction of the mean thickness that omitting the effect changes, as ``cost``."""
        return self.effect.thickness_cost * self._excess

    @property
    def _excess(self) -> float:
        """The largest number over the threshold; 0 without an error."""
        is_left_off = not (self.is_on or math.isnan(self.value))
        if self.rival and EFFECTS[self.rival].kind:
            # the rival has the physics of this effect for its kind of flow
            return 0.0
        if not is_left_off or self.effect.threshold in (0.0, math.inf):
            return 0.0
        return self.largest / self.effect.threshold

    @property
    def reason(self) -> str:
        """Reason for the decision, in a few words."""
        if self.formulation:
            return f'the formulation {self.formulation} {_relation(self.name, self.is_on)}'
        if self.is_forced:
            return 'forced'
        if self.missing:
            return self.missing
        if math.isinf(self.effect.threshold):
            return 'only when asked for'
        is_switched_on = not math.isnan(self.since)
        uses_largest = is_switched_on or self.rival or self.is_missed
        value = self.largest if uses_largest else self.value
        sign = '>' if value > self.effect.threshold else '<='
        text = f'{self.effect.symbol} = {value:.2g} {sign} {self.effect.threshold:.2g}'
        if self.rival:
            return f'{text}, but excluded by {self.rival}'
        if self.is_missed:
            return f'{text}, but only method particles has {self.name}'
        if is_switched_on:
            return f'{text} since {self.since:.0f} s, {self.value:.2g} expected'
        is_known = not (self.is_on or math.isnan(self.measured))
        return f'{text}, measured {self.measured:.2g}' if is_known else text

    def in_run(self, effects: Effects, measured: float, since: float) -> Decision:
        """Return the decision made before the first step, with the results of a run.

        Args:
            effects: The effects that are on in the run.
            measured: Largest number measured while the effect was off; NaN without one.
            since: Simulated time at which the run has switched it on [s]; NaN unless it was off.
        """
        name, rival, is_on = self.name, '', self.name in effects
        if not is_on and np.fmax(self.value, measured) > self.effect.threshold:
            rival = next((other for other in effects if excluded_by(name, other)), '')
        return replace(self, is_on=is_on, measured=measured, since=since, rival=rival)

    def as_dict(self) -> dict[str, Any]:
        """Return the decision as plain data; None for numbers that JSON cannot represent."""
        effect = self.effect
        numbers = {
            'value': self.value, 'measured': self.measured, 'threshold': effect.threshold,
            'on_since_s': self.since,
        }
        return {
            'effect': self.name,
            'title': effect.title,
            'on': self.is_on,
            'forced': self.is_forced,
            'number': effect.symbol,
            **{name: value if math.isfinite(value) else None for name, value in numbers.items()},
            'reason': self.reason,
            'without_it': effect.admits,
            # at the threshold; proportional to the number below it
            'footprint_without_it': effect.cost,
            'thickness_without_it': effect.thickness_cost,
            'source': effect.source,
        }


def expected_scales(
    scene: Scene,
    forced: Mapping[str, bool] | None = None,
    *,
    accuracy: Accuracy | None = None,
    horizon: float = HORIZON,
) -> Scales:
    """Return the scales of a flow before its first step.

    They follow from its expected course (``course_of``). Without a discharge each cell of the
    terrain counts as a column, with the thickness of the accuracy or that of a flow of 1 m3/s.

    Args:
        scene: The scene.
        forced: Effects that a user has switched on or off, by name.
        accuracy: The resolution; automatic if omitted.
        horizon: Time span to consider [s].
    """
    accuracy = accuracy or Accuracy()
    effects = estimated_effects(scene, accuracy, forced, horizon=horizon)
    course = course_of(scene, effects, horizon=horizon)
    if course is None:
        z, area = scene.terrain.elevation, math.inf
        columns = _still_columns(scene, accuracy, effects)
        fall = float(np.nanmax(z) - np.nanmin(z))
    else:
        # lava that leaves the map is part of the volume
        area = course.emitted / course.thickness_of(course.emitted)
        columns, fall = course.columns, course.fall
    return scales_of(
        scene, effects, columns, fall=fall, duration=horizon,
        is_extended=has_left_its_vent(area, course),
    )


def has_left_its_vent(area: float, course: Course | None) -> bool:
    """Return True if a flow of an area [m2] is about as long as its course is wide."""
    return course is None or area >= MIN_EXTENT * course.width**2


def scales_of(scene: Scene, effects: Effects, columns: Columns, **others: Any) -> Scales:
    """Complete the scales of columns of lava; ``others`` as for ``Scales.on_demand``."""
    temperature = max(
        (vent.temperature for vent in scene.vents), default=scene.lava.reference_temperature
    )
    return Scales.on_demand(
        scene=scene,
        rheology=Rheology(scene.lava, effects),
        columns=columns,
        vent_temperature=temperature,
        # it depends on the time over the thickness only
        rest_temperature=lambda: np.interp(
            others['duration'] / columns.normal_thickness,
            *_cooling_curve(scene, effects, temperature),
        ),
        age_of_crust=lambda: _age_of_crust(scene, others['duration']),
        **others,
    )


def _age_of_crust(scene: Scene, horizon: float) -> float:
    """Return one over the number of the crust of the expected flow, 0 unless it is tube-fed."""
    kind = kind_of(scene, horizon)
    return 1.0 / kind.crust if kind is not None and kind.name == TUBE_FED else 0.0


def _including(scales: Scales, name: str) -> Scales:
    """Return scales whose estimates also include an effect, for its own number."""
    effects = scales.rheology.effects
    if name in effects:
        return scales
    kept = ('fall', 'is_extended', 'emitted')
    return scales_of(
        scales.scene,
        compatible([name, *effects]),
        scales.columns,
        **{item: partial(getattr, scales, item) for item in kept},
        duration=scales.duration,
        is_measured=scales.is_measured,
    )


def _still_columns(scene: Scene, accuracy: Accuracy, effects: Effects) -> Columns:
    """Return columns of lava on every cell of a terrain, for a scene without a discharge."""
    terrain, lava = scene.terrain, scene.lava
    thickness = accuracy.thickness or expected_thickness(scene)
    x0, y0, x1, y1 = terrain.extent
    ground = slopes_of(terrain)
    slope = np.maximum(ground, thickness / (0.5 * math.hypot(x1 - x0, y1 - y0)))
    viscosity = Rheology(lava, effects).viscosity_at(lava.reference_temperature)
    one = np.ones_like(slope)
    return Columns(
        volume=one,
        thickness=thickness * one,
        normal_thickness=normal_thickness(thickness * one, ground, effects),
        slope=slope,
        ground_slope=ground,
        temperature=lava.reference_temperature * one,
        speed=lava.density * scene.gravity * thickness**2 * slope / (3.0 * viscosity),
        width=math.nan * one,
    )


def slopes_of(terrain: Terrain) -> np.ndarray:
    """Return slopes (rise over run) at the cells whose neighbours have data, shape [cells]."""
    z = terrain.elevation
    rise = [np.abs(np.diff(z, axis=axis)) / terrain.resolution for axis in (0, 1)]
    steep = np.hypot(rise[0][:, :-1], rise[1][:-1])
    steep = steep[np.isfinite(steep)]
    return steep if steep.size else np.zeros(1)


@lru_cache(maxsize=8)
def _cooling_curve(
    scene: Scene, effects: Effects, temperature: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return times over thickness [s/m], and temperatures [K] of columns at rest after them."""
    ambient = scene.ambient_temperature
    if temperature <= ambient:
        return np.zeros(1), np.array([temperature])
    capacity, loss = scene.lava.density * scene.lava.specific_heat, heat_loss(scene, effects)
    excess = (temperature - ambient) * np.geomspace(1.0, _MIN_EXCESS, _COOLING_POINTS)
    flux = np.array([loss(ambient + value) for value in excess.tolist()])
    # d(time / thickness) = -capacity / flux d(excess) = -slowness d(log excess)
    slowness = capacity * excess / np.maximum(flux, _MIN_FLUX)
    steps = -np.diff(np.log(excess)) * 0.5 * (slowness[1:] + slowness[:-1])
    return np.concatenate([[0.0], np.cumsum(steps)]), ambient + excess


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
        overrides: Effects to switch on or off regardless of the scene, by name.
        accuracy: The resolution; automatic if omitted.
        horizon: Time span to consider [s].

    Raises:
        LavaError: If an override is not the name of an effect, or contradicts the formulation.
    """
    forced = validation.keys('effects', overrides or {}, allowed=EFFECTS)
    horizon = validation.number('horizon', horizon, above=0.0, unit='s')
    scales = expected_scales(scene, forced, accuracy=accuracy, horizon=horizon)
    return decide_by(scales, forced, accuracy or Accuracy())


def implied_effects(accuracy: Accuracy, forced: Mapping[str, bool]) -> dict[str, bool]:
    """Return the effects that the formulation switches on or off, by name.

    Args:
        accuracy: The resolution.
        forced: Effects that a user switches on or off, by name.

    Raises:
        LavaError: If a forced effect contradicts the formulation.
    """
    chosen = FORMULATIONS[accuracy.formulation]
    implied = {name: is_on for name, is_on in chosen.items() if name in EFFECTS}
    for used in [name for name, is_on in implied.items() if is_on]:
        implied |= {name: False for name in EFFECTS if excluded_by(name, used)}
    for name, is_on in implied.items():
        if forced.get(name, is_on) != is_on:
            expected = f'{str(is_on).lower()} with accuracy.formulation {accuracy.formulation}, '
            expected += f'which {_relation(name, is_on)}'
            raise LavaError(f'effects.{name}', forced[name], expected)
    return implied


def _relation(name: str, is_on: bool) -> str:
    """Return what a formulation has to do with an effect, as a verb and its object."""
    return f'{"uses" if is_on else "has no"} {name}'


def decide_by(
    scales: Scales,
    forced: Mapping[str, bool],
    accuracy: Accuracy,
    *,
    names: Iterable[str] = EFFECTS,
) -> tuple[Decision, ...]:
    """Decide about effects by the scales of a flow.

    Args:
        scales: The scales.
        forced: Effects to switch on or off regardless of the flow, by name.
        accuracy: The resolution, whose formulation may switch effects on or off.
        names: The effects to decide about.

    Raises:
        LavaError: If a forced effect contradicts the formulation.
    """
    implied, reasons = implied_effects(accuracy, forced), reasons_without(scales.scene)
    decisions: dict[str, Decision] = {}
    names = set(names)
    for name, effect in EFFECTS.items():
        if effect.number is not None and name in names:
            missing, value = reasons.get(name, ''), math.nan
            is_early = scales.emitted < MIN_EMITTED and effect.fraction < 1.0
            if not missing and (is_early or (effect.needs_extent and not scales.is_extended)):
                # the number would be that of another flow
                value = 0.0
            elif not missing:
                own = effect.number(_including(scales, name))
                value = scales.columns.quantile(own, effect.fraction)
            is_on = implied.get(name, bool(forced.get(name, value > effect.threshold)))
            formulation = accuracy.formulation if name in implied else ''
            is_free = not formulation and name not in forced
            lacks = is_free and accuracy.method == 'cells' and effect.needs_particles
            decisions[name] = Decision(
                name, effect, value, is_on and not lacks, name in forced,
                formulation=formulation, is_lacking=lacks, missing=missing,
            )
    _settle(decisions)
    return tuple(decisions.values())


def _settle(decisions: dict[str, Decision]) -> None:
    """Keep one of the effects that exclude each other.

    It is a forced one, or else one of a single kind of flow, or else the first.

    Two laws for the same quantity, one of which replaces the other, depend on the material:
    forcing the wrong one is an error elsewhere.
    """
    on = [item for item in decisions.values() if item.is_on]
    kept: list[Decision] = []
    for item in sorted(on, key=lambda item: (
        not (item.is_forced or item.formulation), not item.effect.kind
    )):
        rivals = [
            other.name
            for other in kept
            if excluded_by(item.name, other.name) and item.name not in other.effect.replaces
        ]
        if rivals and not item.is_forced:
            decisions[item.name] = replace(item, is_on=False, rival=rivals[0])
        else:
            kept.append(item)


def warnings_of(decisions: Iterable[Decision]) -> list[str]:
    """Return a warning about each effect that the flow needs and the method does not have."""
    return [
        f'the flow needs {item.name} ({item.reason}); without it the inundated area changes by up '
        f'to {100.0 * item.cost:.2g} %'
        for item in decisions if item.is_missed
    ]


def effects_for(
    scene: Scene,
    overrides: Mapping[str, bool] | None = None,
    *,
    accuracy: Accuracy | None = None,
    horizon: float = HORIZON,
) -> Effects:
    """Return the effects that a scene requires; arguments and errors as for ``decide``."""
    decisions = decide(scene, overrides, accuracy=accuracy, horizon=horizon)
    chosen = {item.name: item.is_on for item in decisions}
    return Effects(**{**dict.fromkeys(EFFECTS, False), **chosen, **(overrides or {})})
