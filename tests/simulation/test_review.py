# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Effects that are switched on during a run, and the decisions and measurements behind it."""

from dataclasses import replace
import math
from unittest.mock import Mock

import numpy as np
import pytest

from lava_ros.effects import EFFECTS, Effects
from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.output import measurement
from lava_ros.simulation.output.checkpoint import from_bytes
from lava_ros.simulation.output.measurement import current_resolution, measure_widths
from lava_ros.simulation.selection import Decision
from lava_ros.simulation.setup import review as review_module
from lava_ros.simulation.setup.review import (
    EffectChoice,
    MAX_INTERVAL,
    next_review,
    watched_effects,
)
from slope_scenes import ground, HOUR, LAVA, scene
from solver import only

#: A vent whose lava solidifies once it is at rest: its discharge falls to 0.
COOLING = replace(
    LAVA, arrhenius=0.01, reference_temperature=1360.0, emissivity=0.236, convection=9.45,
    solidus=1143.0, liquidus=1450.0,
)
FADING = Vent((100.0, 300.0), [(0.0, 8.0), (1800.0, 1.0), (3600.0, 0.0)], temperature=1360.0)


def freezing_scene() -> Scene:
    """Return a flow that solidifies after six hours, beyond the expected hour."""
    return Scene(ground(10.0), (FADING,), COOLING)


@pytest.fixture
def simulation(device: str) -> Simulation:
    accuracy = Accuracy(spacing=12.0, thickness=1.0, deterministic=True)
    return Simulation(freezing_scene(), accuracy=accuracy, device=device, horizon=0.5 * HOUR)


def test_solidification_is_switched_on_beyond_the_horizon(simulation: Simulation):
    assert 'solidification' not in simulation.effects
    simulation.advance(6.0 * HOUR)
    assert 'solidification' in simulation.effects
    (decision,) = (item for item in simulation.decisions() if item.name == 'solidification')
    assert decision.is_on and 0.0 < decision.since < 6.0 * HOUR
    assert decision.measured > decision.effect.threshold >= decision.value
    assert f'since {decision.since:.0f} s' in decision.reason
    budget = simulation.budget()
    assert budget.solidified > 0.95 * budget.emitted
    if budget.flowing > 0.0:
        assert simulation.sample().temperature.min() > COOLING.solidus - 1.0


def test_review_does_not_switch_on_forced_effects(device: str):
    accuracy = Accuracy(spacing=12.0, thickness=1.0)
    for effects in ({'solidification': False}, Effects(cooling=True, arrhenius=True)):
        simulation = Simulation(
            freezing_scene(), effects=effects, accuracy=accuracy, device=device, horizon=HOUR
        )
        simulation.advance(3.0 * HOUR)
        assert 'solidification' not in simulation.effects


def test_resumed_run_switches_effects_on_at_the_same_time(simulation: Simulation, device: str):
    copies = []
    for time in (0.4 * HOUR, 5.0 * HOUR):
        simulation.advance(time, limit=6.0 * HOUR)
        copies.append(from_bytes(simulation.checkpoint().to_bytes()))
    simulation.advance(6.0 * HOUR)
    (whole,) = (item for item in simulation.decisions() if item.name == 'solidification')
    assert copies[0].switched_on == {} and 'solidification' in copies[1].switched_on
    for copy in copies:
        resumed = Simulation.resume(copy, device=device)
        resumed.advance(6.0 * HOUR)
        (found,) = (item for item in resumed.decisions() if item.name == 'solidification')
        assert found.since == whole.since
        assert np.array_equal(
            resumed.snapshot().thickness, simulation.snapshot().thickness, equal_nan=True
        )


def test_effects_are_not_switched_off(device: str):
    steep = replace(scene(ground(10.0)), lava=replace(LAVA, yield_strength=500.0))
    simulation = Simulation(steep, device=device, horizon=HOUR, accuracy=Accuracy(spacing=15.0))
    assert 'yielding' in simulation.effects
    simulation.advance(120.0)
    on = set(simulation.effects)
    simulation.set_vents([])
    assert on <= set(simulation.effects)
    simulation.set_terrain(Terrain(np.zeros((60, 200)), 10.0))
    assert on <= set(simulation.effects)


