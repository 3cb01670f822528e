# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Arrival times from maps, between which fronts advance evenly, and from each step."""

from dataclasses import replace
from pathlib import Path
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

from lava_ros.scene import Lava, Scene, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend.graph import Launches
from lava_ros.simulation.output.inundation import inundated_cells, standing_cells
from lava_ros.simulation.output.looks import Looks
from solver import incline

TERRAIN = incline(0.2, 30, 40, 5.0)
SCENE = Scene(TERRAIN, (Vent((40.0, 75.0), 20.0),), lava=Lava())
END = 90.0


def strip(front, rows=1, columns=12, thickness=2.0):
    return np.where(np.arange(columns) < front, thickness, 0.0)[None].repeat(rows, axis=0)


def looks_at(shape, device, threshold=0.1, most=2):
    """Return an arrival map, and the parts of a state that it reads."""
    device = wp.get_device(device)
    clock = wp.zeros(5, dtype=wp.float64, device=device)
    state = SimpleNamespace(device=device, extent=0, launches=Launches(device), clock=clock)
    return Looks(shape, threshold, most, device), state


def take(looks, state, known, *maps):
    kinds = (wp.uint8, float, float)
    arrays = [
        wp.array(values, dtype=kind, device=state.device)
        for values, kind in zip((known, *maps), kinds, strict=True)
    ]
    looks.take(state, *arrays)


def seen_of(looks, device, threshold=0.1):
    """Return the arrival map of observations, each a time and a thickness map."""
    taken, state = looks_at(looks[0][1].shape, device, threshold, len(looks))
    for time, thickness in looks:
        state.clock.fill_(time)
        temperature = np.where(thickness > 0.0, 1400.0 - time, np.nan)
        take(taken, state, np.isfinite(thickness), thickness, temperature)
    assert taken.flaw() == ''
    seen, part = taken.seen(state), taken.seen(state, where_wet=True)
    ends = np.add(part.corner, part.arrival.shape)
    rows, columns = map(slice, part.corner, ends)
    wet = np.zeros(seen.arrival.shape, dtype=bool)
    wet[rows, columns] = True
    assert not (seen.thickness[~wet] > 0.0).any()
    for whole, some in zip(seen[1:4], part[1:4], strict=True):
        np.testing.assert_array_equal(whole[rows, columns], some)
    return seen


LOBE = np.zeros((9, 20))
LOBE[:, :2] = LOBE[3:6, 2:12] = 1.0


