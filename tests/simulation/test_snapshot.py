# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Outputs of a simulation: volume budget, snapshots in progress, and their flaws.

The budget is complete, survives diagnostics unchanged, and is plain to people. Snapshots that are
copied while the next steps run show one moment, and belong to the caller alone. NaN shows as a
flaw, never as dry ground.
"""

from dataclasses import replace
import gc
import math

import numpy as np
import pytest
import warp as wp

from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import advance, Simulation, solver
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend.streams import Reader
from lava_ros.simulation.budget import VolumeBudget
from lava_ros.simulation.diagnostics import FlowDiagnostics, moment_of
from lava_ros.simulation.snapshot import Snapshot, StepReport
from solver import incline, only, simulated

#: Budget after a hole has taken most of an eruption.
SWALLOWED = VolumeBudget(324_000.0, 18_398.0, 0.4, 305_602.0, in_holes=305_500.0)

VENTS = (Vent((60.0, 155.0), 20.0), Vent((160.0, 155.0), 5.0))

COLUMNS = {'x': 0, 'y': 1, 'volume': 2, 'temperature': 3}


def valley():
    """Return a plane with a valley along its middle, shape [30, 40]."""
    y, x = np.mgrid[0:30, 0:40]
    return 500.0 - x + 0.05 * (y - 15.0) ** 2


def test_parts_add_up_to_what_was_emitted():
    """Each cubic metre counts in one place, overdue ones in two."""
    budget = VolumeBudget(100.0, 40.0, 10.0, 25.0, frozen=35.0, late=8.0, in_holes=20.0)
    told = {name: value.removesuffix(' m3') for name, value in budget.rows()}
    assert told == {
        'emitted': '100',
        'flowing': '30',
        'frozen': '35',
        'left over the border': '5',
        'left into cells without data': '20',
        'waiting in the vents': '10',
        'of that late': '8',
        'unaccounted for': 'below 1e-15',
    }
    parts = [float(told[name]) for name in list(told)[1:6]]
    assert sum(parts) == 100.0


def test_lava_that_is_gone_is_told_and_warned_of():
    """An error of 0 means that lava is accounted for, not that it is on the map."""
    assert SWALLOWED.error == 0.0
    assert 'left into cells without data 305,500.0 m3' in SWALLOWED.text()
    (warning,) = SWALLOWED.warnings()
    assert warning.startswith('94.3 % of the lava has left into cells without data')
    frozen = VolumeBudget(300_000.0, 15_395.0, 1.0, 0.0, frozen=284_605.0)
    assert 'flowing 15,394.0 m3, frozen 284,605.0 m3' in frozen.text()
    assert frozen.warnings() == []


@pytest.mark.parametrize(
    ('budget', 'phrase'),
    [
        (VolumeBudget(100.0, 99.0, 2.0, 1.0), '1 % of the lava has left over the border'),
        (VolumeBudget(100.0, 100.0, 2.0, 0.0, late=1.5), 'behind: 1.5 m3 of lava wait'),
        (VolumeBudget(100.0, 99.0, 2.0, 0.0), 'volume is not conserved: 1.0e-02'),
        (VolumeBudget(100.0, math.nan, 2.0, 0.0), 'volume is not conserved: nan'),
    ],
)
def test_warnings(budget, phrase):
    """Each warning is one phrase."""
    (warning,) = budget.warnings()
    assert warning.startswith(phrase)


def test_there_and_back():
    """Values from diagnostics are read unchanged; missing ones in older recordings count as 0."""
    assert VolumeBudget.from_texts(SWALLOWED.texts()) == SWALLOWED
    old = {f'volume_{name}_m3': '1.0' for name in ('emitted', 'held', 'left')}
    assert VolumeBudget.from_texts(old) == VolumeBudget(1.0, 1.0, 0.0, 1.0)
    assert VolumeBudget.from_texts({**old, 'volume_held_m3': 'much'}) is None
    assert VolumeBudget.from_texts({}) is None


def test_a_flow_of_any_size_is_told():
    """Laboratory flows are given in litres."""
    assert VolumeBudget(8.17e-4, 8.17e-4, 0.0, 0.0).rows()[1] == ('flowing', '0.000817 m3')


def flow(device):
    """Return lava in a valley with a hole in it, bitwise identical each time."""
    ground = valley()
    ground[3:6, 20:30] = np.nan
    scene = Scene(Terrain(ground, 10.0), VENTS, lava=Lava())
    forced = {'cooling': True, 'solidification': True}
    return Simulation(scene, effects=forced, accuracy=Accuracy(deterministic=True), device=device)


def as_bytes(snapshot):
    """Return all values of a snapshot."""
    grids = (snapshot.thickness, snapshot.temperature, snapshot.frozen)
    numbers = (snapshot.time, snapshot.budget, snapshot.particle_count, snapshot.steps)
    return [grid.tobytes() for grid in grids], numbers


def test_a_begun_snapshot_is_of_its_moment(device):
    """It equals a direct snapshot; later changes before its result do not show."""
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


def test_snapshots_that_are_kept_stay_as_they_are(device):
    """For any number of them: memory is reused only when no array refers to it."""
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
    # never asked for: nothing is lost with it
    simulation.begin_snapshot()
    for grids, copied in zip(kept, copies, strict=True):
        for grid, former in zip(grids, copied, strict=True):
            assert np.array_equal(grid, former, equal_nan=True)
    assert len({grids[0].ctypes.data for grids in kept}) == len(kept)


def test_memory_is_used_again(device):
    """In the long run a GPU's copies reuse the same memory, and few of them are page-locked."""
    array = wp.array(np.arange(8.0), dtype=wp.float64, device=device)
    reader, places = Reader(array.device), []
    for number in range(20 if array.device.is_cuda else 2):
        reader.before_writing()
        array.fill_(float(number))
        (values,) = reader.begin([array], beside=True)()
        assert (values == number).all()
        places.append(values.ctypes.data)
        del values
        gc.collect()
    if array.device.is_cuda:
        assert len(set(places)) == 1
        held = [reader.begin([array], beside=True)() for _ in range(6)]
        assert sum(reader._made.values()) == 4
        assert len({values.ctypes.data for (values,) in held}) == 6


