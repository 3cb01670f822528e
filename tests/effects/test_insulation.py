# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lava under a crust: growth of the crust, fluid cores, age in place, and when it is chosen."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from lava_ros.effects import compatible, Effects
from lava_ros.effects.column import column_type
from lava_ros.effects.heat import heat_of, heat_type, STEFAN_BOLTZMANN
from lava_ros.effects.insulation import superheat, terms
from lava_ros.effects.laws import HOST, Rheology
from lava_ros.errors import LavaError
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.materials import material_named
from lava_ros.simulation import Particles, Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.selection import decide, effects_for
from lava_ros.verification.cases.case import plane
from solver import lattice, only, simulated

DAY = 86400.0
ETNA = material_named('etna_basalt')
LEVEL = Scene(plane((0.0, 0.0, 40.0, 40.0), 10.0, 0.0), lava=ETNA.lava)


def crusts(scene, times):
    """Return the thickness of the crust [m] at increasing times [s]: heat that the core loses."""
    constants = heat_of(scene, compatible(['insulation', 'latent_heat']), float)
    flux = terms(HOST, float, heat_type(float), column_type(float))
    ends = np.unique(np.concatenate([np.geomspace(1e-2, times[-1], 2000), times]))
    starts = np.concatenate([[0.0], ends[:-1]])
    lost = []
    for begin, end in zip(starts.tolist(), ends.tolist(), strict=True):
        age = (0.5 * (math.sqrt(begin) + math.sqrt(end))) ** 2
        column = SimpleNamespace(age=age, temperature=1300.0, normal_thickness=1.0)
        rate, source = flux(constants, column)
        lost.append((rate * 1300.0 - source) * (end - begin))
    total = np.cumsum(lost) / superheat(scene.lava)
    return total[np.searchsorted(ends, times)]


def conducted(scene, until, *, cell):
    """Return the thickness of a crust [m] by one-dimensional conduction in cells [m]."""
    lava, ambient = scene.lava, scene.ambient_temperature
    capacity, hot = lava.density * lava.specific_heat, superheat(lava)
    diffusivity = 2.0 / capacity
    # heat content over rho c above solid lava at the solidus [K]
    heat = np.full(round(1.0 / cell), hot)
    surface, outer = lava.solidus, diffusivity / (0.5 * cell)
    step = 0.4 * cell**2 / diffusivity
    for _ in range(round(until / step)):
        temperature = lava.solidus + np.minimum(heat, 0.0)
        for _ in range(4):
            loss = lava.emissivity * STEFAN_BOLTZMANN * (surface**4 - ambient**4)
            loss += lava.convection * (surface - ambient)
            steepness = 4.0 * lava.emissivity * STEFAN_BOLTZMANN * surface**3 + lava.convection
            off = loss / capacity - outer * (temperature[0] - surface)
            surface -= off / (steepness / capacity + outer)
        inner = diffusivity * np.diff(temperature) / cell
        flux = np.concatenate([[outer * (temperature[0] - surface)], inner, [0.0]])
        heat += step / cell * np.diff(flux)
    return float(((hot - np.maximum(heat, 0.0)) / hot * cell).sum())


@pytest.mark.parametrize(('hours', 'within'), [(1.0, 0.05), (24.0, 0.05)])
def test_crust_grows_as_by_conduction(hours, within):
    time = 3600.0 * hours
    expected = conducted(LEVEL, time, cell=0.004 * math.sqrt(hours))
    assert crusts(LEVEL, [time])[0] == pytest.approx(expected, rel=within)


def test_crust_is_as_thick_as_on_lobes_of_kilauea():
    """Hon et al. (1994) measured 0.0779 sqrt(t) metres after t hours."""
    times = DAY * np.array([1.0, 5.0, 30.0])
    expected = 0.0779 * np.sqrt(times / 3600.0)
    assert crusts(LEVEL, times) == pytest.approx(expected, rel=0.12)


def test_core_keeps_its_viscosity_under_a_crust():
    lava = ETNA.lava
    mixed = Rheology(lava, only('arrhenius'))
    covered = Rheology(lava, only('arrhenius', 'insulation'))
    hot = lava.reference_temperature
    for core in (1.0, 0.9, 0.5):
        temperature = lava.solidus + core * (hot - lava.solidus)
        found = covered.viscosity_at(temperature)
        assert found == pytest.approx(lava.viscosity / core**3, rel=1e-6)
        assert found <= mixed.viscosity_at(temperature)
    # a column that is nearly solid is no stiffer than one of that temperature
    nearly = lava.solidus + 1.0
    assert covered.viscosity_at(nearly) == mixed.viscosity_at(nearly)
    assert covered.viscosity_at(hot + 10.0) == mixed.viscosity_at(hot + 10.0)


