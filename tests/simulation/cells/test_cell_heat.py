# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Heat on cells: what moves with the lava, what is lost, and what becomes ground."""

from dataclasses import replace
import math

import numpy as np
import pytest
import warp as wp

from effects.test_heat import BALANCES
from lava_ros.effects import compatible, EFFECTS, load
from lava_ros.effects.heat import host_temperature
from lava_ros.effects.laws import Rheology
from lava_ros.scene import Lava, Scene, scene_from_yaml, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.cells.ground import lay_ground
from lava_ros.simulation.cells.heat import HeatState
from lava_ros.simulation.cells.heated_step import heat_functions, heated_step_function
from lava_ros.simulation.cells.spans import spans_function
from lava_ros.simulation.cells.state import (
    Cells,
    CellState,
    EDGE,
    Heat,
    LENGTH,
    LONGEST,
    MAX_END,
    POURED,
    TARGET,
    TIME,
    UNTIL,
)
from lava_ros.verification import exact
from lava_ros.verification.cases.case import GRAVITY

#: Temperatures of lava, of other lava and of the air [K], and cell size [m].
HOT, WARM, AIR, CELL = 1400.0, 1250.0, 300.0, 5.0

#: Lava that loses no heat, and is stiffer when colder.
LAVA = Lava.paper(
    density=2600.0, viscosity=1e4, arrhenius=0.01, reference_temperature=HOT, emissivity=0.0,
    convection=0.0, specific_heat=1000.0,
)

TURNS = [0.0, math.radians(30.0)]

#: Effects of several tests, which share their kernels. Without its constants an effect changes
#: nothing.
STIFFENING = ['arrhenius', 'cooling', 'solidification', 'steep', 'yielding']
MOVING = ['conduction', 'crust_strength', 'viscous_heating']


class Flow:
    """Lava on cells with its heat, without a simulation."""

    def __init__(
        self, lava, effects, elevation, thickness, temperature, *, rate=None, **around
    ):
        """Start with a thickness [m] and a temperature [K]; ``rate`` is emission [m/s]."""
        self.effects = compatible(effects)
        terrain = Terrain(elevation, CELL)
        vent = Vent((0.0, 0.0), 1.0, radius=CELL, temperature=HOT)
        self.scene = Scene(terrain, (vent,), lava, ambient_temperature=AIR, **around)
        self.state = CellState(
            terrain, 'cpu', lava=lava, weight=lava.density * GRAVITY, film=1e-6
        )
        self.heat = HeatState(
            self.state, self.scene, self.effects, Accuracy(thickness=1.0)
        )
        state, heat = self.state, self.heat
        lay_ground(state, heat, self.effects)
        state.thickness.assign(np.pad(thickness, 1))
        for array in (state.stage, heat.former):
            array.assign(np.pad(thickness, 1).astype(np.float32))
        heat.temperature.assign(np.pad(temperature, 1, mode='edge'))
        rows, columns = state.thickness.shape
        state.box.assign(np.array([0, rows - 1, 0, columns - 1], dtype=np.int32))
        state.vent_box.assign(np.array([0, -1, 0, -1], dtype=np.int32))
        if rate is not None:
            state.source.assign(np.pad(rate, 1))
            state.clock.numpy()[POURED] = rate.max()
            heat.vent_temperature.fill_(HOT)
            state.vent_box.assign(np.array([1, rows - 2, 1, columns - 2], dtype=np.int32))
        state.peaks.assign([thickness.max(), 0.0])
        law = Rheology(lava, self.effects)
        state.fluidity.assign(
            1.0 / np.vectorize(law.viscosity_at)(heat.temperature.numpy()).astype(np.float32)
        )
        self._kernel = _kernel(self.effects)

    def advance(self, until, steps=10**7, longest=1e9):
        """Advance to a time [s]."""
        clock = self.state.clock.numpy()
        clock[[UNTIL, TARGET, LONGEST, MAX_END]] = until, until, longest, math.inf
        wp.launch(
            self._kernel, dim=1,
            inputs=[self.state.argument(), self.heat.argument(), steps], device='cpu',
        )

    @property
    def thickness(self):
        """Thickness [m]."""
        return self.state.map_of('thickness')

    @property
    def temperature(self):
        """Temperature [K]."""
        return self.heat.temperature.numpy()[1:-1, 1:-1]

    @property
    def content(self):
        """Sum of thickness and temperature [m K]."""
        return float((self.thickness * self.temperature).sum())


