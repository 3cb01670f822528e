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

"""What coarse runs say about finer ones, of runs whose laws are known."""

import numpy as np
import pytest

from lava_ros.effects import Effects
from lava_ros.forecast.extrapolation import cost_at, error_law, FLOOR, Pilot

EFFECTS = Effects()

NOWHERE = np.zeros(1, dtype=bool)

REFINEMENTS = (0.2, 0.28, 0.4, 0.56)


def _run(refinement, time, evaluations=1000, effects=EFFECTS, covered=NOWHERE, setup=0.0):
    return Pilot(refinement, time, evaluations, 100, effects, covered, setup)


@pytest.mark.parametrize('growth', [0.0, 0.5, 1.5])
@pytest.mark.parametrize(('each', 'particles'), [(1e-3, 0.0), (1e-4, 2e-3), (0.0, 1e-3)])
def test_cost_of_runs_that_follow_the_law(growth, each, particles):
    """Setup, the power of the evaluations and both parts of each are found."""

    def time(refinement):
        return 0.1 + 1000.0 * refinement**growth * (each + particles * refinement**2)

    pilots = [
        _run(refinement, time(refinement), 1000.0 * refinement**growth, setup=0.1)
        for refinement in REFINEMENTS
    ]
    assert cost_at(pilots, 1.0) == pytest.approx(time(1.0))
    assert cost_at(pilots, 0.3) == pytest.approx(time(0.3))


def test_the_solve_takes_more_iterations_in_finer_runs():
    """With it an evaluation goes as the third power."""
    effects = Effects(helmholtz=True)
    pilots = [_run(r, 1.0 + 8.0 * r**3, effects=effects) for r in REFINEMENTS]
    assert cost_at(pilots, 1.0) == pytest.approx(9.0)


def test_times_that_fall_do_not_make_finer_runs_cheaper():
    """A machine that was busy during the first pilots."""
    pilots = [_run(r, 1.0 / r) for r in REFINEMENTS]
    assert cost_at(pilots, 1.5) >= pilots[-1].wall_time


def test_other_physics_say_nothing():
    """Of a single run with its own all of the time is that of the particles."""
    pilots = [_run(0.2, 100.0), _run(0.4, 1.0, effects=Effects(helmholtz=True))]
    assert cost_at(pilots, 0.8) == pytest.approx(2.0**4)
    pilots = [_run(0.2, 100.0, effects=Effects(helmholtz=True)), _run(0.4, 1.0)]
    assert cost_at(pilots, 0.8) == pytest.approx(2.0**3)


@pytest.mark.parametrize('order', [0.8, 1.0, 1.3])
@pytest.mark.parametrize('scatter', [0.0, 0.5, 2.0])
def test_error_of_edges_that_are_off_by_bias_and_by_chance(order, scatter):
    """Within a factor of 2 of the error of a finer run, whatever of the two prevails."""
    random = np.random.default_rng(3)
    place = np.arange(4000.0)

    def run(refinement):
        # the ends of 400 rows
        size = 60.0 * refinement**-order
        ends = 2000.0 + size * (1.0 + scatter * random.standard_normal(400))
        return _run(refinement, 1.0, covered=place < ends[:, None])

    law = error_law([run(refinement) for refinement in REFINEMENTS])
    truth = np.broadcast_to(place < 2000.0, (400, 4000))
    found = run(1.0).covered
    error = np.count_nonzero(found ^ truth) / np.count_nonzero(found | truth)
    assert error / 2.0 < law.at(1.0) < 2.0 * error


def test_runs_that_agree_are_not_without_error():
    """What no refinement has taken away so far is left; nothing is wrong by more than all."""
    covered = np.arange(1_000_000) < 500_000
    law = error_law([_run(refinement, 1.0, covered=covered) for refinement in REFINEMENTS])
    assert law.at(2.0) == FLOOR
    apart = [_run(0.2, 1.0, covered=~covered), _run(0.28, 1.0, covered=covered)]
    assert error_law(apart).at(0.2) == 1.0
