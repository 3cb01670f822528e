# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A forecast equals the run of the simulation that it was forked from."""

import math

import numpy as np
import pytest

from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.forecast.forecast_run import ForecastRun, moments, N_EARLY_SAMPLES
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.carriers import METHODS
from lava_ros.simulation.output.checkpoint import from_bytes
from solver import only

HORIZON, N_SAMPLES, THRESHOLD = 150.0, 6, 0.1

#: Effects of lava of one temperature, for which cells need few kernels.
PLAIN = only('steep')


def hill():
    """Return a rough slope towards +x with cells without data."""
    x, y = np.meshgrid(np.arange(30) * 10.0, np.arange(20) * 10.0)
    height = 900.0 - 0.25 * x + 3.0 * np.sin(x / 17.0) * np.cos(y / 23.0)
    height[3:5, 20:22] = np.nan
    return Terrain(height, 10.0)


def flowing(device, effects, method='particles'):
    """Return a simulation in the middle of an eruption whose discharge varies."""
    vent = Vent((60.0, 100.0), ((0.0, 30.0), (200.0, 8.0), (300.0, 60.0)), radius=12.0)
    accuracy = Accuracy(method, spacing=5.0, thickness=0.7, deterministic=True)
    lava = Lava.paper(viscosity=3e3, solidus=1300.0 if effects.solidification else 0.0)
    simulation = Simulation(
        Scene(hill(), (vent,), lava), effects=effects, accuracy=accuracy, device=device
    )
    simulation.advance(150.0)
    return simulation


def ahead_of(checkpoint, device, **changes):
    options = {'horizon': HORIZON, 'threshold': THRESHOLD, 'samples': N_SAMPLES, 'device': device}
    return ForecastRun(checkpoint, **options | changes)


@pytest.mark.parametrize(('effects', 'method'), [
    (Effects(), 'particles'), (Effects(inertia=True), 'particles'),
    (Effects(solidification=True), 'particles'), (PLAIN, 'cells'),
], ids=str)
def test_forecast_equals_the_continued_simulation(device, effects, method):
    simulation = flowing(device, effects, method)
    checkpoint = from_bytes(simulation.checkpoint().to_bytes())
    peaks, start = simulation.start_peaks(THRESHOLD), simulation.time
    peak = np.full_like(simulation.snapshot().thickness, np.nan)
    for time in (0.0, *moments(HORIZON, N_SAMPLES)):
        simulation.advance(start + time, limit=start + HORIZON)
        list(simulation.observing(peaks))
        peak = np.fmax(peak, simulation.snapshot().thickness)
    continued = simulation.read_peaks(peaks)
    ahead = ahead_of(checkpoint, device)
    while not ahead.is_done:
        # the length of a slice does not matter
        ahead.advance(wall_limit=1e-3)
    forecast = ahead.forecast()
    assert np.isfinite(forecast.arrival).sum() > np.count_nonzero(forecast.arrival == 0.0) > 5
    expected = (continued.arrival - start).astype(np.float32)
    np.testing.assert_array_equal(forecast.arrival, expected)
    # lava that drained between two observations had the threshold thickness
    missed = (forecast.arrival > 0.0) & (peak < 0.1)
    peak[missed] = np.float32(0.1)
    if simulation.keeps_peaks:
        # also the peaks between two observations
        assert (forecast.thickness > (1.0 - 1e-6) * peak - 1e-6)[~np.isnan(peak)].all()
        peak = continued.thickness
    np.testing.assert_array_equal(forecast.thickness, peak)
    np.testing.assert_array_equal(forecast.temperature, continued.temperature)
    assert (forecast.time, forecast.horizon) == (start, HORIZON)
    assert forecast.particle_count == simulation.particle_count


def test_samples_are_denser_near_the_start():
    times = moments(60.0, 6)
    assert len(times) == 6 + N_EARLY_SAMPLES
    assert times[N_EARLY_SAMPLES:] == pytest.approx([10.0, 20.0, 30.0, 40.0, 50.0, 60.0])
    assert times[:N_EARLY_SAMPLES] == [10.0 / 2.0**power for power in (4, 3, 2, 1)]


def test_names_the_invalid_option():
    checkpoint = flowing('cpu', Effects()).checkpoint()
    for changes, field in (
        ({'horizon': 0.0}, 'horizon'),
        ({'horizon': math.nan}, 'horizon'),
        ({'threshold': 0.0}, 'threshold'),
        ({'samples': 0}, 'samples'),
        ({'max_particles': 10}, 'particles'),
    ):
        with pytest.raises(LavaError) as caught:
            ahead_of(checkpoint, 'cpu', **changes)
        assert caught.value.field == field
    ahead = ahead_of(checkpoint, 'cpu', max_particles=checkpoint.particle_count + 5)
    with pytest.raises(LavaError, match='max_particles'):
        ahead.run()


@pytest.mark.parametrize('method', METHODS)
def test_forecast_with_another_threshold_counts_the_lava_at_its_start(device, method):
    simulation = flowing(device, Effects() if method == 'particles' else PLAIN, method)
    checkpoint, start = simulation.checkpoint(), simulation.snapshot()
    thick, usual = (ahead_of(checkpoint, device, threshold=least).run() for least in (1.0, 0.1))
    assert thick.threshold == 1.0
    assert thick.particle_count == usual.particle_count
    here = thick.arrival == 0.0
    assert 3 < here.sum() < (usual.arrival == 0.0).sum()
    assert here[start.thickness >= 1.2].all() and not here[start.thickness < 0.1].any()
    reached = np.isfinite(thick.arrival)
    assert here.sum() < reached.sum() < np.isfinite(usual.arrival).sum()
    assert (thick.arrival[reached] >= usual.arrival[reached]).all()
    np.testing.assert_array_equal(thick.inundated > 0.0, reached)
