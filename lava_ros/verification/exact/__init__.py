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

"""Exact solutions of shallow viscous flow, each derived in its docstring.

All follow from h_t = div[(g / 3 nu) h^3 grad(h + z)] + source with kinematic viscosity
nu = mu / rho, and from alpha = g / (3 nu) where that is shorter. On a slope, x and h are along
the slope and normal to it.
"""

from lava_ros.verification.exact.heat import ColumnOnGround as ColumnOnGround
from lava_ros.verification.exact.heat import ConvectingSlab as ConvectingSlab
from lava_ros.verification.exact.heat import CoolingCurrent as CoolingCurrent
from lava_ros.verification.exact.heat import CoolingSpread as CoolingSpread
from lava_ros.verification.exact.heat import CrystallisingSheet as CrystallisingSheet
from lava_ros.verification.exact.heat import FreezingLens as FreezingLens
from lava_ros.verification.exact.heat import temperature_step as temperature_step
from lava_ros.verification.exact.heat import warming_by_descent as warming_by_descent
from lava_ros.verification.exact.inertia import AcceleratingSheet as AcceleratingSheet
from lava_ros.verification.exact.inertia import OscillatingBowl as OscillatingBowl
from lava_ros.verification.exact.inertia import RitterDamBreak as RitterDamBreak
from lava_ros.verification.exact.inertia import StokerDamBreak as StokerDamBreak
from lava_ros.verification.exact.rheology import BinghamDome as BinghamDome
from lava_ros.verification.exact.rheology import critical_thickness as critical_thickness
from lava_ros.verification.exact.rheology import crystal_factor as crystal_factor
from lava_ros.verification.exact.rheology import (
    herschel_bulkley_velocity as herschel_bulkley_velocity,
)
from lava_ros.verification.exact.rheology import Ridge as Ridge
from lava_ros.verification.exact.rheology import vft_viscosity as vft_viscosity
from lava_ros.verification.exact.sheets import channel_mean_velocity as channel_mean_velocity
from lava_ros.verification.exact.sheets import green_response as green_response
from lava_ros.verification.exact.sheets import RadiatingSheet as RadiatingSheet
from lava_ros.verification.exact.sheets import sheet_velocity as sheet_velocity
from lava_ros.verification.exact.slopes import LISTER_REFERENCE as LISTER_REFERENCE
from lava_ros.verification.exact.slopes import ListerScales as ListerScales
from lava_ros.verification.exact.slopes import SlopeFixedArea as SlopeFixedArea
from lava_ros.verification.exact.slopes import SlopeFlux as SlopeFlux
from lava_ros.verification.exact.slopes import SteadySource as SteadySource
from lava_ros.verification.exact.spreading import ConstantFluxSpread as ConstantFluxSpread
from lava_ros.verification.exact.spreading import DamBreak as DamBreak
from lava_ros.verification.exact.spreading import FixedVolumeSpread as FixedVolumeSpread
from lava_ros.verification.exact.spreading import PlaneFixedArea as PlaneFixedArea
