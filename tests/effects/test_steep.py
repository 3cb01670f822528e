# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Steep slopes: the speed of a sheet up to the steepest layer, and flow over cliffs."""

import math

import numpy as np
import pytest

from lava_ros.effects.steep import STEEPEST
from lava_ros.scene import Lava, Terrain, Vent
from lava_ros.simulation import Particles
from solver import incline, lattice, only, simulated

#: Cell size [m], and the column at whose centre the plateau ends.
CELL, EDGE = 25.0, 40


@pytest.mark.parametrize('angle', [20.0, 50.0, 80.0, 89.0])
@pytest.mark.parametrize('strength', [0.0, 100.0])
def test_sheet_has_the_exact_speed_on_any_slope(device, angle, strength):
    """The factor cos^4 b is constant above the steepest layer."""
    slope = math.tan(math.radians(angle))
    lava = Lava.paper(viscosity=1e6, yield_strength=strength, arrhenius=0.0)
    sample = simulated(
        incline(slope, 41, 41, 10.0, top=200.0 * slope, origin=(-205.0, -205.0)), lava,
        Particles(lattice(51.25, 2.5), 2.5**2, 1400.0), device=device,
        effects=only('steep', *['yielding'] * (strength > 0.0)),
        spacing=2.5, thickness=1.0, precision='float64',
    ).sample()
    inner = (np.abs(sample.position) < 20.0).all(axis=1)
    square = math.cos(math.radians(min(angle, STEEPEST))) ** 2
    b = strength / (lava.density * 9.81 * square * slope * sample.thickness[inner])
    newtonian = lava.density * 9.81 * (square * sample.thickness[inner]) ** 2 * slope / 3e6
    speed = np.hypot(*sample.velocity[inner].T)
    assert speed == pytest.approx(newtonian * (1.0 - 1.5 * b + 0.5 * b**3), rel=1e-6)


@pytest.mark.parametrize(
    ('effects', 'cells', 'drops'),
    [
        (None, 1, (1000.0,)),
        ({'inertia': True}, 4, (50.0,)),
        *(
            pytest.param(effects, cells, (50.0, 200.0, 1000.0), marks=pytest.mark.nightly)
            for effects in (None, {'steep': False}, {'inertia': True})
            for cells in (1, 2, 4)
        ),
    ],
    ids=str,
)
def test_cliff_does_not_stop_lava(device, effects, cells, drops):
    """The lava that passes does not depend on the height or width of the drop."""
    x = np.arange(160) * CELL
    fractions = []
    for drop in drops:
        height = -math.tan(math.radians(5.0)) * x
        height = height - np.clip((np.arange(160) - EDGE) / cells, 0.0, 1.0) * drop
        simulation = simulated(
            Terrain(np.tile(height, (81, 1)), CELL), Lava.paper(viscosity=5e3),
            Vent((20 * CELL, 40.5 * CELL), 20.0, radius=30.0), effects=effects, device=device,
            spacing=12.0,
        )
        simulation.advance(6 * 3600.0)
        thickness = np.nan_to_num(simulation.snapshot().thickness)
        fractions.append(thickness[:, EDGE + cells :].sum() / thickness.sum())
    assert min(fractions) > 0.6
    assert max(fractions) < 0.7
