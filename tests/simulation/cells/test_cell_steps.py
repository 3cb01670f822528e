# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Steps of the flow on cells: order, laws, volume and borders."""

from dataclasses import replace
from functools import lru_cache
import math

import numpy as np
import pytest
import warp as wp

from lava_ros.effects import EFFECTS, Effects
from lava_ros.scene import Scene, Terrain
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.cells import state as at
from lava_ros.simulation.cells.flow import step_function
from lava_ros.simulation.cells.ground import lay_ground
from lava_ros.simulation.cells.heat import HeatState
from lava_ros.simulation.cells.state import (
    CellState,
    LENGTH,
    LIMITED,
    LONGEST,
    MAX_END,
    STAGES,
    STEPS,
    TARGET,
    UNTIL,
)
from lava_ros.verification import exact
from lava_ros.verification.cases.case import GRAVITY, ISOTHERMAL, NU

#: Density times gravity [N/m3].
WEIGHT = ISOTHERMAL.density * GRAVITY

NONE = Effects(**dict.fromkeys(EFFECTS, False))

#: Directions in which a scene lies on its grid.
TURNS = [0.0, math.radians(30.0)]


def centres(half, cell):
    """Return x and y of the cells of a square around (0, 0) [m]."""
    line = np.arange(-half + 0.5 * cell, half, cell)
    return np.meshgrid(line, line)


@lru_cache
def steps_kernel(effects, *, is_uniform):
    """Return the kernel that takes steps until ``clock[TARGET]``, or a number of them."""
    step = step_function(effects, is_uniform=is_uniform)

    @wp.kernel(module='unique', enable_backward=False, grid_stride=False)
    def take_steps(s: at.Cells, most: int):
        for _ in range(most):
            if s.clock[at.TIME] >= s.clock[at.TARGET]:
                break
            step(s)

    return take_steps


def lava_on(
    elevation, cell, thickness, *, effects=NONE, lava=ISOTHERMAL, viscosity=None, film=1e-6
):
    """Return the state of some lava, and a function that advances it to a time [s]."""
    terrain = Terrain(elevation, cell)
    state = CellState(terrain, 'cpu', lava=lava, weight=WEIGHT, film=film)
    if effects.any('is_lateral'):
        state.allocate_lateral()
    scene = Scene(terrain, (), lava)
    lay_ground(state, HeatState(state, scene, effects, Accuracy(thickness=1.0)), effects)
    state.thickness.assign(np.pad(thickness, 1))
    state.stage.assign(np.pad(thickness, 1).astype(np.float32))
    viscosity = np.full(elevation.shape, lava.viscosity) if viscosity is None else viscosity
    state.fluidity.assign(np.pad(1.0 / viscosity, 1, mode='edge').astype(np.float32))
    state.strength.fill_(lava.yield_strength)
    rows, columns = state.thickness.shape
    state.box.assign(np.array([0, rows - 1, 0, columns - 1], dtype=np.int32))
    state.vent_box.assign(np.array([0, -1, 0, -1], dtype=np.int32))
    state.peaks.assign([thickness.max(), 0.0])
    kernel = steps_kernel(effects, is_uniform=bool(np.ptp(viscosity) == 0.0))

    def advance(until, longest=1e9, steps=10**7):
        clock = state.clock.numpy()
        clock[[UNTIL, TARGET, LONGEST, MAX_END]] = until, until, longest, math.inf
        wp.launch(kernel, dim=1, inputs=[state.argument(), steps], device='cpu')
        return state.map_of('thickness')

    return state, advance


