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

"""Exact solutions of lava that is not Newtonian: integrals, balances and limits."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from lava_ros.verification import exact

WEIGHT = 2600.0 * 9.81


@pytest.mark.parametrize('index', [0.5, 1.0, 2.0])
@pytest.mark.parametrize('strength', [0.0, 900.0])
def test_sheet_is_the_integral_of_its_strain_rate(index, strength):
    """The mean of the velocity that ((tau - tau_y) / K)^(1/n) makes, from no slip below."""
    thickness, slope, consistency = 1.4, 0.2, 3e3
    pull = WEIGHT * math.sin(slope)

    def strain_rate(z):
        return (max(pull * (thickness - z) - strength, 0.0) / consistency) ** (1.0 / index)

    # what is sheared at z carries all that is above
    sheared = thickness - strength / pull
    flux = quad(lambda z: strain_rate(z) * (thickness - z), 0.0, sheared)[0]
    found = exact.herschel_bulkley_velocity(
        thickness,
        slope,
        density=2600.0,
        consistency=consistency,
        strength=strength,
        index=index,
        gravity=9.81,
    )
    assert found == pytest.approx(flux / thickness, rel=1e-9)


def test_sheet_has_the_newtonian_limit_and_rests_below_the_critical_thickness():
    """With n = 1, no strength: rho g h^2 sin(b) / (3 mu); with strength, thin, it rests."""
    newtonian = exact.sheet_velocity(1.4, 0.2, 3e3 / 2600.0, 9.81)
    options = {'density': 2600.0, 'consistency': 3e3, 'index': 1.0, 'gravity': 9.81}
    found = exact.herschel_bulkley_velocity(1.4, 0.2, strength=0.0, **options)
    assert found == pytest.approx(newtonian)
    critical = exact.critical_thickness(900.0, 0.2, density=2600.0, gravity=9.81)
    speeds = [
        exact.herschel_bulkley_velocity(share * critical, 0.2, strength=900.0, **options)
        for share in (0.999, 1.001)
    ]
    assert speeds[0] == 0.0 < speeds[1]


def test_dome_holds_its_volume_at_the_yield_stress():
    """The profile's volume and mean square radius by quadrature, and rho g h |dh/dr| = tau_y."""
    dome = exact.BinghamDome(1.5e5, 1e4, 2600.0, 9.81)
    volume = quad(lambda r: 2 * math.pi * r * dome.thickness(r), 0, dome.radius)[0]
    moment = quad(lambda r: 2 * math.pi * r**3 * dome.thickness(r), 0, dome.radius)[0]
    assert volume == pytest.approx(1.5e5, rel=1e-6)
    assert dome.rms_radius == pytest.approx(math.sqrt(moment / volume), rel=1e-6)
    r = np.array([10.0, 50.0, 90.0])
    slope = (dome.thickness(r - 1e-4) - dome.thickness(r + 1e-4)) / 2e-4
    assert WEIGHT * dome.thickness(r) * slope == pytest.approx(1e4, rel=1e-6)
    assert dome.thickness(dome.radius_of_thickness(2.0)) == pytest.approx(2.0)
    places = dome.particles(2000, dome.radius)
    assert np.sqrt((places**2).sum(axis=1).mean()) == pytest.approx(dome.rms_radius, rel=1e-4)


def test_ridge_is_at_the_yield_stress_everywhere():
    """Its section by quadrature, and the stress's two parts at several places."""
    slope, strength = math.radians(20.0), 5e3
    ridge = exact.Ridge(0.9, strength, slope, WEIGHT)
    section = 2.0 * quad(ridge.thickness, 0, ridge.half_width)[0]
    assert section == pytest.approx(ridge.section, rel=1e-6)
    assert ridge.thickness(np.array(0.0)) == pytest.approx(0.9 * ridge.critical)
    y = np.linspace(0.05, 0.95, 7) * ridge.half_width
    d = ridge.thickness(y)
    rise = (ridge.thickness(y + 1e-6) - ridge.thickness(y - 1e-6)) / 2e-6
    stress = WEIGHT * d * np.hypot(math.sin(slope), math.cos(slope) * rise)
    assert stress == pytest.approx(strength, rel=1e-5)
    assert ridge.thickness(ridge.distance_of_thickness(0.1)) == pytest.approx(0.1)


def test_levee_is_twice_as_wide_as_hulme_has_it():
    """A full ridge's edge is tau_y cos(b) / (rho g sin(b)^2), Hulme's tau_y / (2 rho g sin(b)^2).

    Hulme's parabola is the edge where it is thin.
    """
    slope, strength = math.radians(5.0), 5e3
    ridge = exact.Ridge(1.0, strength, slope, WEIGHT)
    hulme = strength / (2.0 * WEIGHT * math.sin(slope) ** 2)
    assert ridge.half_width == pytest.approx(2.0 * math.cos(slope) * hulme)
    near = 1e-3 * ridge.half_width
    parabola = math.sqrt(2.0 * strength * near / (WEIGHT * math.cos(slope)))
    edge = ridge.thickness(np.array(ridge.half_width - near))
    assert edge == pytest.approx(parabola, rel=1e-3)


def test_viscosity_laws_are_the_printed_ones():
    """VFT by its own numbers; crystals at half of the packing by 2^e."""
    assert exact.vft_viscosity(1000.0, -4.5, 6000.0, 400.0) == pytest.approx(10.0**5.5)
    assert exact.crystal_factor(0.3, 0.6, 2.0) == pytest.approx(4.0)
    assert exact.crystal_factor(0.3, 0.6, 2.5) == pytest.approx(2.0**2.5)
