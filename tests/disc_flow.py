# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A synthetic flow whose probabilities are known exactly: a disc that grows from the vent.

Its radius at a time t is SPEED sqrt(Q t) with a lognormal Q. The probability of lava at a distance
r up to the horizon T is therefore that of Q > (r / SPEED)^2 / T.
"""

from collections.abc import Sequence
from statistics import NormalDist
from typing import Any

import numpy as np

from lava_ros.forecast.members import make_plan, MemberFields, Plan
from lava_ros.layers.forecast import HazardMaps, QUANTILES
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
    """Return the plan of an ensemble with an uncertain discharge and other ``uncertainty``."""
    uncertain = uncertainty_from_dict({'discharge': LOGNORMAL, **uncertainty})
    scene = Scene(TERRAIN, (VENT,), uncertainty=uncertain, lava=Lava.paper())
    return make_plan(scene, horizon=HORIZON, samples=60)


def distances() -> np.ndarray:
    """Return the distances of the cells from the vent [m]."""
    rows, columns = TERRAIN.shape
    y, x = np.mgrid[0:rows, 0:columns] * TERRAIN.resolution + 0.5 * TERRAIN.resolution
    return np.hypot(x - VENT.position[0], y - VENT.position[1])


def disc_fields(index: int, factor: float) -> MemberFields:
    """Return the fields of a member with a factor on the discharge."""
    time = (distances() / SPEED) ** 2 / (DISCHARGE * factor)
    arrival = np.where(time <= HORIZON, time, np.nan).astype(np.float32)
    reached = np.where(time <= HORIZON, 1.0, 0.0).astype(np.float32)
    return MemberFields(index, arrival, arrival, inundated=reached, peak=reached)


def disc_members(plan: Plan, members: Sequence[Any], **_: Any) -> list[MemberFields]:
    """Stand in for ``run_members``."""
    return [disc_fields(member.index, member.discharge) for member in members]


def exact_probability() -> np.ndarray:
    """Return the probability of lava up to the horizon, 0 to 1."""
    factor = (distances() / SPEED) ** 2 / HORIZON / DISCHARGE
    normal = NormalDist(0.0, np.log(FACTOR))
    return np.vectorize(lambda value: 1.0 - normal.cdf(np.log(value)))(factor)


def same(one: HazardMaps, other: HazardMaps) -> bool:
    """Return True if all maps are bitwise identical."""
    pairs = [(one.probability, other.probability), (one.thickness, other.thickness)]
    pairs += [(one.arrival[quantile], other.arrival[quantile]) for quantile in QUANTILES]
    return all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)
