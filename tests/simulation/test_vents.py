# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Vent tables on a device; vents without space for their lava, too strong, or closed."""

from dataclasses import replace
from itertools import count
import math
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp

from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.particles import lava as lava_module
from lava_ros.simulation.particles import solver as solver_module
from lava_ros.simulation.particles.layout import FULL
from lava_ros.simulation.particles.state import State
from lava_ros.simulation.step.timestep import longest_from
import lava_ros.simulation.step.vents as vents_module
from lava_ros.simulation.step.vents import Emission, VentSet
from solver import incline, only, simulated

VENT = Vent((50.0, 50.0), 20.0, radius=10.0)


def flow(*vents: Vent, device: str = 'cpu', **accuracy: object) -> Simulation:
    """Return vents on level ground, with particles of 1 m3."""
    ground = Terrain(np.zeros((50, 50)), 2.0)
    scene = Scene(ground, vents, Lava.paper(viscosity=1e4, arrhenius=0.0))
    knobs = Accuracy(spacing=1.0, thickness=1.0, **accuracy)
    return Simulation(scene, accuracy=knobs, device=device)


def vent_set(
    *vents: Vent, slope: float = 0.0, spacing: float = 1.0, symmetric: bool = False
) -> VentSet:
    """Return vents on ground that rises to the east, with particles of 1 m3."""
    ground = Terrain(np.tile(slope * 2.0 * np.arange(50.0), (50, 1)), 2.0)
    accuracy = Accuracy(spacing=spacing, thickness=1.0, symmetric=symmetric)
    before = Emission.of_new_vents(len(vents))
    return VentSet(vents, ground, accuracy, 'cpu', since=0.0, before=before)


def test_capacity_grows_if_each_part_is_one_stage(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lava_module, 'FIRST_CAPACITY', 64)
    ticks = count()
    # 1 s passes between two readbacks of the clock
    clock = SimpleNamespace(monotonic=lambda: float(next(ticks)))
    monkeypatch.setattr(solver_module, 'wall_clock', clock)
    simulation = flow(VENT)
    for _ in range(100_000):
        if simulation.advance(40.0, wall_limit=1.5) >= 40.0:
            break
    budget = simulation.budget()
    assert simulation.time == 40.0
    assert budget.overdue == 0.0 and budget.waiting < 1.0
    assert simulation.particle_count == pytest.approx(800, abs=1)


def test_capacity_grows_before_a_vent_needs_it(
    device: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lava_module, 'FIRST_CAPACITY', 64)
    seen, make_room = [], State.make_room

    def noted(state: State, counts: np.ndarray) -> None:
        seen.append((int(counts[FULL]), state.capacity))
        make_room(state, counts)

    monkeypatch.setattr(State, 'make_room', noted)
    # 30 particles a step
    simulation = flow(VENT, Vent((60.0, 50.0), 400.0, radius=8.0), device=device)
    simulation.advance(20.0)
    assert simulation.particle_count > 8000
    # it has grown, and no vent ever waited
    assert seen[-1][1] > 64 and not any(full for full, _ in seen)


def test_lava_beyond_the_capacity_is_overdue(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lava_module, 'FIRST_CAPACITY', 64)
    monkeypatch.setattr(State, 'make_room', lambda self, counts: None)
    simulation = flow(VENT)
    simulation.advance(40.0)
    budget = simulation.budget()
    assert budget.overdue == pytest.approx(budget.waiting, abs=1.1) and budget.overdue > 600.0


@pytest.mark.parametrize('discharges', [(1e7,), (6e5, 6e5)])
def test_rejects_a_discharge_of_too_many_particles(discharges: tuple[float, ...]) -> None:
    vents = [Vent((40.0 + 5.0 * n, 50.0), flux) for n, flux in enumerate(discharges)]
    simulation = flow(VENT)
    before = simulation.scene.vents
    with pytest.raises(LavaError, match=r'vents\[\d\].discharge is .* at most 1e\+06 m3/s of all'):
        simulation.set_vents(vents)
    assert simulation.scene.vents == before
    simulation.advance(10.0)
    assert simulation.budget().emitted == pytest.approx(200.0)
    with pytest.raises(LavaError, match='at most 1e'):
        flow(*vents)


def test_emission_per_step_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vents_module, '_MAX_PARTICLES_PER_STEP', 2**10)
    simulation = flow(Vent((50.0, 50.0), 7000.0, radius=1e5))
    simulation.advance(1.0)
    budget = simulation.budget()
    assert simulation.steps >= 6
    assert budget.emitted == pytest.approx(7000.0)
    assert simulation.solver.state.capacity <= 2**14


