# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The simulation from a user's view: volume, vents, terrain, errors."""

from contextlib import nullcontext
import logging
import math
import os

import numpy as np
import pytest
import warp as wp

from lava_ros.errors import LavaError
from lava_ros.scene import Lava, Terrain, Vent
from lava_ros.simulation import Particles
from lava_ros.simulation.setup import defaults
from solver import incline, simulated

LAVA = Lava.paper(viscosity=2e3, density=2600.0)

EXACT = {'device': 'cpu', 'precision': 'float64'}


def hillside(rows=60, columns=90):
    return incline(0.2, rows, columns, 10.0, top=1000.0)


def eruption(device='cpu', *vents, terrain=None, **options):
    """Return a simulation on the hillside with one strong vent by default."""
    vents = vents or (Vent((150.0, 300.0), 20.0, radius=15.0),)
    knobs = {'spacing': 6.0, **options}
    return simulated(terrain or hillside(), LAVA, *vents, device=device, **knobs)


def test_lava_flows_downhill_and_is_hot(device):
    simulation = eruption(device)
    simulation.advance(300.0)
    early = simulation.sample().position.mean(axis=0)
    simulation.advance(600.0)
    snapshot = simulation.snapshot()
    assert simulation.time == snapshot.time == 600.0
    assert snapshot.thickness.shape == snapshot.temperature.shape == (60, 90)
    assert snapshot.flaw() == ''
    assert 50 < (snapshot.thickness > 0.1).sum() < 2000
    assert np.isnan(snapshot.temperature[snapshot.thickness == 0.0]).all()
    assert 300.0 < np.nanmin(snapshot.temperature) <= np.nanmax(snapshot.temperature) <= 1423.1
    simulation.advance(1200.0)
    late = simulation.sample().position.mean(axis=0)
    assert late[0] > early[0] + 20.0
    # lava crosses the slope only by chance
    assert abs(late[1] - 300.0) < 3.0


def test_discharge_series_emits_its_integral_along_a_fissure(device):
    vent = Vent((100.0, 200.0), [(100.0, 30.0), (200.0, 0.0), (300.0, 6.0)], end=(100.0, 400.0))
    simulation = eruption(device, vent)
    for time, volume in ((99.0, 0.0), (150.0, 1500.0), (250.0, 3000.0), (400.0, 3600.0)):
        simulation.advance(time)
        assert simulation.budget().emitted == pytest.approx(volume)
    y = simulation.sample().position[:, 1]
    assert y.min() < 230.0 and y.max() > 370.0


def test_replacing_the_terrain_keeps_the_lava_in_place(device):
    simulation = eruption(device)
    simulation.advance(300.0)
    before = simulation.sample().position
    x = np.arange(0, 900, 5.0)
    simulation.set_terrain(Terrain(np.tile(500 + 0.1 * x, (160, 1)), 5.0, origin=(-20.0, 10.0)))
    after = simulation.sample().position
    assert np.sort(after[:, 0]) == pytest.approx(np.sort(before[:, 0]), abs=1e-2)
    assert simulation.snapshot().thickness.shape == (160, 180)
    simulation.advance(900.0)
    assert simulation.budget().emitted == pytest.approx(18000.0)


def test_rejected_changes_leave_the_simulation_unchanged():
    simulation = eruption()
    simulation.advance(60.0)
    scene, volume = simulation.scene, simulation.budget()
    with pytest.raises(LavaError, match=r'vents\[0\]\.position'):
        simulation.set_vents([Vent((-5.0, 0.0), 1.0)])
    with pytest.raises(LavaError, match=r'vents\[0\]\.position'):
        simulation.set_terrain(hillside(rows=10))
    assert simulation.scene is scene
    assert simulation.budget() == volume
    simulation.advance(120.0)
    assert simulation.budget().emitted == pytest.approx(2400.0)


def test_rejects_an_unknown_device_and_a_particle_off_the_map():
    with pytest.raises(LavaError, match='^device'):
        simulated(hillside(), Lava.paper(), device='tpu')
    with pytest.raises(LavaError, match=r'^particles\.position\[0\]'):
        simulated(hillside(), Lava.paper(), Particles([[1e6, 0.0]], 1.0, 1400.0))


