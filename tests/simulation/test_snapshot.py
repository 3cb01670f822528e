# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Outputs of a simulation: the volume budget, snapshots and their flaws."""

from dataclasses import replace
import math
import re

import numpy as np
import pytest

from lava_ros.effects import Effects
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.carriers import METHODS
from lava_ros.simulation.output.budget import volume_key, VolumeBudget, VOLUMES
from lava_ros.simulation.output.diagnostics import gather_numbers, moment_of
from lava_ros.simulation.output.inundation import reached_cells
from lava_ros.simulation.output.snapshot import Particles, rows_of, Snapshot, StepReport
from lava_ros.simulation.particles import lava as lava_module
from lava_ros.simulation.particles import solver as solver_module
from solver import incline, simulated

#: Budget after a hole has taken most of an eruption.
SWALLOWED = VolumeBudget(
    324_000.0, 18_397.5, lost_over_border=102.0, lost_in_no_data=305_500.0, waiting=0.5
)

VENTS = (Vent((60.0, 155.0), 20.0), Vent((160.0, 155.0), 5.0))

COLUMNS = {'x': 0, 'y': 1, 'volume': 2, 'temperature': 3}


def test_coincident_particles_are_moved_apart():
    places = [(5.0, 5.0), (0.5, 0.5), (5.0, 5.0), (2.0, 3.0), (5.0, 5.0), (0.5, 0.5)]
    given = Particles(places, 1.0, 1400.0)
    rows = rows_of(given, Terrain(np.zeros((10, 10)), 1.0), 2.0)
    moved = np.hypot(*(rows[:, :2] - places).T)
    # a thousandth of the spacing, times the root of the number of particles there before
    assert moved == pytest.approx(2e-3 * np.sqrt([0, 0, 1, 0, 2, 1]))
    assert len(np.unique(rows[:, :2], axis=0)) == len(places)
    assert given.position.tolist() == [list(place) for place in places]


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('lost', ['never', 'at the start', 'hole in the lava', 'sea'])
def test_inundated_fraction_is_unknown_where_the_ground_has_no_data(method, lost):
    whole = Terrain(valley(), 10.0)
    holed = np.array(whole.elevation)
    holed[13:18, 8:12] = np.nan
    after = {
        'never': whole, 'sea': replace(whole, sea_level=492.0),
    }.get(lost, replace(whole, elevation=holed))
    simulation = Simulation(
        Scene(after if lost == 'at the start' else whole, VENTS[:1], Lava(viscosity=1e3)),
        accuracy=Accuracy(method=method, spacing=10.0), device='cpu',
    )
    simulation.advance(200.0)
    before = simulation.snapshot()
    simulation.set_terrain(after)
    snapshot = simulation.snapshot()
    assert (reached_cells(before.arrived) & ~after.has_data).any() is np.bool_(
        lost in ('hole in the lava', 'sea')
    )
    np.testing.assert_array_equal(np.isnan(snapshot.inundated), ~after.has_data)
    np.testing.assert_array_equal(np.isnan(snapshot.inundated), np.isnan(snapshot.thickness))
    kept = np.where(after.has_data, before.inundated, 0.0)
    assert snapshot.area(snapshot.inundated) == before.area(kept) > 0.0


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('spacing', [5.0, 10.0, 20.0])
@pytest.mark.parametrize('time', [0.0, 200.0])
def test_temperature_is_known_exactly_where_there_is_lava(method, spacing, time):
    simulation = Simulation(
        Scene(Terrain(valley(), 10.0), VENTS[:1], Lava(viscosity=1e3)),
        accuracy=Accuracy(method=method, spacing=spacing), device='cpu',
    )
    simulation.advance(time)
    snapshot = simulation.snapshot()
    wet = snapshot.thickness > 0.0
    assert wet.any() is np.bool_(time > 0.0)
    np.testing.assert_array_equal(np.isfinite(snapshot.temperature), wet)
    assert (snapshot.temperature[wet] > 1000.0).all()


