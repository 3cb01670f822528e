# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Inertia: exact speeds, lava at rest, and conserved momentum and energy."""

from dataclasses import replace
import math

import numpy as np
import pytest
from scipy.integrate import trapezoid

from lava_ros.errors import LavaError
from lava_ros.scene import Lava, Vent, vents_from_list
from lava_ros.simulation import Particles
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification import exact
from lava_ros.verification.cases.inertia import INERTIAL, swing, THIN
from solver import flat, incline, lattice, simulated

LOCAL = replace(INERTIAL, inertia=False)


def square(half, volume, **particles):
    return Particles(lattice(half), volume, 1400.0, **particles)


def simulation(lava, particles, *, effects=INERTIAL, slope=0.0, **options):
    ground = incline(slope, 80, 80, 1.0, top=40.0 * slope, origin=(-40.0, -40.0))
    knobs = {'spacing': 1.0, 'thickness': 1.0, 'precision': 'float64', **options}
    return simulated(ground, lava, particles, effects=effects, **knobs)


def middle_velocity(seen):
    """Return the mean velocity of particles near their centre."""
    sample = seen.sample()
    centre = sample.position.mean(axis=0)
    near = np.linalg.norm(sample.position - centre, axis=1) < 3.0
    return sample.velocity[near].mean(axis=0)


def test_exact_dam_breaks_conserve_volume_and_momentum():
    x = np.linspace(-40.0, 40.0, 400_001)
    stoker = exact.StokerDamBreak(2.0, 0.3, 9.81)
    for dam, bed in ((exact.RitterDamBreak(2.0, 9.81), 0.0), (stoker, 0.3)):
        thickness = dam.thickness(x, 3.0)
        assert trapezoid(thickness, x) == pytest.approx(40.0 * (2.0 + bed), rel=1e-4)
        assert (np.diff(thickness) <= 1e-12).all()
    speed = 2.0 * (math.sqrt(9.81 * 2.0) - math.sqrt(9.81 * stoker.plateau))
    flux = 0.3 * stoker.bore
    assert stoker.plateau * (stoker.bore - speed) == pytest.approx(flux)
    push = 0.5 * 9.81 * (stoker.plateau**2 - 0.3**2)
    assert flux * speed == pytest.approx(push)


def test_exact_oscillation_obeys_its_equation():
    """R'' = w^2 / 4 (R^-3 - R) for R = q^(-1/2)."""
    bowl = exact.OscillatingBowl(1.5, 30.0, 0.4, 9.81)
    time = np.linspace(0.0, bowl.period, 4001)
    ratio = np.array([bowl.narrowness(moment) for moment in time]) ** -0.5
    second = np.diff(ratio, 2) / (time[1] - time[0]) ** 2
    w = 2.0 * math.pi / bowl.period
    middle = ratio[1:-1]
    assert np.allclose(second, 0.25 * w**2 * (middle**-3 - middle), atol=1e-4 * w**2)
    r = np.linspace(0.0, 80.0, 40_001)
    for moment in (0.0, 0.3 * bowl.period):
        volume = trapezoid(2.0 * math.pi * r * bowl.thickness(r, moment), r)
        assert volume == pytest.approx(0.5 * math.pi * 1.5 * 30.0**2, rel=1e-4)


@pytest.mark.parametrize('precision', ['float32', 'float64'])
def test_sheet_accelerates_exponentially_to_the_local_speed(device, precision):
    lava = replace(THIN, viscosity=5000.0)
    slope = math.atan(0.1)
    effects = replace(INERTIAL, steep=True)
    sheet = exact.AcceleratingSheet(1.0, slope, lava.viscosity / lava.density, 9.81)
    seen = simulation(
        lava, square(10.0, 1.0), effects=effects, device=device, slope=0.1, precision=precision,
        longest_step=0.005 / sheet.rate,
    )
    for time in (0.0, 0.5 / sheet.rate, 1.0 / sheet.rate, 4.0 / sheet.rate):
        seen.advance(time)
        velocity = middle_velocity(seen)
        assert velocity[0] == pytest.approx(sheet.speed(time), rel=0.005, abs=1e-9)
        assert abs(velocity[1]) < 1e-3 * sheet.final_speed
    assert sheet.final_speed == pytest.approx(
        exact.sheet_velocity(math.cos(slope), slope, 5000.0 / 2600.0, 9.81) * math.cos(slope)
    )


@pytest.mark.parametrize('power', [1.0, 0.5, 2.0])
def test_lava_of_any_law_reaches_the_local_speed(power):
    lava = replace(THIN, viscosity=300.0, yield_strength=800.0, flow_index=power)
    effects = replace(INERTIAL, yielding=True, power_law=power != 1.0)
    layer = square(12.0, 1.0)
    local = simulation(lava, layer, effects=replace(effects, inertia=False), slope=0.1)
    expected = middle_velocity(local)[0]
    assert expected > 0.1
    # start at that speed
    start = Particles(layer.position, 1.0, 1400.0, velocity=(expected, 0.0))
    seen = simulation(lava, start, effects=effects, slope=0.1, longest_step=0.02)
    seen.advance(0.5)
    assert middle_velocity(seen)[0] == pytest.approx(expected, rel=0.002)
    seen = simulation(lava, layer, effects=effects, slope=0.1, longest_step=0.02)
    seen.advance(0.2)
    assert 0.01 * expected < middle_velocity(seen)[0] < 0.95 * expected


