# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Without lava, and without a vent that emits any until the end, only the clock advances."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy, METHODS
from lava_ros.simulation.batch import Batch

SLOPE = Terrain(np.tile(900.0 - 0.3 * 10.0 * np.arange(30.0), (24, 1)), 10.0)

#: It loses its heat above the solidus within minutes.
LAVA = Lava.paper(viscosity=5e3, density=2600.0, convection=500.0, solidus=1395.0)

VENT = Vent((60.0, 120.0), ((0.0, 20.0), (300.0, 0.0)), radius=12.0)

#: Maximum length of a step [s], and a long time: its steps would take minutes even on a GPU.
MAX_STEP, LONG = 5.0, 1e9

#: Particles wait on the host, cells within a launch: the same flow must rest in both.
both = pytest.mark.parametrize('method', METHODS)


def begun(device, method, *vents):
    return Simulation(
        Scene(SLOPE, vents, LAVA), effects={'solidification': True}, device=device,
        accuracy=Accuracy(
            spacing=8.0, thickness=1.0, longest_step=MAX_STEP, deterministic=True,
            method=method,
        ),
    )


def frozen(device, method):
    simulation = begun(device, method, VENT)
    simulation.advance(600.0, limit=1e5)
    while simulation.particle_count:
        simulation.advance(simulation.time + 600.0, limit=1e5)
    return simulation


@both
@pytest.mark.parametrize('vents', [(), (replace(VENT, discharge=((0.0, 0.0),)),)])
def test_an_idle_scene_reaches_any_time_at_once(vents, method, device):
    simulation = begun(device, method, *vents)
    for time in (1e4, LONG):
        assert simulation.advance(time) == time == simulation.time
        assert simulation.steps < 100
    assert simulation.snapshot().time == LONG
    # and it still erupts
    simulation.set_vents([replace(VENT, discharge=20.0)])
    simulation.advance(LONG + 100.0)
    assert simulation.budget().emitted == pytest.approx(2000.0)
    assert simulation.particle_count > 10


@both
def test_frozen_lava_takes_no_steps(method, device):
    simulation = frozen(device, method)
    before, steps = simulation.snapshot(), simulation.steps
    assert before.budget.solidified > 5000.0
    for time in (before.time + 1e4, LONG):
        assert simulation.advance(time, limit=LONG) == time
        after = simulation.snapshot()
        for name in ('thickness', 'temperature', 'frozen', 'arrived'):
            assert getattr(after, name).tobytes() == getattr(before, name).tobytes()
        assert after.budget == before.budget
        assert simulation.steps < steps + 100


@both
def test_a_vent_that_opens_later_is_not_missed(method, device):
    """The time before is passed at once, and no stop in it changes what follows."""
    later = replace(VENT, discharge=((0.0, 0.0), (4000.0, 20.0)))
    simulation = begun(device, method, later)
    assert simulation.advance(3900.0) == 3900.0
    assert simulation.steps < 20
    simulation.advance(4200.0)
    assert simulation.particle_count > 10
    maps = []
    for stops in ((), (1000.0, 3990.0, 4010.0)):
        simulation = begun(device, method, later)
        for time in (*stops, 4200.0):
            simulation.advance(time, limit=4200.0)
            if time < 4000.0:
                assert simulation.steps < 20
        maps.append(simulation.snapshot())
        # 800 until the opening would be added
        assert simulation.steps < 200
    assert maps[0].thickness.tobytes() == maps[1].thickness.tobytes()
    assert np.nanmax(maps[0].thickness) > 0.5


@both
def test_members_of_a_batch_rest_as_well(method, device):
    """One has no vent, one freezes, and one flows until the end."""
    vents = (), (VENT,), (replace(VENT, discharge=5.0),)
    members = [begun(device, method, *own) for own in vents]
    ends = [1e5, 1e5, 2000.0]
    Batch().run(
        member.advancing(end) for member, end in zip(members, ends, strict=True)
    )
    assert [member.time for member in members] == ends
    assert [member.particle_count > 0 for member in members] == [False, False, True]
    # 20,000 without a rest
    assert max(member.steps for member in members) < 2000
    alone = frozen(device, method).snapshot()
    np.testing.assert_array_equal(members[1].snapshot().thickness, alone.thickness)
