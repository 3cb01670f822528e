# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Simulations with the method cells: vents, maps, budget, changes and refusals."""

from dataclasses import replace
import math
from types import SimpleNamespace

import numpy as np
import pytest

from lava_ros.effects import EFFECTS
from lava_ros.errors import LavaError
from lava_ros.forecast.members import make_plan, run_members
from lava_ros.forecast.sampling import Member
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.events import TerrainEvent
from lava_ros.simulation import Particles, Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.cells import solver as solver_module
from lava_ros.simulation.cells.lava import DUST, remove_dust
from lava_ros.simulation.cells.solver import CellSolver
from lava_ros.simulation.output.measurement import current_resolution
from lava_ros.simulation.selection import decide, effects_for, warnings_of
from solver import flat, only

LAVA = Lava.paper(viscosity=1e4, density=2600.0)


def simulated(terrain, *vents, effects=None, lava=LAVA, particles=None, events=(), **knobs):
    """Return a simulation on cells of isothermal lava."""
    effects = only('steep') if effects is None else effects
    return Simulation(
        Scene(terrain, vents, lava, events=events), effects=effects, particles=particles,
        accuracy=Accuracy(method='cells', **knobs), device='cpu', horizon=3600.0,
    )


def slope(turn=0.0, cells=60, cell=5.0):
    """Return a plane that falls by 0.1, around (0, 0)."""
    half = 0.5 * cells * cell
    line = np.arange(-half + 0.5 * cell, half, cell)
    x, y = np.meshgrid(line, line)
    return Terrain(-0.1 * (x * math.cos(turn) + y * math.sin(turn)), cell, origin=(-half, -half))


def test_vents_emit_the_integral_of_their_rates():
    rates = ((0.0, 3.0), (40.0, 0.0), (100.0, 8.0), (130.0, 1.0))
    vents = Vent((-60.0, 3.0), rates, radius=7.0), Vent((-40.0, 30.0), 2.0, end=(-20.0, 50.0))
    simulation = simulated(slope(), *vents)
    for until in (10.0, 70.0, 100.0, 101.0, 200.0):
        simulation.advance(until)
        budget = simulation.budget()
        expected = sum(vent.volume_between(0.0, until) for vent in vents)
        assert budget.emitted == pytest.approx(expected, rel=1e-12)
    snapshot = simulation.snapshot()
    volume = np.nansum(snapshot.thickness, dtype=float) * 25.0
    assert volume == pytest.approx(budget.flowing, rel=1e-6)


FREEZING = only('steep', 'arrhenius', 'cooling', 'solidification')
COLD = replace(LAVA, arrhenius=0.02, solidus=1250.0)


def test_bare_simulations_share_the_ground_until_lava_solidifies():
    ground, vent = slope(), Vent((-60.0, 3.0), 3.0, radius=7.0, temperature=1300.0)
    former, first, second, freezing = (
        simulated(ground, vent, effects=effects, lava=COLD)
        for effects in (None, None, None, FREEZING)
    )
    former.advance(600.0)
    freezing.advance(600.0)
    assert freezing.budget().solidified > 0.0
    first.advance(600.0)
    np.testing.assert_array_equal(former.snapshot().thickness, first.snapshot().thickness)
    second.set_effects(dict.fromkeys(EFFECTS, False) | dict.fromkeys(FREEZING, True))
    faces = [one.solver.state.drop_x.ptr for one in (former, first, second, freezing)]
    assert len(set(faces)) == 3
    assert faces[0] == faces[1]


def initial_lava():
    """Return lava of which the edge is thinner than a film, away from the vent."""
    places = np.array([[50.0, 60.0], [52.0, 61.0], [0.0, -90.0]])
    return Particles(places, np.array([30.0, 1e-7, 1e-9]), np.array([1300.0, 1260.0, 1290.0]))