def test_age_is_that_of_the_place(device):
    """Lava loses less heat where lava arrived earlier, however young it is itself."""
    lava = Lava.paper(viscosity=1e10, arrhenius=0.0, solidus=1100.0)
    late, hot = 100.0 * 3600.0, 1400.0
    below_old, on_ground = (
        Vent((x, 0.0), ((0.0, 0.0), (late, 0.2)), radius=15.0, temperature=hot)
        for x in (-50.0, 50.0)
    )
    place = lattice(30, 2.0) - (50.0, 0.0)
    simulation = simulated(
        plane((-100.0, -50.0, 100.0, 50.0), 10.0, 0.0), lava, below_old, on_ground,
        Particles(place, 8.0, 1250.0), effects=only('insulation'), device=device, spacing=2.0,
        thickness=2.0, longest_step=600.0,
    )
    simulation.advance(late + 3600.0)
    sample = simulation.sample()
    is_new, is_west = sample.temperature > 1300.0, sample.position[:, 0] < 0.0
    heat = sample.volume * (hot - sample.temperature)
    west, east = (heat[is_new & here].sum() for here in (is_west, ~is_west))
    assert 0.0 < 3.0 * west < east


def gentle(rate, slope, material, **constants):
    """Return a scene of a vent [m3/s] on a slope, and its horizon [s]."""
    drop = -slope * 30.0 * np.arange(160)
    ground = Terrain(np.tile(500.0 + drop, (120, 1)), 30.0)
    hot = material_named(material).vent_temperature.value
    vent = Vent((450.0, 1800.0), rate, radius=45.0, temperature=hot)
    return Scene(ground, (vent,), material_named(material).lava_with(constants)), 30.0 * DAY


REPLACED = {'cooling', 'cover', 'crust', 'crust_strength'}


@pytest.mark.parametrize('material', ['etna_basalt', 'basalt', 'kilauea_tholeiite'])
def test_slow_lava_on_a_gentle_slope_is_insulated(material):
    scene, horizon = gentle(1.0, 0.026, material)
    found = effects_for(scene, horizon=horizon)
    assert 'insulation' in found and REPLACED.isdisjoint(found)


@pytest.mark.parametrize(('rate', 'slope'), [(11.0, 0.18), (5.0, 0.14), (0.7, 0.27)])
@pytest.mark.parametrize('material', ['etna_basalt', 'etna_magflow', 'basalt'])
def test_flows_of_etna_are_not_insulated(material, rate, slope):
    """Rates and slopes of the flows of 2001, 1974 and May 2001."""
    scene, horizon = gentle(rate, slope, material)
    found = effects_for(scene, horizon=horizon)
    assert 'insulation' not in found and 'cover' in found


@pytest.mark.parametrize('material', ['etna_magflow', 'basalt'])
def test_flow_of_a_steep_flank_that_reaches_a_plain_is_not_insulated(material):
    """Fluid lava runs out of the flank, but is no tube-fed flow there."""
    scene, horizon = gentle(5.0, 0.2, material)
    x = 30.0 * np.arange(160)
    rise = 500.0 - 0.2 * np.minimum(x, 2000.0) - 0.02 * np.maximum(x - 2000.0, 0.0)
    flank = Terrain(np.tile(rise, (120, 1)), 30.0)
    found = effects_for(Scene(flank, scene.vents, scene.lava), horizon=horizon)
    assert 'insulation' not in found and 'cover' in found


def test_user_decides_about_insulation():
    scene, horizon = gentle(1.0, 0.026, 'etna_basalt')
    off = effects_for(scene, {'insulation': False}, horizon=horizon)
    assert 'insulation' not in off and 'cover' in off
    steep, horizon = gentle(11.0, 0.18, 'etna_basalt')
    assert 'insulation' in effects_for(steep, {'insulation': True}, horizon=horizon)
    with pytest.raises(LavaError, match='crust_strength'):
        Effects(cooling=False, insulation=True, crust_strength=True)


def test_effects_that_insulation_replaces_leave_no_error():
    scene, horizon = gentle(1.0, 0.026, 'etna_basalt')
    found = {item.name: item for item in decide(scene, horizon=horizon)}
    for name in ('cover', 'crust_strength'):
        assert found[name].rival == 'insulation'
        assert found[name].cost == found[name].thickness_cost == 0.0


@pytest.mark.parametrize('method', ['particles', 'cells'])
def test_tube_fed_flow_is_as_long_as_published_laws_estimate(method, device):
    """A month of 1 m3/s down 1.5 degrees is neither a mound nor a film.

    Smith (1973) gives 2.2 km for lava of the viscosity at the vent that does not cool.
    """
    scene, horizon = gentle(1.0, math.tan(math.radians(1.5)), 'etna_basalt')
    simulation = Simulation(
        scene, accuracy=Accuracy(method=method, spacing=30.0, refinement=0.7), device=device,
        horizon=horizon,
    )
    assert 'insulation' in simulation.effects
    simulation.advance(horizon)
    snapshot = simulation.snapshot()
    rows, columns = np.nonzero(snapshot.footprint)
    length = 30.0 * (columns.max() + 1) - scene.vents[0].position[0]
    assert 0.5 * 2200.0 < length < 2.0 * 2200.0
    assert horizon / (len(rows) * 30.0**2) < 10.0