@pytest.mark.parametrize('end', [None, (70.0, 50.0)])
@pytest.mark.parametrize('symmetric', [False, True])
@pytest.mark.parametrize(
    'waiting', [0.0, 0.4, 1.0, 700.3, pytest.param(1e9, marks=pytest.mark.nightly)]
)
def test_closed_vent_empties_its_conduit(
    waiting: float, end: tuple[float, float] | None, symmetric: bool
) -> None:
    vent = Vent((50.0, 50.0), 20.0, temperature=1400.0, radius=10.0, end=end)
    found = vent_set(vent, symmetric=symmetric).conduit_particles(0, waiting)
    places, volumes = np.array(found).reshape(-1, 4)[:, :2], [row[2] for row in found]
    assert sum(volumes) == pytest.approx(waiting)
    assert len(found) <= 2**18 and {row[3] for row in found} <= {1400.0}
    if waiting < 1e6:
        least = math.ceil(waiting)
        assert least <= len(found) < least + 8 and max(volumes, default=0.0) <= 1.0
    x, y = places.T
    near = np.hypot(np.maximum(x - (end or vent.position)[0], np.minimum(x - 50.0, 0.0)), y - 50.0)
    assert (near <= 10.0 * math.sqrt(2.0)).all()
    if 1.0 < waiting < 1e6:
        assert len(np.unique(places, axis=0)) == len(found)
    if symmetric and 1.0 < waiting < 1e6:
        relative = places - ((60.0 if end else 50.0), 50.0)
        for turned in (-relative, relative * (-1, 1), *([] if end else [relative[:, ::-1]])):
            order = [np.lexsort(np.round(points, 6).T) for points in (relative, turned)]
            assert relative[order[0]] == pytest.approx(turned[order[1]], abs=1e-9)


def ground_with(**features: object) -> Terrain:
    x, y = np.meshgrid(5.0 * np.arange(60) + 2.5, 5.0 * np.arange(50) + 2.5)
    height = np.zeros_like(x)
    if 'hole' in features:
        height[np.hypot(x - 100.0, y - 100.0) < 12.0] = np.nan
    if 'ridge' in features:
        height = 40.0 - 2.0 * np.abs(x - 120.0).clip(0.0, 20.0)
    if 'cliff' in features:
        height[x > 120.0] = 143.0
    return Terrain(height, 5.0, origin=(-0.0, 0.0))


#: A ground, a vent on it, and the side of x [m] that lava has to stay on.
NARROW = {
    'border': (ground_with(), Vent((8.0, 120.0), 5.0, radius=1.0), 300.0),
    'corner': (ground_with(), Vent((1.0, 249.0), 5.0, radius=1.0), 300.0),
    'wide at a border': (ground_with(), Vent((8.0, 120.0), 5.0, radius=60.0), 300.0),
    'fissure along a border': (
        ground_with(), Vent((8.0, 120.0), 5.0, radius=1.0, end=(200.0, 2.0)), 300.0
    ),
    'hole': (ground_with(hole=True), Vent((82.0, 100.0), 5.0, radius=1.0), 300.0),
    'fissure across a hole': (
        ground_with(hole=True), Vent((62.0, 100.0), 5.0, radius=1.0, end=(162.0, 101.0)), 300.0
    ),
    'ridge': (ground_with(ridge=True), Vent((97.0, 120.0), 5.0, radius=1.0), 120.0),
    'fissure along a ridge': (
        ground_with(ridge=True), Vent((99.0, 50.0), 5.0, radius=1.0, end=(102.0, 200.0)), 120.0
    ),
    'cliff': (ground_with(cliff=True), Vent((112.0, 120.0), 5.0, radius=1.0), 120.0),
}


@pytest.mark.parametrize('symmetric', [False, pytest.param(True, marks=pytest.mark.nightly)])
@pytest.mark.parametrize('name', NARROW)
def test_vent_emits_only_on_connected_ground(name: str, symmetric: bool) -> None:
    """Not beyond the map, on a hole, behind a ridge or on a cliff."""
    terrain, vent, most = NARROW[name]
    # lava that does not move stays where it was emitted
    lava = Lava.paper(viscosity=1e15, arrhenius=0.0, emissivity=0.0, convection=0.0)
    simulation = Simulation(
        Scene(terrain, (vent,), lava), effects=Effects(), device='cpu',
        accuracy=Accuracy(spacing=40.0, thickness=2.0, symmetric=symmetric),
    )
    simulation.advance(200.4 * simulation.accuracy.particle_volume / 5.0)
    simulation.set_vents([])
    sample = simulation.sample()
    budget = simulation.budget()
    assert budget.lost == 0.0 and budget.waiting < 1e-3
    assert terrain.covered(sample.position).all()
    assert sample.position[:, 0].max() <= most
    # still spread over the available ground
    assert np.ptp(sample.position, axis=0).max() > 5.0
    assert len(np.unique(sample.position, axis=0)) > 50


