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

"""What the forms of the lateral viscous stress cost, and how close to its response they come.

A wave sin(q x) of the driving term comes out multiplied by 1 / (1 + q^2 h^2 / 3). Three forms of
one velocity, on an even layer, for kernel radii l of 0.3 to 10 thicknesses:

* ``local``: no lateral stress. It responds with 1: its error is the effect itself.
* ``green``: the Green's function, cut off at the kernel radius.
* ``helmholtz``: the solve that it approximates.

The kernel radius sets the distance of particles, by its ratio to it. At the smallest l a particle
is a column an eleventh as wide as it is thick, at the largest three times as wide as thick. Waves
shorter than four distances are left out: no form could show them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
import math
from statistics import median
import time as wall_clock

import numpy as np
import warp as wp

from lava_ros.scene import Scene, Terrain
from lava_ros.simulation import Particles, Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification import exact
from lava_ros.verification.cases import Case, Measurement, Run
from lava_ros.verification.cases.case import FLAT, ISOTHERMAL, joined, plane

#: The name of every experiment's case.
NAME = 'lateral'

FORMS = ('local', 'green', 'helmholtz')

#: Kernel radii over the thickness.
RADII = (0.3, 0.6, 1.0, 2.0, 3.5, 6.0, 10.0)

#: Wavelengths of the driving term over the thickness.
WAVELENGTHS = (4.0, 8.0, 20.0)

#: Distances of particles that a wave needs to be resolved.
RESOLVED = 4.0

#: Particles at a refinement of 1; at least as many are taken as keep the borders at a distance.
PARTICLES = 10_000

#: How far from where it is measured the layer goes on, beside a kernel radius, over the
#: thickness: five times the reach 1 / k of the lateral stress.
MARGIN = 3.0

#: Timed evaluations of a velocity.
EVALUATIONS = 5

#: Amplitude of the driving terrain over the thickness.
AMPLITUDE = 0.01


@dataclass(frozen=True)
class Experiment:
    """A form of the lateral stress at a kernel radius.

    Attributes:
        setting: Which, in words: ``green, l = 2 h``.
        case: Measures it. Its accuracy gives the ratio and, by the refinement, how many particles
            there are. Time does not pass: the run's wall time is that of so many velocity
            evaluations, neighbours included, as it counts.
    """

    setting: str
    case: Case


def lateral_experiments() -> list[Experiment]:
    """Every form at every kernel radius, from the smallest."""
    return [
        Experiment(
            f'{form}, l = {radius:g} h',
            Case(
                NAME,
                'lateral stress under a driving term sin(q x)',
                'Kedadry 2023',
                partial(_run, form, radius),
            ),
        )
        for radius in RADII
        for form in FORMS
    ]


def _run(form: str, radius: float, accuracy: Accuracy, device: str) -> Run:
    spacing = radius / accuracy.ratio
    return joined(
        NAME,
        [
            _respond(form, radius, wavelength, accuracy, device)
            for wavelength in WAVELENGTHS
            if wavelength >= RESOLVED * spacing
        ],
    )


def _respond(form: str, radius: float, wavelength: float, accuracy: Accuracy, device: str) -> Run:
    """Response to a wave: amplitude of the velocity over the local one's, on a layer of 1 m."""
    spacing = radius / accuracy.ratio
    q = 2.0 * math.pi / wavelength
    # one wave, or as much of it beside a node of the terrain as there is room for
    half = min(0.5 * wavelength, max(2.5, RESOLVED * spacing))
    margin = radius + MARGIN
    columns = 2 * math.ceil((half + margin) / spacing)
    least = 2 * math.ceil((spacing + margin) / spacing)
    rows = max(least, round(PARTICLES * accuracy.refinement**2 / columns))
    sides = (columns * spacing, rows * spacing)
    ticks = [(np.arange(number) - 0.5 * (number - 1)) * spacing for number in (columns, rows)]
    places = np.stack(np.meshgrid(*ticks), axis=-1).reshape(-1, 2)
    simulations = [
        Simulation(
            Scene(_waves(sides, q, spacing), lava=ISOTHERMAL),
            effects=replace(FLAT, **({} if name == 'local' else {name: True})),
            accuracy=replace(accuracy, spacing=spacing, thickness=1.0),
            particles=Particles(places, spacing**2, 1400.0),
            device=device,
        )
        for name in (form, 'local')
    ]
    amplitudes = []
    for simulation in simulations:
        sample = simulation.sample()
        inside = (np.abs(sample.position[:, 0]) <= half) & (
            np.abs(sample.position[:, 1]) <= 0.5 * sides[1] - margin
        )
        wave = np.cos(q * sample.position[inside, 0])
        amplitudes.append(float(sample.velocity[inside, 0] @ wave / (wave @ wave)))
    return Run(
        case=NAME,
        measurements=(
            Measurement(
                f'response at {wavelength:g} h',
                amplitudes[0] / amplitudes[1],
                exact.green_response(q, 1.0),
                '1',
            ),
        ),
        particles=simulations[0].particle_count,
        steps=0,
        evaluations=EVALUATIONS,
        simulated_time=0.0,
        wall_time=EVALUATIONS * _evaluation_time(simulations[0]),
    )


def _waves(sides: tuple[float, float], q: float, spacing: float) -> Terrain:
    """Ground sin(q x) under a layer of given sides [m] and a little more."""
    x, y = (0.5 * side + 2.0 * spacing for side in sides)
    # a fortieth of the wave shows its slope, and more cells than particles no more
    cell = min(2.0 * math.pi / q / 40.0, max(spacing, 0.1))
    terrain = plane((-x, -y, x, y), cell)
    place = terrain.origin[0] + (np.arange(terrain.shape[1]) + 0.5) * cell
    row = AMPLITUDE * np.sin(q * place)
    return replace(terrain, elevation=np.tile(row, (terrain.shape[0], 1)))


def _evaluation_time(simulation: Simulation) -> float:
    """Median time of a velocity evaluation [s], as a graph on a GPU, as in a time step."""
    device = wp.get_device(simulation.device)
    simulation.evaluate()
    evaluate = simulation.evaluate
    if device.is_cuda:
        with wp.ScopedCapture(device=device) as capture:
            simulation.evaluate()
        evaluate = partial(wp.capture_launch, capture.graph)
    times = []
    for _ in range(EVALUATIONS + 1):
        wp.synchronize_device(device)
        start = wall_clock.perf_counter()
        evaluate()
        wp.synchronize_device(device)
        times.append(wall_clock.perf_counter() - start)
    # a graph's first launch is its upload
    return median(times[1:])