def test_review_measures_only_the_scales_that_its_effects_read(
    simulation: Simulation, monkeypatch: pytest.MonkeyPatch
):
    simulation.advance(0.2 * HOUR)
    widths = Mock(wraps=measure_widths)
    monkeypatch.setattr(measurement, 'measure_widths', widths)
    simulation.review(['solidification', 'steep'])
    assert not widths.called
    scales = simulation.measure_scales()
    assert scales is not None and (scales.lateral > 0.0).all() and widths.called


@pytest.mark.parametrize('name', ['steep', 'solidification'])
def test_switch_keeps_the_particles_and_the_room_for_new_ones(simulation: Simulation, name: str):
    simulation.advance(0.1 * HOUR)
    former = simulation.solver.state
    # sums of position and remainder round to other positions
    former.remainder.fill_(1e-3)
    simulation._switch_to(replace(simulation.effects, **{name: name not in simulation.effects}))
    state = simulation.solver.state
    assert state is not former and state.particles_ahead == former.particles_ahead > 0
    expected, found = former.save(), state.save()
    for array in ('particle', 'remainder', 'clock', 'counts', 'top', 'left'):
        assert np.array_equal(found[array], expected[array]), array


def test_reviews_do_not_change_the_flow(device: str):
    plain = replace(scene(ground(10.0)), lava=replace(LAVA, solidus=900.0, emissivity=0.9))
    accuracy = Accuracy(spacing=12.0, thickness=1.0, deterministic=True)
    reviewed = Simulation(plain, accuracy=accuracy, device=device, horizon=HOUR)
    same = Simulation(
        plain, effects=reviewed.effects, accuracy=accuracy, device=device, horizon=HOUR
    )
    for item in (reviewed, same):
        item.advance(0.5 * HOUR)
    assert reviewed.review_count > 5 and same.review_count == 0
    assert reviewed.effects == same.effects
    thickness = [item.snapshot().thickness for item in (reviewed, same)]
    assert np.array_equal(*thickness, equal_nan=True)


@pytest.mark.parametrize('horizon', [1.0, 0.3, 3600.0, 86400.0 * 30.1])
def test_reviews_become_rarer_while_the_flow_slows(horizon: float):
    times = [next_review(0.0, horizon)]
    while times[-1] < 3.0 * horizon:
        times.append(next_review(times[-1], horizon))
    expected = [1 / 128, 1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 3 / 4, 1, 5 / 4, 25 / 16]
    assert times[:11] == pytest.approx([horizon * part for part in expected])
    assert np.all(np.diff(times) <= MAX_INTERVAL * np.maximum(times[:-1], horizon) * (1.0 + 1e-9))


def test_review_times_do_not_depend_on_the_caller():
    times = [next_review(0.0, 1.0)]
    while times[-1] < 3.0:
        times.append(next_review(times[-1], 1.0))
    for time in np.linspace(0.0, 2.9, 400):
        assert next_review(time, 1.0) == pytest.approx(min(t for t in times if t > time))
    assert next_review(30.0, 100.0) == pytest.approx(100.0 * next_review(0.3, 1.0))


def test_measurements_of_a_steady_flow_are_close_to_the_expected_ones(device: str):
    simulation = Simulation(
        scene(ground(5.0, 0.2)), effects={}, device=device, horizon=HOUR,
        accuracy=Accuracy(spacing=4.0),
    )
    expected = simulation.resolution
    simulation.advance(0.5 * HOUR)
    scales = simulation.measure_scales()
    assert scales is not None and scales.is_measured and scales.is_extended
    columns = scales.columns
    assert columns.quantile(columns.width, 0.5) == pytest.approx(expected.width, rel=0.4)
    slope = math.tan(math.radians(5.0))
    assert columns.quantile(columns.slope, 0.5) == pytest.approx(slope, rel=0.25)
    fastest = columns.quantile(columns.speed, 0.9)
    assert fastest == pytest.approx(
        columns.quantile(LAVA.density * 9.81 * columns.thickness**2 * slope / 3e4, 0.9), rel=0.3
    )
    assert scales.fall == pytest.approx(
        np.ptp(simulation.scene.terrain.elevations_at(
            np.vstack([simulation.sample().position, [[100.0, 300.0]]])
        )), rel=1e-6
    )
    found = current_resolution(simulation.snapshot(), simulation.accuracy, expected)
    assert found.limit == 'measured'
    assert found.width == pytest.approx(expected.width, rel=0.4)
    assert found.across == pytest.approx(expected.across, rel=0.4)
    assert found.thickness == pytest.approx(expected.thickness, rel=0.3)