@pytest.mark.parametrize('change', ['none', 'terrain', 'vents', 'restart'])
@pytest.mark.parametrize('effects', [None, FREEZING], ids=['steep', 'freezing'])
def test_budget_and_count_include_all_cells(effects, change):
    vent = Vent((-60.0, 3.0), 3.0, radius=7.0, temperature=1300.0)
    simulation = simulated(
        slope(), vent, effects=effects, lava=COLD, particles=initial_lava()
    )
    check_sums(simulation)
    simulation.advance(600.0)
    if change == 'terrain':
        ground = slope()
        simulation.set_terrain(Terrain(ground.elevation[5:, :-2] + 1.0, 5.0, (-150.0, -125.0)))
    elif change == 'vents':
        simulation.set_vents([Vent((90.0, -90.0), 2.0)])
    elif change == 'restart':
        simulation = Simulation.resume(simulation.checkpoint(), device='cpu')
    check_sums(simulation)
    simulation.advance(900.0)
    check_sums(simulation)


def check_sums(simulation):
    """Check budget and count against the whole maps."""
    state, heat, area = simulation.solver.state, simulation.solver.heat, 25.0
    thickness, budget = state.thickness.numpy(), simulation.budget()
    assert budget.flowing == pytest.approx(thickness.sum() * area, rel=1e-14)
    assert budget.solidified == pytest.approx(heat.frozen.numpy().sum() * area, rel=1e-14)
    assert simulation.particle_count == (thickness > simulation.solver._film).sum()


def test_simulations_that_take_turns_are_as_if_alone():
    # simulations of a thread share the buffers of their launches
    def begun(number):
        effects, flux = (None, FREEZING, None)[number], (5.0, 5.0, 9.0)[number]
        return simulated(slope(cells=40 + number), Vent((-60.0, 3.0), flux), effects=effects)

    def volume_and_map(simulation):
        return simulation.budget(), simulation.snapshot().thickness

    alone = []
    for number in range(3):
        simulation = begun(number)
        for until in (20.0, 45.0, 80.0):
            simulation.advance(until)
        alone.append(volume_and_map(simulation))
    together = [begun(number) for number in range(3)]
    for until in (20.0, 45.0, 80.0):
        for simulation in together:
            simulation.advance(until)
    for expected, simulation in zip(alone, together, strict=True):
        budget, thickness = volume_and_map(simulation)
        assert budget == expected[0]
        np.testing.assert_array_equal(thickness, expected[1])


def test_a_launch_has_as_many_steps_as_take_its_time(monkeypatch):
    """On a clock by which a step takes a millisecond."""
    now, launch = [0.0], CellSolver._launch
    clock = SimpleNamespace(perf_counter=lambda: now[0], monotonic=lambda: now[0])
    monkeypatch.setattr(solver_module, 'wall_clock', clock)

    def slow(solver, *arguments):
        before = solver.steps
        launch(solver, *arguments)
        now[0] += 1e-3 * (solver.steps - before) + 1e-9

    monkeypatch.setattr(CellSolver, '_launch', slow)
    simulation = simulated(slope(), Vent((-60.0, 3.0), 8.0, radius=7.0))
    simulation.advance(100.0)
    assert simulation.solver._steps_at_once == pytest.approx(
        1e3 * solver_module._LAUNCH_TIME, abs=1.0
    )


def test_rounding_errors_beyond_the_fronts_are_not_on_maps():
    simulation = simulated(slope(), Vent((-60.0, 3.0), 20.0))
    simulation.advance(1200.0)
    snapshot = simulation.snapshot()
    has_lava = snapshot.thickness > 0.0
    thickness = simulation.solver.state.map_of('thickness')
    assert ((thickness > 0.0) & ~has_lava).any()
    assert thickness[~has_lava].max() < thickness[has_lava].min()
    np.testing.assert_array_equal(np.isfinite(snapshot.temperature), has_lava)
    # the omitted volume is below the rounding of the map
    assert thickness[~has_lava].sum() < DUST * thickness.sum()


