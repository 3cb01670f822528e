# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The heat balance in time: its order for each effect, steps of a node, ages of weeks, slopes."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from deleted_effects import DELETED
from effects.columns import AIR, HOT, HOUR, precisions
from lava_ros.effects import considered, EFFECTS, load
from lava_ros.effects.heat import host_temperature
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Particles
from solver import incline, only, simulated

#: Thickness of the columns [m], and slope of the ground where one is steep.
THICKNESS, SLOPE = 2.0, math.tan(math.radians(30.0))

#: Effects that are on, and constants of the lava, for each effect that transports heat.
BALANCES = {
    'cooling': (('cooling',), {'emissivity': 0.9, 'convection': 5.0}),
    'cover': (('cover',), {'emissivity': 0.9, 'crust_cover': 0.9, 'crust_temperature': 800.0}),
    'crust': (('crust',), {'emissivity': 0.9, 'crust': True, 'conductivity': 2.0}),
    'insulation': (('insulation',), {'emissivity': 0.9, 'solidus': 1100.0}),
    'wind': (('cooling', 'wind'), {'emissivity': 0.9}),
    'ground': (('ground',), {'ground_conductivity': 2.0}),
    'latent_heat': (
        ('cooling', 'latent_heat'),
        {'emissivity': 0.9, 'latent_heat': 3.5e5, 'liquidus': 1473.0, 'solidus': 1100.0},
    ),
    'steep': (('cooling', 'ground', 'steep'), {'emissivity': 0.9, 'ground_conductivity': 2.0}),
}

balances = pytest.mark.parametrize(
    'name', [name for name in BALANCES if not set(BALANCES[name][0]) & set(DELETED)]
)


def column(name, *, longest_step, precision='float64', device='cpu'):
    """Return a simulation of one column that does not move, in its middle on a plane."""
    effects, constants = BALANCES[name]
    slope = SLOPE if 'steep' in effects else 0.0
    lava = Lava.paper(**{
        'viscosity': 1e15, 'arrhenius': 0.0, 'emissivity': 0.0, 'convection': 0.0, **constants
    })
    around = {'wind_speed': 0.5} if 'wind' in effects else {}
    # a single column has a thickness of 0.0275 m per cubic metre
    return simulated(
        incline(slope, 6, 6, 10.0, origin=(-30.0, -30.0)), lava,
        Particles(np.zeros((1, 2)), THICKNESS / 0.0275, HOT), effects=only(*effects),
        device=device, spacing=3.0, ratio=3.0, thickness=THICKNESS, precision=precision,
        longest_step=longest_step, ambient_temperature=AIR, **around,
    )


def temperature(simulation):
    """Return the temperature of the only column [K]."""
    return float(simulation.sample().temperature[0])


def test_every_effect_that_transports_heat_has_a_balance():
    """Viscous heating needs motion; its case in ``lava check solver`` has exact solutions."""
    found = {name for name in EFFECTS if hasattr(load(name), 'terms')} - {'viscous_heating'}
    assert DELETED or found | {'wind', 'latent_heat', 'steep'} == set(BALANCES)


@balances
def test_heat_balance_has_its_order_in_time(name):
    """The order is 2, except under a new crust, which first loses the heat of a bare surface."""
    steps = np.array([3600.0, 1800.0, 900.0, 450.0])
    ends = []
    for step in (*steps, 28.125):
        simulation = column(name, longest_step=float(step))
        simulation.advance(10.0 * HOUR)
        ends.append(temperature(simulation))
    errors = np.abs(np.array(ends[:-1]) - ends[-1])
    fall = HOT - ends[-1]
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    # the ground's loss has no error to fit: the exact law of its age is integrated
    assert order > (0.7 if name in ('crust', 'insulation') else 1.7) or errors.max() < 1e-6 * fall
    assert errors[-1] < 1e-3 * fall


@precisions
@balances
@pytest.mark.parametrize('age', [0.0, 4e6], ids=['new', 'weeks'])
def test_short_steps_lose_as_much_heat_as_one(device, name, age, precision):
    """In float32 a step of 0.02 s cools by less than a rounding unit of the temperature."""
    span, tick = 4.0, 0.02
    falls = {}
    for steps in (1, round(span / tick)):
        simulation = column(name, longest_step=2e4, precision=precision, device=device)
        simulation.advance(age)
        before = temperature(simulation)
        for number in range(1, steps + 1):
            simulation.advance(age + span * number / steps)
        assert simulation.steps >= steps
        falls[steps] = before - temperature(simulation)
    one, many = falls.values()
    assert many == pytest.approx(one, rel=2e-3, abs=1e-9)
    assert one > 0.0


@balances
def test_estimates_integrate_the_balance_of_the_kernels(name):
    """The function of the host, by which the expected course cools, and a kernel agree."""
    effects, _ = BALANCES[name]
    simulation = column(name, longest_step=1e9)
    cosine = math.cos(math.atan(SLOPE)) if 'steep' in effects else 1.0
    across = float(simulation.sample().thickness[0]) * cosine
    after = host_temperature(simulation.scene, only(*effects))
    simulation.advance(20.0 * HOUR)
    expected = after(
        temperature=HOT, age=0.0, step=20.0 * HOUR, normal_thickness=across, drop=0.0, speed=0.0
    )
    assert temperature(simulation) == pytest.approx(expected, rel=1e-7)


def test_effect_switched_on_in_a_run_counts_ages_from_then(device):
    simulation = column('cooling', longest_step=1e4, device=device)
    simulation.advance(1e5)
    simulation.solver.switch_effects(only('cooling', 'ground'))
    assert simulation.solver.state.emission_time.numpy()[0] == 1e5
    simulation.advance(2e5)
    assert simulation.solver.state.emission_time.numpy()[0] == 1e5


def test_lava_of_a_vent_has_the_time_of_its_emission(device):
    """The vent opens after weeks."""
    opens = 4e6
    vent = Vent((0.0, 0.0), ((0.0, 0.0), (opens, 1.0)), radius=2.0)
    simulation = simulated(
        incline(0.0, 10, 10, 10.0, origin=(-50.0, -50.0)),
        Lava.paper(viscosity=1e8, ground_conductivity=2.0), vent, effects=only('ground'),
        device=device, spacing=5.0, thickness=2.0, longest_step=10.0,
    )
    simulation.advance(opens + 200.0)
    # no steps before
    assert simulation.solver.steps < 100
    state = simulation.solver.state
    times = np.sort(state.emission_time.numpy()[: state.count])
    assert len(times) == 4
    assert times - opens == pytest.approx([50.0, 100.0, 150.0, 200.0], abs=10.0 + 1e-6)
    assert (times > opens).all()


def test_column_of_a_scene_without_heat_keeps_its_temperature():
    scene = Scene(Terrain(np.zeros((4, 4)), 10.0), lava=Lava.paper())
    after = host_temperature(scene, only('steep'))
    assert after(temperature=HOT, age=0.0, step=1e6) == HOT


def test_considered_effects_leave_out_those_forced_off():
    scene = SimpleNamespace(lava=Lava.paper(emissivity=0.9), wind_speed=0.0)
    assert {'cooling', 'arrhenius'} <= set(considered(scene))
    assert not {'cooling', 'arrhenius'} & set(
        considered(scene, {'cooling': False, 'arrhenius': False})
    )
    assert 'green' in considered(scene, {'green': True})
