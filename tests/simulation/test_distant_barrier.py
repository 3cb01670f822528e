# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A barrier that no lava approaches changes nothing."""

from dataclasses import replace

import numpy as np
import pytest

from command_line import done
from geodata import write_raster
from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.scene.reshaping import Barrier, with_barriers
from lava_ros.scene.terrain_files import load_terrain
from lava_ros.simulation import Simulation
from lava_ros.simulation.particles.terrain import ringed_heights

#: A rough slope of 800 m with elevations that float32 does not represent exactly.
CELLS = np.random.default_rng(1).normal(0.0, 0.7, (80, 80))
SLOPE = np.add.outer(700.0 - 1.5 * np.arange(80.0), 0.02 * (np.arange(80.0) - 40.0) ** 2) + CELLS
GROUND = Terrain(SLOPE, 10.0, epsg=32633, offset=(500_000.0, 4_180_000.0))
VENTS = (Vent((400.0, 150.0), 10.0, radius=20.0),)

FAR = {
    'low': {'line': [(500_050.0, 4_180_750.0), (500_150.0, 4_180_750.0)], 'height': 5.0},
    'higher than all': {
        'line': [(500_700.0, 4_180_050.0), (500_780.0, 4_180_050.0)], 'height': 150.0,
        'slope': 9.0,
    },
}


def flow(terrain):
    simulation = Simulation(Scene(terrain, VENTS), device='cpu')
    simulation.advance(5400.0)
    return simulation.snapshot()


@pytest.fixture(scope='module')
def without():
    return flow(GROUND)


@pytest.mark.parametrize('name', FAR)
def test_distant_barrier_changes_no_bit_of_the_flow(name, without):
    known = FAR[name]
    barrier = Barrier(tuple(known['line']), known['height'], 20.0, known.get('slope', 1.0))
    raised = with_barriers(GROUND, [barrier])
    added = raised.elevation - GROUND.elevation
    assert added.max() > 4.0 and not (added * np.nan_to_num(without.inundated)).any()
    found = flow(raised)
    assert without.thickness.max() > 1.0
    for grid in ('thickness', 'temperature', 'arrived', 'inundated'):
        np.testing.assert_array_equal(getattr(found, grid), getattr(without, grid))
    assert found.budget == without.budget


def test_near_barrier_changes_the_flow(without):
    line = ((500_300.0, 4_180_220.0), (500_500.0, 4_180_220.0))
    found = flow(with_barriers(GROUND, [Barrier(line, 15.0, 20.0)]))
    assert np.nanmax(np.abs(found.thickness - without.thickness)) > 1.0


def test_written_terrain_is_that_of_the_barrier(without, tmp_path):
    path = write_raster(
        tmp_path / 'ground.tif', GROUND.elevation[::-1], cell=10.0,
        north_west=(500_000.0, 4_180_800.0), crs='EPSG:32633',
    )
    known = FAR['low']
    words = [f'{x:.0f},{y:.0f}' for x, y in known['line']]
    done(
        'barrier', path, '-o', tmp_path / 'dam.tif', '--line', *words, '--height', known['height'],
        '--width', '20',
    )
    found = flow(load_terrain(tmp_path / 'dam.tif'))
    np.testing.assert_array_equal(found.thickness, without.thickness)


@pytest.mark.parametrize('rise', [0.0, 0.03, 20.0])
def test_level_of_the_ground_keeps_all_digits(rise):
    heights = np.array(GROUND.elevation)
    heights[0, 0] += rise
    ring = ringed_heights(replace(GROUND, elevation=heights))[1:-1, 1:-1]
    level = float(heights[5, 5] - ring[5, 5])
    assert level % 64.0 == 0.0 and abs(ring.mean()) <= 64.0
    np.testing.assert_array_equal(ring.astype(np.float32) + np.float32(level), heights)
