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

"""Spreading of a fixed volume against Huppert (1982)."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from lava_ros.accuracy import Accuracy
from lava_ros.verification.cases import spread_of_fixed_volume
from lava_ros.verification.exact import FixedVolumeSpread


def test_huppert_coefficients_are_the_published_ones():
    """R = 0.894 (g V^3 t / 3 nu)^(1/8) and h0 = 0.531 (3 nu V / (g t))^(1/4)."""
    assert FixedVolumeSpread.RADIUS == pytest.approx(0.89391, abs=1e-5)
    assert FixedVolumeSpread.HEIGHT == pytest.approx(0.53113, abs=1e-5)


def test_huppert_solution_satisfies_its_equation():
    """The profile holds the volume, and obeys h_t = (g / 3 nu) (1/r) d/dr (r h^3 dh/dr)."""
    exact = FixedVolumeSpread(1e5, 4.0, 9.81)
    time = 1e4
    volume = quad(lambda r: 2 * math.pi * r * exact.thickness(r, time), 0, exact.radius(time))[0]
    assert volume == pytest.approx(1e5, rel=1e-5)

    def flux(r):
        step = 1e-2
        slope = (exact.thickness(r + step, time) - exact.thickness(r - step, time)) / (2 * step)
        return r * exact.thickness(r, time) ** 3 * slope

    r = 0.5 * exact.radius(time)
    spread = 9.81 / (3 * 4.0) * (flux(r + 1.0) - flux(r - 1.0)) / (2.0 * r)
    rate = (exact.thickness(r, time + 1.0) - exact.thickness(r, time - 1.0)) / 2.0
    assert spread == pytest.approx(rate, rel=1e-3)


def test_particles_of_the_profile_have_its_moments():
    """The particles given for a time have its root mean square radius and no centre offset."""
    exact = FixedVolumeSpread(1e5, 4.0, 9.81)
    places = exact.particles(8000, 1e4)
    assert np.hypot(*places.T).max() < exact.radius(1e4)
    assert math.sqrt((places**2).sum(axis=1).mean()) == pytest.approx(
        exact.rms_radius(1e4), rel=1e-4
    )
    assert np.abs(places.mean(axis=0)).max() < 1e-3 * exact.radius(1e4)


def test_fixed_volume_spreads_as_huppert(device):
    """8k particles: radius within 0.5 %, profile within 1 %, no scatter in the centre."""
    spread = spread_of_fixed_volume(8000, accuracy=Accuracy(diffusion_number=1.5), device=device)
    assert spread.radius.error < 0.005
    assert spread.profile_error < 0.01
    assert spread.scatter < 0.01


def test_the_papers_kernel_clumps():
    """With poly6 the same volume is visibly wrong: why Wendland C2 is the default."""
    spread = spread_of_fixed_volume(2000, accuracy=Accuracy(kernel='poly6'))
    assert spread.scatter > 0.02
    assert spread.radius.error > 0.01
