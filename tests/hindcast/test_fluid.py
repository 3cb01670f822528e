# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Bounds of the cost of cases whose lava is fluid at the vent."""

from dataclasses import replace

import pytest

from eruption import elevation, write_case, write_grid
from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.fluid import PARTICLES, STEPS
from lava_ros.hindcast.run import Settings
from lava_ros.simulation.resolution import resolution_of

MONTH = 30 * 86400.0

#: Refinement of `draft`.
REFINEMENT = 0.707


@pytest.fixture
def month(tmp_path):
    """Return the folder of a case of a month on a steep slope."""
    folder = write_case(tmp_path / 'valley')
    write_grid(folder / 'elevation.asc', 3.0 * elevation())
    rates = f'start_s,end_s,effusion_rate_m3_per_s\n0,{MONTH},3\n'
    (folder / 'effusion_rate.csv').write_text(rates)
    return folder


def test_cost_of_fluid_lava_is_bounded(month):
    case, settings = load_case(month, material='basalt'), Settings('draft', device='cpu', maps=1)
    accuracy = settings.accuracy(case)
    bare = replace(accuracy, spacing=None, thickness=None, mobility_limit=None)
    own, found = (
        resolution_of(case.scene, item, horizon=case.duration) for item in (bare, accuracy)
    )
    assert accuracy.mobility_limit is not None
    assert own.particles > 2.0 * PARTICLES * REFINEMENT**2
    assert found.spacing > own.spacing and found.thickness == own.thickness
    assert found.particles < 1.1 * max(
        PARTICLES * REFINEMENT**2, own.particles * (own.spacing / found.spacing) ** 2
    )
    # lava on a slope of 1 takes as many steps of the largest displacement
    reach = accuracy.courant_number * accuracy.spacing
    assert 0.3 < case.duration * accuracy.mobility_limit / (STEPS * REFINEMENT * reach) < 10.0


def test_fitted_material_and_given_limit_have_no_other_bound(month):
    fitted = load_case(month, material='etna_basalt')
    assert Settings('draft').accuracy(fitted).mobility_limit is None
    fluid = load_case(month, material='basalt')
    given = Settings('draft', mobility_limit=2.5).accuracy(fluid)
    assert given.mobility_limit == 2.5
    # a spacing that is given remains
    assert Settings('draft', spacing=12.0).accuracy(fluid).spacing == 12.0
