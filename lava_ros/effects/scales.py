# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Scales of a flow, from which the numbers that select effects are computed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
import math
from typing import Any, TYPE_CHECKING, TypeVar

import numpy as np

from lava_ros.effects.protocols import Lava, Rheology, Scene

#: Conductivity of a crust if the lava has none [W/(m K)].
CRUST_CONDUCTIVITY = 2.0

#: Interval of the temperatures at which a law is evaluated [K]; in between its logarithm is
#: interpolated.
_STEP = 5.0

#: The ends of the temperature range are multiples of this [K], so that tables can be reused.
_RANGE = 50.0


def thickness_change(speed: float) -> float:
    """Return the maximum fraction of a mean thickness that a change of the speed changes.

    The thickness of a flow is proportional to a power of its mobility: -1/3 down a plane and
    between walls, -1/4 in a valley and on level ground, and -1/2 where walls and length confine
    the flow.
    """
    return 0.5 * speed


def footprint_change(speed: float) -> float:
    """Return the maximum fraction of an inundated area that a change of the speed changes.

    In a valley with evenly rising sides the length of a flow is proportional to the root of its
    mobility k, and its width to k^(-1/4): one outline is longer by half of the change, the other
    is wider by a quarter. On a plane and between walls the change is less (docs/MODEL.md).
    """
    return 0.75 * speed


