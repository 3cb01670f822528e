# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lateral conduction of heat against exact solutions."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.scene import Lava
from lava_ros.simulation import Particles
from lava_ros.verification import exact
from solver import flat, only, simulated

CONDUCTING = only('conduction')

#: Diffusivity 1e-3 m2/s.
LAVA = Lava.paper(
    density=1000.0, specific_heat=1000.0, viscosity=1e15, emissivity=0.0, convection=0.0,
    conductivity=1000.0,
)


def layer(temperature_at, *, effects=CONDUCTING, lava=LAVA, jitter=0.0, **options):
    """Return a strip 40 m by 8 m and 2 m thick, with particles 0.5 m apart."""
    x, y = np.meshgrid(np.arange(-20.0, 20.0, 0.5) + 0.25, np.arange(-4.0, 4.0, 0.5) + 0.25)
    places = np.stack([x, y], axis=-1).reshape(-1, 2)
    places += jitter * np.random.default_rng(1).uniform(-0.5, 0.5, places.shape)
    particles = Particles(places, 0.5, temperature_at(places[:, 0]))
    knobs = {'spacing': 0.5, 'thickness': 2.0, 'precision': 'float64', **options}
    return simulated(flat(60), lava, particles, effects=effects, **knobs)


def step_at(x):
    return np.where(x < 0.0, 1000.0, 1400.0)


@pytest.mark.parametrize(
    ('precision', 'jitter', 'step'),
    [*((real, jitter, 60.0) for real in ('float32', 'float64') for jitter in (0.0, 0.2)),
     ('float64', 0.0, 30.0), ('float64', 0.0, 600.0)],
)
def test_temperature_step_spreads_as_the_error_function(device, precision, jitter, step):
    """Long time steps are divided into sweeps."""
    simulation = layer(
        step_at, precision=precision, jitter=jitter, longest_step=step, device=device
    )
    for time in (1500.0, 6000.0):
        simulation.advance(time)
        sample = simulation.sample()
        inside = (np.abs(sample.position[:, 1]) < 2.0) & (np.abs(sample.position[:, 0]) < 15.0)
        expected = exact.temperature_step(
            sample.position[inside, 0], time, low=1000.0, high=1400.0, diffusivity=1e-3
        )
        assert sample.temperature[inside] == pytest.approx(expected, abs=8.0 if jitter else 4.0)


@pytest.mark.parametrize('step', [60.0, 1e7])
@pytest.mark.parametrize('jitter', [0.2, 1.0])
def test_heat_is_conserved_to_rounding(device, step, jitter):
    random = np.random.default_rng(2)
    simulation = layer(
        lambda x: random.uniform(500.0, 1500.0, len(x)), jitter=jitter, longest_step=step,
        device=device,
    )
    before = simulation.sample()
    simulation.advance(5.0 * step)
    after = simulation.sample()
    heat = before.volume @ before.temperature
    assert after.temperature.std() < 0.5 * before.temperature.std()
    assert after.volume @ after.temperature == pytest.approx(heat, rel=1e-13)


@pytest.mark.parametrize('step', [60.0, 1e9])
@pytest.mark.parametrize('jitter', [0.0, 1.0])
def test_temperatures_stay_in_their_range(device, step, jitter):
    simulation = layer(step_at, jitter=jitter, longest_step=step, device=device)
    for number in (1, 3, 10):
        simulation.advance(number * step)
        temperature = simulation.sample().temperature
        assert temperature.min() >= 1000.0 - 1e-9
        assert temperature.max() <= 1400.0 + 1e-9
    assert ((temperature > 1000.1) & (temperature < 1399.9)).any()


def test_columns_exchange_heat_by_volume():
    places = np.array([[0.0, 0.0], [0.4, 0.0], [0.0, 0.4]])
    particles = Particles(places, np.array([5.0, 0.5, 0.05]), np.array([1400.0, 900.0, 700.0]))
    knobs = {'spacing': 0.5, 'thickness': 2.0, 'precision': 'float64'}
    simulation = simulated(flat(20), LAVA, particles, effects=CONDUCTING, **knobs)
    simulation.advance(1e4)
    sample = simulation.sample()
    mean = (5.0 * 1400.0 + 0.5 * 900.0 + 0.05 * 700.0) / 5.55
    assert sample.temperature == pytest.approx(mean, abs=0.5)
    assert sample.volume @ sample.temperature == pytest.approx(5.55 * mean, rel=1e-13)


def test_conduction_conserves_latent_heat():
    lava = replace(LAVA, latent_heat=3.5e5, liquidus=1300.0, solidus=1100.0)
    simulation = layer(step_at, lava=lava, effects=replace(CONDUCTING, latent_heat=True))

    def content(sample):
        melt = np.clip((sample.temperature - 1100.0) / 200.0, 0.0, 1.0)
        return sample.volume @ (sample.temperature + 350.0 * melt)

    before = content(simulation.sample())
    simulation.advance(6000.0)
    sample = simulation.sample()
    assert content(sample) == pytest.approx(before, rel=1e-13)
    assert sample.temperature.min() >= 1000.0 - 1e-9
    assert sample.temperature.max() <= 1400.0 + 1e-9
    assert ((sample.temperature > 1101.0) & (sample.temperature < 1299.0)).any()
