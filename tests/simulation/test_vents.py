# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The tables of vents on a device, and vents that are choked, too strong or closed."""

from itertools import count
import math
from types import SimpleNamespace

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
import lava_ros.simulation.simulation as simulation_module
from lava_ros.simulation.vents import MOST_A_SECOND, parting, VentSet

VENT = Vent((50.0, 50.0), 20.0, radius=10.0)


def flow(*vents: Vent, **accuracy: object) -> Simulation:
    """Vents on level ground, particles of 1 m3."""
    scene = Scene(Terrain(np.zeros((50, 50)), 2.0), vents, Lava(viscosity=1e4, arrhenius=0.0))
    knobs = Accuracy(spacing=1.0, thickness=1.0, **accuracy)
    return Simulation(scene, accuracy=knobs, device='cpu')


def test_parts_of_a_stage_make_room(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lava comes out whole however short the parts are, each of them one stage."""
    monkeypatch.setattr(simulation_module, '_FIRST_CAPACITY', 64)
    ticks = count()
    # a second goes by between two looks at the clock
    clock = SimpleNamespace(monotonic=lambda: float(next(ticks)))
    monkeypatch.setattr(simulation_module, 'wall_clock', clock)
    simulation = flow(VENT)
    for _ in range(100_000):
        if simulation.advance(40.0, wall_limit=1.5) >= 40.0:
            break
    budget = simulation.budget()
    assert simulation.time == 40.0
    assert budget.late == 0.0 and budget.pending < 1.0
    assert simulation.particle_count == pytest.approx(800, abs=1)


def test_lava_that_finds_no_room_is_late(monkeypatch: pytest.MonkeyPatch) -> None:
    """The budget says so: nothing is unaccounted for."""
    monkeypatch.setattr(simulation_module, '_FIRST_CAPACITY', 64)
    simulation = flow(VENT)
    monkeypatch.setattr(Simulation, '_make_room', lambda self, counts: None)
    simulation.advance(40.0)
    budget = simulation.budget()
    assert budget.late == pytest.approx(budget.pending, abs=1.1) and budget.late > 600.0
    assert budget.error < 1e-9


@pytest.mark.parametrize('discharges', [(1e7,), (6e5, 6e5)])
def test_a_discharge_of_too_many_particles_is_refused(discharges: tuple[float, ...]) -> None:
    """The error names vent, discharge and limit, and the old vents stay."""
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


def test_a_strong_vent_comes_out_in_many_steps() -> None:
    """What a step brings is bounded, and so is the memory that is asked for."""
    simulation = flow(Vent((50.0, 50.0), 0.9 * MOST_A_SECOND, radius=1e5))
    simulation.advance(2.0)
    budget = simulation.budget()
    assert simulation.steps >= 6
    assert budget.emitted == pytest.approx(1.8 * MOST_A_SECOND)
    assert simulation._state.capacity < 2**21


@pytest.mark.parametrize('end', [None, (70.0, 50.0)])
@pytest.mark.parametrize('waiting', [0.0, 0.4, 1.0, 700.3, 1e9])
def test_a_conduit_is_emptied_in_whole_particles(waiting: float, end: object) -> None:
    """Their volumes add up, none is larger than a particle, and they have the vent's symmetry."""
    vent = Vent((50.0, 50.0), 20.0, radius=10.0, end=end)
    found = list(parting(vent, waiting, 1.0))
    volumes = [volume for _, volume in found]
    assert sum(volumes) == pytest.approx(waiting)
    assert len(found) <= 2**18
    if waiting < 1e6:
        least = math.ceil(waiting)
        assert least <= len(found) < least + 8 and max(volumes, default=0.0) <= 1.0
    for x, y in dict.fromkeys(place for place, _ in found):
        inside = math.hypot(x - 50.0, y - 50.0) <= 10.0
        assert inside if end is None else 50.0 <= x <= 70.0 and y == 50.0
    if 1.0 < waiting < 1e6:
        assert len({place for place, _ in found}) == len(found)
        middle = 60.0 if end else 50.0
        relative = np.array([place for place, _ in found]) - (middle, 50.0)
        for turned in (-relative, relative * (-1, 1), *([] if end else [relative[:, ::-1]])):
            order = [np.lexsort(np.round(points, 6).T) for points in (relative, turned)]
            assert relative[order[0]] == pytest.approx(turned[order[1]], abs=1e-9)


def test_a_long_discharge_series_becomes_a_table() -> None:
    """Of 300,000 points: to integrate up to each one from the first would take hours."""
    count = 300_000
    vent = Vent((0.0, 0.0), 1.0)
    # what is validated point by point takes seconds
    series = tuple((float(time), float(time % 7)) for time in range(count))
    object.__setattr__(vent, 'discharge', series)
    ground, accuracy = Terrain(np.zeros((3, 3)), 1.0), Accuracy(spacing=1.0)
    vents = VentSet((vent,), ground, accuracy, 1.0, 'cpu', since=10.0, carried=[4.0])
    volumes = vents.outlets.volumes.numpy()
    assert volumes.shape == (count,)
    assert volumes[:14].tolist() == 11 * [4.0] + [7.0, 11.0, 16.0]
    assert volumes[-1] == 4.0 + vents.emitted(count - 1.0)