def _kernel(effects):
    step = heated_step_function(effects)

    @wp.kernel(module='unique', enable_backward=False, grid_stride=False)
    def take_steps(s: Cells, m: Heat, most: int):
        for _ in range(most):
            if s.clock[TIME] >= s.clock[TARGET]:
                break
            step(s, m)

    return take_steps


def centres(half):
    """Return x and y of the cells of a square around (0, 0) [m]."""
    line = np.arange(-half + 0.5 * CELL, half, CELL)
    return np.meshgrid(line, line)


def slide(lava, effects, turn, *, emits=False):
    """Return a hot and a warm half of a mound on a slope of 6 degrees, far from all borders."""
    x, y = centres(150.0)
    along = x * math.cos(turn) + y * math.sin(turn)
    across = y * math.cos(turn) - x * math.sin(turn)
    thickness = 2.0 * (np.hypot(along + 60.0, across) < 30.0)
    temperature = np.where(across > 0.0, HOT, WARM)
    rate = (np.hypot(along + 60.0, across) < 15.0) * 1e-3 if emits else None
    ground = -math.tan(math.radians(6.0)) * along
    return Flow(lava, effects, ground, thickness, temperature, rate=rate)


@pytest.mark.parametrize('turn', TURNS)
def test_heat_of_lava_that_loses_none_is_that_of_its_sources(turn):
    flow = slide(LAVA, STIFFENING, turn, emits=True)
    before, volume = flow.content, flow.thickness.sum()
    flow.advance(900.0)
    emitted = float(flow.state.source.numpy().sum()) * 900.0
    assert flow.thickness.sum() == pytest.approx(volume + emitted, rel=1e-12)
    # where more passes through a cell in a step than it contains, its temperature is clipped
    assert flow.content == pytest.approx(before + emitted * HOT, rel=1e-5)
    wet = flow.thickness > 1e-6
    assert flow.temperature[wet].min() >= WARM - 1e-3
    assert flow.temperature[wet].max() <= HOT + 1e-3


def test_hot_and_warm_lava_stay_apart_as_they_flow():
    flow = slide(LAVA, STIFFENING, 0.0)
    flow.advance(900.0)
    _, y = centres(150.0)
    wet = flow.thickness > 0.1
    mixed = wet & (np.abs(flow.temperature - 0.5 * (HOT + WARM)) < 0.4 * (HOT - WARM))
    # a few cells on either side of the middle
    assert np.abs(y[mixed]).max() < 5 * CELL
    assert mixed.sum() < 0.3 * wet.sum()


def covered(thickness):
    """Return the part of each cell that its lava covers."""
    around = np.pad(thickness, 1)
    beside = np.max([
        around[:-2, 1:-1], around[2:, 1:-1], around[1:-1, :-2], around[1:-1, 2:]
    ], axis=0)
    return np.minimum(thickness / np.maximum(EDGE * beside, 1e-9), 1.0)


def test_heat_is_lost_by_the_surface_alone():
    lava = replace(LAVA, convection=500.0)
    flow = slide(lava, STIFFENING, TURNS[1])
    contents, powers = [], []
    times = np.linspace(0.0, 900.0, 91)
    for time in times:
        flow.advance(time)
        wet = flow.thickness > 1e-6
        contents.append(flow.content)
        area = covered(flow.thickness)[wet]
        powers.append(500.0 * (area * (flow.temperature[wet] - AIR)).sum() / (2600.0 * 1000.0))
    lost = contents[0] - contents[-1]
    assert lost == pytest.approx(np.trapezoid(powers, times), rel=0.01)
    assert lost > 0.05 * contents[0]


