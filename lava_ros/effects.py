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
        green: Lateral viscous stress by the Green's function (MODEL.md, sections 2 and 4) instead
            of the local balance.
        helmholtz: The same stress by solving the equation that the Green's function approximates:
            dearer, exact at free edges, not limited by the kernel radius. Not beside ``green``.
        arrhenius: Viscosity depends on temperature; otherwise every particle has the lava's own.
        cooling: Radiation and convection.
        steep: Thickness and distance are taken along the slope instead of in plan, a factor
            cos^4(slope) on the speed.
    """

    green: bool = False
    helmholtz: bool = False
    arrhenius: bool = True
    cooling: bool = True
    steep: bool = True

    def __post_init__(self) -> None:
        """Refuse anything but booleans.

        Raises:
            LavaError: A field is not true or false.
        """
        for item in fields(self):
            if not isinstance(getattr(self, item.name), bool):
                raise LavaError(f'effects.{item.name}', getattr(self, item.name), 'true or false')
        if self.green and self.helmholtz:
            raise LavaError('effects.helmholtz', True, 'false beside green: they are one effect')


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
        'green': False,
        'helmholtz': False,
        'arrhenius': lava.arrhenius > 0.0,
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
