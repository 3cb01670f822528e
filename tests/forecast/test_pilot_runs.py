# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Pilot runs: their timing, and the cost and error that they predict for finer runs."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from lava_ros.effects import Effects
from lava_ros.forecast import pilot_runs as pilots
from lava_ros.forecast.pilot_runs import (
    completed,
    cost_at,
    error_law,
    MIN_RELATIVE_ERROR,
    N_COMPARISON_TIMES,
    Pilot,
)
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation.resolution import EDGES
from lava_ros.simulation.setup.course import course_of

SCENE = Scene(Terrain(np.zeros((40, 40)), 10.0), (Vent((200.0, 200.0), 20.0),), lava=Lava())


def test_refinements_between_presets_have_their_accuracy():
    scene = replace(SCENE, lava=Lava(viscosity=1e4))
    thickness = course_of(scene, horizon=3600.0).thickness
    for refinement, name in ((0.3, 'draft'), (1.0, 'standard'), (1.3, 'standard'), (2.5, 'fine')):
        accuracy = pilots.accuracy_at(scene, refinement, 3600.0)
        assert accuracy.spacing == pytest.approx(EDGES * thickness / refinement, rel=5e-3)
        expected = replace(pilots.PRESETS[name].accuracy, spacing=accuracy.spacing)
        assert accuracy == expected


def test_pilot_is_timed_and_stopped_by_the_given_clock():
    scene = replace(SCENE, lava=Lava(viscosity=1e6))
    full, stopped = (
        pilots.run_at(
            scene, 0.5, 3600.0, device='cpu', wall_limit=limit, clock=iter(range(10**6)).__next__
        )
        for limit in (1e6, 10.0)
    )
    assert full.is_done and full.setup == 1.0
    # a tick for each part, before each look, and before and after all of them
    assert full.wall_time == full.progress[-1, 2] + N_COMPARISON_TIMES + 2.0
    assert full.spent == full.wall_time + N_COMPARISON_TIMES - 1
    assert not stopped.is_done and stopped.progress[-1, 2] == 11.0
    assert 0.0 < stopped.progress[-1, 0] < 1.0 == full.progress[-1, 0]
    assert (np.diff(full.progress, axis=0) >= 0.0).all()
    assert stopped.progress[-1, 3] < full.progress[-1, 3]
    assert stopped.evaluations < full.evaluations


def test_pilot_has_the_given_effects(device):
    scene = replace(SCENE, lava=Lava(viscosity=1e6))
    run = partial(pilots.run_at, scene, 0.5, 60.0, device=device, wall_limit=600.0)
    own = run().effects
    other = replace(own, green=not own.green, helmholtz=False)
    assert run(effects=other).effects == other != own
    assert run(effects={'green': other.green, 'helmholtz': False}).effects == other
    stopped = pilots.run_at(scene, 0.5, 1e9, device=device, wall_limit=1e-3)
    assert not stopped.is_done and stopped.progress[-1, 0] < 1.0


EFFECTS = Effects()
NOWHERE = np.zeros((1, 1), dtype=bool)
REFINEMENTS = (0.2, 0.28, 0.4, 0.56)


def _run(refinement, time, evaluations=1000, effects=EFFECTS, covered=NOWHERE, setup=0.0):
    progress = np.array([[0.0] * 4, [1.0, time - setup, evaluations, 100.0]])
    return Pilot(
        refinement, time, evaluations, effects, np.stack([covered] * N_COMPARISON_TIMES), time,
        setup, progress,
    )


@pytest.mark.parametrize('growth', [0.0, 0.5, 1.5])
@pytest.mark.parametrize(('each', 'particles'), [(1e-3, 0.0), (1e-4, 2e-3), (0.0, 1e-3)])
def test_cost_law_is_recovered_from_runs_that_follow_it(growth, each, particles):
    def time(refinement):
        return 0.1 + 1000.0 * refinement**growth * (each + particles * refinement**2)

    pilots = [
        _run(refinement, time(refinement), 1000.0 * refinement**growth, setup=0.1)
        for refinement in REFINEMENTS
    ]
    assert cost_at(pilots, 1.0) == pytest.approx(time(1.0))
    assert cost_at(pilots, 0.28) == pytest.approx(time(0.28))
    assert cost_at(pilots, 0.3) == pytest.approx(time(0.3), rel=0.03)