def test_thin_lava_on_a_large_map_is_not_taken_for_rounding_errors():
    # together it is much more than the rounding of the map
    thickness = np.full((100, 100), 1e-7)
    thickness[0, 0] = 200.0
    expected = thickness.copy()
    remove_dust(thickness)
    np.testing.assert_array_equal(thickness, expected)


def test_steps_keep_the_largest_thickness():
    simulation = simulated(slope(), Vent((-60.0, 3.0), ((0.0, 8.0), (60.0, 0.0)), radius=7.0))
    peaks = simulation.start_peaks(simulation.accuracy.inundation_threshold)
    largest = np.zeros(simulation.scene.terrain.shape, dtype=np.float32)
    for time in range(10, 301, 10):
        simulation.advance(float(time))
        largest = np.maximum(largest, np.nan_to_num(simulation.snapshot().thickness))
    # one observation, at the end
    list(simulation.observing(peaks))
    found = simulation.read_peaks(peaks)
    assert not found.flaw
    wet = largest > 0.0
    assert (found.thickness[wet] >= largest[wet]).all()
    assert np.abs(found.thickness - largest)[wet].max() < 0.05 * largest.max()
    assert np.nanmax(found.temperature) == pytest.approx(simulation.scene.vents[0].temperature)


def test_lava_in_cells_partly_without_data_is_on_the_map():
    # the outermost cells are half outside of the odd side; a fixture checks the volume
    level = np.zeros((21, 21))
    level[9:13:2, 10:12] = math.nan
    terrain = Terrain(level, 5.0, origin=(-52.5, -52.5))
    for place in ((0.0, 0.0), (52.0, 0.0)):
        simulation = simulated(terrain, Vent(place, 20.0, radius=5.0), spacing=10.0)
        simulation.advance(5.0)
        assert simulation.snapshot().budget.flowing > 50.0


def test_narrow_vent_is_as_wide_as_a_cell():
    simulation = simulated(flat(41, 5.0), Vent((0.0, 0.0), 1.0, radius=0.1))
    simulation.advance(1.0)
    wet = simulation.solver.state.map_of('source') > 0.0
    assert wet.sum() == 1
    assert wet[20, 20]


@pytest.mark.parametrize('turn', [0.0, 30.0, 45.0])
def test_area_and_front_do_not_depend_on_the_direction_of_the_grid(turn):
    reference = reached(0.0)
    assert reached(turn) == pytest.approx(reference, rel=0.02)


def reached(turn):
    """Return the inundated area [m2], and the distance of the front down the slope [m]."""
    turn = math.radians(turn)
    terrain = slope(turn, cells=120)
    place = -200.0 * math.cos(turn), -200.0 * math.sin(turn)
    simulation = simulated(terrain, Vent(place, 10.0))
    simulation.advance(1800.0)
    snapshot = simulation.snapshot()
    row, column = np.nonzero(snapshot.footprint)
    x, y = (np.array([column, row]) + 0.5) * 5.0 + np.array(terrain.origin)[:, None]
    along = x * math.cos(turn) + y * math.sin(turn)
    return snapshot.area(snapshot.inundated), np.sort(along)[-5:].mean() + 200.0


@pytest.mark.parametrize('spacing', [2.5, 5.0, 10.0])
def test_error_of_the_area_is_less_than_a_fraction_of_the_spacing(spacing):
    assert area_by(spacing) == pytest.approx(area_by(1.25), rel=0.01 * spacing)


def area_by(spacing):
    """Return the inundated area [m2] by cells of a size [m], on a terrain with cells of 5 m."""
    simulation = simulated(slope(), Vent((-60.0, 0.0), 10.0), spacing=spacing)
    simulation.advance(600.0)
    assert simulation.solver.grid.resolution == spacing
    snapshot = simulation.snapshot()
    assert np.nansum(snapshot.thickness, dtype=float) * 25.0 == pytest.approx(6000.0, rel=1e-5)
    return snapshot.area(snapshot.inundated)


