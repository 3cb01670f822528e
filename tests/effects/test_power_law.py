# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Strain rate as a power of stress: exact speeds, limits, and level lava."""

from dataclasses import replace
import math

import numpy as np
import pytest

from effects.rheology import precisions, responses, scattered
from lava_ros.scene import Lava
from lava_ros.simulation import Particles
from lava_ros.verification import exact
from solver import flat, lattice, only, simulated


@precisions
@pytest.mark.parametrize('strength', [0.0, 1500.0])
def test_power_law_of_exponent_one_is_the_simpler_law(device, precision, within, strength):
    effects = only('steep', *['yielding'] * (strength > 0.0))
    simple, general = (
        scattered(on, yield_strength=strength, precision=precision, device=device).sample()
        for on in (effects, replace(effects, power_law=True))
    )
    assert general.velocity == pytest.approx(simple.velocity, rel=within, abs=within * 0.1)


@pytest.mark.parametrize('index', [0.5, 2.0, 5.0])
def test_level_lava_has_a_finite_step(device, index):
    """On a level surface lava of n > 1 has zero viscosity."""
    simulation = simulated(
        flat(60), Lava.paper(viscosity=1e4, flow_index=index, arrhenius=0.0),
        Particles(lattice(15.5), 1.0, 1400.0), effects=only('steep', 'power_law'), device=device,
        spacing=1.0, thickness=1.0,
    )
    assert np.isfinite(simulation.sample().velocity).all()
    simulation.advance(0.5)
    assert simulation.time == 0.5
    assert simulation.snapshot().steps.count < 20
    assert np.isfinite(simulation.sample().velocity).all()


@pytest.mark.parametrize(
    ('index', 'strength'),
    [(1.0, 800.0), (0.4, 0.0), (0.4, 800.0), (2.5, 0.0), (2.5, 800.0)],
)
def test_mobility_and_step_limit_follow_the_exact_flux(device, index, strength):
    thickness = 0.8
    lava = Lava.paper(viscosity=2e3, yield_strength=strength, flow_index=index)
    effects = only('power_law', *['yielding'] * (strength > 0.0))
    slopes = np.geomspace(0.002, 0.9, 60)

    def speeds(at):
        return np.array([
            exact.herschel_bulkley_velocity(
                thickness, math.asin(slope), density=2500.0, consistency=2e3,
                strength=strength, index=index, gravity=9.81,
            )
            for slope in at
        ])

    mobility, bound = responses(effects, lava, slopes, thickness, device).T
    across = speeds(slopes) / slopes
    along = (speeds(slopes * (1 + 1e-6)) - speeds(slopes * (1 - 1e-6))) / (2e-6 * slopes)
    larger = np.maximum(across, along)
    assert strength == 0.0 or (mobility == 0.0).sum() > 5
    assert mobility == pytest.approx(across, rel=1e-9, abs=1e-12)
    assert (bound >= larger * (1.0 - 1e-5) - 1e-9).all()
    if index <= 1.0 or strength == 0.0:
        assert bound == pytest.approx(larger, rel=1e-5, abs=1e-9)
    else:
        assert (bound <= (across + along) * (1.0 + 1e-5) + 1e-9).all()
