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

"""Cooling of a surface that a crust covers in part, against the equation of a column."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lava_ros.effects.laws import heat_loss, STEFAN_BOLTZMANN
from lava_ros.errors import LavaError
from lava_ros.scene import Lava, Scene
from lava_ros.simulation import Particles
from lava_ros.verification.cases.case import plane
from solver import lattice, only, simulated

COVER = only('cover')

LAVA = Lava(
    viscosity=1e15,
    emissivity=0.95,
    convection=9.0,
    crust_cover=0.9,
    crust_cover_decay=0.16,
    crust_temperature=773.15,
)


def column(lava, initial, time, *, thickness=2.0, ambient=300.0, speed=0.0):
    """Temperature of a column after a time, by a solver of ordinary equations."""
    capacity = lava.density * lava.specific_heat * thickness
    share = lava.crust_cover * np.exp(-lava.crust_cover_decay * speed)

    def flux(surface):
        radiation = lava.emissivity * STEFAN_BOLTZMANN * (surface**4 - ambient**4)
        return radiation + lava.convection * (surface - ambient)

    def rate(_, temperature):
        crust = np.minimum(max(lava.crust_temperature, ambient), temperature)
        return -(share * flux(crust) + (1.0 - share) * flux(temperature)) / capacity

    return solve_ivp(rate, (0.0, time), [initial], rtol=1e-8, atol=1e-6).y[0, -1]


@pytest.mark.parametrize('precision, off', [('float64', 0.02), ('float32', 0.1)])
def test_columns_at_rest_cool_as_the_equation_says(device, still_columns, precision, off):
    """Hotter than the crust, as cold, colder, as the air and colder than the air."""
    temperatures = [1423.0, 900.0, 773.15, 500.0, 300.0, 280.0]
    for hours, samples in zip(
        (1.0, 10.0, 100.0),
        still_columns(
            LAVA, COVER, temperatures, [3600.0, 36000.0, 3.6e5], precision=precision,
            device=device,
        ),
        strict=True,
    ):
        found, thickness = samples
        exact = [
            column(LAVA, initial, 3600.0 * hours, thickness=thickness[0])
            for initial in temperatures
        ]
        assert found == pytest.approx(exact, abs=off)


def test_fast_lava_bares_its_core(device):
    """A sheet that slides at some metres a second loses what its speed says."""
    lava = replace(LAVA, viscosity=3e3, crust_cover_decay=0.5)
    simulation = simulated(
        plane((-100.0, -100.0, 100.0, 100.0), 5.0, 0.3),
        lava,
        Particles(lattice(30.0, 2.0), 8.0, 1423.0),
        effects=COVER,
        device=device,
        spacing=2.0,
        thickness=2.0,
        precision='float64',
    )
    start = simulation.sample()
    time = 1.0
    simulation.advance(time)
    end = simulation.sample()
    inside = np.hypot(*start.position.T) < 10.0
    way = np.hypot(*(end.position - start.position)[inside].T)
    speed, thickness = way.mean() / time, float(end.thickness[inside].mean())
    assert speed > 2.0
    fast, slow = (
        1423.0 - column(lava, 1423.0, time, thickness=thickness, speed=u) for u in (speed, 0.0)
    )
    lost = 1423.0 - end.temperature[inside].mean()
    assert lost == pytest.approx(fast, rel=0.005)
    assert lost > 1.5 * slow


@pytest.mark.parametrize(
    ('share', 'others'), [(0.0, only('cooling')), (0.9, only('cooling', 'cover'))]
)
def test_cover_takes_the_place_of_cooling(still_columns, share, others):
    """A share of 0 loses what bare ground loses, and beside it the loss is not counted twice."""
    lava = replace(LAVA, crust_cover=share)
    one, two = (
        still_columns(lava, effects, [1423.0], [3600.0])[0][0][0] for effects in (COVER, others)
    )
    assert one == pytest.approx(two, abs=1e-9)


def test_host_and_device_agree(still_columns):
    """``heat_loss`` is what a column at rest loses."""
    (temperature, thickness), = still_columns(LAVA, COVER, [1423.0], [1.0], longest_step=1.0)
    capacity = LAVA.density * LAVA.specific_heat * thickness[0]
    lost = (1423.0 - temperature[0]) * capacity
    scene = Scene(plane((0.0, 0.0, 40.0, 40.0), 10.0, 0.0), lava=LAVA)
    assert lost == pytest.approx(heat_loss(scene)(1423.0), rel=1e-3)


def test_two_crusts_are_refused():
    """A crust that covers a part does not go with one that covers all."""
    with pytest.raises(LavaError, match=r'crust_cover.*0\.9.*0 beside lava\.crust'):
        Lava(crust=True, conductivity=2.0, crust_cover=0.9)