def test_lava_covers_its_cells_from_where_it_comes():
    """A flow to the north covers its cells as one to the south does."""
    south, north = (
        simulated(slope(turn), Vent((0.0, -60.0 * math.sin(turn)), 5.0), spacing=15.0)
        for turn in (-0.5 * math.pi, 0.5 * math.pi)
    )
    maps = []
    for simulation in (south, north):
        simulation.advance(300.0)
        maps.append(simulation.snapshot().inundated)
    assert (maps[0] > 0.0).sum() > 10
    np.testing.assert_array_equal(maps[0], maps[1][::-1])


def test_covered_area_is_that_of_a_constant_flux():
    simulation = simulated(flat(80, 5.0), Vent((0.0, 0.0), 10.0), effects=only())
    simulation.advance(3600.0)
    snapshot = simulation.snapshot()
    # R = 0.715 (g Q^3 / 3 nu)^(1/8) t^(1/2), Huppert 1982
    radius = 0.71502 * (9.81 * 10.0**3 * 2600.0 / 3e4) ** 0.125 * 60.0
    assert snapshot.area(snapshot.inundated) == pytest.approx(math.pi * radius**2, rel=0.03)
    times = snapshot.arrived[40, 40:]
    reached = np.isfinite(times)
    assert (np.diff(times[reached]) >= 0.0).all()
    assert snapshot.standing_area == snapshot.area(snapshot.inundated)


def test_lava_at_the_start_keeps_its_volume_and_temperature():
    places = np.random.default_rng(3).uniform(-50.0, 50.0, (500, 2))
    simulation = simulated(
        slope(), particles=Particles(places, 7.0, 1250.0), thickness=1.0, spacing=5.0
    )
    assert simulation.budget().flowing == pytest.approx(3500.0, rel=1e-12)
    simulation.advance(100.0)
    assert set(simulation.sample().temperature) == {1250.0}


def test_changes_of_vents_and_terrain_conserve_volume():
    simulation = simulated(slope(), Vent((-60.0, 0.0), 10.0))
    simulation.advance(200.0)
    simulation.set_vents([Vent((20.0, 40.0), 5.0)])
    simulation.advance(300.0)
    smaller = Terrain(
        slope().elevation[10:50, 4:] + 1.0, 5.0, origin=(-130.0, -100.0)
    )
    arrived = np.isfinite(simulation.snapshot().arrived).sum()
    simulation.set_terrain(smaller)
    simulation.advance(400.0)
    budget = simulation.budget()
    assert budget.emitted == pytest.approx(3000.0, rel=1e-12)
    assert np.isfinite(simulation.snapshot().arrived).sum() >= arrived


@pytest.mark.parametrize(('knobs', 'shape', 'used'), [
    ({'spacing': 4.0}, (60, 60), 5.0), ({'spacing': 8.0, 'thickness': 2.0}, (60, 60), 10.0),
    ({'spacing': 3.0}, (60, 60), 2.5), ({'spacing': 2.5}, (60, 60), 2.5),
    # two cells along a side, and three become two
    ({'spacing': 100.0}, (60, 2), 5.0), ({'spacing': 100.0}, (5, 60), 10.0),
    ({'refinement': 0.2}, (60, 4), 10.0),
])
def test_spacing_in_outputs_is_the_size_of_the_cells(knobs, shape, used):
    ground = Terrain(np.zeros(shape), 5.0)
    simulation = simulated(ground, Vent((5.0, 5.0), 10.0), **knobs)
    for item in (simulation, Simulation.resume(simulation.checkpoint(), device='cpu')):
        assert item.solver.grid.resolution == item.accuracy.spacing == used
        found = current_resolution(item.snapshot(), item.accuracy, item.resolution)
        assert item.resolution.spacing == found.spacing == used
    plan = make_plan(simulation.scene, horizon=600.0, accuracy=Accuracy(method='cells', **knobs))
    assert plan.accuracy.spacing == used