def test_no_measurement_without_lava(device: str):
    later = Vent((100.0, 300.0), [(0.0, 0.0), (1000.0, 5.0)])
    simulation = Simulation(
        replace(freezing_scene(), vents=(later,)), device=device, horizon=HOUR,
        accuracy=Accuracy(spacing=12.0),
    )
    assert simulation.advance(500.0) == 500.0
    assert simulation.measure_scales() is None
    expected = simulation.resolution
    found = current_resolution(simulation.snapshot(), simulation.accuracy, expected)
    assert found is expected


@pytest.mark.parametrize('turns', range(4))
def test_width_is_the_shortest_chord(turns: int):
    wet = np.zeros((60, 80), dtype=bool)
    wet[20:27, 5:75] = True
    found = measure_widths(np.rot90(wet, turns), 2.0)
    assert found.max() == pytest.approx(14.0)
    assert np.median(found[found > 0.0]) == pytest.approx(14.0)
    y, x = np.indices(wet.shape)
    diagonal = np.abs(y - x + 10) <= 6
    found = measure_widths(np.rot90(diagonal, turns), 2.0)
    middle = found[np.rot90(np.abs(y - 30) < 5, turns) & (found > 0.0)]
    # 13 diagonals, 1/sqrt(2) cells apart
    assert np.median(middle) == pytest.approx(13.0 / math.sqrt(2.0) * 2.0, rel=0.1)
    disc = np.hypot(y - 30, x - 40) <= 15
    assert measure_widths(disc, 1.0)[30, 40] == pytest.approx(31.0, rel=0.05)
    assert not measure_widths(np.zeros_like(wet), 1.0).any()


def decision(name, value, is_on=False):
    return Decision(name, EFFECTS[name], value, is_on)


@pytest.mark.parametrize('name', ['steep', 'cooling', 'helmholtz', 'inertia'])
def test_cost_is_proportional_to_the_largest_number(name):
    effect = EFFECTS[name]
    assert decision(name, effect.threshold).cost == pytest.approx(effect.cost)
    half = decision(name, 0.5 * effect.threshold)
    assert half.cost == pytest.approx(0.5 * effect.cost)
    assert replace(half, measured=0.1 * effect.threshold).cost == half.cost
    assert replace(half, measured=effect.threshold).cost == pytest.approx(effect.cost)


def test_review_measures_an_excluded_effect(monkeypatch: pytest.MonkeyPatch):
    choice, threshold = EffectChoice({}, HOUR), EFFECTS['helmholtz'].threshold

    def review(value, *on):
        found = [decision('helmholtz', value, is_on=value > threshold)]
        monkeypatch.setattr(review_module, 'decide_by', lambda *_, **__: found)
        return set(choice.reviewed(None, only(*on), Accuracy(), 60.0))

    for value in (0.1, 0.4, 0.3):
        assert review(value, 'inertia') == {'inertia'}
    assert choice.largest == {'helmholtz': 0.4} and choice.review_count == 3
    assert not choice.since
    assert review(0.3) == review(0.3, 'helmholtz') == {'helmholtz'}
    assert choice.since == {'helmholtz': 60.0}


def test_reviews_evaluate_effects_that_are_off_and_have_a_threshold():
    watched = set(watched_effects(scene(ground(10.0)), only('cooling'), {'inertia': False}))
    assert {'helmholtz', 'steep'} <= watched
    assert not {'cooling', 'green', 'inertia', 'merging'} & watched


def test_decision_names_the_effect_that_excludes_it():
    before = decision('helmholtz', 0.01)
    low, high = (before.in_run(only('inertia'), measured, math.nan) for measured in (0.1, 0.4))
    assert low.rival == '' and low.reason.endswith('0.01 <= 0.22, measured 0.1')
    assert high.rival == 'inertia'
    assert high.reason == 'h / half-width = 0.4 > 0.22, but excluded by inertia'
    assert high.cost == pytest.approx(EFFECTS['helmholtz'].cost * 0.4 / 0.22)
    switched = before.in_run(only('helmholtz'), 0.4, 60.0)
    assert switched.is_on and switched.rival == '' and switched.cost == 0.0
    assert switched.reason == 'h / half-width = 0.4 > 0.22 since 60 s, 0.01 expected'
    assert np.isnan(before.in_run(only(), math.nan, math.nan).measured)
