# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Cases of lava with inertia: release of a sheet, dam breaks, an oscillation in a bowl."""

from dataclasses import replace
import math
from typing import NamedTuple

import numpy as np

from lava_ros.scene import Lava, Scene, Terrain
from lava_ros.simulation import Particles
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification import exact
from lava_ros.verification.cases import case
from lava_ros.verification.cases.case import GRAVITY
from lava_ros.verification.cases.confined import ground_at

#: Effects: momentum and drag only.
INERTIAL = case.only('inertia')

#: Lava with negligible drag.
THIN = Lava.paper(density=2600.0, viscosity=1e-6, arrhenius=0.0, emissivity=0.0, convection=0.0)

#: Length of a fan behind a dam when it is measured, and the thickness behind it [m].
REACH, HEIGHT = 10.0, 1.0

#: Minimum number of steps in a period of the bowl.
STEPS = 400

#: Particles of a dam break and of a bowl at a refinement of 1.
PARTICLES = 20_000


def _run_sheet(accuracy: Accuracy, device: str) -> case.Run:
    """Compare the speed of the middle of a sheet after 0.5, 1 and 3 relaxation times."""
    thickness, slope = 2.0, math.radians(10.0)
    lava = replace(THIN, viscosity=1e3)
    sheet = exact.AcceleratingSheet(thickness, slope, lava.viscosity / lava.density, GRAVITY)
    spacing = 2.0 / accuracy.refinement
    times = np.array([0.5, 1.0, 3.0]) / sheet.rate
    # disturbances from the border travel at the wave speed
    pace = math.sqrt(GRAVITY * thickness)
    half = 1.5 * pace * times[-1] + 5.0 * spacing
    ticks = np.arange(-half, half, spacing)
    run_out = sheet.final_speed * times[-1]
    window = (-2.0 * half, -2.0 * half, 2.0 * half + run_out, 2.0 * half)
    trial = case.Trial(
        Scene(case.plane(window, 0.05 * half, slope), lava=lava), accuracy, device,
        effects=replace(INERTIAL, steep=True),
        particles=Particles(case.places(ticks, ticks), thickness * spacing**2, 1400.0),
        spacing=spacing, thickness=thickness, longest_step=0.02 / sheet.rate / accuracy.refinement,
    )
    for time, name in zip(times, ('half', 'one', 'three'), strict=True):
        trial.advance(time)
        sample = trial.sample()
        centre = sheet.final_speed * time - sheet.lag(time)
        middle = np.hypot(sample.position[:, 0] - centre, sample.position[:, 1]) < 0.2 * half
        found = sample.velocity[middle, 0].mean()
        trial.compare(f'speed after {name}', found, sheet.speed(float(time)), 'm/s')
    return trial.run()


def _broken_dams(
    solution: exact.RitterDamBreak | exact.StokerDamBreak, bed: float, ahead: float,
    accuracy: Accuracy, device: str,
) -> tuple[case.Trial, np.ndarray, np.ndarray]:
    """Let a block of lava collapse on both sides, onto a dry bed or a layer of lava.

    ``bed`` is the thickness of that layer [m], 0 for a dry bed. The layer extends so far that its
    outer ends disturb nothing within ``ahead`` [m] of the dams by the end; nor do the strip's long
    sides affect the sampled band. On a dry bed the particle spacing next to the dams is halved,
    because the lava of the tip comes from there, and it thins to less than a single particle.

    Returns:
        The trial at the time when the fans meet; distances outwards from a dam [m], from the start
        of the fan to ``ahead``; the mean thickness of both sides at these distances [m].
    """
    time = REACH / math.sqrt(GRAVITY * HEIGHT)
    # half of the width of the measured band
    band = 1.0
    half, side = 1.1 * REACH, 1.1 * REACH + band
    if bed:
        outer = half + ahead + 1.1 * math.sqrt(GRAVITY * bed) * time
        parts = [(-outer, -half, bed, 1.0), (-half, half, HEIGHT, 1.0), (half, outer, bed, 1.0)]
    else:
        outer, inner = half, half - 0.1 * REACH
        parts = [
            (-half, -inner, HEIGHT, 2.0), (-inner, inner, HEIGHT, 1.0), (inner, half, HEIGHT, 2.0)
        ]
    area = sum((end - start) * fineness**2 for start, end, _, fineness in parts) * 2.0 * side
    spacing = math.sqrt(area / PARTICLES) / accuracy.refinement
    position, volumes = [], []
    for start, end, thickness, fineness in parts:
        count = max(2, round((end - start) * 2.0 * side * (fineness / spacing) ** 2))
        fraction, y = case.strip(2.0 * side, count)
        position.append(np.column_stack([start + fraction * (end - start), y]))
        volumes.append(np.full(count, thickness * (end - start) * 2.0 * side / count))
    far = max(outer, half + 2.2 * REACH)
    trial = case.Trial(
        Scene(case.plane((-far, -2.0 * side, far, 2.0 * side), 1.0), lava=THIN), accuracy, device,
        effects=INERTIAL,
        particles=Particles(np.concatenate(position), np.concatenate(volumes), 1400.0),
        spacing=spacing, thickness=HEIGHT,
    )
    trial.advance(time)
    field = trial.field((-far, -2.0 * band, far, 2.0 * band))
    line = field.along_x(band)
    right = field.x > 0.0
    distance, found = field.x[right] - half, 0.5 * (line + line[::-1])[right]
    inside = (distance > -REACH) & (distance < ahead)
    expected = solution.thickness(distance[inside], trial.simulation.time)
    trial.compare_mean(found[inside], expected, 'thickness')
    return trial, distance, found