def test_spacing_in_outputs_follows_a_replaced_terrain():
    simulation = simulated(slope(), Vent((-60.0, 0.0), 10.0), spacing=1.25)
    simulation.advance(600.0)
    simulation.set_terrain(Terrain(np.zeros((40, 40)), 7.0, origin=(-140.0, -140.0)))
    found = current_resolution(
        simulation.snapshot(), simulation.accuracy, simulation.resolution
    )
    assert found.limit == 'measured'
    assert simulation.solver.grid.resolution == found.spacing == 1.75
    assert simulation.accuracy.spacing == simulation.checkpoint().accuracy.spacing == 1.75


@pytest.mark.parametrize(('shape', 'cell', 'knobs', 'message'), [
    ((40, 40), 5000.0, {'spacing': 1.0}, r'spacing is 1.0, expected at least 39.06 m, the smal'),
    ((2, 9000), 8.0, {'spacing': 1.0}, r'spacing is 1.0, expected at least 4 m, the smallest'),
    ((4, 4), 1e-3, {'spacing': 1e-5}, r'spacing is 1e-05, expected at least 0.000125 m, the'),
    ((600, 600), 10.0, {'refinement': 20.0}, r'refinement is 20.0, expected one for which the a'),
])
def test_refuses_cells_that_the_terrain_cannot_have(shape, cell, knobs, message):
    ground = Terrain(np.zeros(shape), cell)
    with pytest.raises(LavaError, match=f'^accuracy.{message}'):
        simulated(ground, Vent((cell, cell), 1e-6, radius=cell), **knobs)


def test_wide_vent_spreads_evenly_over_small_cells():
    ground = Terrain(np.zeros((2, 2)), 100.0)
    simulation = simulated(ground, Vent((100.0, 100.0), 10.0, radius=5000.0), spacing=1.0)
    weights = simulation.solver.vents.weights[0]
    assert weights.size == 256 * 256 and weights.max() < 4.1 * weights.min()


def test_terrain_remains_if_the_next_one_is_refused():
    simulation = simulated(slope(), Vent((-60.0, 0.0), 10.0), spacing=5.0)
    simulation.advance(100.0)
    with pytest.raises(LavaError, match=r'accuracy.spacing is 5.0, expected at least 39.06 m'):
        simulation.set_terrain(Terrain(np.zeros((40, 40)), 5000.0, origin=(-1e5, -1e5)))
    simulation.advance(200.0)
    budget = simulation.budget()
    assert simulation.scene.terrain.shape == (60, 60) and simulation.accuracy.spacing == 5.0
    assert budget.emitted == pytest.approx(2000.0) and budget.error < 1e-12


def test_terrain_events_change_the_ground_at_their_times():
    wall = slope().elevation.astype(float)
    wall[:, 30:32] += 30.0
    raised = Terrain(wall, 5.0, origin=slope().origin)
    event = TerrainEvent(0.0, 'a wall', terrain=raised)
    free, held = (
        simulated(slope(), Vent((-60.0, 0.0), 10.0), events=events) for events in ((), (event,))
    )
    for simulation in (free, held):
        simulation.advance(1200.0)
    assert np.isfinite(free.snapshot().arrived[:, 33:]).any()
    assert not np.isfinite(held.snapshot().arrived[:, 33:]).any()


@pytest.mark.parametrize(
    'name',
    [name for name, effect in EFFECTS.items() if effect.needs_particles],
)
def test_effects_of_particles_only_are_refused_by_name(name):
    with pytest.raises(LavaError, match=f'effects.{name} .* method particles'):
        simulated(slope(), effects=only(name))


