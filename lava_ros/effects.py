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

"""Which physics a scene calls for.

An ``Effects`` value is the key of the compiled step: what it leaves out is in no kernel.
"""

from dataclasses import dataclass, fields
import math

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.scene import Scene, Terrain

#: Slope above which the steep-slope factor cos^4 differs from 1 by more than 3 %.
STEEP_SLOPE = math.tan(math.radians(7.0))


@dataclass(frozen=True)
class Effects:
    """The physics that is switched on beside slope, spreading and viscosity.

    Attributes:
        yielding: Lava has a yield strength: it stops where its weight does not overcome it.
        power_law: Strain rate grows with a power of stress other than one.
        arrhenius: Viscosity depends on temperature by the Arrhenius law.
        vft: Viscosity depends on temperature by the Vogel-Fulcher-Tammann law.
        crystals: Crystals that form as lava cools stiffen it.
        steep: Thickness and distance are taken along the slope instead of in plan, a factor
            cos^4(slope) on the speed.
        inertia: Lava has momentum and takes time to reach the speed its weight can drive.
        green: Lateral viscous stress by the Green's function (MODEL.md, sections 2 and 4) instead
            of the local balance.
        helmholtz: The same stress by solving the equation that the Green's function approximates:
            dearer, exact at free edges, not limited by the kernel radius. Not beside ``green``.
        cooling: Radiation and convection.
        crust: Lava radiates from a crust that is colder than its core.
        ground: Heat goes into the ground.
        viscous_heating: Shear warms lava.
        latent_heat: Crystallisation gives heat.
        conduction: Heat flows from column to column.
        solidification: Columns below the solidus become terrain.
        merging: Particles that have come together merge, stretched ones split.
        border: The kernel radius shrinks towards the border of the flow.
    """

    yielding: bool = False
    power_law: bool = False
    arrhenius: bool = True
    vft: bool = False
    crystals: bool = False
    steep: bool = True
    inertia: bool = False
    green: bool = False
    helmholtz: bool = False
    cooling: bool = True
    crust: bool = False
    ground: bool = False
    viscous_heating: bool = False
    latent_heat: bool = False
    conduction: bool = False
    solidification: bool = False
    merging: bool = False
    border: bool = False

    def __post_init__(self) -> None:
        """Refuse anything but booleans.

        Raises:
            LavaError: A field is not true or false.
        """
        for item in fields(self):
            if not isinstance(getattr(self, item.name), bool):
                raise LavaError(f'effects.{item.name}', getattr(self, item.name), 'true or false')
        for one, other in (('helmholtz', 'green'), ('vft', 'arrhenius')):
            if getattr(self, one) and getattr(self, other):
                right = f'false beside {other}: they are one effect'
                raise LavaError(f'effects.{one}', True, right)


def effects_for(scene: Scene, overrides: dict[str, bool] | None = None) -> Effects:
    """Choose the effects a scene calls for.

    The lateral stress is off unless asked for: it acts over 0.58 thicknesses, less than the
    particle spacing of a field-scale scene.

    Args:
        scene: The scene.
        overrides: Effects switched on or off whatever the scene says, by name.

    Raises:
        LavaError: An override names no effect.
    """
    lava = scene.lava
    chosen = {
        'yielding': lava.yield_strength > 0.0,
        'power_law': lava.flow_index != 1.0,
        'arrhenius': lava.arrhenius > 0.0 and lava.vft_b == 0.0,
        'vft': lava.vft_b > 0.0,
        'crystals': lava.crystal_law != 'none' and lava.crystals > 0.0,
        'cooling': lava.emissivity > 0.0 or lava.convection > 0.0,
        'steep': steepest_slope(scene.terrain) > STEEP_SLOPE,
    }
    names = [item.name for item in fields(Effects)]
    chosen.update(validation.keys('effects', overrides or {}, allowed=names))  # type: ignore[arg-type]
    return Effects(**chosen)


def steepest_slope(terrain: Terrain) -> float:
    """Largest slope (rise over run) between neighbouring cells with data."""
    steepest = 0.0
    for axis in (0, 1):
        rise = np.abs(np.diff(terrain.elevation, axis=axis))
        known = np.isfinite(rise)
        if known.any():
            steepest = max(steepest, float(rise[known].max()) / terrain.resolution)
    return steepest
