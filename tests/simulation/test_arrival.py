# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Inundated fractions and arrival times from each step, and peak values from observations."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from lava_ros.errors import LavaError
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend.threads import MIN_MOVES, use_threads
from lava_ros.simulation.output import covered_cells
from lava_ros.simulation.output.inundation import (
    footprint_cells,
    inundated_fraction,
    reached_cells,
)
from lava_ros.simulation.output.peaks import Peaks
from lava_ros.simulation.output.snapshot import Particles
from lava_ros.simulation.output.window import Window
from lava_ros.simulation.presets import preset_accuracy
from solver import incline

TERRAIN = incline(0.2, 30, 40, 5.0)
SCENE = Scene(TERRAIN, (Vent((40.0, 75.0), 20.0),), lava=Lava.paper())
END = 90.0


class Shown:
    """Maps on a device, as ``Peaks.observe`` reads them."""

    def __init__(self, shape, device):
        self.grids = wp.zeros((2, *shape), dtype=wp.float32, device=device)
        self.window = Window(shape, 1)


def peaks_of(maps, device):
    """Return the results of observing maps of thickness and temperature on level ground."""
    shape = maps[0][0].shape
    known = np.isfinite(maps[0][0])
    terrain = Terrain(np.where(known, 0.0, np.nan), 1.0)
    state = Simulation(Scene(terrain), effects={}, device=device).solver.state
    state.cell_maps.bounds.assign([shape[0], shape[0], shape[1], shape[1]])
    peaks, shown = Peaks(shape, 0.1, 0.0, state.device), Shown(shape, state.device)
    ground = wp.array(known.astype(np.uint8), dtype=wp.uint8, device=state.device)
    for thickness, temperature in maps:
        shown.grids.assign(np.stack([thickness, temperature]).astype(np.float32))
        peaks.observe(state, ground, shown)
    return peaks, peaks.read(state, terrain, tuple(slice(0, count) for count in shape))


def test_bounds_contain_all_covered_cells(device):
    """Their sides are those of the square of some particle."""
    level = Terrain(np.zeros((30, 30)), 5.0)
    simulation = Simulation(
        Scene(level, (Vent((70.0, 80.0), 20.0),), lava=Lava.paper()), device=device,
        accuracy=Accuracy(spacing=3.0, thickness=1.0),
    )
    simulation.advance(60.0)
    state = simulation.solver.state
    reached = state.cell_maps.arrived.numpy() >= 0.0
    rows, columns = (np.flatnonzero(reached.any(axis=axis)) for axis in (1, 0))
    assert len(rows) > 3 < len(columns)
    found = state.cell_maps.bounds.numpy()
    ends = 30 - rows[0], rows[-1] + 1, 30 - columns[0], columns[-1] + 1
    assert (found >= ends).all()


def test_peaks_are_the_largest_values_of_all_observations(device):
    thickness = np.array([[3.0, 0.0, 1.0, np.nan]] * 2)
    temperature = np.array([[1300.0, np.nan, 1200.0, np.nan]] * 2)
    peaks, seen = peaks_of(
        [(thickness, temperature), (thickness[:, [2, 1, 0, 3]], temperature[:, [2, 1, 0, 3]])],
        device,
    )
    np.testing.assert_array_equal(seen.thickness, [[3.0, 0.0, 3.0, np.nan]] * 2)
    warmest = [[1300.0, np.nan, 1300.0, np.nan]] * 2
    np.testing.assert_array_equal(seen.temperature, warmest)
    np.testing.assert_array_equal(seen.inundated, [[0.0, 0.0, 0.0, np.nan]] * 2)
    assert peaks.flaw() == '' and np.isnan(seen.arrival).all()


@pytest.mark.parametrize(
    ('thickness', 'temperature', 'flaw'),
    [
        (1.0, 1400.0, ''),
        (np.inf, 1400.0, 'thickness is not a number of metres'),
        (-1.0, 1400.0, 'thickness is not a number of metres'),
        (1.0, np.nan, 'temperature is not a number of kelvin'),
        (1.0, 0.0, 'temperature is not a number of kelvin'),
    ],
)
def test_invalid_value_of_a_map_is_a_flaw(device, thickness, temperature, flaw):
    maps = np.full((2, 2), thickness), np.full((2, 2), temperature)
    assert peaks_of([(np.zeros((2, 2)), np.zeros((2, 2))), maps], device)[0].flaw() == flaw