def test_needed_effects_of_particles_are_off_and_warned_about():
    scene = Scene(slope(), (Vent((-60.0, 0.0), 100.0),), replace(LAVA, viscosity=1.0))
    by_method = {
        method: decide(scene, accuracy=Accuracy(method=method, spacing=5.0), horizon=600.0)
        for method in ('particles', 'cells')
    }
    needed = [
        item.name for item in by_method['particles'] if item.is_on and item.effect.needs_particles
    ]
    assert 'inertia' in needed
    found = {item.name: item for item in by_method['cells']}
    for name in needed:
        assert not found[name].is_on and found[name].is_missed and found[name].cost > 0.0
    texts = warnings_of(by_method['cells'])
    assert len(texts) == len(needed) and 'the flow needs inertia (' in texts[0]
    assert warnings_of(by_method['particles']) == []
    assert 'inertia' not in effects_for(scene, accuracy=Accuracy(method='cells'), horizon=600.0)


def test_limit_of_the_mobility_is_refused():
    with pytest.raises(LavaError, match='mobility_limit is 1.4'):
        simulated(slope(), mobility_limit=1.4)


def test_members_of_an_ensemble_run_on_cells_and_pairs_on_doubled_ones():
    scene = Scene(slope(), (Vent((-60.0, 0.0), 10.0),), LAVA)
    plan = make_plan(scene, horizon=600.0, accuracy=Accuracy(method='cells'))
    assert plan.accuracy.spacing == 5.0 and plan.coarser.accuracy.spacing == 10.0
    pair, alone = run_members(plan, [Member(0), Member(1)], device='cpu')
    assert pair.pair is not None and alone.pair is None
    np.testing.assert_array_equal(pair.arrival, alone.arrival)
    # the same volume on cells of half the side
    assert abs(pair.pair.growth) < 0.2 and 0.0 < pair.pair.difference < 0.5


def test_wall_limit_stops_between_steps():
    simulation = simulated(slope(), Vent((-60.0, 0.0), 10.0))
    assert simulation.advance(1e5, wall_limit=1e-3) < 1e5


def test_launch_takes_no_more_steps_after_its_lava_has_frozen():
    vent = Vent((-60.0, 3.0), ((0.0, 1.0), (20.0, 0.0), (4e5, 1.0)), radius=7.0)
    lava = replace(LAVA, convection=1e5, solidus=1200.0)
    simulation = simulated(
        slope(), vent, lava=lava, effects=only('cooling', 'solidification'), longest_step=10.0
    )
    # a launch could take them all
    simulation.solver._steps_at_once = 10**6
    simulation.advance(4e5)
    assert simulation.budget().solidified == pytest.approx(20.0, rel=1e-12)
    assert simulation.solver.steps < 500


@pytest.mark.parametrize('discharge', [
    ((0.0, 1.0), (20.0, 0.0), (1e3, 1.0)), ((0.0, 0.0), (1e3, 1.0)),
])
def test_ticks_without_lava_take_no_launch_and_change_nothing(discharge):
    vent = Vent((-60.0, 3.0), discharge, radius=7.0)
    lava = replace(LAVA, convection=1e5, solidus=1200.0)
    ticked, expected = (
        simulated(
            slope(), vent, lava=lava, effects=only('cooling', 'solidification'),
            longest_step=10.0,
        ) for _ in range(2)
    )
    launches, solver = [], ticked.solver
    launch = solver._take_steps
    solver._take_steps = lambda: (launches.append(solver.time), launch())
    for until in [500.0, *np.arange(520.0, 1e3, 20.0), 1020.0]:
        ticked.advance(until, limit=1020.0)
    expected.advance(1020.0)
    assert solver.steps == expected.solver.steps > 3
    # the lava of the first 20 s is solid long before 500 s
    assert not [time for time in launches if 500.0 < time < 1e3]
    for name, values in vars(ticked.sample()).items():
        assert np.array_equal(values, vars(expected.sample())[name]), name
    maps = [simulation.snapshot() for simulation in (ticked, expected)]
    assert np.array_equal(*(one.arrived for one in maps), equal_nan=True)
    assert np.array_equal(*(one.thickness for one in maps), equal_nan=True)