@pytest.mark.parametrize('turn', TURNS)
def test_heat_of_the_fall_is_the_potential_energy_lost(turn):
    lava = replace(LAVA, specific_heat=10.0, arrhenius=0.0)
    x, y = centres(150.0)
    ground = -0.1 * (x * math.cos(turn) + y * math.sin(turn))
    thickness = 2.0 * (np.hypot(x, y) < 30.0)
    flow = Flow(lava, MOVING, ground, thickness, np.full(x.shape, HOT))

    def energy():
        h = flow.thickness
        return GRAVITY * float((h * (ground + 0.5 * h)).sum())

    before = energy()
    flow.advance(600.0)
    warmed = 10.0 * (flow.content - HOT * flow.thickness.sum())
    assert before - energy() > 1.0
    assert warmed == pytest.approx(before - energy(), rel=1e-4)


@pytest.mark.parametrize('name', BALANCES)
def test_column_of_a_cell_cools_as_all_columns_do(name):
    effects, constants = BALANCES[name]
    lava = replace(LAVA, viscosity=1e15, **constants)
    rng = np.random.default_rng(3)
    x, _ = centres(50.0)
    slope = 0.5 if 'steep' in effects else 0.0
    # no cell is the edge of a front
    least = 1.01 * EDGE * 5.0
    thickness = rng.uniform(least, 5.0, x.shape)
    temperature = rng.uniform(700.0, 1500.0, x.shape)
    around = {'wind_speed': 0.5} if 'wind' in effects else {}
    flow = Flow(lava, effects, -slope * x, thickness, temperature, **around)
    exchange, find_spans = heat_functions(flow.effects).exchange, spans_function(Cells)

    @wp.kernel(module='unique', enable_backward=False)
    def once(s: Cells, m: Heat):
        find_spans(s)
        exchange(s, m, 1, s.rows - 2, 1, s.stride - 2)

    begun, step = 2000.0, 600.0
    # the step is longer than the age of lava in every second row
    emitted = flow.heat.emission_time.numpy()
    emitted[1::2] = 1900.0
    flow.heat.emission_time.assign(emitted)
    clock = flow.state.clock.numpy()
    clock[TIME], clock[LENGTH] = begun + step, step
    wp.launch(once, dim=1, inputs=[flow.state.argument(), flow.heat.argument()], device='cpu')
    after = host_temperature(flow.scene, flow.effects)
    cosine = 1.0 / math.hypot(1.0, slope)
    # cells at the border have the slope of one face and the ring
    for i, j in rng.integers(1, len(x) - 1, (40, 2)):
        expected = after(
            temperature=temperature[i, j], age=begun - emitted[i + 1, j + 1], step=step,
            thickness=thickness[i, j],
            normal_thickness=thickness[i, j] * cosine, slope=0.0, speed=0.0, drop=0.0,
        ) - temperature[i, j]
        found = flow.temperature[i, j] - temperature[i, j]
        assert found == pytest.approx(expected, rel=2e-4, abs=1e-3)


def test_lava_colder_than_its_solidus_becomes_ground():
    lava = replace(LAVA, convection=1000.0, solidus=1200.0)
    flow = slide(lava, STIFFENING, TURNS[1])
    ground = flow.heat.elevation.numpy().copy()
    volume = flow.thickness.sum()
    flow.advance(300.0)
    frozen = flow.heat.frozen.numpy()
    assert 0.0 < flow.thickness.sum() < 0.9 * volume
    assert flow.thickness.sum() + frozen.sum() == pytest.approx(volume, rel=1e-12)
    wet = flow.thickness > 1e-6
    assert flow.temperature[wet].min() >= 1200.0
    # the faces are those of the raised ground
    raised = slide(lava, flow.effects, TURNS[1])
    raised.heat.elevation.assign(ground + frozen)
    lay_ground(raised.state, raised.heat, flow.effects)
    for name in ('drop_x', 'drop_y', 'cross_x', 'cross_y', 'factor_x', 'factor_y'):
        np.testing.assert_allclose(
            getattr(flow.state, name).numpy(), getattr(raised.state, name).numpy(), atol=1e-6
        )