def test_yield_strength_stops_a_sliding_layer():
    lava = replace(THIN, yield_strength=2600.0)
    effects = replace(INERTIAL, yielding=True, viscous_heating=True)
    layer = square(25.0, 0.2, velocity=(2.0, 0.0))
    seen = simulation(lava, layer, effects=effects, thickness=0.2, longest_step=0.002)
    deceleration = 2600.0 / (2600.0 * 0.2)
    assert middle_velocity(seen)[0] == 2.0
    seen.advance(0.2)
    assert middle_velocity(seen)[0] == pytest.approx(2.0 - 0.2 * deceleration, rel=0.01)
    seen.advance(0.5)
    sample = seen.sample()
    assert (sample.velocity == 0.0).all()
    inner = np.abs(sample.position[:, 1]) < 20.0
    middle = np.median(sample.position[inner, 0])
    assert middle == pytest.approx(0.5 * 2.0**2 / deceleration, rel=0.02)
    inner = np.linalg.norm(sample.position, axis=1) < 10.0
    warmer = sample.temperature[inner] - 1400.0
    assert warmer == pytest.approx(0.5 * 2.0**2 / lava.specific_heat, rel=0.02)


def test_momentum_is_conserved():
    rng = np.random.default_rng(1)
    heap = square(8.0, 1.0)
    drift = np.array([0.3, -0.2])
    velocity = drift - 0.3 * heap.position + 0.3 * rng.normal(size=heap.position.shape)
    heap = Particles(
        heap.position, rng.uniform(0.5, 1.5, len(heap.position)), 1400.0, velocity=velocity
    )
    before = heap.volume @ heap.velocity
    seen = simulation(replace(THIN, viscosity=1e-6), heap)
    seen.advance(2.0)
    sample = seen.sample()
    assert np.abs(sample.velocity - drift).max() > 1.0
    assert np.allclose(sample.volume @ sample.velocity, before, rtol=1e-5, atol=0.0)


def test_oscillation_in_a_bowl_has_the_exact_period_and_loses_energy():
    seen = swing(1500, accuracy=Accuracy(ratio=3.5), periods=2.0, samples=16)
    assert seen.period == pytest.approx(seen.exact_period, rel=0.01)
    assert seen.growth < 1e-4
    assert 0.0 < seen.damping < 0.05


def test_lava_has_the_velocity_of_its_vent_only_with_inertia(device):
    lava = replace(THIN, viscosity=10.0)
    centres = {}
    knobs = {'symmetric': True, 'deterministic': True, 'longest_step': 0.05}
    for effects in (INERTIAL, LOCAL):
        for velocity in ((0.0, 0.0), (3.0, -1.5)):
            vent = Vent((0.0, 0.0), 2.0, radius=2.0, velocity=velocity)
            seen = simulated(
                flat(80), lava, vent, effects=effects, device=device, spacing=0.5, thickness=0.1,
                **knobs,
            )
            seen.advance(3.0)
            centres[effects.inertia, velocity] = seen.sample().position.mean(axis=0)
    jet = centres[True, (3.0, -1.5)]
    assert jet[0] > 1.0 and jet[1] == pytest.approx(-0.5 * jet[0], rel=0.1)
    assert np.abs(centres[True, (0.0, 0.0)]).max() < 0.1
    assert (centres[False, (3.0, -1.5)] == centres[False, (0.0, 0.0)]).all()


def test_lava_keeps_its_velocity_when_vents_or_terrain_change():
    seen = simulation(THIN, square(10.0, 0.01, velocity=(2.0, 1.0)), thickness=0.01)
    seen.advance(0.5)
    seen.set_vents([Vent((0.0, 20.0), 0.001)])
    seen.advance(1.0)
    seen.set_vents([])
    seen.set_terrain(flat(90))
    seen.advance(1.5)
    assert middle_velocity(seen) == pytest.approx([2.0, 1.0], rel=0.01)


def test_rejects_an_invalid_velocity():
    vents = vents_from_list(
        [{'position': [0.0, 0.0], 'discharge': 1.0, 'velocity': [3, -1]}], flat(80)
    )
    assert vents[0].velocity == (3.0, -1.0)
    for wrong in (5.0, (1.0,), (math.nan, 0.0)):
        with pytest.raises(LavaError, match='velocity'):
            Vent((0.0, 0.0), 1.0, velocity=wrong)
    with pytest.raises(LavaError, match='particles.velocity'):
        Particles(np.zeros((3, 2)), 1.0, 1400.0, velocity=np.zeros((2, 2)))


def test_rejects_inertia_with_the_published_formulas():
    with pytest.raises(LavaError, match='effects.inertia.*as-published'):
        simulated(flat(80), Lava.paper(), effects=INERTIAL, formulation='as-published')


def test_step_is_limited_by_waves_or_viscosity():
    """Thin lava: half a radius over c; stiff lava: 2 gamma / (g h q^2)."""
    steps = {}
    for viscosity in (1e-6, 1e5):
        seen = simulation(replace(THIN, viscosity=viscosity), square(8.0, 1.0))
        seen.advance(0.1)
        steps[viscosity] = seen.snapshot().steps
        assert steps[viscosity].limit in ('waves', 'advection')
    stiffness = 10.18 / 3.0**2
    wave = 1.6 / math.sqrt(9.81 * stiffness)
    assert steps[1e-6].length < wave
    assert steps[1e-6].length == pytest.approx(wave, rel=0.4)
    drag = 3.0 * 1e5 / 2600.0
    assert steps[1e5].length == pytest.approx(1.6 * drag / (9.81 * stiffness), rel=0.05)