def bump(cell, turn, viscosity=lambda x: 1e4 + 0.0 * x, effects=NONE, base=1.0, pace=40.0):
    """Return a smooth hill of lava, after it has flowed down a slope, on cells of 20 m.

    ``base`` is the thickness around it [m], and the longest step lasts as long as a cell at a
    ``pace`` [m/s].
    """
    x, y = centres(320.0, cell)
    x, y = x * math.cos(turn) + y * math.sin(turn), y * math.cos(turn) - x * math.sin(turn)
    thickness = base + np.exp(-((x / 90.0) ** 2) - (y / 60.0) ** 2)
    _, advance = lava_on(
        -0.05 * x + 2.0 * np.sin(y / 60.0), cell, thickness, viscosity=viscosity(x),
        effects=effects,
    )
    found, parts = advance(60.0, longest=cell / pace), round(20.0 / cell)
    size = len(found) // parts
    means = found.reshape(size, parts, size, parts).mean(axis=(1, 3))
    # lava leaves over the border
    return means[5:-5, 5:-5]


@pytest.mark.parametrize('turn', TURNS)
@pytest.mark.parametrize(
    'viscosity', [lambda x: 1e4 + 0.0 * x, lambda x: 1e4 * np.exp(0.5 * np.sin(x / 60.0))],
    ids=['uniform', 'varying'],
)
def test_error_of_smooth_lava_is_of_second_order(turn, viscosity):
    coarse, middle, fine = (bump(cell, turn, viscosity) for cell in (20.0, 10.0, 5.0))
    order = math.log2(np.abs(coarse - middle).mean() / np.abs(middle - fine).mean())
    assert order > 1.9


@pytest.mark.parametrize('turn', TURNS)
def test_error_with_lateral_stress_is_of_second_order(turn):
    """The lava is a quarter as thick as its hill is wide.

    Lateral stress reaches farther from the border than lava flows.
    """
    stress = replace(NONE, helmholtz=True)
    coarse, middle, fine, local = (
        bump(cell, turn, lambda x: 1e7 + 0.0 * x, effects, base=15.0, pace=4.0)[4:-4, 4:-4]
        for cell, effects in ((20.0, stress), (10.0, stress), (5.0, stress), (5.0, NONE))
    )
    order = math.log2(np.abs(coarse - middle).mean() / np.abs(middle - fine).mean())
    assert order > 1.9
    assert np.abs(local - fine).max() > 5.0 * np.abs(middle - fine).max()


@pytest.mark.parametrize('turn', TURNS)
def test_speed_of_a_sheet_on_a_steep_slope_is_exact(turn):
    slope, thickness = math.radians(25.0), 2.0
    x, y = centres(100.0, 5.0)
    along = (x * math.cos(turn) + y * math.sin(turn)) * math.tan(slope)
    state, advance = lava_on(
        -along, 5.0, np.full(x.shape, thickness), effects=replace(NONE, steep=True, yielding=True)
    )
    advance(1.0, steps=1)
    across = thickness * math.cos(slope)
    speed = GRAVITY * across**2 * math.sin(slope) / (3.0 * NU) * math.cos(slope)
    middle = len(x) // 2
    per_time = 5.0 / (thickness * state.clock.numpy()[LENGTH])
    found = [state.map_of(name)[middle, middle] * per_time for name in ('flux_x', 'flux_y')]
    np.testing.assert_allclose(
        found, [speed * math.cos(turn), speed * math.sin(turn)], rtol=1e-4, atol=1e-9
    )


@pytest.mark.parametrize('effects', [{'yielding': True}, {'yielding': True, 'steep': True}])
@pytest.mark.parametrize('turn', TURNS)
def test_sheet_below_its_critical_thickness_rests(turn, effects):
    slope = math.radians(10.0)
    x, y = centres(100.0, 5.0)
    along = (x * math.cos(turn) + y * math.sin(turn)) * math.tan(slope)
    sine = math.sin(slope) * math.cos(slope) if 'steep' in effects else math.tan(slope)
    lava = replace(ISOTHERMAL, yield_strength=WEIGHT * sine)
    for thickness, rests in ((0.99, True), (1.01, False)):
        state, advance = lava_on(
            -along, 5.0, np.full(x.shape, thickness), effects=replace(NONE, **effects), lava=lava
        )
        advance(100.0, steps=1)
        middle = len(x) // 2
        assert (state.map_of('flux_x')[middle, middle] == 0.0) == rests


