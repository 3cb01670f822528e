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

"""The study of the lateral stress: what it says of three forms at a few kernel radii."""

import math

import pytest

from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification.cases.sheets import EXPERIMENTS, FORMS, RADII
from lava_ros.verification.exact import green_response

ACCURACY = Accuracy(refinement=0.3, ratio=3.5)


def run(setting, device='cpu'):
    """The run of an experiment, and the errors by wavelength over the thickness."""
    found = EXPERIMENTS[setting].run(ACCURACY, device)
    return found, {
        float(item.quantity.split()[2]): item.error for item in found.measurements
    }


def test_every_form_at_every_radius():
    """One experiment each, all of one case, told apart by their settings."""
    assert len(EXPERIMENTS) == len(FORMS) * len(RADII)
    assert {case.name for case in EXPERIMENTS.values()} == {'lateral'}
    assert 'green, l = 2 h' in EXPERIMENTS


def test_no_lateral_stress_errs_by_all_of_it():
    """The local velocity responds with 1 to every wave."""
    found, errors = run('local, l = 2 h')
    assert all(item.measured == pytest.approx(1.0) for item in found.measurements)
    for wavelength, error in errors.items():
        response = green_response(2.0 * math.pi / wavelength, 1.0)
        assert error == pytest.approx(1.0 / response - 1.0)


def test_green_function_needs_a_wide_support(device):
    """Within 1 % at a kernel radius of 3.5 thicknesses, useless at one."""
    _, wide = run('green, l = 3.5 h', device)
    _, narrow = run('green, l = 1 h', device)
    assert max(wide.values()) < 0.01
    assert narrow[4.0] > 0.3


def test_helmholtz_solve_needs_a_small_radius(device):
    """Where the Green's function is blind the solve is within 3 %."""
    _, errors = run('helmholtz, l = 1 h', device)
    assert set(errors) == {4.0, 8.0, 20.0}
    assert max(errors.values()) < 0.03


def test_waves_that_particles_cannot_show_are_left_out():
    """At l = 10 h particles are 2.9 thicknesses apart."""
    _, errors = run('local, l = 10 h')
    assert set(errors) == {20.0}


def test_a_run_is_the_time_of_its_evaluations():
    """No time passes; the dearer form takes longer for the same particles."""
    local, _ = run('local, l = 3.5 h')
    solve, _ = run('helmholtz, l = 3.5 h')
    for found in (local, solve):
        assert found.simulated_time == 0.0 and found.steps == 0
        assert found.evaluations == 15
        assert found.wall_time > 0.0
    assert local.particles == solve.particles
    assert solve.wall_time > 2.0 * local.wall_time