def test_looks_refuse_another_threshold_than_that_of_the_simulation():
    with pytest.raises(LavaError, match=r'threshold is 0.5, expected 0.1 m'):
        made().start_peaks(0.5)


def made():
    return Simulation(SCENE, device='cpu', accuracy=Accuracy(spacing=3.5, thickness=0.7))


def test_arrival_equals_that_of_frequent_maps():
    simulation = made()
    seen = np.full(TERRAIN.shape, np.nan)
    for time in np.arange(1.0, END + 1.0):
        simulation.advance(time, limit=END)
        seen[np.isnan(seen) & simulation.snapshot().standing] = time
    one = made()
    one.advance(END)
    shown = one.snapshot()
    np.testing.assert_array_equal(shown.arrived, simulation.snapshot().arrived)
    np.testing.assert_array_equal(shown.inundated, simulation.snapshot().inundated)
    standing, reached = shown.standing, reached_cells(shown.arrived)
    assert standing.sum() > 50 and not (standing & ~reached).any()
    assert abs(np.nanmedian(seen - shown.half_inundated)) <= 2.0
    assert np.nanmin(shown.arrived) < 10.0 and np.nanmax(shown.arrived) <= END
    assert len(np.unique(shown.arrived[reached])) > 20


def test_frozen_lava_is_on_reached_cells_and_keeps_its_volume(device):
    lava = Lava.paper(viscosity=2e4, solidus=1300.0, convection=300.0)
    scene = Scene(TERRAIN, (Vent((40.0, 75.0), ((0.0, 20.0), (40.0, 0.0))),), lava=lava)
    accuracy = Accuracy(spacing=3.5, thickness=0.7)
    on = {'cooling': True, 'solidification': True}
    simulation = Simulation(scene, effects=on, device=device, accuracy=accuracy)
    simulation.advance(3000.0)
    shown = simulation.snapshot()
    cell = TERRAIN.resolution**2
    assert shown.budget.solidified > 0.2 * shown.budget.emitted
    solid = shown.frozen.astype(float).sum() * cell
    assert solid == pytest.approx(shown.budget.solidified, rel=1e-6)
    assert not ((shown.frozen > 0.0) & ~reached_cells(shown.arrived)).any()


def test_arrival_is_kept_on_new_terrain():
    simulation = made()
    simulation.advance(20.0)
    before = simulation.snapshot().arrived
    simulation.set_terrain(replace(TERRAIN, elevation=TERRAIN.elevation + 3.0))
    simulation.advance(25.0)
    after = simulation.snapshot().arrived
    known = np.isfinite(before)
    np.testing.assert_array_equal(after[known], before[known])
    simulation.set_terrain(replace(TERRAIN, origin=(-5.0, 0.0)))
    moved = simulation.snapshot().arrived
    np.testing.assert_array_equal(moved[:, 1:], after[:, :-1])
    assert np.isnan(moved[:, 0]).all()


def squares_under(particles, thickness, cell, shape):
    """Return the squares of cells under particles, of the simulation's width, as bool."""
    parts = covered_cells.PARTS
    middle = (np.arange(parts * max(shape)) + 0.5) * cell / parts
    half = 0.5 * covered_cells.WIDTH * np.sqrt(particles.volume / thickness)
    under = np.zeros((parts * shape[0], parts * shape[1]), dtype=bool)
    for (x, y), reach in zip(particles.position, half, strict=True):
        rows, columns = (np.abs(middle - place) <= reach for place in (y, x))
        under |= np.outer(rows[: len(under)], columns[: under.shape[1]])
    return under


def fraction_of(squares, shape):
    parts = covered_cells.PARTS
    return squares.reshape(shape[0], parts, shape[1], parts).mean(axis=(1, 3))