def test_launches_under_way_change_nothing(monkeypatch):
    """Launches made before the previous ones are read: the same times, steps and lava.

    There is more lava than there was room for at the start, and it comes far. Cells are laid
    around it at other stages, but before it is there.
    """
    ends = []
    monkeypatch.setattr(solver, '_FIRST_CAPACITY', 256)
    for number in (1, 2):
        monkeypatch.setitem(advance._IN_FLIGHT, False, number)
        ground = incline(0.5, 30, 200, 10.0, top=900.0)
        simulation = simulated(
            ground,
            Lava(),
            Vent((60.0, 155.0), 100.0),
            effects=only('inertia'),
            spacing=5.0,
            thickness=0.4,
            deterministic=True,
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


def test_volumes_are_summed_where_they_are(device):
    """The sum is that of the existing particles, for any number of them including 0."""
    simulation = flow(device)
    for time in (0.0, 60.0, 600.0):
        simulation.advance(time)
        held = simulation.sample().volume.sum()
        state, vents = simulation.solver.state, simulation.solver.vents
        numbers = FlowDiagnostics().take(state, vents).numpy()
        moment = moment_of(numbers, state, vents, 0.0)
        assert moment.budget.flowing == pytest.approx(held, rel=1e-12)
        assert moment.particle_count == len(state.read_particles())
        assert moment.steps.count == simulation.steps
        assert moment.budget.pending == vents.pending(simulation.time).sum()
        assert simulation.budget() == simulation.snapshot().budget == moment.budget
    assert moment.particle_count > 0


@pytest.fixture
def sound(device):
    """Return lava that has flowed a little way."""
    simulation = simulated(Terrain(valley(), 10.0), Lava(), VENTS[0], device=device)
    simulation.advance(120.0)
    assert simulation.snapshot().flaw() == ''
    return simulation


def spoil(simulation, column, value):
    """Replace a value of a particle."""
    rows = simulation.solver.state.particle.numpy()
    rows[3, column] = value
    simulation.solver.state.particle.assign(rows)


@pytest.mark.parametrize('value', [np.nan, np.inf])
@pytest.mark.parametrize('name', COLUMNS)
def test_a_broken_particle_shows(sound, name, value):
    """One particle with NaN spoils the snapshot, at once and later on."""
    spoil(sound, COLUMNS[name], value)
    assert sound.snapshot().flaw()
    sound.advance(150.0, wall_limit=5.0)
    assert sound.snapshot().flaw()


def test_a_particle_flung_far_away_has_left(sound):
    """Such a particle has left, its volume is accounted for, and there is no flaw."""
    spoil(sound, COLUMNS['x'], 1e30)
    sound.advance(150.0, wall_limit=5.0)
    assert sound.snapshot().flaw() == ''
    assert sound.budget().error < 1e-5


def test_lava_around_a_broken_particle_is_not_dry(sound):
    """Cells whose sum is NaN are NaN on the map, not 0."""
    before = sound.snapshot().thickness
    spoil(sound, COLUMNS['volume'], np.nan)
    after = sound.snapshot().thickness
    assert np.isnan(after[before > 0.1]).any()
    assert not ((before > 0.1) & (after == 0.0)).any()


def snapshot():
    """Return a snapshot without lava, with one cell without data."""
    elevation = np.zeros((4, 5))
    elevation[0, 0] = np.nan
    thickness = np.zeros((4, 5), np.float32)
    thickness[0, 0] = np.nan
    return Snapshot(
        time=1.0,
        terrain=Terrain(elevation, 10.0),
        thickness=thickness,
        temperature=np.full((4, 5), np.nan, np.float32),
        budget=VolumeBudget(0.0, 0.0, 0.0, 0.0),
        particle_count=0,
        steps=StepReport(1, 1, 1, 1.0, 'longest'),
    )


def spoilt(**cells):
    """Return that snapshot with values put into cell (1, 2) of its arrays."""
    good = snapshot()
    arrays = {name: getattr(good, name).copy() for name in cells}
    for name, value in cells.items():
        arrays[name][1, 2] = value
    return replace(good, **arrays)


def test_a_sound_snapshot_has_no_flaw():
    """Unknown ground and dry cells without temperature are not flaws."""
    assert snapshot().flaw() == ''
    assert spoilt(thickness=0.5, temperature=1300.0).flaw() == ''


@pytest.mark.parametrize(
    ('broken', 'words'),
    [
        (lambda: replace(snapshot(), time=np.nan), 'time nan s'),
        (lambda: replace(snapshot(), budget=VolumeBudget(1.0, np.nan, 0.0, 0.0)), 'held=nan'),
        (lambda: replace(snapshot(), budget=VolumeBudget(1.0, 1.0, 0.0, np.inf)), 'left=inf'),
        (lambda: spoilt(thickness=np.nan), 'thickness is not a number of metres in 1 cell'),
        (lambda: spoilt(thickness=np.inf), 'thickness'),
        (lambda: spoilt(thickness=-0.1), 'thickness'),
        (lambda: spoilt(thickness=0.5), 'temperature is not a number of kelvin in 1 cell'),
        (lambda: spoilt(thickness=0.5, temperature=-3.0), 'temperature'),
        (lambda: spoilt(thickness=0.5, temperature=np.inf), 'temperature'),
    ],
)
def test_flaws_are_named(broken, words):
    """Each flaw states its kind and the number of cells."""
    assert words in broken().flaw()