def test_gentle_slope_does_not_change_the_places_of_emission() -> None:
    vent = Vent((50.0, 50.0), 20.0, radius=2.0)
    level, sloping = (
        vent_set(vent, slope=slope, spacing=20.0).places(0, 0, 100) for slope in (0.0, 0.04)
    )
    around = np.sort(np.hypot(*(level - 50.0).T)), np.sort(np.hypot(*(sloping - 50.0).T))
    assert around[0] == pytest.approx(around[1]) and around[0][-1] > 15.0


def test_a_step_emits_no_more_than_half_a_thickness() -> None:
    """The steps from any time, over changes of the discharge, without and with another limit."""
    series = ((0.0, 0.0), (100.0, 60.0), (130.0, 3.0), (140.0, 90.0), (145.0, 0.0), (400.0, 2.0))
    steady = Vent((20.0, 20.0), 1.0, radius=5.0)
    vents = vent_set(replace(VENT, discharge=series), steady)
    ends, limits, rates = vents.step_limits.T
    assert ends.tolist() == [100.0, 130.0, 140.0, 145.0, 400.0, math.inf]
    assert rates.tolist() == [1.0, 61.0, 4.0, 91.0, 1.0, 3.0]
    half = 0.5 * math.pi * 25.0
    assert limits[0] == limits[4] == pytest.approx(half)
    times = np.array([0.0, 70.0, 99.0, 100.0, 120.0, 139.9, 143.0, 300.0, 399.0, 1e6])
    found = {}
    for longest in (20.0, 1e3):
        steps = wp.zeros(len(times), dtype=wp.float64, device='cpu')
        tables = [wp.array(item, dtype=wp.float64, device='cpu') for item in (times, ends, limits)]
        wp.launch(longest_steps, len(times), [longest, *tables], [steps], device='cpu')
        found[longest] = steps.numpy()
    assert (found[20.0] == np.minimum(found[1e3], 20.0)).all()
    for vent, area in ((vents.vents[0], math.pi * 100.0), (steady, math.pi * 25.0)):
        given = [vent.volume_between(a, a + b) for a, b in zip(times, found[1e3], strict=True)]
        assert max(given) <= 0.5 * area * (1.0 + 1e-9)
    # the limit is reached by a vent where the discharge is constant
    assert found[1e3][[0, 3, 7]] == pytest.approx([half, 0.5 * math.pi * 100.0 / 60.0, half])
    # a fissure is as wide as its ends
    fissure = vent_set(Vent((20.0, 20.0), 1.0, radius=5.0, end=(20.0, 50.0)))
    assert fissure.step_limits[0, 1] == pytest.approx(half + 0.5 * 30.0 * 10.0)


def test_lava_comes_out_at_the_stages_of_a_step() -> None:
    simulation = simulated(
        incline(0.1, 20, 20, 5.0), Lava.paper(viscosity=1e3, ground_conductivity=2.0),
        Vent((50.0, 50.0), 50.0, radius=10.0), effects=only('ground'), spacing=2.0,
    )
    simulation.advance(60.0)
    state = simulation.solver.state
    times = np.unique(state.emission_time.numpy()[: state.count])
    assert simulation.snapshot().steps.stages > 2 and len(times) > simulation.steps


def test_steps_are_longer_after_a_strong_discharge() -> None:
    simulation = flow(Vent((50.0, 50.0), ((0.0, 100.0), (10.0, 0.1)), radius=10.0))
    simulation.advance(10.0)
    strong = simulation.steps
    assert strong >= 10.0 / (0.5 * math.pi * 100.0 / 100.0)
    simulation.advance(110.0)
    assert simulation.steps - strong < 5 * strong


@wp.kernel
def longest_steps(
    longest: wp.float64, times: wp.array(dtype=wp.float64), ends: wp.array(dtype=wp.float64),
    limits: wp.array(dtype=wp.float64), steps: wp.array(dtype=wp.float64),
):
    """Compute the longest step from each time."""
    i = wp.tid()
    steps[i] = longest_from(times[i], longest, ends, limits)


def test_table_of_a_long_discharge_series() -> None:
    count = 50_000
    vent = Vent((0.0, 0.0), 1.0)
    # point by point validation takes seconds
    series = tuple((float(time), float(time % 7)) for time in range(count))
    object.__setattr__(vent, 'discharge', series)
    ground, accuracy = Terrain(np.zeros((3, 3)), 1.0), Accuracy(spacing=1.0, thickness=1.0)
    before = replace(Emission.of_new_vents(1), volume=np.array([4.0]))
    vents = VentSet((vent,), ground, accuracy, 'cpu', since=10.0, before=before)
    volumes = vents.outlets.volumes.numpy()
    assert volumes.shape == (count,)
    assert volumes[:14].tolist() == 11 * [4.0] + [7.0, 11.0, 16.0]
    assert volumes[-1] == 4.0 + vents.emitted(count - 1.0)
