# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Wind: forced convection carries heat from the surface, in addition to free convection.

q = CH rho_a c_a U (T - Ta), linear in the wind's speed U (Keszthelyi, Harris & Dehn 2003, Geophys.
Res. Lett. 30, 1989): CH = 0.0036 over lava (Greeley & Iversen 1987), with air of 0.4412 kg/m3 and
1099 J/(kg K) for the air above lava, as in flow models (Harris & Rowland 2001, Bulletin of
Volcanology 63, 20-44). That is 1.75 W/(m2 K) at 1 m/s. It is added to the convection in
``cooling``, ``cover`` and ``crust``. If ``convection`` itself already includes wind, such as
FLOWGO's 8.73 W/(m2 K) for 5 m/s, set it to 0.
"""

import numpy as np

from lava_ros.effects.effect import Effect, number
from lava_ros.effects.protocols import Scene
from lava_ros.effects.scales import Scales

#: Heat transfer over the speed of the wind [J/(m3 K)].
TRANSFER = 0.0036 * 0.4412 * 1099.0


def _heat_taken(scales: Scales) -> np.ndarray:
    """Return the effect of the heat that the wind takes from each column up to the horizon."""
    taken = TRANSFER * scales.scene.wind_speed * scales.duration
    return scales.matters(np.minimum(taken / scales.heat_capacity, 1.0))


def _convection(scene: Scene) -> float:
    """Return the heat transfer over rho c [m/s]."""
    return float(TRANSFER * scene.wind_speed / (scene.lava.density * scene.lava.specific_heat))


EFFECT = Effect(
    rank=125,
    title='forced convection by wind',
    symbol='heat taken',
    number=_heat_taken,
    threshold=0.01,
    admits='1 % of the temperature or 3 % of the speed',
    speed_error=0.03,
    source='column at rest',
    no_case='it adds to the convection of cooling',
    exists=lambda lava: lava.radiates,
    environment={
        'wind_speed': number(0.0, 'Speed of the wind over the lava; 0: still', 0.0, 100.0, 'm/s'),
    },
    heat={'convection': _convection},
    adds_to=('convection',),
    is_surface=True,
    benchmark={'wind_speed': 10.0},
)