@pytest.mark.parametrize('turn', TURNS)
def test_dome_with_a_yield_strength_stops_in_the_exact_shape(turn):
    volume, strength = 1.5e5, 1e4
    dome = exact.BinghamDome(volume, strength, ISOTHERMAL.density, GRAVITY)
    cell = dome.radius / 24.0
    x, y = centres(32.0 * cell, cell)
    place = 0.3 * cell
    distance = np.hypot(x - place * math.cos(turn), y - place * math.sin(turn)) / 0.8
    start = dome.thickness(distance)
    start *= volume / (start.sum() * cell**2)
    _, advance = lava_on(
        np.zeros(x.shape), cell, start, effects=replace(NONE, yielding=True),
        lava=replace(ISOTHERMAL, yield_strength=strength),
    )
    found = advance(3e4 * ISOTHERMAL.viscosity / strength)
    error = np.abs(found - dome.thickness(0.8 * distance)).sum() * cell**2 / volume
    assert error < 0.02


def test_rows_have_full_vectors_and_lava_flows_alike_anywhere_in_them():
    width, found = 47, []
    columns = np.arange(1, width + 1)
    slope = -0.3 * np.arange(30.0)[:, None] + np.zeros(width)
    for shift in range(9):
        thickness = np.zeros(slope.shape)
        thickness[8:22, 15 + shift : 25 + shift] = 2.0
        state, advance = lava_on(slope, 5.0, thickness)
        flow = advance(60.0)
        found.append(np.roll(flow, -shift, axis=1))
        for row, cells in zip(state.spans.numpy().reshape(-1, 4)[1:], flow > 0.3, strict=False):
            if not cells.any():
                continue
            begin, end = row[:2]
            assert begin % 8 == 0 and (end % 8 == 0 or end == width + 1)
            assert begin + 2 <= columns[cells].min() and columns[cells].max() <= end - 2
    np.testing.assert_array_equal(found, np.broadcast_to(found[0], np.shape(found)))


def test_lava_is_neither_lost_nor_less_than_nothing():
    x, y = centres(200.0, 5.0)
    rough = 8.0 * np.sin(x / 11.0) * np.cos(y / 7.0) - 0.5 * x
    thickness = np.where(np.hypot(x, y) < 60.0, 3.0, 0.0)
    state, advance = lava_on(rough, 5.0, thickness)
    found = advance(600.0)
    left = state.left.numpy()
    assert found.min() >= 0.0
    assert state.counts.numpy()[LIMITED] > 0
    assert left[0] > 0.01 * thickness.sum()
    assert found.sum() + left.sum() == pytest.approx(thickness.sum(), rel=1e-12)


def test_fluxes_of_a_step_are_the_change_of_the_thickness():
    x, y = centres(100.0, 5.0)
    thickness = 2.0 * np.exp(-(np.hypot(x, y) / 40.0) ** 2)
    state, advance = lava_on(-0.1 * x, 5.0, thickness)
    before = state.thickness.numpy().copy()
    advance(1e3, steps=1)
    assert state.counts.numpy()[STEPS] == 1
    assert state.counts.numpy()[STAGES] >= 3
    east, north = (getattr(state, name).numpy().astype(float) for name in ('flux_x', 'flux_y'))
    after = before.copy()
    after[1:-1, 1:-1] += east[1:-1, :-2] - east[1:-1, 1:-1] + north[:-2, 1:-1] - north[1:-1, 1:-1]
    np.testing.assert_allclose(state.thickness.numpy(), after, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize(('cells', 'place'), [(np.nan, 1), (-1.0, 2)])
def test_lava_leaves_on_cells_without_data_and_in_the_sea(cells, place):
    x, _ = centres(100.0, 5.0)
    ground = 20.0 - 0.2 * x
    ground[x > 50.0] = cells
    terrain = Terrain(ground, 5.0, sea_level=0.0)
    state = CellState(terrain, 'cpu', lava=ISOTHERMAL, weight=WEIGHT, film=1e-6)
    kinds = np.bincount(state.kind.numpy()[1:-1, 1:-1].ravel(), minlength=4)
    assert kinds[1 + place] == (x > 50.0).sum()
