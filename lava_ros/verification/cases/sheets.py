# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Layers of uniform thickness: speed on a slope, and lateral stress over wavy ground.

The driving force is along y and a wave along x, so that lateral stress is shear across the flow.
Stokes flow multiplies the wave by ``exact.wave_response``. The model's equation is 0.53 % below
that for waves of 4 thicknesses, 0.06 % for 8 and 0.002 % for 20. The experiments of ``lateral``
compare three forms of the velocity for kernel radii l of 0.3 to 10 thicknesses:

* ``local``: no lateral stress. Its response is 1, so its error is the size of the effect.
* ``green``: the Green's function, cut off at the kernel radius.
* ``helmholtz``: the solve that the Green's function approximates.

The kernel radius over its ratio gives the spacing. At the smallest l a particle is a column an
eleventh as wide as it is thick, at the largest three times as wide as thick. Waves shorter than
four spacings are left out, because no form could resolve them.
"""

from dataclasses import replace
from functools import partial
import math
from statistics import median

import numpy as np
import warp as wp

from lava_ros.effects import Effects
from lava_ros.effects.laws import LATERAL_DRAG
from lava_ros.scene import Lava, Scene, Terrain
from lava_ros.simulation import Particles, Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.particles.solver import ParticleSolver
from lava_ros.verification import exact
from lava_ros.verification.benchmarks.effects import timed
from lava_ros.verification.cases import case
from lava_ros.verification.cases.case import FLAT, GRAVITY, ISOTHERMAL, SLOPING

#: Half the side of the middle of a sheet, which the ends do not influence [m].
MIDDLE = 24.0

#: Name of the case of all experiments with lateral stress.
LATERAL = 'lateral'

FORMS = ('local', 'green', 'helmholtz')

#: Kernel radii over the thickness, and the one of the case ``green``, 6 / k = 3.79.
RADII, GREEN_RADIUS = (0.3, 0.6, 1.0, 2.0, 3.5, 6.0, 10.0), 6.0 / math.sqrt(LATERAL_DRAG)

#: Wavelengths of the driving term over the thickness.
WAVELENGTHS = (4.0, 8.0, 20.0)

#: Shortest wavelength that is resolved, over the spacing.
RESOLVED = 4.0

#: Number of velocity evaluations that are timed.
EVALUATIONS = 5


def sheet_speed(
    quantity: str, lava: Lava, accuracy: Accuracy, device: str, *, slope: float,
    viscosity: float | None = None, strength: float = 0.0, duration: float | None = 4.0,
    temperature: float = ISOTHERMAL.reference_temperature, effects: Effects = SLOPING,
) -> case.Run:
    """Measure the speed of a sheet 1 m thick along a slope [rad] as ``quantity``.

    ``viscosity`` [Pa s], by default the lava's own, and ``strength`` [Pa] are those at the
    temperature [K]. A ``duration`` [s] of None is the time to move by one thickness.
    """
    expected = exact.herschel_bulkley_velocity(
        1.0, slope, density=lava.density, consistency=viscosity or lava.viscosity,
        strength=strength, index=lava.flow_index, gravity=GRAVITY,
    )
    trial = case.layer(
        lava, effects, replace(accuracy, longest_step=1e6), device,
        thickness=1.0 / math.cos(slope), slope=slope, temperature=temperature,
    )
    speeds = []
    for time in (0.0, duration or 1.0 / expected):
        trial.advance(time)
        speeds.append(trial.middle('velocity', MIDDLE)[:, 0].mean())
    trial.compare(quantity, float(np.mean(speeds)) / math.cos(slope), expected, 'm/s')
    return trial.run()


def _run_sheet(accuracy: Accuracy, device: str) -> case.Run:
    return case.joined(
        sheet_speed(
            f'speed at {degrees:g} degrees', ISOTHERMAL, accuracy, device,
            slope=math.radians(degrees),
        )
        for degrees in (3.0, 10.0, 25.0)
    )


def response(
    form: str, radius: float, wavelength: float, accuracy: Accuracy, device: str = 'cpu'
) -> case.Run:
    """Velocity amplitude relative to ``local``, in a layer 1 m thick driven by cos(q x).

    ``form`` is one of ``FORMS``, ``radius`` that of the kernel and ``wavelength`` 2 pi / q [m].
    The ratio of the accuracy gives the spacing, its refinement the number of particles. No
    simulated time passes; the wall time is that of the velocity evaluations, neighbour search
    included.
    """
    spacing = radius / accuracy.ratio
    q = 2.0 * math.pi / wavelength
    # half a wave on both sides of the largest drive, or a part of it where waves are long
    half = min(0.5 * wavelength, max(2.5, RESOLVED * spacing))
    # five times the reach 1 / k of the lateral stress
    margin = radius + 3.0
    columns = 2 * math.ceil((half + margin) / spacing)
    least = 2 * math.ceil((spacing + margin) / spacing)
    rows = max(least, round(10_000 * accuracy.refinement**2 / columns))
    sides = (columns * spacing, rows * spacing)

    def amplitude(simulation: Simulation) -> float:
        sample = simulation.sample()
        x, y = np.abs(sample.position.T)
        inside = (x <= half) & (y <= 0.5 * sides[1] - margin)
        wave = np.cos(q * sample.position[inside, 0])
        return float(sample.velocity[inside, 1] @ wave / (wave @ wave))

    simulation, local = (
        Simulation(
            Scene(_waves(sides, q, spacing), lava=ISOTHERMAL),
            effects=replace(FLAT, **({} if name == 'local' else {name: True})),
            accuracy=replace(accuracy, spacing=spacing, thickness=1.0),
            particles=Particles(case.lattice(columns, rows, spacing), spacing**2, 1400.0),
            device=device,
        )
        for name in (form, 'local')
    )
    ratio = amplitude(simulation) / amplitude(local)
    expected = exact.wave_response(q, 1.0)
    return case.Run(
        case='',
        measurements=(case.Measurement(f'response at {wavelength:g} h', ratio, expected, '1'),),
        particles=simulation.particle_count, steps=0, evaluations=EVALUATIONS, simulated_time=0.0,
        wall_time=EVALUATIONS * _evaluation_time(simulation),
    )


def _waves(sides: tuple[float, float], q: float, spacing: float) -> Terrain:
    """Return ground that falls along y by cos(q x), larger than a layer of given sides [m]."""
    x, y = (0.5 * side + 2.0 * spacing for side in sides)
    # cells of a fortieth of a wave resolve its slope; cells smaller than the spacing add nothing
    cell = min(2.0 * math.pi / q / 40.0, max(spacing, 0.1))
    terrain = case.plane((-x, -y, x, y), cell)
    rows, columns = (
        start + (np.arange(count) + 0.5) * cell
        for start, count in zip(reversed(terrain.origin), terrain.shape, strict=True)
    )
    # the slope across is larger by the distance from the middle over a wavelength
    return replace(terrain, elevation=-1e-3 * np.outer(rows, np.cos(q * columns)))


def _evaluation_time(simulation: Simulation) -> float:
    """Return the median time of a velocity evaluation [s], on a GPU as a graph as in a step."""
    device = wp.get_device(simulation.device)
    solver = simulation.solver
    assert isinstance(solver, ParticleSolver)
    evaluate = solver.evaluate
    evaluate()
    if device.is_cuda:
        with wp.ScopedCapture(device=device) as capture:
            solver.evaluate()
        evaluate = partial(wp.capture_launch, capture.graph)
    # the first launch of a graph uploads it to the device
    return median([timed(simulation.device, evaluate) for _ in range(EVALUATIONS + 1)][1:])


def _run_green(accuracy: Accuracy, device: str) -> case.Run:
    # the kernel radius is fixed, so a finer spacing has more neighbours
    ratio = min(12.0, max(1.5, accuracy.ratio * accuracy.refinement))
    accuracy = replace(accuracy, ratio=ratio)
    return case.joined(
        response('green', GREEN_RADIUS, wavelength, accuracy, device)
        for wavelength in WAVELENGTHS
    )


def _run_lateral(form: str, radius: float, accuracy: Accuracy, device: str) -> case.Run:
    return case.joined(
        response(form, radius, wavelength, accuracy, device)
        for wavelength in WAVELENGTHS
        if wavelength >= RESOLVED * radius / accuracy.ratio
    )


CASES = (
    case.Case('sheet', 'uniform sheet on slopes', 'Nusselt 1916; Jeffreys 1925', _run_sheet,
              ('steep',)),
    case.Case('green', 'lateral stress under a driving term sin(q x)', 'Stokes flow', _run_green,
              ('green',)),
)

#: Every form of the lateral stress at every kernel radius, from the smallest, by description.
EXPERIMENTS = {
    f'{form}, l = {radius:g} h': replace(
        CASES[1], name=LATERAL, measure=partial(_run_lateral, form, radius)
    )
    for radius in RADII
    for form in FORMS
}
