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

from lava_ros.errors import LavaError


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
        inertia: Lava has momentum and takes time to reach the speed its weight can drive. Steps
            then have one stage, whatever ``Accuracy.integrator`` says. Not beside ``green`` or
            ``helmholtz``.
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

    def __post_init__(self) -> None:
        """Refuse anything but booleans.

        Raises:
            LavaError: A field is not true or false, or two do not go together.
        """
        for item in fields(self):
            if not isinstance(getattr(self, item.name), bool):
                raise LavaError(f'effects.{item.name}', getattr(self, item.name), 'true or false')
        for one, other in (('helmholtz', 'green'), ('vft', 'arrhenius')):
            if getattr(self, one) and getattr(self, other):
                right = f'false beside {other}: they are one effect'
                raise LavaError(f'effects.{one}', True, right)
        for one in ('green', 'helmholtz'):
            if getattr(self, one) and self.inertia:
                right = 'false beside inertia: the lateral stress is part of the local balance'
                raise LavaError(f'effects.{one}', True, right)
