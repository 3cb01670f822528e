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

"""Cases: they run, they measure what they say, and their errors fall."""

import math

import pytest

from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.presets import PRESETS
from lava_ros.verification.bounds import bound, BOUNDED_PRESETS, BOUNDS
from lava_ros.verification.cases import CASES, Measurement, spread_of_fixed_volume


def test_error_is_relative_to_the_exact_value_or_the_scale():
    """A norm has the exact value 0 and a scale; what was not measured is within no bound."""
    assert Measurement('front', 99.0, 100.0, 'm').error == pytest.approx(0.01)
    assert Measurement('profile', 0.02, 0.0, 'm', scale=2.0).error == pytest.approx(0.01)
    assert not Measurement('front', math.nan, 100.0, 'm').error <= 1e9


def test_fixed_volume_spreads_as_huppert(device):
    """8k particles: radius within 0.3 %, profile within 1 %, no scatter in the centre."""
    spread = spread_of_fixed_volume(8000, accuracy=Accuracy(), device=device)
    assert spread.errors['radius'] < 0.003
    assert spread.errors['profile'] < 0.01
    assert spread.errors['scatter'] < 0.01


def test_the_papers_kernel_clumps():
    """With poly6 the same volume is visibly wrong: why Wendland C2 is the default."""
    spread = spread_of_fixed_volume(2000, accuracy=Accuracy(kernel='poly6'))
    assert spread.errors['scatter'] > 0.02
    assert spread.errors['radius'] > 0.01


@pytest.mark.parametrize(
    'name',
    # its swing is in tests/effects/test_inertia.py too, at fewer particles
    [pytest.param(name, marks=pytest.mark.nightly if name == 'thacker' else ()) for name in CASES],
)
def test_every_case_is_within_the_draft_bounds(name):
    """Every case runs at the cheapest preset, within its bounds, and reports what it did."""
    run = CASES[name].run(PRESETS['draft'].accuracy, 'cpu')
    assert run.case == name
    assert {item.quantity for item in run.measurements} == set(BOUNDS[name])
    for item in run.measurements:
        assert item.error <= bound('draft', name, item.quantity), item
    assert run.particles > 0
    assert run.evaluations >= run.steps
    assert run.simulated_time >= 0.0 and run.wall_time >= 0.0


@pytest.mark.parametrize('name', ['fixed_volume', 'plane_fixed_area', 'dam_break'])
def test_errors_fall_with_the_spacing(name):
    """A quarter of the particles makes the largest error of a case larger."""
    coarse, fine = (
        max(
            item.error
            for item in CASES[name].run(Accuracy(refinement=refinement), 'cpu').measurements
        )
        for refinement in (0.35, 0.7)
    )
    assert fine < 0.8 * coarse


def test_bounds_are_there_for_every_preset_and_get_no_wider():
    """Every quantity has a bound at every preset that has any, never wider at a dearer one."""
    assert set(BOUNDS) == set(CASES)
    assert set(BOUNDED_PRESETS) <= set(PRESETS)
    for case, quantities in BOUNDS.items():
        for quantity in quantities:
            limits = [bound(preset, case, quantity) for preset in BOUNDED_PRESETS]
            assert all(limit > 0.0 for limit in limits)
            assert limits == sorted(limits, reverse=True)
