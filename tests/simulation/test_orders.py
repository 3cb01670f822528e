# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Order of each term of the model in the time step; ``effects/test_heat.py`` has those of heat.

The particles are the same in all runs of a term, in float64, and a much shorter step is the
reference, so that the error of the spacing cancels.
"""

from dataclasses import replace
import math

import numpy as np
import pytest

from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Particles, Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.resolution import MAX_STEP_FRACTION, resolved_accuracy
from solver import flat, incline, lattice, only, simulated

LAVA = Lava.paper(density=2600.0, viscosity=1e4, arrhenius=0.0, emissivity=0.0, convection=0.0)

#: Without inertia, without drag, and with a relaxation time of half a second.
THIN, THICK = replace(LAVA, viscosity=1e-6), replace(LAVA, viscosity=1e3)

LEVEL, SLOPE = flat(60, 2.0), incline(0.2, 40, 60, 2.0, origin=(-40.0, -40.0))

STRONG = replace(LAVA, yield_strength=1500.0)


def fitted_order(steps, errors):
    """Return the exponent of the step in the error, by least squares."""
    return np.polyfit(np.log(steps), np.log(errors), 1)[0]


def dome(ground, lava, *effects, step, device, **options):
    """Return a dome of 316 particles, 2 m high in its middle, with a radius of 20 m."""
    place = lattice(20.0, 2.0)
    place = place[np.hypot(*place.T) < 20.0]
    thickness = 2.0 * np.cbrt(1.0 - (np.hypot(*place.T) / 20.0) ** 2)
    # the volume identifies a particle
    volume = 4.0 * thickness * (1.0 + 1e-6 * np.arange(len(place)))
    return simulated(
        ground, lava, Particles(place, volume, 1400.0), effects=only(*effects), device=device,
        precision='float64', spacing=2.0, thickness=2.0, longest_step=step, **options,
    )


#: Ground, lava, effects, integrator, longest of four steps [s] each half of the one before, step
#: of the reference [s], end [s], and lower bound of the order.
MOTIONS = {
    # measured on a CPU: 1.92, 1.06, 1.04
    'spreading, rkl2': (LEVEL, LAVA, (), 'rkl2', 2.0, 0.02, 8.0, 1.8),
    'spreading, rkl1': (LEVEL, LAVA, (), 'rkl1', 2.0, 0.02, 8.0, 0.95),
    'spreading, euler': (LEVEL, LAVA, (), 'euler', 0.8, 0.01, 8.0, 0.95),
    # 2.05, 1.05
    'slope, rkl2': (SLOPE, LAVA, ('steep',), 'rkl2', 1.0, 0.02, 8.0, 1.8),
    'slope, rkl1': (SLOPE, LAVA, ('steep',), 'rkl1', 2.0, 0.02, 8.0, 0.95),
    # 1.96, 1.07
    'yielding, rkl2': (LEVEL, STRONG, ('yielding',), 'rkl2', 2.0, 0.02, 8.0, 1.8),
    'yielding, rkl1': (LEVEL, STRONG, ('yielding',), 'rkl1', 2.0, 0.02, 8.0, 0.95),
    # 1.88; 0.97, because the drag is that of the velocity at the end of a kick
    'inertia': (LEVEL, THIN, ('inertia',), 'rkl2', 0.16, 0.002, 1.6, 1.75),
    'inertia with drag': (LEVEL, THICK, ('inertia',), 'rkl2', 0.16, 0.002, 1.6, 0.9),
}


@pytest.mark.parametrize('name', MOTIONS)
def test_motion_has_its_order_in_time(name, device):
    ground, lava, effects, integrator, longest, shortest, until, least = MOTIONS[name]
    steps = longest * 0.5 ** np.arange(4)
    ends = []
    for step in (*steps, shortest):
        simulation = dome(
            ground, lava, *effects, step=float(step), device=device, integrator=integrator
        )
        before = simulation.sample()
        simulation.advance(until)
        # nothing else limits the steps
        assert until / step - 0.5 < simulation.steps < 1.1 * until / step + 1.0
        sample = simulation.sample()
        ends.append(sample.position[np.argsort(sample.volume)])
    first = before.position[np.argsort(before.volume)]
    distance = math.sqrt(((ends[-1] - first) ** 2).mean())
    errors = [math.sqrt(((end - ends[-1]) ** 2).mean()) for end in ends[:-1]]
    assert errors[-1] < 0.03 * distance
    assert fitted_order(steps, errors) > least


@pytest.mark.parametrize('integrator', ['rkl2', 'rkl1'])
def test_lava_emitted_in_a_step_moves_within_it(integrator, device):
    """Lava that came out at the end of a step would be late by half a step.

    A particle is due every 0.05 s. The few particles for which steps end when one is due are fewer
    at a small refinement. The mean square of the distance grows in proportion to time. Measured
    errors are at most 0.16 of that of half a step.
    """
    squares, steps, end = [], np.array([0.8, 0.4, 0.2, 0.1]), 10.0
    for step in (*steps, 0.0125):
        simulation = simulated(
            LEVEL, LAVA, Vent((0.0, 0.0), 20.0, radius=6.0), effects=only(), device=device,
            precision='float64', spacing=0.7, thickness=2.0, refinement=0.05, longest_step=step,
            integrator=integrator,
        )
        simulation.advance(end)
        sample = simulation.sample()
        squares.append(np.average((sample.position**2).sum(axis=1), weights=sample.volume))
    late = 0.5 * steps / end * squares[-1]
    assert (abs(squares[-1] - np.array(squares[:-1])) < 0.2 * late).all()


def test_solidification_is_of_first_order_in_time(device):
    """A column solidifies at the end of a step, on average half a step after its time.

    Columns at rest that cool by convection reach the solidus after rho c h / lambda ln(...). The
    measured order is 1.0.
    """
    hot, solidus, air, convection = 1400.0, 1300.0, 300.0, 2000.0
    lava = replace(LAVA, viscosity=1e15, convection=convection, solidus=solidus)
    count = 60
    # thicknesses of which one is to twice another, in no order
    volume = 40.0 * (1.0 + np.modf(np.arange(count) * math.sqrt(2.0))[0])
    place = np.column_stack([np.zeros(count), 30.0 * np.arange(count)])
    steps, delays = np.array([8.0, 4.0, 2.0, 1.0]), []
    for step in steps:
        simulation = simulated(
            incline(0.0, 6 * count + 12, 12, 5.0, origin=(-30.0, -30.0)), lava,
            Particles(place, volume, hot), effects=only('cooling', 'solidification'),
            device=device, precision='float64', spacing=3.0, ratio=3.0, thickness=1.5,
            longest_step=float(step), ambient_temperature=air,
        )
        sample = simulation.sample()
        capacity = lava.density * lava.specific_heat * sample.thickness
        due = capacity / convection * math.log((hot - air) / (solidus - air))
        mean = time = 0.0
        while (flowing := simulation.budget().flowing):
            # to the end of the next step
            reached = simulation.advance(time + 1e-3, limit=1e9)
            mean += flowing / volume.sum() * (reached - time)
            time = reached
        delays.append(mean - np.average(due, weights=sample.volume))
    assert np.array(delays) == pytest.approx(0.5 * steps, rel=0.1)
    assert fitted_order(steps, delays) > 0.9


def test_similar_flow_takes_the_same_steps_at_any_speed():
    """Creep is similar: viscosity, the inverse of the effusion rate and time scale alike."""
    y, x = np.mgrid[0:20, 0:40] * 10.0
    valley = Terrain(500.0 - 0.16 * x + 0.0015 * (y - 95.0) ** 2, 10.0)
    steps, volumes = [], []
    for slowness in (1.0, 100.0):
        lava = Lava.paper(viscosity=2e4 * slowness, arrhenius=0.0, emissivity=0.0, convection=0.0)
        scene = Scene(valley, (Vent((100.0, 95.0), 7.0 / slowness, radius=10.0),), lava)
        simulation = Simulation(
            scene, accuracy=Accuracy(spacing=12.0), device='cpu', horizon=1200.0 * slowness
        )
        simulation.advance(1200.0 * slowness)
        steps.append(simulation.steps)
        volumes.append(simulation.budget().emitted)
    assert volumes[1] == pytest.approx(volumes[0])
    assert steps[1] == pytest.approx(steps[0], rel=0.03)


def test_longest_step_of_cooling_lava_does_not_change_the_flow():
    """Lava that radiates for two days is as thick, and spreads as far, as with shorter steps."""
    level = Terrain(np.zeros((60, 60)), 10.0)
    lava = Lava.paper(viscosity=3e5, arrhenius=0.02, density=2600.0)
    scene = Scene(level, (Vent((300.0, 300.0), ((0.0, 4.0), (20000.0, 0.0)), radius=15.0),), lava)
    horizon = 172800.0
    automatic = resolved_accuracy(Accuracy(spacing=14.0), scene, horizon=horizon)
    assert automatic.longest_step < MAX_STEP_FRACTION * horizon
    found = []
    for fraction in (1.0, 0.25):
        accuracy = replace(automatic, longest_step=fraction * automatic.longest_step)
        simulation = Simulation(scene, accuracy=accuracy, device='cpu', horizon=horizon)
        simulation.advance(horizon)
        sample = simulation.sample()
        place = sample.position - 300.0
        found.append((np.average(sample.thickness), math.sqrt((place**2).sum(axis=1).mean())))
    assert found[0] == pytest.approx(found[1], rel=0.01)
