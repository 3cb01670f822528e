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

"""Cases of layers of even thickness: speed on a slope, lateral stress, heat."""

from dataclasses import replace
import math

import numpy as np

from lava_ros.effects import Effects
from lava_ros.scene import Lava, Scene
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
    Measurement,
    NU,
    plane,
    Run,
    SLOPING,
    square,
    Trial,
)

#: Angles of the slopes [degrees].
SLOPES = (3.0, 10.0, 25.0)

#: Wavelengths of the driving term over the thickness.
WAVELENGTHS = (4.0, 8.0, 20.0)

#: Moments at which the sheet's temperature is read [s].
HOURS = (1.0, 10.0, 24.0)


def _sheet_trial(slope: float, accuracy: Accuracy, device: str) -> tuple[Trial, Measurement]:
    spacing, thickness, side, duration = 2.0 / accuracy.refinement, 1.0, 120.0, 4.0
    trial = Trial(
        Scene(plane(square(2.0 * side), 5.0, slope), lava=ISOTHERMAL),
        effects=SLOPING,
        accuracy=replace(accuracy, spacing=spacing, thickness=thickness),
        particles=Particles(lattice(side, side, spacing), thickness * spacing**2, 1400.0),
        device=device,
    )
    speeds = []
    for time in (0.0, duration):
        trial.advance(time)
        sample = trial.simulation.sample()
        middle = np.abs(sample.position).max(axis=1) < 0.2 * side
        speeds.append(sample.velocity[middle, 0].mean())
    return trial, Measurement(
        f'speed at {math.degrees(slope):g} degrees',
        float(np.mean(speeds)) / math.cos(slope),
        exact.sheet_velocity(thickness * math.cos(slope), slope, NU, GRAVITY),
        'm/s',
    )


def sheet_on_slope(slope: float, *, accuracy: Accuracy, device: str = 'cpu') -> Measurement:
    """Speed along the slope of the middle of a uniform sheet, over its first seconds [m/s].

    Args:
        slope: Angle of the slope [rad].
        accuracy: Resolution; its spacing and thickness are set by the case.
        device: Warp device.
    """
    return _sheet_trial(slope, accuracy, device)[1]


def _run_sheet(accuracy: Accuracy, device: str) -> Run:
    runs = []
    for degrees in SLOPES:
        trial, measurement = _sheet_trial(math.radians(degrees), accuracy, device)
        runs.append(trial.run('sheet', measurement))
    return joined('sheet', runs)


def _green_trials(
    wavelength: float, support: float, accuracy: Accuracy, device: str
) -> tuple[list[Trial], Measurement]:
    thickness = 1.0
    radius = support * thickness / math.sqrt(3.0)
    spacing = radius / accuracy.ratio
    side = 2.0 * wavelength + 4.0 * radius
    q = 2.0 * math.pi / wavelength
    terrain = plane(square(0.6 * side), min(spacing, wavelength / 40.0))
    x = terrain.origin[0] + (np.arange(terrain.shape[1]) + 0.5) * terrain.resolution
    wavy = replace(terrain, elevation=np.tile(0.01 * np.sin(q * x), (terrain.shape[0], 1)))
    trials, speeds = [], []
    for green in (True, False):
        trial = Trial(
            Scene(wavy, lava=ISOTHERMAL),
            effects=replace(FLAT, green=green),
            accuracy=replace(accuracy, spacing=spacing, thickness=thickness),
            particles=Particles(lattice(side, side, spacing), thickness * spacing**2, 1400.0),
            device=device,
        )
        trials.append(trial)
        sample = trial.simulation.sample()
        inside = (np.abs(sample.position[:, 0]) <= wavelength) & (
            np.abs(sample.position[:, 1]) < 0.5 * side - 2.0 * radius
        )
        wave = np.cos(q * sample.position[inside, 0])
        speeds.append(float(sample.velocity[inside, 0] @ wave / (wave @ wave)))
    return trials, Measurement(
        f'response at {wavelength:g} h',
        speeds[0] / speeds[1],
        exact.green_response(q, thickness),
        '1',
    )


def green_response(
    wavelength: float, *, support: float, accuracy: Accuracy, device: str = 'cpu'
) -> Measurement:
    """Amplitude of the Green velocity over the local one on a terrain A sin(q x).

    Args:
        wavelength: 2 pi / q [m], for a layer 1 m thick.
        support: Radius at which the Green's function is cut off, in units of 1 / k.
        accuracy: Resolution; its spacing and thickness are set by the case.
        device: Warp device.
    """
    return _green_trials(wavelength, support, accuracy, device)[1]


def _run_green(accuracy: Accuracy, device: str) -> Run:
    # the support is the kernel's radius: with it given, finer is more neighbours
    ratio = min(12.0, max(1.5, accuracy.ratio * accuracy.refinement))
    runs = []
    for wavelength in WAVELENGTHS:
        trials, measurement = _green_trials(
            wavelength, 6.0, replace(accuracy, ratio=ratio), device
        )
        runs.append(trials[0].run('green', measurement))
    return joined('green', runs)


def _run_radiating(accuracy: Accuracy, device: str) -> Run:
    # too viscous to move
    lava = Lava(
        density=2500.0,
        viscosity=1e15,
        arrhenius=0.0,
        specific_heat=1150.0,
        emissivity=0.9,
        convection=0.0,
    )
    spacing, thickness = 4.0 / accuracy.refinement, 2.0
    side = max(80.0, 8.0 * spacing)
    solution = exact.RadiatingSheet(
        initial=1423.0,
        ambient=300.0,
        emissivity=lava.emissivity,
        density=lava.density,
        specific_heat=lava.specific_heat,
        thickness=thickness,
    )
    trial = Trial(
        Scene(plane(square(side), 10.0), lava=lava),
        effects=Effects(arrhenius=False, cooling=True, steep=False),
        accuracy=replace(accuracy, spacing=spacing, thickness=thickness),
        particles=Particles(lattice(side, side, spacing), thickness * spacing**2, 1423.0),
        device=device,
    )
    measurements = []
    for hours in HOURS:
        trial.advance(3600.0 * hours)
        sample = trial.simulation.sample()
        middle = np.abs(sample.position).max(axis=1) < 0.2 * side
        measurements.append(
            Measurement(
                f'temperature after {hours:g} h',
                float(sample.temperature[middle].mean()),
                solution.temperature(3600.0 * hours),
                'K',
            )
        )
    return trial.run('radiating_sheet', *measurements)


CASES = (
    Case('sheet', 'uniform sheet on slopes', 'Nusselt 1916; Jeffreys 1925', _run_sheet),
    Case('green', 'lateral stress under a driving term sin(q x)', 'Kedadry 2023', _run_green),
    Case(
        'radiating_sheet', 'sheet that cools by radiation', 'Stefan-Boltzmann law', _run_radiating
    ),
)
