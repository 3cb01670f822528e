# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Pilot runs: their timing, and the time that they predict for finer runs."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.effects import Effects
from lava_ros.forecast import pilot_runs as pilots
from lava_ros.forecast.pilot_runs import cost_at, Pilot
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation.numerical_error import Areas
from lava_ros.simulation.resolution import resolution_of

SCENE = Scene(
    Terrain(np.zeros((40, 40)), 10.0), (Vent((200.0, 200.0), 20.0),),
    lava=Lava.paper(viscosity=1e6)
)


def test_refinements_between_presets_have_the_accuracy_of_the_coarser_one():
    standard = resolution_of(SCENE, pilots.PRESETS['standard'].accuracy, horizon=3600.0).spacing
    for refinement, name in ((0.3, 'draft'), (1.0, 'standard'), (1.3, 'standard'), (2.5, 'fine')):
        accuracy = pilots.accuracy_at(SCENE, refinement, 3600.0)
        assert accuracy == replace(pilots.PRESETS[name].accuracy, spacing=standard / refinement)


def test_pilot_is_timed_and_stopped_by_the_given_clock():
    def run(limit):
        clock = iter(range(10**6)).__next__
        return pilots.run_at(SCENE, 0.5, 3600.0, device='cpu', wall_limit=limit, clock=clock)

    full = run(1e6)
    assert full.setup == 1.0 and full.wall_time > 3.0
    assert full.areas.inundated.any() and full.evaluations > 0
    assert full.spacing == pilots.spacing_at(SCENE, 0.5, 3600.0)
    assert run(full.wall_time - 2.0) is None


def test_pilot_has_the_given_effects(device):
    own = pilots.run_at(SCENE, 0.5, 60.0, device=device).effects
    other = replace(own, green=not own.green, helmholtz=False)
    assert pilots.run_at(SCENE, 0.5, 60.0, device=device, effects=other).effects == other != own


NOWHERE = Areas(*np.zeros((2, 1, 1), dtype=bool))
REFINEMENTS = (0.2, 0.28, 0.4, 0.56)


def _run(refinement, time, evaluations=1000, effects=None, setup=0.0):
    return Pilot(
        refinement, 1.0 / refinement, time, setup, evaluations, 100, effects or Effects(), NOWHERE
    )


@pytest.mark.parametrize('growth', [1.0, 1.5])
@pytest.mark.parametrize(('each', 'particles'), [(1e-3, 0.0), (1e-4, 2e-3), (0.0, 1e-3)])
def test_cost_law_is_recovered_from_runs_that_follow_it(growth, each, particles):
    def time(refinement):
        return 0.1 + 1000.0 * refinement**growth * (each + particles * refinement**2)

    found = [
        _run(refinement, time(refinement), 1000.0 * refinement**growth, setup=0.1)
        for refinement in REFINEMENTS
    ]
    assert cost_at(found, 1.0) == pytest.approx(time(1.0))
    assert cost_at(found, 0.28) == pytest.approx(time(0.28))
    assert cost_at(found, 0.3) == pytest.approx(time(0.3), rel=0.03)


def test_cost_with_a_solve_grows_as_the_third_power():
    solving = [
        _run(r, r + 8.0 * r**4, 1000.0 * r, effects=Effects(helmholtz=True)) for r in REFINEMENTS
    ]
    assert cost_at(solving, 1.0) == pytest.approx(9.0)
    # coarse pilots may have hardly more steps than coarser ones; fine runs have
    few = [_run(r, 1.0 + 8.0 * r**2) for r in REFINEMENTS]
    assert cost_at(few, 1.12) == pytest.approx(2.0 * (1.0 + 8.0 * 1.12**2))
    # a busy machine does not make finer runs cheaper
    busy = [_run(r, 1.0 / r) for r in REFINEMENTS]
    assert cost_at(busy, 1.5) >= busy[-1].wall_time
