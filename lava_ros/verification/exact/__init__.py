# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Exact solutions of shallow viscous flow, each derived in its docstring.

All follow from h_t = div[(g / 3 nu) h^3 grad(h + z)] + source with kinematic viscosity
nu = mu / rho, and from alpha = g / (3 nu) where that is shorter. On a slope, x and h are along
the slope and normal to it.
"""

from lava_ros.verification.exact.heat import *  # noqa: F403
from lava_ros.verification.exact.inertia import *  # noqa: F403
from lava_ros.verification.exact.rheology import *  # noqa: F403
from lava_ros.verification.exact.slopes import *  # noqa: F403
from lava_ros.verification.exact.spreading import *  # noqa: F403