@pytest.mark.parametrize(
    ('looks', 'columns', 'expected'),
    [
        (
            [(10.0, strip(2, 5)), (20.0, strip(7, 5)), (30.0, strip(10, 5))], slice(10),
            [10.0, 10.0, 11.0, 13.0, 15.0, 17.0, 19.0, 20.0 + 10.0 / 6, 25.0, 30.0 - 10.0 / 6],
        ),
        # along a lobe
        ([(0.0, strip(2, 9, 20, 1.0)), (10.0, LOBE)], slice(2, 12), np.arange(10) + 0.5),
        # lava that rises to the threshold
        ([(0.0, strip(5, thickness=0.02)), (10.0, strip(5, thickness=0.22))], slice(5), [4.0] * 5),
        # unconnected lava may have arrived right after the previous observation
        ([(5.0, strip(0)), (15.0, strip(3))], slice(3), [5.0] * 3),
    ],
)
def test_arrival_is_interpolated_between_observations(device, looks, columns, expected):
    arrival = seen_of(looks, device).arrival
    middle = arrival[len(arrival) // 2]
    np.testing.assert_allclose(middle[columns], expected, rtol=1e-6)
    assert np.isnan(middle[columns.stop :]).all()


@pytest.mark.nightly
def test_observation_without_lava_indexes_within_the_map(monkeypatch):
    """Warp checks each index in its debug mode, in a separate process."""
    code = 'import warp; warp.config.mode = "debug"; from simulation import test_arrival as here; '
    code += 'looks = [(time, here.strip(cells, 8)) for time, cells in ((5, 0), (9, 0), (15, 3))]; '
    code += 'assert (here.seen_of(looks, "cpu").arrival[:, :3] == 9.0).all()'
    folder = Path(__file__).parents[1]
    monkeypatch.setenv('PYTHONPATH', f'{folder.parent}:{folder}')
    words = [sys.executable, '-c', code]
    ended = subprocess.run(words, capture_output=True, text=True, timeout=300)
    assert ended.returncode == 0, ended.stderr


def test_drained_cells_keep_arrival_and_peak(device):
    looks = [(0.0, strip(3)), (1.0, strip(6, thickness=4.0)), (2.0, strip(1))]
    for _, thickness in looks:
        thickness[0, 11] = np.nan
    result = seen_of(looks, device)
    assert np.isfinite(result.arrival[0, :6]).all()
    np.testing.assert_array_equal(result.thickness[0, :6], 4.0)
    np.testing.assert_array_equal(result.temperature[0, :6], [1400.0] * 3 + [1399.0] * 3)
    assert np.isnan(result.thickness[0, 11]) and np.isnan(result.arrival[0, 11])
    assert (result.thickness[0, 6:11] == 0.0).all() and np.isnan(result.temperature[0, 6:]).all()


@pytest.mark.parametrize(
    ('thickness', 'temperature', 'flaw'),
    [
        (1.0, 1400.0, ''),
        (np.nan, 1400.0, 'thickness is not a number of metres'),
        (np.inf, 1400.0, 'thickness is not a number of metres'),
        (-1.0, 1400.0, 'thickness is not a number of metres'),
        (1.0, np.nan, 'temperature is not a number of kelvin'),
        (1.0, 0.0, 'temperature is not a number of kelvin'),
    ],
)
def test_invalid_value_is_a_flaw_only_on_ground_with_data(device, thickness, temperature, flaw):
    taken, state = looks_at((2, 2), device)
    for known in (0, 1):
        assert taken.flaw() == ''
        maps = np.full((2, 2), thickness), np.full((2, 2), temperature)
        take(taken, state, np.full((2, 2), known), *maps)
    assert taken.flaw() == flaw


def made():
    return Simulation(SCENE, device='cpu', accuracy=Accuracy(spacing=3.5, thickness=0.7))


def test_arrival_equals_that_of_frequent_maps():
    simulation = made()
    seen = np.full(TERRAIN.shape, np.nan)
    for time in np.arange(1.0, END + 1.0):
        simulation.advance(time, limit=END)
        seen[np.isnan(seen) & standing_cells(simulation.snapshot().thickness)] = time
    one = made()
    one.advance(END)
    shown = one.snapshot()
    np.testing.assert_array_equal(shown.arrived, simulation.snapshot().arrived)
    standing, inundated = standing_cells(shown.thickness), inundated_cells(shown.arrived)
    assert standing.sum() > 50
    assert (standing & ~inundated).sum() <= 0.01 * standing.sum()
    assert abs(np.nanmedian(seen - shown.arrived)) <= 2.0
    assert np.nanmin(shown.arrived) < 10.0 and np.nanmax(shown.arrived) <= END
    assert len(np.unique(shown.arrived[inundated])) > 20


def test_frozen_lava_is_on_inundated_cells_and_keeps_its_volume(device):
    lava = Lava(viscosity=2e4, solidus=1300.0, convection=300.0)
    scene = Scene(TERRAIN, (Vent((40.0, 75.0), ((0.0, 20.0), (40.0, 0.0))),), lava=lava)
    accuracy = Accuracy(spacing=3.5, thickness=0.7)
    on = {'cooling': True, 'solidification': True}
    simulation = Simulation(scene, effects=on, device=device, accuracy=accuracy)
    simulation.advance(3000.0)
    shown = simulation.snapshot()
    cell = TERRAIN.resolution**2
    assert shown.budget.frozen > 0.2 * shown.budget.emitted
    assert shown.frozen.astype(float).sum() * cell == pytest.approx(shown.budget.frozen, rel=1e-6)
    inundated = inundated_cells(shown.arrived)
    assert not ((shown.frozen > 0.0) & ~inundated).any()


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