@lru_cache(maxsize=64)
def _logarithms(
    law: Callable[[float], float], low: float, high: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return temperatures [K] of a range and the logarithms of a law there."""
    nodes = np.maximum(np.arange(low, high + 0.5 * _STEP, _STEP), 1.0)
    return nodes, np.log([max(law(float(node)), 1e-300) for node in nodes])


def volume_quantile(values: np.ndarray, volume: np.ndarray, fraction: float) -> float:
    """Return the value that a fraction of the volume does not exceed; shapes [columns]."""
    order = np.argsort(values)
    total = np.cumsum(volume[order], dtype=np.float64)
    index = int(np.searchsorted(total, fraction * total[-1]))
    return float(values[order[min(index, len(order) - 1)]])


_Kind = TypeVar('_Kind', bound='_OnDemand')


class _OnDemand:
    """Base of a dataclass whose fields may be computed when they are first read."""

    @classmethod
    def on_demand(cls: type[_Kind], **values: Any) -> _Kind:
        """Return an object whose fields are values, or functions that compute them."""
        new = cls.__new__(cls)
        known = {name: value for name, value in values.items() if not callable(value)}
        vars(new).update(known, _functions=values)
        return new

    if not TYPE_CHECKING:

        def __getattr__(self, name):
            """Compute a field."""
            if name not in vars(self).get('_functions', ()):
                raise AttributeError(name)
            return vars(self).setdefault(name, self._functions[name]())


@dataclass(frozen=True)
class Columns(_OnDemand):
    """Columns of lava, either expected or of a running simulation.

    Attributes:
        volume: Their volume [m3], float64, shape [columns] like all arrays.
        thickness: Vertical thickness h [m].
        normal_thickness: Thickness across the flow d [m] (``column.py``).
        slope: Slope of the lava's surface, rise over run.
        ground_slope: Slope of the ground, rise over run.
        temperature: Temperature [K].
        speed: Depth-averaged speed [m/s].
        width: Width of the flow [m], NaN where it is unknown.
    """

    volume: np.ndarray
    thickness: np.ndarray
    normal_thickness: np.ndarray
    slope: np.ndarray
    ground_slope: np.ndarray
    temperature: np.ndarray
    speed: np.ndarray
    width: np.ndarray

    def quantile(self, values: np.ndarray | float, fraction: float) -> float:
        """Return the value that a fraction of the volume does not exceed.

        Args:
            values: One for each column, shape [columns], or one for all.
            fraction: Fraction of the volume, 0 to 1.
        """
        return volume_quantile(np.broadcast_to(values, self.volume.shape), self.volume, fraction)


@dataclass(frozen=True)
class Scales(_OnDemand):
    """The scales of a flow.

    Attributes:
        scene: The scene.
        rheology: Laws of flow with the effects that estimates include (``effects.considered``).
        columns: Columns of lava.
        vent_temperature: Temperature of the hottest vent, or the material's reference [K].
        rest_temperature: Temperature of each column after ``duration`` of radiation and convection
            from its bare surface at rest [K], shape [columns].
        fall: Largest difference of elevation along the flow [m].
        duration: Time from the start of the eruption to the horizon [s].
        is_extended: True if the flow has left its vent.
        age_of_crust: Time in which the expected flow moves by its own thickness over the time in
            which a crust forms, 1 / Psi, if its kind is tube-fed; otherwise 0
            (``simulation/flow_kind.py``).
        emitted: Fraction of the volume at the horizon that has been emitted.
        is_measured: True if the columns are those of a running simulation.
    """

    scene: Scene
    rheology: Rheology
    columns: Columns
    vent_temperature: float
    rest_temperature: np.ndarray
    fall: float
    duration: float
    is_extended: bool
    age_of_crust: float
    emitted: float = 1.0
    is_measured: bool = False

    @property
    def lava(self) -> Lava:
        """The material."""
        return self.scene.lava

    @property
    def warmth(self) -> float:
        """Temperature above that of the air [K], at least 1 K: lava without vents may be cold."""
        return max(self.vent_temperature - self.scene.ambient_temperature, 1.0)

    @cached_property
    def viscosity(self) -> np.ndarray:
        """Viscosity of each column [Pa s]."""
        return self.law(self.rheology.viscosity_at, self.columns.temperature)

    @cached_property
    def stress(self) -> np.ndarray:
        """Shear stress at the base of each column [Pa]: rho g h s cos^2 b, for the slope s."""
        columns = self.columns
        stress = self.lava.density * self.scene.gravity * columns.slope
        return stress * columns.normal_thickness**2 / columns.thickness

    @cached_property
    def heat_capacity(self) -> np.ndarray:
        """Heat capacity of each column per area of its surface [J/(m2 K)]."""
        return self.lava.density * self.lava.specific_heat * self.columns.normal_thickness

    def law(self, law: Callable[[float], float], temperature: np.ndarray) -> np.ndarray:
        """Evaluate a law whose values are positive at many temperatures [K]."""
        low = math.floor(float(temperature.min()) / _RANGE) * _RANGE
        high = math.ceil(float(temperature.max()) / _RANGE) * _RANGE
        return np.exp(np.interp(temperature, *_logarithms(law, low, high)))

    @property
    def lateral(self) -> np.ndarray:
        """Thickness over half of the flow's width, its shortest wave; 0 where it is unknown."""
        return self.over_half_width(self.columns.thickness)

    def over_half_width(self, length: np.ndarray | float) -> np.ndarray:
        """Return a length [m] over half of the flow's width; 0 where the width is unknown."""
        width = self.columns.width
        is_known = width > 0.0
        return np.where(is_known, 2.0 * length / np.where(is_known, width, 1.0), 0.0)

    @property
    def freezing(self) -> np.ndarray:
        """Fraction of the way to the solidus by which each column has cooled.

        A running simulation has the temperatures; before it, columns count as at rest.
        """
        above = max(self.vent_temperature - self.lava.solidus, 1.0)
        if self.is_measured:
            return (self.vent_temperature - self.columns.temperature) / above
        return (self.vent_temperature - self.rest_temperature) / above

    @property
    def heat_lost(self) -> np.ndarray:
        """Effect of the fraction of its heat that a column at rest loses up to the horizon."""
        return self.matters((self.vent_temperature - self.rest_temperature) / self.warmth)

    def matters(self, fraction: np.ndarray | float) -> np.ndarray:
        """Return the effect of a fraction of a column's heat: itself, or its effect on the flow.

        1 % of the number is 1 % of the temperature, or 3 % of the viscosity and of the speed, or a
        change of the yield strength that changes as much of the inundated area.
        """
        fraction = np.atleast_1d(fraction)
        ambient = self.scene.ambient_temperature
        colder = np.maximum(self.vent_temperature - fraction * self.warmth, ambient)
        largest = fraction
        # the area of lava that stops is inversely proportional to its yield strength
        strong = 1.0 / footprint_change(1.0)
        for law, weight in (
            (self.rheology.viscosity_at, 1.0), (self.rheology.strength_at, strong)
        ):
            at_vent = law(self.vent_temperature)
            if at_vent > 0.0:
                ratio = self.law(law, colder) / at_vent
                largest = np.maximum(largest, weight * np.abs(np.log(ratio)) / 3.0)
        return largest
