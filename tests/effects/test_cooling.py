# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Cooling of bare lava by radiation and convection."""

import numpy as np
import pytest

from effects.columns import check_range, precisions
from lava_ros.scene import Lava
from lava_ros.simulation import Particles
from solver import flat, lattice, only, simulated


@precisions
def test_temperature_stays_in_range_for_a_long_step(device, precision):
    check_range(
        Lava.paper(viscosity=1e14), only('cooling'), 1e9, 1, precision=precision, device=device
    )


def cooled(lava, hours, *, longest_step, device='cpu'):
    """Return temperature and thickness in the middle of a sheet too stiff to move."""
    simulation = simulated(
        flat(20), lava, Particles(lattice(6.0), 2.0, 1423.0), effects=only('cooling'),
        device=device, spacing=1.0, thickness=2.0, longest_step=longest_step,
    )
    simulation.advance(3600.0 * hours)
    sample = simulation.sample()
    middle = np.argmin(np.abs(sample.position).sum(axis=1))
    return sample.temperature[middle], sample.thickness[middle]


def test_cooling_is_second_order_in_time():
    lava = Lava.paper(viscosity=1e14, convection=0.0)
    reference, _ = cooled(lava, 10.0, longest_step=30.0)
    errors = [
        abs(cooled(lava, 10.0, longest_step=step)[0] - reference) for step in (7200.0, 3600.0)
    ]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.3)