def test_age_of_lava_is_that_of_its_emission():
    flow = slide(replace(LAVA, crust_strength=1.0), MOVING, 0.0, emits=True)
    flow.advance(900.0)
    emitted = float(flow.state.source.numpy().sum()) * 900.0
    times = flow.heat.emission_time.numpy()[1:-1, 1:-1]
    # the lava of the start came out at 0, the rest evenly over the time
    total = float((flow.thickness * times).sum())
    assert total == pytest.approx(emitted * 450.0, rel=1e-5)


def test_conducted_heat_follows_the_error_function():
    lava = replace(LAVA, viscosity=1e15, specific_heat=100.0, conductivity=260.0)
    x, _ = centres(100.0)
    flow = Flow(
        lava, MOVING, np.zeros(x.shape), np.full(x.shape, 2.0),
        np.where(x < 0.0, 1000.0, 1400.0),
    )
    flow.advance(2e5, longest=2000.0)
    expected = exact.temperature_step(x, 2e5, low=1000.0, high=1400.0, diffusivity=1e-3)
    middle = np.abs(x) < 60.0
    assert np.abs(flow.temperature - expected)[10:-10][middle[10:-10]].max() < 0.01 * 400.0
    assert flow.temperature.mean() == pytest.approx(1200.0, rel=1e-6)


def test_cell_that_empties_is_not_heated_by_its_neighbours():
    """Lava runs off the tops of rough ground while heat is conducted from cell to cell."""
    lava = replace(LAVA, viscosity=1e3, specific_heat=100.0, conductivity=260.0)
    rng = np.random.default_rng(4)
    x, _ = centres(100.0)
    flow = Flow(
        lava, MOVING, rng.uniform(0.0, 5.0, x.shape) - 0.3 * x, rng.uniform(0.0, 0.5, x.shape),
        rng.uniform(1000.0, 1400.0, x.shape),
    )
    for until in (20.0, 200.0, 2000.0):
        flow.advance(until, longest=2000.0)
        wet = flow.thickness > 0.0
        assert 0.0 < flow.thickness[wet].min() < 1e-6
        assert 900.0 < flow.temperature[wet].min() <= flow.temperature[wet].max() < 1500.0


def test_cold_film_ahead_of_a_front_does_not_dam_it():
    lava = replace(LAVA, yield_strength=50.0, yield_rate=0.02)
    x, _ = centres(50.0)
    thickness = np.where(x < 0.0, 10.0, 1e-5)
    flow = Flow(
        lava, STIFFENING, -0.2 * x, thickness, np.where(x < 0.0, HOT, AIR)
    )
    law = Rheology(lava, flow.effects)
    strength = np.vectorize(law.strength_at)(flow.heat.temperature.numpy())
    flow.state.strength.assign(strength.astype(np.float32))
    flow.advance(20.0)
    ahead = (x > 0.0) & (x < CELL)
    assert flow.thickness[ahead].min() > 2.0
    assert flow.temperature[ahead].min() > HOT - 1.0


def test_every_effect_of_a_column_has_a_part_on_cells():
    for name, effect in EFFECTS.items():
        if hasattr(load(name), 'terms') or effect.freezes or hasattr(load(name), 'strength'):
            heat_functions(compatible([name]))


def test_volume_of_lava_that_cools_on_a_volcano_is_exact():
    scene = scene_from_yaml('etna.yaml')
    accuracy = Accuracy(method='cells', spacing=30.0)
    simulation = Simulation(scene, accuracy=accuracy, device='cpu', horizon=43200.0)
    simulation.advance(43200.0)
    snapshot, columns = simulation.snapshot(), simulation.solver.columns()
    assert snapshot.budget.solidified > 0.0
    assert columns.thickness.min() >= 0.0
    wet = columns.thickness > 1e-6
    assert columns.temperature[wet].min() >= scene.lava.solidus
    # viscous heating, from a fall of less than 1500 m
    hottest = scene.vents[0].temperature + scene.gravity * 1500.0 / scene.lava.specific_heat
    assert columns.temperature[wet].max() <= hottest
