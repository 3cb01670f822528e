# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A made-up flow whose probabilities are known exactly: a disc that grows from the vent.

Its radius at a time t is SPEED sqrt(Q t), and Q is lognormal, so that the probability of lava at a
distance r up to the horizon T is that of Q > (r / SPEED)^2 / T.
"""

from collections.abc import Sequence
from statistics import NormalDist
from typing import Any

import numpy as np

from lava_ros.forecast.members import make_plan, MemberFields, Plan
from lava_ros.maps.forecast import HazardMaps, QUANTILES
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.uncertainty import uncertainty_from_dict

SPEED = 0.5

HORIZON = 3600.0

DISCHARGE = 25.0

#: Geometric standard deviation of the discharge.
FACTOR = 1.6

LOGNORMAL = {'distribution': 'lognormal', 'median': 1.0, 'factor': FACTOR}

TERRAIN = Terrain(np.zeros((24, 30)), 20.0, epsg=32633, offset=(500_000.0, 4_180_000.0))

VENT = Vent((300.0, 240.0), DISCHARGE)


def disc_plan(**uncertainty: Any) -> Plan:
    """The plan of an ensemble with an uncertain discharge, and what else is asked for."""
    uncertain = uncertainty_from_dict({'discharge': LOGNORMAL, **uncertainty})
    scene = Scene(TERRAIN, (VENT,), uncertainty=uncertain, lava=Lava())
    return make_plan(scene, horizon=HORIZON, looks=60)


def distances() -> np.ndarray:
    """Distances of the cells from the vent [m]."""
    rows, columns = TERRAIN.shape
    y, x = np.mgrid[0:rows, 0:columns] * TERRAIN.resolution + 0.5 * TERRAIN.resolution
    return np.hypot(x - VENT.position[0], y - VENT.position[1])


def disc_fields(index: int, factor: float) -> MemberFields:
    """What a member with a factor on the discharge does, without a solver."""
    time = (distances() / SPEED) ** 2 / (DISCHARGE * factor)
    arrival = np.where(time <= HORIZON, time, np.nan).astype(np.float32)
    return MemberFields(index, arrival, np.where(time <= HORIZON, 1.0, 0.0).astype(np.float32))


def disc_members(plan: Plan, members: Sequence[Any], **_: Any) -> list[MemberFields]:
    """Stands in for ``run_members``."""
    return [disc_fields(member.index, member.discharge) for member in members]


def exact_probability() -> np.ndarray:
    """Probability of lava up to the horizon, 0 to 1."""
    factor = (distances() / SPEED) ** 2 / HORIZON / DISCHARGE
    normal = NormalDist(0.0, np.log(FACTOR))
    return np.vectorize(lambda value: 1.0 - normal.cdf(np.log(value)))(factor)


def same(one: HazardMaps, other: HazardMaps) -> bool:
    """Whether two have the same bits in all maps."""
    pairs = [(one.probability, other.probability), (one.thickness, other.thickness)]
    pairs += [(one.arrival[share], other.arrival[share]) for share in QUANTILES]
    return all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)