def _run_ritter(accuracy: Accuracy, device: str) -> case.Run:
    solution = exact.RitterDamBreak(HEIGHT, GRAVITY)
    return _broken_dams(solution, 0.0, 2.0 * REACH, accuracy, device)[0].run()


def _run_stoker(accuracy: Accuracy, device: str) -> case.Run:
    bed = 0.1 * HEIGHT
    solution = exact.StokerDamBreak(HEIGHT, bed, GRAVITY)
    bore = solution.bore * REACH / math.sqrt(GRAVITY * HEIGHT)
    trial, distance, thickness = _broken_dams(solution, bed, bore + 0.2 * REACH, accuracy, device)
    place = case.front(distance, thickness, 0.5 * (bed + solution.plateau))
    trial.compare('bore', place, bore, 'm')
    return trial.run()


class Swing(NamedTuple):
    """An oscillation in a bowl, with the best fitting and the exact period [s].

    ``damping`` is the fraction of the energy above that at rest that is lost in a period,
    ``growth`` the largest increase of the energy between two samples, over the first energy.
    """

    trial: case.Trial
    period: float
    exact_period: float
    damping: float
    growth: float


def swing(
    count: int, *, accuracy: Accuracy, periods: float = 2.0, samples: int = 20, device: str = 'cpu'
) -> Swing:
    """Let lava oscillate in a paraboloid (Thacker 1981), from rest at its narrowest.

    There are about ``count`` particles, sampled ``samples`` times per period.
    """
    solution = exact.OscillatingBowl(1.0, 50.0, 0.3, GRAVITY)
    narrow = solution.radius / math.sqrt(solution.narrowness(0.0))
    wide = solution.radius / math.sqrt(solution.narrowness(0.5 * solution.period))
    cell, half = 1.0, math.ceil(1.3 * wide)
    ticks = np.arange(-half + 0.5 * cell, half, cell)
    bowl = solution.depth * (ticks[None, :] ** 2 + ticks[:, None] ** 2) / solution.radius**2
    spacing = narrow * math.sqrt(math.pi / count)
    # even points of a disc: the golden angle
    index = np.arange(count) + 0.5
    distance, angle = narrow * np.sqrt(index / count), index * math.pi * (3.0 - math.sqrt(5.0))
    thickness = solution.thickness(distance, 0.0)
    trial = case.Trial(
        Scene(Terrain(bowl, cell, origin=(-half, -half)), lava=THIN), accuracy, device,
        effects=INERTIAL,
        particles=Particles(
            np.column_stack([distance * np.cos(angle), distance * np.sin(angle)]),
            thickness * spacing**2, 1400.0,
        ),
        spacing=spacing, thickness=0.5 * float(thickness.max()),
        longest_step=solution.period / STEPS,
    )
    times = solution.period * np.arange(1 + round(periods * samples)) / samples
    # velocities are those in the middle of a step, so each sample follows a very short step
    instant = 1e-5 * solution.period
    spread, energy = [], []
    # a paraboloid of liquid at rest: its centre of mass is at 2/3 of its depth above the bottom
    volume = 0.5 * math.pi * solution.depth * solution.radius**2
    rest = GRAVITY * volume * solution.depth * 2.0 / 3.0
    for time in times:
        trial.advance(time - instant)
        trial.advance(time)
        sample = trial.sample()
        weight = sample.volume / sample.volume.sum()
        spread.append(float(weight @ (sample.position**2).sum(axis=1)))
        ground = ground_at(trial.simulation.scene.terrain, sample.position)
        head = GRAVITY * (0.5 * sample.thickness + ground)
        kinetic = 0.5 * (sample.velocity**2).sum(axis=1)
        energy.append(float(sample.volume @ (kinetic + head)) - rest)
    known = np.array(energy)
    growth = float((known - np.minimum.accumulate(known)).max() / known[0])
    damping = 1.0 - float(known[-1] / known[0]) ** (solution.period / times[-1])
    period = _fitted_period(times, np.array(spread), solution.period)
    return Swing(trial, period, solution.period, damping, growth)


def _fitted_period(times: np.ndarray, spread: np.ndarray, expected: float) -> float:
    """Return the best-fitting period [s] of a mean of r^2, for a cosine that may be damped."""

    def misfit(period: float) -> float:
        phase = 2.0 * math.pi * times / period
        wave = np.column_stack([np.cos(phase), np.sin(phase)])
        columns = np.column_stack([np.ones_like(phase), phase, wave, wave * times[:, None]])
        fit = np.linalg.lstsq(columns, spread, rcond=None)[0]
        return float(((columns @ fit - spread) ** 2).sum())

    candidates = expected * np.linspace(0.95, 1.05, 2001)
    return float(min(candidates, key=misfit))


def _run_thacker(accuracy: Accuracy, device: str) -> case.Run:
    count = max(200, round(PARTICLES * accuracy.refinement**2))
    seen = swing(count, accuracy=accuracy, device=device)
    seen.trial.compare('period', seen.period, seen.exact_period, 's')
    seen.trial.compare('loss a period', seen.damping, 0.0, '1', scale=1.0)
    seen.trial.compare('energy growth', seen.growth, 0.0, '1', scale=1.0)
    return seen.trial.run()


CASES = (
    case.Case('inertial_sheet', 'sheet released on a slope', 'exponential', _run_sheet,
              ('inertia', 'steep')),
    case.Case('ritter', 'dam break onto a dry bed, with inertia', 'Ritter 1892', _run_ritter,
              ('inertia',)),
    case.Case('stoker', 'dam break onto a wet bed, with inertia', 'Stoker 1957', _run_stoker,
              ('inertia',)),
    case.Case('thacker', 'oscillation in a paraboloid', 'Thacker 1981', _run_thacker,
              ('inertia',)),
)
