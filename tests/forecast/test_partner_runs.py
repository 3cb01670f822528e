# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Partner runs of a run, and the numerical error that they measure."""

from dataclasses import replace
import queue

import numpy as np
import pytest

from lava_ros.effects import Effects
from lava_ros.forecast import partner_process
from lava_ros.forecast.ensemble_error import measure_ensemble_error, MIN_MEMBERS
from lava_ros.forecast.members import make_plan
from lava_ros.forecast.partner_process import PartnerRuns
from lava_ros.forecast.partner_runs import measure_error, partner_of
from lava_ros.forecast.store import Store
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.events import TerrainEvent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.numerical_error import Areas, between_methods, Pair, richardson

X, Y = np.meshgrid(np.arange(60) * 5.0, np.arange(40) * 5.0)

#: Fluid lava on a slope with bumps, resolved by eight cells.
BUMPY = Scene(
    Terrain(0.1 * X + 0.8 * np.sin(X / 6.0) * np.sin(Y / 7.0), 5.0),
    (Vent((230.3, 100.2), 5.0),),
    lava=Lava.paper(viscosity=1000.0),
)
SMOOTH = replace(BUMPY, terrain=Terrain(0.1 * X, 5.0))
ACCURACY = Accuracy(spacing=4.0, thickness=1.0)
END = 300.0
PLAIN = Effects()


def run(scene, accuracy, device, effects=PLAIN):
    """Return the areas at the end of a run."""
    simulation = Simulation(
        scene, accuracy=accuracy, effects=effects, device=device, horizon=END
    )
    simulation.advance(END)
    return Areas.of(simulation.snapshot())


def options(device):
    return {'accuracy': ACCURACY, 'effects': PLAIN, 'horizon': END, 'device': device}


@pytest.mark.parametrize(('method', 'limit', 'other', 'reduction'), [
    # the terrain has cells of 5 m
    ('particles', None, {'method': 'cells', 'spacing': 5.0}, 1.0 + (5.0 / 8.0) ** 1.5),
    ('particles', 1e9, {'spacing': 10.0}, 2.5**1.5 - 1.0),
    ('cells', None, {'spacing': 8.0}, 2.0**1.25 - 1.0),
])
def test_particles_part_is_the_difference_from_its_partner(
    method, limit, other, reduction, device
):
    accuracy = replace(ACCURACY, method=method, mobility_limit=limit)
    areas = run(SMOOTH, accuracy, device)
    found = measure_error(SMOOTH, areas, END, **{**options(device), 'accuracy': accuracy})
    partner = run(SMOOTH, replace(accuracy, **other), device)
    expected = Pair(areas, partner, reduction).errors()
    assert found.inundated.lava == expected.inundated > 0.0
    assert found.standing.lava == expected.standing > 0.0
    # the coarser ground of a plane is the same plane but for rounding
    assert found.inundated.ground < 0.01
    assert (found.spacing, found.cell, found.time) == (4.0, 5.0, END) and found.cost > 0.0


@pytest.mark.parametrize(('spacing', 'effects', 'method', 'size'), [
    (2.0, (), 'cells', 5.0), (6.0, (), 'cells', 10.0), (10.0, ('arrhenius',), 'cells', 10.0),
    # the largest cells of which the terrain has two along each side
    (1e3, (), 'cells', 80.0),
    # cells lack inertia, and freezing lava ends elsewhere on them
    (6.0, ('inertia',), 'particles', 15.0), (6.0, ('solidification',), 'particles', 15.0),
])
def test_partner_is_on_cells_where_both_methods_agree(spacing, effects, method, size):
    accuracy, on = replace(ACCURACY, spacing=spacing), Effects(**dict.fromkeys(effects, True))
    partner, reduction = partner_of(SMOOTH, accuracy, on)
    assert partner == replace(accuracy, method=method, spacing=size)
    expected = richardson(2.5, 1.5) if method == 'particles' else between_methods(size, spacing)
    assert reduction == pytest.approx(expected)


def test_ground_part_is_larger_on_bumps_and_independent_of_the_particles(device):
    found = measure_error(BUMPY, run(BUMPY, ACCURACY, device), END, **options(device))
    assert 0.05 < found.inundated.ground < 0.5
    assert 0.05 < found.standing.ground < 0.5
    again = measure_error(BUMPY, run(BUMPY, ACCURACY, device), END, **options(device))
    assert again.as_dict() == found.as_dict() or device != 'cpu'


def test_partner_runs_have_the_events_of_the_scene(device):
    # the ground becomes bumpy at the start
    later = replace(SMOOTH, events=(TerrainEvent(0.0, 'bumps', BUMPY.terrain),))
    found = measure_error(later, run(later, ACCURACY, device), END, **options(device))
    assert found.inundated.ground > 0.05


class Requests(list):
    """Requests, and the rests before slices."""

    def __init__(self, *items):
        super().__init__(items)
        self.rests = []

    def get(self, *, timeout):
        if self:
            return self.pop()
        self.rests.append(timeout)
        raise queue.Empty


def test_process_rests_and_finds_the_same_error():
    areas, replies = run(SMOOTH, ACCURACY, 'cpu'), []
    values = {'scene': SMOOTH, 'run': areas, 'time': END, **options('cpu')}
    requests = Requests(('measure', values | {'share': 0.25}))
    runs = PartnerRuns(requests, lambda name, **values: replies.append((name, values['error'])))
    runs.turn()
    while runs.is_busy:
        runs.turn()
    (name, found), = replies
    assert name == 'measured'
    assert found.as_dict() == measure_error(**values).as_dict()
    # three times as long as it computes
    assert sum(requests.rests) == pytest.approx(3.0 * found.cost, rel=0.5)


@pytest.mark.parametrize('error', [OSError(28, 'disk full'), MemoryError('too large')])
def test_process_explains_why_the_error_is_not_measured(monkeypatch, error):
    def measuring(**_):
        raise error
        yield

    monkeypatch.setattr(partner_process, 'measuring', measuring)
    replies = []
    runs = PartnerRuns(
        Requests(('measure', {'share': 1.0})), lambda name, **values: replies.append(values)
    )
    runs.turn()
    runs.turn()
    assert replies == [{'reason': f'{type(error).__name__}: {error}'}] and not runs.is_busy


def test_error_of_an_ensemble_is_that_of_its_scene_and_is_kept(tmp_path, monkeypatch):
    plan = make_plan(SMOOTH, horizon=END, accuracy=ACCURACY)
    store = Store(tmp_path / 'a', plan)
    assert measure_ensemble_error(store, MIN_MEMBERS - 1) is None
    found = measure_ensemble_error(store, MIN_MEMBERS, device='cpu')
    (tmp_path / 'a/members/0000000.npz').touch()
    store.close()
    areas = run(SMOOTH, ACCURACY, 'cpu', plan.effects)
    expected = measure_error(
        SMOOTH, areas, END, **{**options('cpu'), 'effects': plan.effects}
    )
    assert found.as_dict() == expected.as_dict()
    monkeypatch.setattr('lava_ros.forecast.ensemble_error.measure_error', None)
    again = Store(tmp_path / 'a', plan)
    assert measure_ensemble_error(again, 2).as_dict() == found.as_dict()
    without = Store(tmp_path / 'b', replace(plan, scene=replace(SMOOTH, vents=())))
    assert measure_ensemble_error(without, 99) is None
