# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Temperature and age of the lava on cells, and the ground that it has become."""

from dataclasses import dataclass, fields
import math
from typing import Any

import warp as wp

from lava_ros.effects import Effects
from lava_ros.effects.heat import heat_of, warming_function
from lava_ros.effects.laws import law_of
from lava_ros.scene import Scene
from lava_ros.simulation.backend.memory import shared_array
from lava_ros.simulation.cells.state import CellState, EDGE, Heat, maps_of
from lava_ros.simulation.particles.terrain import ringed_heights

_REAL = wp.float32


@dataclass(eq=False)
class HeatState:
    """Temperature and age of the lava on cells, and the ground that it has become.

    Attributes:
        law: Constants of the laws of flow.
        constants: Constants of the heat balance.
        diffusivity: Thermal diffusivity of lava [m2/s], with ``conduction``.
        emerging: Minimum thickness of the columns that lava forms as it comes out of a vent [m].
        temperature: Temperature [K], float64, a map.
        emission_time: Mean time of emission [s], float64, a map.
        vent_temperature: Temperature of the lava that comes out [K], float32, a map.
        former: Thickness at the end of the latest step [m], float32, a map.
        warming, renewal: Changes of temperature [K] and time of emission [s] by the flow of the
            latest step, float32, maps.
        descent: Height that lava has fallen in that step [m], float32, a map.
        elevation: Elevation of the bare ground [m], float64, a map.
        frozen: Thickness of solidified lava [m], float64, a map.
        cold: 1 for rows with lava that has become colder than the solidus, int32, shape [rows].
    """

    law: Any
    constants: Any
    diffusivity: float
    emerging: float
    temperature: Any
    emission_time: Any
    vent_temperature: Any
    former: Any
    warming: Any
    renewal: Any
    descent: Any
    elevation: Any
    frozen: Any
    cold: Any

    @classmethod
    def on(
        cls, cells: CellState, scene: Scene, effects: Effects, thickness: float
    ) -> 'HeatState':
        """Return the state without lava, whose temperature is 0.

        Args:
            cells: State of the flow.
            scene: The scene.
            effects: The effects that are on.
            thickness: Expected thickness of the flow [m].
        """
        shape, lava = cells.thickness.shape, scene.lava
        elevation = shared_array(ringed_heights, cells.terrain, wp.float64, cells.device)
        arrays = maps_of(
            Heat, shape, cells.device, {'cold': shape[0]}, {'elevation': elevation}
        )
        diffusivity = 0.0
        if 'conduction' in effects:
            diffusivity = lava.conductivity / (lava.density * lava.specific_heat)
        return cls(
            law_of(lava, _REAL), heat_of(scene, effects, _REAL), diffusivity, EDGE * thickness,
            **arrays,
        )

    def longest_step(self, cell: float) -> float:
        """Return the longest step in which a cell [m] conducts at most half of its heat [s]."""
        return math.inf if self.diffusivity == 0.0 else cell**2 / (8.0 * self.diffusivity)

    def argument(self, heat: Any = None) -> Any:
        """Return the argument of functions: ``heat``, or a new one."""
        heat = heat or Heat()
        for item in fields(self):
            setattr(heat, item.name, getattr(self, item.name))
        return heat


def hottest_of(scene: Scene) -> float:
    """Return the temperature of the hottest vent [K], the liquidus without vents."""
    return max((vent.temperature for vent in scene.vents), default=scene.lava.liquidus)


def carries_heat(scene: Scene, effects: Effects) -> bool:
    """Return True if the lava of a scene differs in temperature or age from place to place."""
    temperatures = {vent.temperature for vent in scene.vents}
    is_warmed = warming_function(wp, _REAL, effects) is not None
    return is_warmed or len(temperatures) > 1 or effects.any('needs_age') or effects.any('freezes')