def test_fraction_of_a_cell_is_that_in_the_squares_of_particles(device):
    shape, cell = (12, 15), 4.0
    random = np.random.default_rng(1)
    places = random.uniform(12.0, 34.0, (60, 2))
    particles = Particles(places, random.uniform(2.0, 30.0, 60), 1400.0)
    simulation = Simulation(
        Scene(Terrain(np.zeros(shape), cell)), effects={}, device=device, particles=particles,
        accuracy=Accuracy(spacing=3.0, thickness=1.0),
    )
    shown, sample = simulation.snapshot(), simulation.sample()
    expected = fraction_of(squares_under(sample, sample.thickness, cell, shape), shape)
    rows, columns = (sample.position[:, ::-1] // cell).astype(int).T
    touched = np.zeros(shape, dtype=bool)
    touched[rows, columns] = True
    expected[touched & (expected == 0.0)] = 0.02
    assert 0.0 < expected[(expected > 0.0) & (expected < 1.0)].min() < 0.5
    np.testing.assert_allclose(shown.inundated, expected, atol=1e-6)
    np.testing.assert_array_equal(shown.footprint, expected >= 0.5)
    np.testing.assert_array_equal(np.isfinite(shown.arrived), expected > 0.0)
    np.testing.assert_array_equal(np.isfinite(shown.half_inundated), expected >= 0.5)
    assert shown.area(shown.inundated) == pytest.approx(expected.sum() * cell**2)


@pytest.mark.parametrize('way', [0.0, 0.3, 3.0])
def test_covered_squares_are_those_of_all_places_of_particles(way, device):
    shape, cell = (12, 15), 4.0
    random = np.random.default_rng(2)
    places, volumes = random.uniform(8.0, 38.0, (60, 2)), random.uniform(2.0, 30.0, 60)
    simulation = Simulation(
        Scene(Terrain(np.zeros(shape), cell)), effects={}, device=device,
        accuracy=Accuracy(spacing=3.0, thickness=1.0),
        particles=Particles(places, volumes, 1400.0),
    )
    squares = np.zeros(np.multiply(covered_cells.PARTS, shape), dtype=bool)
    touched = np.zeros(shape, dtype=bool)
    for _ in range(4):
        sample = simulation.sample()
        squares |= squares_under(sample, sample.thickness, cell, shape)
        rows, columns = (sample.position[:, ::-1] // cell).astype(int).T
        touched[rows, columns] = True
        expected = fraction_of(squares, shape)
        expected[touched & (expected == 0.0)] = 0.02
        shown = simulation.snapshot().inundated
        np.testing.assert_allclose(shown, expected, atol=1e-6)
        rows = simulation.solver.state.read_particles()
        rows[:, :2] += random.uniform(-way, way, (len(rows), 2))
        simulation.solver.state.write_particles(rows)
        simulation.solver.cover()
        simulation.solver.record_covered_ground()
    assert (expected == 1.0).sum() > 20 and ((expected > 0.02) & (expected < 1.0)).sum() > 20


@pytest.mark.parametrize('cell', [20.0, 10.0, 5.0, 2.0])
def test_inundated_area_of_a_disc_is_exact_for_any_cells_and_particles(cell):
    """A constant flux on level ground (Huppert 1982), whose radius is known."""
    density, viscosity, flux, end = 2600.0, 1e5, 10.0, 900.0
    radius = 0.715 * (9.81 * density * flux**3 / (3.0 * viscosity)) ** 0.125 * end**0.5
    count = round(200.0 / cell)
    lava = Lava.paper(
        density=density, viscosity=viscosity, arrhenius=0.0, emissivity=0.0, convection=0.0,
        reference_temperature=1400.0,
    )
    scene = Scene(
        Terrain(np.full((count, count), 100.0), cell, origin=(-101.7, -98.9)),
        (Vent((0.0, 0.0), flux, radius=5.0, temperature=1400.0),), lava,
        ambient_temperature=300.0,
    )
    errors = []
    for preset in ('draft', 'fine'):
        simulation = Simulation(
            scene, accuracy=preset_accuracy(preset), device='cpu', horizon=end
        )
        simulation.advance(end)
        shown = simulation.snapshot()
        errors.append(shown.area(shown.inundated) / (np.pi * radius**2) - 1.0)
    assert max(map(abs, errors)) < 0.03 and np.ptp(errors) < 0.03


def test_fractions_are_kept_on_new_terrain(device):
    simulation = Simulation(SCENE, device=device, accuracy=Accuracy(spacing=3.5, thickness=0.7))
    simulation.advance(60.0)
    before = simulation.snapshot()
    # moved by two squares of the 25 of a cell
    simulation.set_terrain(replace(TERRAIN, origin=(-2.0, 0.0)))
    after = simulation.snapshot()
    assert after.area(after.inundated) == pytest.approx(before.area(before.inundated), rel=0.01)
    assert not (after.standing & ~reached_cells(after.arrived)).any()
    np.testing.assert_array_equal(after.inundated > 0.0, reached_cells(after.arrived))
    np.testing.assert_array_equal(
        footprint_cells(after.inundated), np.isfinite(after.half_inundated)
    )


@pytest.mark.parametrize(
    ('until', 'origin', 'cell'),
    [(0.0, (-2.0, 0.0), 5.0), (60.0, (1e4, 0.0), 5.0), (60.0, (5.0, 5.0), 3.0),
     (60.0, (0.0, 0.0), 10.0)],
)
def test_fractions_are_resampled_where_terrains_overlap(until, origin, cell):
    simulation = made()
    simulation.advance(until)
    before = simulation.snapshot()
    count = round(120.0 / cell)
    ground = Terrain(np.zeros((count, count)), cell, origin)
    cells = simulation.solver.covered
    cells.move(ground, None, 0.1)
    arrived, half, squares = (
        getattr(cells.maps, name).numpy() for name in ('arrived', 'half_inundated', 'covered')
    )
    inundated = inundated_fraction(arrived, squares)
    np.testing.assert_array_equal(footprint_cells(inundated), half >= 0.0)
    assert not squares[arrived < 0.0].any()
    # the part of the former terrain that the new one covers
    x, y = (np.arange(n) * 5.0 for n in TERRAIN.shape[::-1])
    inside = np.logical_and.outer(
        *((side >= at) & (side < at + 120.0) for side, at in ((y, origin[1]), (x, origin[0])))
    )
    expected = np.where(inside, before.inundated, 0.0).sum() * 25.0
    assert inundated.sum() * cell**2 == pytest.approx(expected, rel=0.03)
    assert (expected > 0.0) == (until > 0.0 and origin[0] < 200.0)


def test_fractions_do_not_depend_on_the_number_of_threads():
    shown, side = [], 0.5 * np.arange(200) + 20.0
    places = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    for threads in (1, 3):
        use_threads(threads)
        try:
            simulation = Simulation(
                replace(SCENE, vents=()), device='cpu', effects={},
                accuracy=Accuracy(spacing=0.5, thickness=0.7),
                particles=Particles(places, 0.25 * 0.7, 1400.0),
            )
            simulation.advance(0.5)
            shown.append(simulation.snapshot())
        finally:
            use_threads(None)
    # enough for three threads to move them
    assert shown[0].particle_count > 2 * MIN_MOVES
    for name in ('inundated', 'arrived', 'half_inundated'):
        np.testing.assert_array_equal(*(getattr(one, name) for one in shown))


@pytest.mark.parametrize('columns', [80, 400])
def test_maps_visit_the_surroundings_of_lava_and_no_other_cells(columns):
    terrain = incline(0.2, 60, columns, 5.0)
    simulation = Simulation(
        replace(SCENE, terrain=terrain, vents=(Vent((60.0, 150.0), 20.0),)), effects={},
        device='cpu', accuracy=Accuracy(spacing=3.5, thickness=0.7),
    )
    simulation.advance(30.0)
    rows, across = simulation.solver.raster.window.rectangle(simulation.solver.state)
    reached = np.argwhere(reached_cells(simulation.snapshot().arrived))
    assert (rows.stop - rows.start) * (across.stop - across.start) < 1500
    assert (reached.min(axis=0) >= (rows.start, across.start)).all()
    assert (reached.max(axis=0) < (rows.stop, across.stop)).all()


@pytest.mark.parametrize(
    ('thickness', 'given', 'expected'),
    [
        (2.0, None, 0.1), (0.5, None, 0.1), (0.3, None, 0.06), (0.0072, None, 0.001),
        (2.0, 1.5, 1.5),
    ],
)
def test_threshold_follows_the_thickness_of_thin_lava_unless_given(thickness, given, expected):
    accuracy = Accuracy(spacing=5.0, thickness=thickness, threshold=given)
    assert accuracy.inundation_threshold == expected
