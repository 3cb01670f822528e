# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Order of cooling in time, and speed as a function of the slope."""

import math

import numpy as np
import pytest
import warp as wp

from lava_ros.effects import Effects
from lava_ros.effects.laws import law_of, law_type, speed_function
from lava_ros.scene import Lava
from lava_ros.simulation import Particles
from lava_ros.verification import exact
from solver import flat, lattice, only, simulated

WEIGHT = 2500.0 * 9.81


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
    lava = Lava(viscosity=1e14, convection=0.0)
    reference, _ = cooled(lava, 10.0, longest_step=30.0)
    errors = [
        abs(cooled(lava, 10.0, longest_step=step)[0] - reference) for step in (7200.0, 3600.0)
    ]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.3)


def test_temperature_is_constant_without_heat_loss():
    lava = Lava(viscosity=1e14, emissivity=0.0, convection=0.0)
    assert cooled(lava, 10.0, longest_step=600.0)[0] == 1423.0


def responses(effects, lava, slopes, thickness, device):
    """Return mobility and its bound [m/s] from the device function, shape [slopes, 2]."""
    speed = speed_function(wp, wp.float64, law_type(wp.float64), effects)

    @wp.kernel(module='unique', enable_backward=False)
    def evaluate(
        law: law_type(wp.float64), depth: wp.float64, slope: wp.array(dtype=wp.float64),
        found: wp.array(dtype=wp.vec2d),
    ):
        i = wp.tid()
        temperature, age = wp.float64(1400.0), wp.float64(0.0)
        found[i] = speed(law, wp.float64(WEIGHT), depth, slope[i], temperature, age)

    found = wp.zeros(len(slopes), dtype=wp.vec2d, device=device)
    wp.launch(
        evaluate,
        dim=len(slopes),
        inputs=[
            law_of(lava, wp.float64), thickness, wp.array(slopes, dtype=wp.float64, device=device)
        ],
        outputs=[found],
        device=device,
    )
    return found.numpy()


@pytest.mark.parametrize(
    ('index', 'strength'),
    [(1.0, 800.0), (0.4, 0.0), (0.4, 800.0), (2.5, 0.0), (2.5, 800.0)],
)
def test_mobility_and_step_limit_follow_the_exact_flux(device, index, strength):
    thickness = 0.8
    lava = Lava(viscosity=2e3, yield_strength=strength, flow_index=index)
    effects = Effects(
        arrhenius=False, yielding=strength > 0.0, power_law=index != 1.0, cooling=False
    )
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


def test_yield_strength_does_not_shorten_the_step(device):
    """The bound of Bingham lava is (rho g h^2 / 3 mu)(1 - B^3)."""
    lava = Lava(viscosity=2e3, yield_strength=800.0)
    effects = Effects(arrhenius=False, yielding=True, cooling=False)
    slopes = np.geomspace(0.002, 0.9, 60)
    b = 800.0 / (WEIGHT * 0.8 * slopes)
    bound = responses(effects, lava, slopes, 0.8, device)[:, 1]
    newtonian = WEIGHT * 0.8**2 / 6e3
    assert bound == pytest.approx(newtonian * np.maximum(1.0 - b**3, 0.0), rel=1e-9, abs=1e-12)


def test_newtonian_lava_compiles_no_speed_function():
    law = law_type(wp.float32)
    assert speed_function(wp, wp.float32, law, Effects(crystals=True)) is None
