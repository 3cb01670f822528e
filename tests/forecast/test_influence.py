# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Effects of uncertain quantities, from members whose areas are known functions of them."""

from dataclasses import replace
import math
from typing import Any

import numpy as np
import pytest

from disc_flow import FACTOR, LOGNORMAL
from lava_ros.forecast.influence import Influences, influences_of
from lava_ros.forecast.probability import Footprint, NEVER
from lava_ros.forecast.sampling import draw_members, Member
from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.scene.uncertainty import uncertainty_from_dict
from lava_ros.simulation.output.inundation import TOUCHED

TERRAIN = Terrain(np.zeros((120, 120)), 4.0)

#: Factor on the area between the 10 % and the 90 % quantile of the lognormal discharge.
CHANGE = FACTOR ** (2.0 * 1.2815515655)

VISCOSITY = {'distribution': 'loguniform', 'low': 0.25, 'high': 4.0}


def footprints(members: tuple[Member, ...], power: float) -> list[Footprint]:
    """Return discs with an area proportional to Q mu^-power, shifted by the displacement."""
    rows, columns = TERRAIN.shape
    y, x = np.mgrid[0:rows, 0:columns] * TERRAIN.resolution
    result = []
    for member in members:
        radius = 50.0 * math.sqrt(member.discharge * member.viscosity**-power)
        east, north = member.displacement
        inside = np.hypot(x - 240.0 - east, y - 240.0 - north) < radius
        sample = np.where(inside, 0, NEVER).astype(np.uint16)
        inundated = np.where(inside, round(1.0 / TOUCHED), 0).astype(np.uint8)
        thickness = inside.astype(np.uint32)
        result.append(Footprint(member.index, (0, 0), sample, sample, inundated, thickness))
    return result


def found(count: int, power: float, **uncertainty: Any) -> Influences:
    scene = scene_of(**uncertainty)
    members = draw_members(scene, count)
    return influences_of(scene, members, footprints(members, power))


def scene_of(**uncertainty: Any) -> Scene:
    """Return a scene with an uncertain discharge and other ``uncertainty``."""
    known = uncertainty_from_dict({'discharge': LOGNORMAL, **uncertainty})
    return Scene(TERRAIN, (Vent((240.0, 240.0), 10.0),), uncertainty=known)


def test_effects_are_those_of_a_change_of_one_quantity():
    result = found(64, 0.5, viscosity=VISCOSITY)
    rows = {row.quantity: row for row in result.rows}
    assert [row.quantity for row in result.rows] == ['effusion_rate', 'viscosity']
    rate, viscosity = rows['effusion_rate'], rows['viscosity']
    assert rate.area == pytest.approx(CHANGE - 1.0, rel=0.1)
    assert viscosity.area == pytest.approx(16.0 ** (-0.5 * 0.8) - 1.0, rel=0.1)
    # of concentric discs J is the ratio of the areas
    assert rate.mismatch == pytest.approx(1.0 - 1.0 / CHANGE, abs=0.1)
    assert viscosity.mismatch == pytest.approx(1.0 - 16.0 ** (-0.5 * 0.8), abs=0.1)
    for row in (rate, viscosity):
        assert 0.0 < row.area_error < 0.1 * abs(row.area)
        assert 0.0 < row.mismatch_error < 0.1


def test_quantity_without_effect_has_none_within_its_error():
    row = next(row for row in found(64, 0.0, viscosity=VISCOSITY).rows
               if row.quantity == 'viscosity')
    assert abs(row.area) < 3.0 * row.area_error + 0.02
    assert row.mismatch < 3.0 * row.mismatch_error + 0.02


def test_displacement_shows_in_the_place_and_not_in_the_area():
    rows = {row.quantity: row for row in found(64, 0.0, position={'deviation': 40.0}).rows}
    assert rows['position'].mismatch > 0.1
    assert rows['position'].area < 3.0 * rows['position'].area_error + 0.02


@pytest.mark.parametrize('count', [1, 3])
def test_few_members_state_how_many_are_needed(count):
    result = found(count, 0.5, viscosity=VISCOSITY)
    assert result.rows == () and result.members == count
    assert len(found(result.needed, 0.5, viscosity=VISCOSITY).rows) == 2


def test_quantities_that_follow_another_are_named_with_it():
    follower = {**LOGNORMAL, 'follows': 'effusion_rate'}
    result = found(16, 0.5, viscosity=follower)
    assert [row.quantity for row in result.rows] == ['effusion_rate']
    assert result.rows[0].together == ('viscosity',)
    # both together: Q mu^-0.5
    assert result.rows[0].area == pytest.approx(math.sqrt(CHANGE) - 1.0, abs=0.1)


def test_errors_cover_the_effect_as_often_as_stated():
    """With noise in the area, two standard errors contain most of the effects."""
    scene, inside = scene_of(viscosity=VISCOSITY), 0
    for seed in range(20):
        members, noise = draw_members(scene, 24, seed=seed), np.random.default_rng(seed)
        runs = [
            replace(member, discharge=member.discharge * math.exp(0.3 * noise.standard_normal()))
            for member in members
        ]
        rows = influences_of(scene, members, footprints(tuple(runs), 0.5)).rows
        row = next(row for row in rows if row.quantity == 'effusion_rate')
        inside += abs(row.area - (CHANGE - 1.0)) < 2.0 * row.area_error
    assert inside >= 15
