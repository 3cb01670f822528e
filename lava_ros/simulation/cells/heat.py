# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Temperature and age of the lava on cells, and the ground that it has become."""

import math
from typing import Any

import warp as wp

from lava_ros.effects import Effects
from lava_ros.effects.heat import heat_values, warming_function
from lava_ros.effects.laws import law_values
from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend.memory import ArrayBlock, shared_array
from lava_ros.simulation.cells.state import CellState, EDGE, Heat, KernelState, layout_of
from lava_ros.simulation.particles.terrain import ringed_heights

_REAL = wp.float32


class HeatState(KernelState):
    """Temperature and age of the lava on cells, and the ground that it has become.

    Attributes:
        block: The arrays of this state alone.
        law: Constants of the laws of flow, by name.
        constants: Constants of the heat balance, by name.
        diffusivity: Thermal diffusivity of lava [m2/s], with ``conduction``.
        emerging: Minimum thickness of the columns that lava forms as it comes out of a vent [m].
        threshold: Minimum thickness of lava that inundates ground [m].
        temperature: Temperature [K], float64, a map.
        emission_time: Mean time of emission [s], float64, a map. With an effect that
            ``ages_in_place``, the time at which lava reached the cell, or ``UNREACHED``.
        vent_temperature: Temperature of the lava that comes out [K], float32, a map.
        former: Thickness at the end of the latest step [m], float32, a map.
        warming, renewal: Changes of temperature [K] and time of emission [s] by the flow of the
            latest step, float32, maps.
        descent: Height that lava has fallen in that step [m], float32, a map.
        elevation: Elevation of the bare ground [m], float64, a map.
        frozen: Thickness of solidified lava [m], float64, a map.
        cold: 1 for rows with lava that has become colder than the solidus, int32, shape [rows].
    """

    STRUCT = Heat
    temperature: Any
    emission_time: Any
    vent_temperature: Any
    former: Any
    warming: Any
    renewal: Any
    descent: Any
    frozen: Any
    cold: Any

    def __init__(
        self, cells: CellState, scene: Scene, effects: Effects, accuracy: Accuracy
    ) -> None:
        """Allocate without lava; the temperature is 0.

        Args:
            cells: State of the flow.
            scene: The scene.
            effects: The effects that are on.
            accuracy: The resolution, with the expected thickness of the flow.
        """
        assert accuracy.thickness is not None
        self.emerging = EDGE * accuracy.thickness
        self.threshold = accuracy.inundation_threshold
        self.elevation = shared_array(ringed_heights, cells.terrain, wp.float64, cells.device)
        layout = layout_of(Heat, (cells.rows, cells.stride), ('elevation',), cold=cells.rows)
        self.block = ArrayBlock(layout, cells.device)
        self.set_constants(scene, effects)

    def set_constants(self, scene: Scene, effects: Effects) -> None:
        """Compute the constants of the kernels for a scene and the effects that are on."""
        lava = scene.lava
        self.law, self.constants = law_values(lava), heat_values(scene, tuple(effects))
        self.diffusivity = 0.0
        if 'conduction' in effects:
            self.diffusivity = lava.conductivity / (lava.density * lava.specific_heat)

    def longest_step(self, cell: float) -> float:
        """Return the longest step in which a cell [m] conducts at most half of its heat [s]."""
        return math.inf if self.diffusivity == 0.0 else cell**2 / (8.0 * self.diffusivity)


def hottest_of(scene: Scene) -> float:
    """Return the temperature of the hottest vent [K], the liquidus without vents."""
    return max((vent.temperature for vent in scene.vents), default=scene.lava.liquidus)


def carries_heat(scene: Scene, effects: Effects) -> bool:
    """Return True if the lava of a scene differs in temperature or age from place to place."""
    temperatures = {vent.temperature for vent in scene.vents}
    is_warmed = warming_function(wp, _REAL, effects) is not None
    return is_warmed or len(temperatures) > 1 or effects.any('needs_age') or effects.any('freezes')
