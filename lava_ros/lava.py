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

"""The material: what lava is made of, as constants of its laws."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
import math
from typing import Any

from lava_ros import validation
from lava_ros.errors import LavaError

#: Stefan-Boltzmann constant [W/(m2 K4)] (CODATA 2018).
STEFAN_BOLTZMANN = 5.670374419e-8

#: Laws of what crystals do to viscosity.
CRYSTAL_LAWS = ('none', 'einstein-roscoe', 'maron-pierce')


def _constant(default: float, text: str, least: float, most: float, unit: str = '') -> Any:
    """A number within limits; its text goes to the node's parameter."""
    return field(
        default=default, metadata={'text': text, 'limits': (least, most), 'unit': unit}
    )


@dataclass(frozen=True)
class Lava:
    """Material constants; each field says what it is, in which unit and within which limits.

    The defaults are table 3.1 of the paper this method comes from. What the table lacks is off: a
    constant of 0 switches its physics off.
    """

    density: float = _constant(2500.0, 'Density', 1.0, 1e5, 'kg/m3')
    specific_heat: float = _constant(1150.0, 'Specific heat capacity', 1.0, 1e5, 'J/(kg K)')

    viscosity: float = _constant(
        100.0, 'Dynamic viscosity (consistency, Pa s^n) at reference_temperature', 1e-6, 1e15,
        'Pa s',
    )
    reference_temperature: float = _constant(
        1423.0, 'Temperature at which viscosity and yield_strength hold', 1.0, 5000.0, 'K'
    )
    # mu = viscosity exp(arrhenius (reference_temperature - T)); 8e-3 is the paper's, 0.04 is usual
    # in the field (Dragoni 1989)
    arrhenius: float = _constant(
        8e-3, 'Rate of the Arrhenius law of viscosity; 0: constant', 0.0, 1.0, '1/K'
    )
    # log10 mu = vft_a + vft_b / (T - vft_c) (Giordano, Russell & Dingwell 2008)
    vft_a: float = _constant(-4.55, 'Constant A of the VFT law: log10 Pa s', -20.0, 20.0)
    vft_b: float = _constant(
        0.0, 'Constant B of the VFT law, which replaces viscosity; 0: not used', 0.0, 1e5, 'K'
    )
    vft_c: float = _constant(0.0, 'Constant C of the VFT law', 0.0, 2000.0, 'K')

    liquidus: float = _constant(1473.0, 'Temperature above which there are no crystals', 1.0,
                                5000.0, 'K')
    solidus: float = _constant(
        0.0, 'Temperature below which lava is solid; 0: never', 0.0, 5000.0, 'K'
    )
    crystal_law: str = field(
        default='none',
        metadata={
            'text': 'What crystals do to viscosity: ' + ', '.join(CRYSTAL_LAWS),
            'choices': CRYSTAL_LAWS,
        },
    )
    crystals: float = _constant(
        0.0, 'Volume fraction of crystals at the solidus, linear up to the liquidus', 0.0, 1.0
    )
    packing: float = _constant(
        0.6, 'Volume fraction at which crystals jam', 0.01, 1.0
    )

    yield_strength: float = _constant(
        0.0, 'Yield strength at reference_temperature; 0: none', 0.0, 1e9, 'Pa'
    )
    # tau_y = yield_strength exp(yield_rate (reference_temperature - T))
    yield_rate: float = _constant(
        0.0, 'Rate at which yield strength rises as lava cools', 0.0, 1.0, '1/K'
    )
    flow_index: float = _constant(
        1.0, 'Exponent n of Herschel-Bulkley flow; 1: Newtonian or Bingham', 0.1, 5.0
    )

    emissivity: float = _constant(0.9, 'Emissivity of the surface; 0: no radiation', 0.0, 1.0)
    convection: float = _constant(50.0, 'Heat transfer to the air; 0: none', 0.0, 1e5, 'W/(m2 K)')
    conductivity: float = _constant(
        0.0, 'Thermal conductivity of lava, along the flow and of its crust; 0: none', 0.0, 1e3,
        'W/(m K)',
    )
    ground_conductivity: float = _constant(
        0.0, 'Thermal conductivity of the ground; 0: no heat goes there', 0.0, 1e3, 'W/(m K)'
    )
    ground_diffusivity: float = _constant(
        7e-7, 'Thermal diffusivity of the ground', 1e-9, 1e-3, 'm2/s'
    )
    latent_heat: float = _constant(
        0.0, 'Latent heat between liquidus and solidus; 0: none', 0.0, 1e7, 'J/kg'
    )
    crust: bool = field(
        default=False,
        metadata={'text': 'Radiate from a crust that is colder the older it is, not the core'},
    )

    def __post_init__(self) -> None:
        """Validate every field.

        Raises:
            LavaError: A field is not usable, or two do not go together.
        """
        for item in fields(self):
            label, value = f'lava.{item.name}', getattr(self, item.name)
            if 'limits' in item.metadata:
                least, most = item.metadata['limits']
                value = validation.number(
                    label, value, at_least=least, at_most=most, unit=item.metadata['unit']
                )
                object.__setattr__(self, item.name, value)
            elif 'choices' in item.metadata:
                validation.choice(label, value, item.metadata['choices'])
            elif not isinstance(value, bool):
                raise LavaError(label, value, 'true or false')
        if self.solidus >= self.liquidus:
            raise LavaError(
                'lava.solidus', self.solidus, f'below lava.liquidus, {self.liquidus:g} K'
            )
        uses = {'crystal_law': self.crystal_law != 'none', 'latent_heat': self.latent_heat > 0.0}
        for name, is_used in uses.items():
            if is_used and not self.solidus:
                raise LavaError('lava.solidus', self.solidus, f'above 0 K beside lava.{name}')
        if self.crust and not self.conductivity:
            raise LavaError('lava.conductivity', self.conductivity, 'above 0 beside lava.crust')

    @property
    def is_vft(self) -> bool:
        """Whether the VFT law gives the viscosity."""
        return self.vft_b > 0.0

    def crystal_fraction(self, temperature: float) -> float:
        """Volume fraction of crystals at a temperature [K]: none at the liquidus."""
        share = (self.liquidus - temperature) / (self.liquidus - self.solidus)
        return self.crystals * min(max(share, 0.0), 1.0) if self.solidus else 0.0

    def viscosity_at(self, temperature: float) -> float:
        """Viscosity [Pa s] at a temperature [K], crystals included."""
        if self.is_vft:
            above = max(temperature - self.vft_c, 1.0)
            viscosity: float = 10.0 ** min(self.vft_a + self.vft_b / above, 15.0)
        else:
            power = self.arrhenius * (self.reference_temperature - temperature)
            viscosity = self.viscosity * math.exp(max(min(power, 60.0), -60.0))
        if self.crystal_law == 'none':
            return viscosity
        free = max(1.0 - self.crystal_fraction(temperature) / self.packing, 1e-3)
        power = -2.5 if self.crystal_law == 'einstein-roscoe' else -2.0
        return float(viscosity * free**power)

    def yield_strength_at(self, temperature: float) -> float:
        """Yield strength [Pa] at a temperature [K]."""
        colder = self.reference_temperature - temperature
        return self.yield_strength * math.exp(min(self.yield_rate * colder, 60.0))