@pytest.mark.parametrize(
    ('field', 'change'),
    [
        ('position', {'position': [1.0, 2.0]}),
        ('position', {'position': [[1.0, math.nan]]}),
        ('volume', {'volume': 0.0}),
        ('volume', {'volume': [1.0, 2.0]}),
        ('temperature', {'temperature': math.inf}),
    ],
)
def test_rejects_invalid_particles_by_name(field, change):
    with pytest.raises(LavaError, match=rf'^particles\.{field}'):
        Particles(**{'position': [[1.0, 2.0]], 'volume': 1.0, 'temperature': 1400.0, **change})


def test_wall_limit_stops_before_the_target():
    simulation = eruption()
    assert simulation.advance(3600.0, wall_limit=0.01) < 3600.0
    reached = simulation.time
    for passed in (reached - 1.0, reached):
        assert simulation.advance(passed) == reached == simulation.time
    # completes the step
    simulation.snapshot()
    reached = simulation.time
    assert simulation.advance(reached + 10.0) == reached + 10.0


@pytest.mark.parametrize(
    ('one', 'other', 'error'),
    [
        ({'precision': 'float32'}, {'precision': 'float64'}, 2e-3),
        ({'device': 'cpu'}, {}, 2e-3),
        # the deterministic order gives the same sums to rounding
        (EXACT, {**EXACT, 'deterministic': True}, 1e-6),
    ],
    ids=['precision', 'device', 'order'],
)
def test_precision_device_and_order_change_only_rounding(device, one, other, error):
    grids = []
    for knobs in (one, other):
        simulation = eruption(**{'device': device, **knobs})
        simulation.advance(300.0)
        grids.append(simulation.snapshot().thickness)
    assert np.abs(grids[0] - grids[1]).max() < error * grids[1].max()


def test_scene_without_vents_stays_dry(device):
    simulation = simulated(hillside(), Lava.paper(), device=device)
    simulation.advance(1e5)
    snapshot = simulation.snapshot()
    assert snapshot.time == 1e5
    assert (snapshot.thickness == 0.0).all()


def test_effects_can_change_during_a_run(device):
    simulation = eruption(device)
    simulation.advance(300.0)
    held = simulation.budget().flowing
    assert simulation.effects.cooling
    simulation.set_effects({'helmholtz': True, 'steep': False}, horizon=1.0)
    assert simulation.effects.helmholtz
    assert not (simulation.effects.steep or simulation.effects.cooling)
    decided = {item.name: item.reason for item in simulation.decisions()}
    assert decided['helmholtz'] == decided['steep'] == 'forced'
    assert decided['cooling'].endswith('<= 0.01')
    assert simulation.time == 300.0
    assert simulation.budget().flowing == pytest.approx(held, rel=1e-6)
    simulation.advance(600.0)
    assert simulation.snapshot().thickness.max() > 0.1


def test_rejected_effects_leave_the_effects_unchanged():
    simulation = eruption(effects={'steep': False})
    before = simulation.effects
    for forced, options in (
        ({'slope': True}, {}),
        ({'green': True, 'inertia': True}, {}),
        ({'steep': True}, {'horizon': 0.0}),
    ):
        with pytest.raises(LavaError):
            simulation.set_effects(forced, **options)
        simulation.set_vents([Vent((150.0, 300.0), 21.0)])
        assert simulation.effects == before


@pytest.mark.parametrize('fails', [False, True])
def test_stderr_of_warp_is_logged(fails, monkeypatch, caplog, capfd):
    def start():
        os.write(2, b'Warp CUDA warning: no driver\n[INFO] [lava]: of another thread\n')
        if fails:
            raise RuntimeError('Warp did not start')

    monkeypatch.setattr(wp, 'init', start)
    expected = pytest.raises(RuntimeError) if fails else nullcontext()
    with caplog.at_level(logging.INFO, logger='lava_ros'), expected:
        defaults._start_warp.__wrapped__()
    assert caplog.messages == ['Warp CUDA warning: no driver']
    assert capfd.readouterr().err == '[INFO] [lava]: of another thread\n'
