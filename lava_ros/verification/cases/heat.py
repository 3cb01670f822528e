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


"""Cases of lava that gains and loses heat, and freezes.

Errors of temperatures are relative to what the lava has cooled or warmed by.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
import math
from typing import Any

import numpy as np

from lava_ros.scene import Lava, Scene, Vent
from lava_ros.simulation import Particles
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification import exact
from lava_ros.verification.cases.case import (
    Case,
    FLAT,
    GRAVITY,
    ISOTHERMAL,
    joined,
    lattice,
    layer,
    mean_difference,
    Measurement,
    NU,
    places,
    plane,
    Run,
    SLOPING,
    square,
    Trial,
)

#: Too viscous to move, and losing nothing unless a case says so.
STILL = Lava(density=2500.0, viscosity=1e15, arrhenius=0.0, emissivity=0.0, convection=0.0)

#: Temperatures of vents and of the air [K], and the thickness of sheets [m].
HOT, COLD, THICKNESS = 1423.0, 300.0, 2.0

#: Moments at which a sheet's temperature is read [h].
HOURS = (1.0, 10.0, 100.0)


#: Too stiff to flow, it cools by convection alone and freezes.
FREEZING = Lava(
    density=2600.0, viscosity=1e9, arrhenius=0.0, emissivity=0.0, convection=25.0, solidus=1300.0
)

#: Half the side of the freezing lens's terrain [m], and shares of the time until all is frozen at
#: which the frozen lava is measured.
HALF, SHARES = 90.0, (0.3, 0.6, 0.9)


def _cooling_sheet(
    accuracy: Accuracy,
    device: str,
    *,
    lava: Lava,
    solution: Callable[..., Any],
    hours: Sequence[float] = HOURS,
    is_of_loss: bool = True,
    **switched: bool,
) -> Run:
    """Compare temperatures in the middle of a sheet at rest with the solution.

    Errors are relative to the loss of temperature if ``is_of_loss``, else to the temperature.
    """
    trial = layer(
        lava,
        replace(FLAT, **switched),
        replace(accuracy, longest_step=600.0),
        device,
        thickness=THICKNESS,
        spacing=4.0,
        side=80.0,
        temperature=HOT,
    )
    temperature = solution(lava, initial=HOT, thickness=THICKNESS).temperature
    measurements = []
    for hour in hours:
        trial.advance(3600.0 * hour)
        right = temperature(3600.0 * hour)
        found = float(trial.middle('temperature', 16.0).mean())
        scale = HOT - right if is_of_loss else None
        measurements.append(
            Measurement(f'temperature after {hour:g} h', found, right, 'K', scale)
        )
    return trial.run(*measurements)


def _run_viscous(accuracy: Accuracy, device: str) -> Run:
    # a small heat capacity, to warm by degrees
    lava = replace(ISOTHERMAL, specific_heat=1.0)
    slope, thickness, duration = math.radians(10.0), 1.0, 20.0
    effects = replace(SLOPING, viscous_heating=True)
    trial = layer(
        lava, effects, accuracy, device, thickness=thickness, slope=slope, temperature=HOT
    )
    trial.advance(duration)
    warmed = float(trial.middle('temperature', 24.0).mean()) - HOT
    speed = exact.sheet_velocity(thickness * math.cos(slope), slope, NU, GRAVITY)
    rise = exact.warming_by_descent(
        speed * math.sin(slope) * duration, gravity=GRAVITY, specific_heat=lava.specific_heat
    )
    sheet = trial.run(Measurement('warming', warmed, rise, 'K'))
    return joined([sheet, _spreading(lava, accuracy, device)])


def _spreading(lava: Lava, accuracy: Accuracy, device: str) -> Run:
    """Heat of a fixed volume that spreads, beside the potential energy that it loses."""
    volume, count = 1e5, round(2000 * accuracy.refinement**2)
    solution = exact.FixedVolumeSpread(volume, lava.viscosity / lava.density, GRAVITY)
    start, end = solution.time_of_radius(100.0), solution.time_of_radius(160.0)
    trial = Trial(
        Scene(plane(square(250.0), 10.0), lava=lava),
        accuracy,
        device,
        effects=replace(FLAT, viscous_heating=True),
        particles=Particles(solution.particles(count, start), volume / count, HOT),
        spacing=math.sqrt(math.pi * 100.0**2 / count),
        thickness=volume / 3e4,
    )
    trial.advance(end - start)
    sample = trial.simulation.sample()
    rise = float((sample.volume * (sample.temperature - HOT)).sum() / volume)
    # the centre of mass of the profile is at 2 / 5 of its height
    fall = 0.4 * (solution.centre(start) - solution.centre(end))
    return trial.run(
        Measurement(
            'heat of spreading',
            rise,
            exact.warming_by_descent(fall, gravity=GRAVITY, specific_heat=lava.specific_heat),
            'K',
        ),
    )


def _run_conduction(accuracy: Accuracy, device: str) -> Run:
    # conducts so well that a front of temperature is wider than the kernel
    lava = replace(STILL, density=1000.0, specific_heat=1000.0, conductivity=1000.0)
    diffusivity, time = 1e-3, 1.6e4
    length, width = 60.0, 14.0
    # as many columns on either side of the step
    spacing = 0.5 * length / round(length * accuracy.refinement)
    position = lattice(int(length / spacing), int(width / spacing), spacing)
    first = np.where(position[:, 0] < 0.0, 1000.0, 1400.0)
    trial = Trial(
        Scene(plane((-40.0, -15.0, 40.0, 15.0), 1.0), lava=lava),
        accuracy,
        device,
        effects=replace(FLAT, conduction=True),
        particles=Particles(position, THICKNESS * spacing**2, first),
        spacing=spacing,
        thickness=THICKNESS,
    )
    trial.advance(time)
    sample = trial.simulation.sample()
    middle = (np.abs(sample.position[:, 1]) < 0.2 * width) & (
        np.abs(sample.position[:, 0]) < 0.4 * length
    )
    right = exact.temperature_step(
        sample.position[:, 0], time, low=1000.0, high=1400.0, diffusivity=diffusivity
    )
    apart = np.abs(sample.temperature - right)[middle].max()
    return trial.run(
        Measurement('profile', float(apart), 0.0, 'K', scale=400.0),
        Measurement(
            'heat',
            float(sample.volume @ sample.temperature / sample.volume.sum()),
            float(first.mean()),
            'K',
        ),
    )


def _run_current(accuracy: Accuracy, device: str) -> Run:
    # Garel et al. measured it with silicone oil; this is lava
    lava = replace(ISOTHERMAL, emissivity=0.9, convection=50.0)
    discharge = 1.0
    solution = exact.CoolingCurrent(lava, initial=HOT, ambient=COLD, discharge=discharge)
    # until the radius is four thermal radii: what is stored then grows by 2 % of the supply
    spread = exact.ConstantFluxSpread(discharge, lava.viscosity / lava.density, GRAVITY)
    side = 4.5 * solution.thermal_radius
    trial = Trial(
        Scene(
            plane(square(side), 10.0),
            vents=(Vent((0.0, 0.0), discharge, radius=5.0, temperature=HOT),),
            lava=lava,
            ambient_temperature=COLD,
        ),
        accuracy,
        device,
        effects=replace(FLAT, cooling=True),
        spacing=8.0 / accuracy.refinement,
    )
    trial.advance((4.0 * solution.thermal_radius / spread.coefficient) ** 2)
    sample = trial.simulation.sample()
    distance = np.hypot(*sample.position.T)
    measurements = []
    for share in (0.5, 1.0):
        ring = np.abs(distance / solution.thermal_radius - share) < 0.1
        measurements.append(
            Measurement(
                f'temperature at {share:g} thermal radii',
                float(sample.temperature[ring].mean()),
                float(solution.temperature(distance[ring]).mean()),
                'K',
                scale=HOT - COLD,
            )
        )
    loss = solution.flux(sample.temperature) @ (sample.volume / sample.thickness)
    return trial.run(
        *measurements,
        Measurement('power of the surface', float(loss), solution.power, 'W'),
    )


def _run_freezing(accuracy: Accuracy, device: str) -> Run:
    lens = exact.FreezingLens(FREEZING, depth=3.0, radius=60.0, first=HOT, ambient=COLD)
    spacing = 3.0 / accuracy.refinement
    terrain = plane(square(HALF), spacing)
    ticks = np.arange(-HALF, HALF, spacing) + 0.5 * spacing
    position = places(ticks, ticks)
    thickness = lens.thickness(np.hypot(*position.T))
    wet = thickness > 0.0
    trial = Trial(
        Scene(terrain, lava=FREEZING, ambient_temperature=COLD),
        accuracy,
        device,
        effects=replace(FLAT, cooling=True, solidification=True),
        particles=Particles(position[wet], thickness[wet] * spacing**2, HOT),
        spacing=spacing,
        thickness=0.5 * lens.depth,
    )

    def frozen(when: str, share: float, scale: float | None = None) -> Measurement:
        budget = trial.simulation.budget()
        return Measurement(f'frozen {when}', budget.frozen / budget.emitted, share, '', scale)

    measured = []
    for share in SHARES:
        trial.advance(share * lens.end)
        right = lens.frozen_share(share * lens.end)
        measured.append(frozen(f'after {share:g} of the time', right, scale=1.0))
    trial.advance(1.2 * lens.end)
    measured.append(frozen('in the end', 1.0))
    x0, y0 = terrain.origin
    rows, columns = terrain.shape
    x, y = np.meshgrid(
        x0 + (np.arange(columns) + 0.5) * spacing, y0 + (np.arange(rows) + 0.5) * spacing
    )
    deposit = trial.simulation.snapshot().frozen
    assert deposit is not None
    measured.append(mean_difference(deposit, lens.thickness(np.hypot(x, y)), 'deposit'))
    # all has frozen, no particle is left
    return replace(trial.run(*measured), particles=int(wet.sum()))


CASES = (
    Case(
        'radiating_sheet',
        'sheet that cools by radiation',
        'Stefan-Boltzmann law',
        partial(
            _cooling_sheet,
            lava=replace(STILL, emissivity=0.9),
            solution=partial(exact.RadiatingSheet, ambient=COLD),
            hours=(1.0, 10.0, 24.0),
            is_of_loss=False,
            cooling=True,
        ),
    ),
    Case(
        'ground',
        'sheet that warms the ground',
        'Carslaw & Jaeger 1959',
        partial(
            _cooling_sheet,
            lava=replace(STILL, ground_conductivity=2.0),
            solution=partial(exact.ColumnOnGround, ground=COLD),
            ground=True,
        ),
    ),
    Case(
        'crust',
        'sheet that cools under a crust',
        'Carslaw & Jaeger 1959',
        partial(
            _cooling_sheet,
            lava=replace(STILL, convection=50.0, conductivity=2.0, crust=True),
            solution=partial(exact.ConvectingSlab, ambient=COLD),
            crust=True,
        ),
    ),
    Case(
        'latent_heat',
        'sheet that crystallises',
        'enthalpy balance',
        partial(
            _cooling_sheet,
            # 16 kW/m2 at first: solid after two days
            lava=replace(
                STILL, convection=50.0, latent_heat=3.5e5, liquidus=1400.0, solidus=1250.0
            ),
            solution=partial(exact.CrystallisingSheet, ambient=COLD),
            cooling=True,
            latent_heat=True,
        ),
    ),
    Case('viscous_heating', 'lava that warms as it descends', 'energy balance', _run_viscous),
    Case('conduction', 'step of temperature', 'error function', _run_conduction),
    Case(
        'cooling_current',
        'steady current that cools as it spreads',
        'heat balance; Garel et al. 2012',
        _run_current,
    ),
    Case(
        'freezing_lens', 'lava at rest that freezes from its rim', 'Newton cooling', _run_freezing
    ),
)