def valley():
    y, x = np.mgrid[0:30, 0:40]
    return 500.0 - x + 0.05 * (y - 15.0) ** 2


def test_parts_of_the_budget_add_up_to_the_emitted_volume():
    budget = VolumeBudget(
        100.0, 30.0, 35.0, lost_over_border=5.0, lost_in_no_data=18.0, lost_in_sea=2.0,
        waiting=10.0, overdue=8.0,
    )
    rows = {name: value.removesuffix(' m3') for name, value in budget.rows()}
    assert rows == {
        'emitted': '100', 'flowing': '30', 'solidified': '35', 'lost over the border': '5',
        'lost in no-data cells': '18', 'lost in the sea': '2', 'waiting in the vents': '10',
        'overdue in the vents': '8', 'error': 'below 1e-15 of the emitted volume',
    }
    parts = [float(rows[name]) for name in list(rows)[1:7]]
    assert sum(parts) == 100.0
    # a flow in the laboratory
    assert VolumeBudget(8.17e-4, 8.17e-4).rows()[1] == ('flowing', '0.000817 m3')


def test_text_names_lost_and_solidified_lava():
    assert SWALLOWED.error == 0.0
    assert 'lost in no-data cells 305,500.0 m3' in SWALLOWED.text()
    frozen = VolumeBudget(300_000.0, 15_394.0, 284_605.0, waiting=1.0)
    assert 'flowing 15,394.0 m3, solidified 284,605.0 m3' in frozen.text()
    assert frozen.warnings() == []


@pytest.mark.parametrize(
    ('budget', 'phrase'),
    [
        (SWALLOWED, '94.3 % of the lava was lost in no-data cells'),
        (VolumeBudget(100.0, 99.0, lost_over_border=1.0), '1 % of the lava was lost over'),
        (VolumeBudget(100.0, 98.0, waiting=2.0, overdue=1.5), 'behind: 1.5 m3 of lava is'),
        (VolumeBudget(100.0, 100.0, thin=20.0), '20 % of the lava is on ground that it'),
        (VolumeBudget(100.0, 99.0), 'volume is not conserved: 1.0e-02'),
        (VolumeBudget(100.0, math.nan), 'volume is not conserved: nan'),
    ],
)
def test_budget_warns_of_lost_overdue_and_unaccounted_lava(budget, phrase):
    (warning,) = budget.warnings()
    assert warning.startswith(phrase)


@pytest.mark.parametrize(('viscosity', 'is_thin'), [(1e-3, True), (1e4, False)])
def test_budget_of_a_snapshot_has_lava_that_does_not_inundate(viscosity, is_thin):
    simulation = simulated(
        Terrain(valley(), 10.0), Lava.paper(viscosity=viscosity), VENTS[0], spacing=5.0,
        thickness=0.05,
        threshold=0.1, effects=Effects(inertia=is_thin),
    )
    simulation.advance(30.0)
    snapshot = simulation.snapshot()
    dry = np.nansum(snapshot.thickness[~reached_cells(snapshot.arrived)], dtype=float) * 100.0
    assert snapshot.budget.thin == pytest.approx(dry)
    assert bool(snapshot.budget.warnings()) == is_thin


def test_budget_is_unchanged_by_diagnostics():
    budget = replace(
        SWALLOWED, flowing=18_000.0, solidified=397.5, overdue=0.25, lost_in_sea=64.0, thin=5.0
    )
    texts = budget.texts()
    assert VolumeBudget.from_texts(texts) == budget
    for name in VOLUMES:
        key = volume_key(name)
        assert VolumeBudget.from_texts({**texts, key: 'much'}) is None
        del (others := dict(texts))[key]
        assert VolumeBudget.from_texts(others) is None


def test_label_of_a_volume_has_the_words_of_its_key():
    for name, (label, _) in VOLUMES.items():
        words = iter(re.split('[ -]', label))
        # in the same order: the iterator is consumed
        assert all(word in words for word in name.split('_')), (name, label)


