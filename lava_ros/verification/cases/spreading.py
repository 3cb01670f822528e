# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Cases of lava that spreads on a plane."""

import math

import numpy as np

from lava_ros.scene import Scene, Vent
from lava_ros.simulation import Particles
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification import exact
from lava_ros.verification.cases import case
from lava_ros.verification.cases.case import FLAT, FRONT, GRAVITY, ISOTHERMAL, NU


def spread_of_fixed_volume(
    count: int, *, accuracy: Accuracy, growth: float = 1.3, device: str = 'cpu'
) -> case.Run:
    """Let a volume on a plane spread until its radius is ``growth`` times as large (Huppert 1982).

    The measurements are the root mean square radius, the profile, the radius where the output grid
    is thinner than ``FRONT``, and the scatter of h / exact inside 0.3 R. ``count`` is the number
    of particles.
    """
    volume, first_radius = 1e5, 100.0
    solution = exact.FixedVolumeSpread(volume, NU, GRAVITY)
    start = solution.time_of_radius(first_radius)
    end = start * growth**8
    radius = solution.radius(end)
    area = math.pi * radius**2
    half = 1.5 * radius
    window = case.square(half)
    trial = case.Trial(
        Scene(case.plane(window, 0.05 * half), lava=ISOTHERMAL), accuracy, device,
        particles=Particles(solution.particles(count, start), volume / count, 1400.0),
        spacing=math.sqrt(area / count), thickness=volume / area,
    )
    trial.advance(end - start)
    sample = trial.sample()
    distance = np.hypot(*sample.position.T)
    expected = solution.thickness(distance, end)
    found = math.sqrt(np.average(distance**2, weights=sample.volume))
    trial.compare('radius', found, solution.rms_radius(end), 'm')
    trial.compare_mean(sample.thickness, expected)
    edge = trial.field(window).mean_radius(FRONT, half)
    trial.compare('edge', edge, solution.radius_of_thickness(FRONT, end), 'm')
    inner = distance < 0.3 * radius
    scatter = (sample.thickness[inner] / expected[inner]).std()
    trial.compare('scatter', scatter, 0.0, '1', scale=1.0)
    return trial.run()


def _run_fixed_volume(accuracy: Accuracy, device: str) -> case.Run:
    count = max(20, round(8000 * accuracy.refinement**2))
    return spread_of_fixed_volume(count, accuracy=accuracy, device=device)


def _run_constant_flux(accuracy: Accuracy, device: str) -> case.Run:
    """Compare the radius after an hour, and its power law after the first quarter of an hour."""
    discharge, end = 10.0, 3600.0
    solution = exact.ConstantFluxSpread(discharge, NU, GRAVITY)
    half = 1.3 * solution.radius(end)
    window = case.square(half)
    trial = case.Trial(
        Scene(case.plane(window, 8.0), (Vent((0.0, 0.0), discharge, radius=10.0),), ISOTHERMAL),
        accuracy, device, effects=FLAT, spacing=2.8 / accuracy.refinement, thickness=1.15,
    )
    times = np.geomspace(0.25 * end, end, 7)
    radii = []
    for time in times:
        trial.advance(time)
        radii.append(trial.field(window).mean_radius(FRONT, half))
    edge = solution.radius_of_thickness(FRONT, end)
    trial.compare('radius', radii[-1], edge, 'm')
    trial.compare('exponent', case.slope_of(np.log(times), np.log(radii)), 0.5, '1')
    # neither coefficient includes the effect of the threshold on the radius
    coefficient = math.exp(np.mean(np.log(radii) - 0.5 * np.log(times)))
    coefficient *= solution.radius(end) / edge
    trial.compare('coefficient', coefficient, solution.coefficient, 'm/s^(1/2)')
    return trial.run()


def _run_plane_fixed_area(accuracy: Accuracy, device: str) -> case.Run:
    """Compare a strip along its middle; its width is 3.5 times the final distance of the front."""
    area, first, growth = 100.0, 100.0, 1.3
    solution = exact.PlaneFixedArea(area, NU, GRAVITY)
    start = solution.time_of_length(first)
    end = start * growth**5
    length = solution.length(end)
    width = 3.5 * length
    window = (-1.3 * length, -2.6 * length, 1.3 * length, 2.6 * length)
    spacing = length / 33.0 / accuracy.refinement
    thickness = area / length
    fraction, y = case.strip(width, round(2.0 * area * width / (thickness * spacing**2)))
    # from one front to the other
    place = np.linspace(-1.0, 1.0, 20001)
    x = first * case.distributed(fraction, place, np.cbrt(1.0 - place**2))
    volume = 2.0 * area * width / len(fraction)
    trial = case.Trial(
        Scene(case.plane(window, 0.05 * length), lava=ISOTHERMAL), accuracy, device,
        particles=Particles(np.column_stack([x, y]), volume, 1400.0),
        spacing=spacing, thickness=thickness,
    )
    trial.advance(end - start)
    sample = trial.sample()
    middle = np.abs(sample.position[:, 1]) < 0.2 * length
    expected = solution.thickness(np.abs(sample.position[middle, 0]), end)
    grid = trial.field(window)
    reach = case.half_width(grid.x, grid.along_x(0.2 * length), FRONT)
    trial.compare('front', reach, solution.length_of_thickness(FRONT, end), 'm')
    trial.compare_mean(sample.thickness[middle], expected)
    return trial.run()


def _run_dam_break(accuracy: Accuracy, device: str) -> case.Run:
    """Compare a block whose long ends collapse, until disturbances have come half-way.

    Its sides are as far from the middle line as its ends are from the middle.
    """
    height, reach = 2.0, 15.0
    half = 3.0 * reach
    solution = exact.DamBreak(height, NU, GRAVITY)
    end = solution.time_of_reach(reach)
    spacing = 1.0 / accuracy.refinement
    fraction, y = case.strip(2.0 * half, round((2.0 * half / spacing) ** 2))
    x = (2.0 * fraction - 1.0) * half
    window = case.square(half + reach)
    volume = height * (2.0 * half) ** 2 / len(fraction)
    trial = case.Trial(
        Scene(case.plane(window, 3.0), lava=ISOTHERMAL), accuracy, device,
        particles=Particles(np.column_stack([x, y]), volume, 1400.0),
        spacing=spacing, thickness=height,
    )
    trial.advance(end)
    grid = trial.field(window)
    band = 0.5 * reach
    front = case.half_width(grid.x, grid.along_x(band), FRONT) - half
    trial.compare('front', front, solution.front_of_thickness(FRONT, end), 'm')
    sample = trial.sample()
    past = (np.abs(sample.position[:, 1]) < band) & (np.abs(sample.position[:, 0]) > half)
    passed = float(sample.volume[past].sum()) / (4.0 * band)
    trial.compare('passed', passed, solution.passed(end), 'm2')
    return trial.run()


CASES = (
    case.Case('fixed_volume', 'fixed volume on a plane', 'Huppert 1982', _run_fixed_volume),
    case.Case('constant_flux', 'constant flux onto a plane', 'Huppert 1982', _run_constant_flux),
    case.Case('plane_fixed_area', 'fixed area on a plane', 'Huppert 1982', _run_plane_fixed_area),
    case.Case('dam_break', 'viscous dam break', 'Cordonnier et al. 2015, BM1', _run_dam_break),
)
