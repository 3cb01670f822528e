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

from lava_ros.verification.exact.cooling import *  # noqa: F403
from lava_ros.verification.exact.heat import *  # noqa: F403
from lava_ros.verification.exact.inertia import *  # noqa: F403
from lava_ros.verification.exact.rheology import *  # noqa: F403
from lava_ros.verification.exact.slopes import *  # noqa: F403
from lava_ros.verification.exact.spreading import *  # noqa: F403