def flow(device):
    """Return lava in a valley with a hole in it, bitwise identical each time."""
    ground = valley()
    ground[3:6, 20:30] = np.nan
    scene = Scene(Terrain(ground, 10.0), VENTS, lava=Lava.paper())
    forced = {'cooling': True, 'solidification': True}
    return Simulation(scene, effects=forced, accuracy=Accuracy(deterministic=True), device=device)


def as_bytes(snapshot):
    grids = (snapshot.thickness, snapshot.temperature, snapshot.frozen)
    numbers = (snapshot.time, snapshot.budget, snapshot.particle_count, snapshot.steps)
    return [grid.tobytes() for grid in grids], numbers


def test_pending_snapshot_is_that_of_its_start(device):
    one, other = flow(device), flow(device)
    for time in (60.0, 120.0):
        one.advance(time)
        other.advance(time)
        pending, snapshot = one.begin_snapshot(), other.snapshot()
        one.advance(time + 30.0)
        one.set_vents(VENTS[:1])
        other.advance(time + 30.0)
        other.set_vents(VENTS[:1])
        assert snapshot.time == pytest.approx(time, abs=30.0)
        assert as_bytes(pending.result()) == as_bytes(snapshot)
        assert pending.result() is pending.result()
    assert np.isnan(snapshot.thickness[3:6, 20:30]).all()
    assert as_bytes(one.snapshot()) == as_bytes(other.snapshot())


def test_kept_snapshots_do_not_change(device):
    simulation = flow(device)
    kept, copies = [], []
    for number in range(6):
        simulation.advance(20.0 * (number + 1))
        snapshot = simulation.begin_snapshot().result()
        # a view keeps the memory, too
        kept.append((snapshot.thickness[2:], snapshot.temperature))
        copies.append([grid.copy() for grid in kept[-1]])
    del snapshot
    simulation.advance(140.0)
    simulation.begin_snapshot()
    for grids, copied in zip(kept, copies, strict=True):
        for grid, copy in zip(grids, copied, strict=True):
            assert np.array_equal(grid, copy, equal_nan=True)
    assert len({grids[0].ctypes.data for grids in kept}) == len(kept)


def test_launches_in_flight_do_not_change_the_flow(monkeypatch):
    ends = []
    monkeypatch.setattr(lava_module, 'FIRST_CAPACITY', 256)
    for number in (1, 2):
        monkeypatch.setitem(solver_module._IN_FLIGHT, False, number)
        ground = incline(0.5, 30, 200, 10.0, top=900.0)
        simulation = simulated(
            ground, Lava.paper(), Vent((60.0, 155.0), 100.0), effects=Effects(inertia=True),
            spacing=5.0,
            thickness=0.4, deterministic=True,
        )
        room = simulation.solver.state.capacity
        for time in (15.0, 15.001, 40.0):
            assert simulation.advance(time) >= time
        assert simulation.solver.state.capacity > room
        assert simulation.most_particles == simulation.particle_count
        ends.append((simulation.steps, simulation.time, simulation.snapshot()))
    one, other = ends
    assert one[:2] == other[:2]
    np.testing.assert_array_equal(one[2].thickness, other[2].thickness)


def test_diagnostics_equal_sums_over_the_particles(device):
    """The budget is that of the existing particles, for any number of them including 0."""
    simulation = flow(device)
    for time in (0.0, 60.0, 600.0):
        simulation.advance(time)
        held = simulation.sample().volume.sum()
        state, vents = simulation.solver.state, simulation.solver.vents
        numbers = gather_numbers(state, vents, None).numpy()
        moment = moment_of(numbers, state, vents, 0.0)
        assert moment.budget.flowing == pytest.approx(held, rel=1e-12)
        assert moment.particle_count == len(state.read_particles())
        assert moment.steps.count == simulation.steps
        assert moment.budget.waiting == vents.pending(simulation.time).sum()
        mapped = replace(simulation.snapshot().budget, thin=0.0)
        assert simulation.budget() == mapped == moment.budget
    assert moment.particle_count > 0