def test_cost_with_a_solve_grows_as_the_third_power():
    solving = [_run(r, 1.0 + 8.0 * r**3, effects=Effects(helmholtz=True)) for r in REFINEMENTS]
    assert cost_at(solving, 1.0) == pytest.approx(9.0)
    # a busy machine does not make finer runs cheaper
    busy = [_run(r, 1.0 / r) for r in REFINEMENTS]
    assert cost_at(busy, 1.5) >= busy[-1].wall_time


def _grown(refinement, constant, effects=EFFECTS, until=1.0):
    """Make a run whose evaluations grow as a power of time, and its particles unsteadily."""
    fraction = np.linspace(0.0, 1.0, 201)
    evaluations = 1000.0 * refinement * fraction**1.3
    particles = 5000.0 * refinement**2 * fraction**0.8
    middle = 0.5 * (particles[1:] + particles[:-1])
    each = constant + 1e-6 * middle ** (1.5 if effects.helmholtz else 1.0)
    times = np.concatenate([[0.0], np.cumsum(np.diff(evaluations) * each)])
    progress = np.stack([fraction, times, evaluations, particles], axis=1)[fraction <= until]
    _, time, count, _ = progress[-1]
    covered = np.zeros((int(N_COMPARISON_TIMES * until), 1, 1), dtype=bool)
    return Pilot(refinement, time + 0.1, count, effects, covered, time + 0.1, 0.1, progress)


@pytest.mark.parametrize('constant', [0.0, 1e-3])
@pytest.mark.parametrize('effects', [EFFECTS, Effects(helmholtz=True)])
def test_stopped_run_is_completed_by_a_coarser_one(constant, effects):
    whole = _grown(1.0, constant, effects)
    alone = cost_at([_grown(0.5, constant, effects)], 1.0)
    assert alone == pytest.approx(whole.wall_time, rel=0.05)
    stopped = _grown(1.0, constant, effects, until=0.3)
    assert stopped.wall_time < 0.25 * whole.wall_time
    for model in (_grown(0.5, constant, effects), _grown(0.5, 1e-2, Effects(green=True))):
        found = completed(stopped, model)
        assert found.wall_time == pytest.approx(whole.wall_time, rel=0.03)
        assert found.evaluations == pytest.approx(whole.evaluations, rel=0.01)
        assert found.spent == stopped.spent and not found.is_done


@pytest.mark.parametrize('order', [0.8, 1.0, 1.3])
@pytest.mark.parametrize('scatter', [0.0, 0.5, 2.0])
def test_error_law_of_biased_and_scattered_edges(order, scatter):
    random = np.random.default_rng(3)
    place = np.arange(4000.0)

    def run(refinement):
        # the ends of 400 rows
        size = 60.0 * refinement**-order
        ends = 2000.0 + size * (1.0 + scatter * random.standard_normal(400))
        return _run(refinement, 1.0, covered=place < ends[:, None])

    law = error_law([run(refinement) for refinement in REFINEMENTS])
    truth = np.broadcast_to(place < 2000.0, (400, 4000))
    found = run(1.0).covered[-1]
    error = np.count_nonzero(found ^ truth) / np.count_nonzero(found | truth)
    assert error / 2.0 < law(1.0) < 2.0 * error


def test_stopped_run_predicts_the_error_at_the_horizon():
    place = np.arange(20_000.0)

    def run(refinement, marks=N_COMPARISON_TIMES):
        # an edge whose error grows by a power that the coarse runs alone do not show
        fraction = np.arange(1, marks + 1)[:, None, None] / N_COMPARISON_TIMES
        ends = 10_000.0 * fraction**0.5 * (1.0 + 0.04 * fraction / refinement**1.5)
        return replace(_run(refinement, 1.0), covered=place < ends)

    full = error_law([run(0.2), run(0.28), run(0.6)])
    stopped = error_law([run(0.2), run(0.28), run(0.6, marks=3)])
    coarse = error_law([run(0.2), run(0.28)])
    for refinement in (0.6, 0.9):
        error = 0.04 * refinement**-1.5
        assert stopped(refinement) == pytest.approx(full(refinement), rel=0.15)
        assert 0.5 < stopped(refinement) / error < 2.0
        assert coarse(refinement) != pytest.approx(full(refinement), rel=0.15)


def test_error_of_equal_runs_has_a_floor():
    covered = np.arange(1_000_000)[None] < 500_000
    law = error_law([_run(refinement, 1.0, covered=covered) for refinement in REFINEMENTS])
    assert law(2.0) == MIN_RELATIVE_ERROR
    apart = [_run(0.2, 1.0, covered=~covered), _run(0.28, 1.0, covered=covered)]
    assert error_law(apart)(0.2) == 1.0