@pytest.fixture
def sound(device):
    simulation = simulated(Terrain(valley(), 10.0), Lava.paper(), VENTS[0], device=device)
    simulation.advance(120.0)
    assert simulation.snapshot().flaw() == ''
    return simulation


def spoil(simulation, column, value):
    rows = simulation.solver.state.particle.numpy()
    rows[3, column] = value
    simulation.solver.state.particle.assign(rows)


@pytest.mark.spoils_volume
@pytest.mark.parametrize(
    ('name', 'value'), [*((name, np.nan) for name in COLUMNS), ('x', np.inf)]
)
def test_invalid_particle_is_a_flaw(sound, name, value):
    spoil(sound, COLUMNS[name], value)
    assert sound.snapshot().flaw()
    sound.advance(150.0, wall_limit=5.0)
    assert sound.snapshot().flaw()


def test_particle_moved_far_away_has_left(sound):
    spoil(sound, COLUMNS['x'], 1e30)
    sound.advance(150.0, wall_limit=5.0)
    assert sound.snapshot().flaw() == ''


@pytest.mark.spoils_volume
def test_cells_of_an_invalid_particle_are_nan(sound):
    before = sound.snapshot().thickness
    spoil(sound, COLUMNS['volume'], np.nan)
    after = sound.snapshot().thickness
    assert np.isnan(after[before > 0.1]).any()
    assert not ((before > 0.1) & (after == 0.0)).any()


def snapshot(**cells):
    elevation = np.zeros((4, 5))
    elevation[0, 0] = np.nan
    arrays = {
        'thickness': elevation.astype(np.float32),
        'temperature': np.full((4, 5), np.nan, np.float32),
    }
    for name, value in cells.items():
        arrays[name][1, 2] = value
    return Snapshot(
        time=1.0, terrain=Terrain(elevation, 10.0), **arrays, particle_count=0,
        budget=VolumeBudget(0.0, 0.0), steps=StepReport(1, 1, 1, 1.0, 'longest'),
    )


def test_ground_without_data_and_dry_cells_are_no_flaws():
    assert snapshot().flaw() == ''
    assert snapshot(thickness=0.5, temperature=1300.0).flaw() == ''


@pytest.mark.parametrize(
    ('broken', 'words'),
    [
        (lambda: replace(snapshot(), time=np.nan), 'time nan s'),
        (lambda: replace(snapshot(), budget=VolumeBudget(1.0, np.nan)), 'flowing=nan'),
        (lambda: replace(snapshot(), budget=VolumeBudget(1.0, 1.0, np.inf)), 'solidified=inf'),
        (lambda: snapshot(thickness=np.nan), 'thickness is not a number of metres in 1 cell'),
        (lambda: snapshot(thickness=np.inf), 'thickness'),
        (lambda: snapshot(thickness=-0.1), 'thickness'),
        (lambda: snapshot(thickness=0.5), 'temperature is not a number of kelvin in 1 cell'),
        (lambda: snapshot(thickness=0.5, temperature=-3.0), 'temperature'),
        (lambda: snapshot(thickness=0.5, temperature=np.inf), 'temperature'),
    ],
)
def test_flaw_names_the_quantity_and_the_number_of_cells(broken, words):
    assert words in broken().flaw()


@pytest.mark.parametrize('part', ['flowing', 'solidified', 'lost_in_sea', 'waiting'])
def test_error_of_a_budget_counts_each_part_of_the_volume(part):
    volumes = {
        'emitted': 10.0, 'flowing': 4.0, 'solidified': 2.0, 'lost_in_sea': 3.0, 'waiting': 1.0
    }
    budget = VolumeBudget(**volumes)
    assert budget.error == 0.0 and budget.is_conserved
    missing = VolumeBudget(**volumes | {part: volumes[part] - 1.0})
    assert missing.error == pytest.approx(0.1) and not missing.is_conserved
