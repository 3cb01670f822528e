# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Cases of non-Newtonian lava, and of the effects of temperature and crystals on viscosity."""

from dataclasses import replace
import math

import numpy as np

from lava_ros.scene import Lava, Scene
from lava_ros.simulation import Particles
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification import exact
from lava_ros.verification.cases import case
from lava_ros.verification.cases.case import FLAT, GRAVITY, ISOTHERMAL, SLOPING
from lava_ros.verification.cases.sheets import MIDDLE, sheet_speed

#: Weight of a volume [N/m3].
WEIGHT = ISOTHERMAL.density * GRAVITY

#: Slope of most sheets [rad].
SLOPE = math.radians(10.0)

#: Temperature at which strength and viscosity are given [K].
REFERENCE = ISOTHERMAL.reference_temperature

#: Time of measuring slumps, in mu / tau_y: the remaining motion decreases as 1 / t.
SLUMP = 1e4

#: Initial radius, or half-width, of slumps over the final one: all of the lava moves at first.
SQUEEZE = 0.7


def _run_sheets(accuracy: Accuracy, device: str) -> case.Run:
    runs = []
    for quantity, switched, index in (
        ('speed, Bingham', {'yielding': True}, 1.0),
        ('speed, power law, n 0.5', {'power_law': True}, 0.5),
        ('speed, n 0.5', {'yielding': True, 'power_law': True}, 0.5),
        ('speed, n 1', {'yielding': True, 'power_law': True}, 1.0),
        ('speed, n 2', {'yielding': True, 'power_law': True}, 2.0),
    ):
        strength = 0.4 * WEIGHT * math.sin(SLOPE) if 'yielding' in switched else 0.0
        lava = replace(ISOTHERMAL, viscosity=4e3, yield_strength=strength, flow_index=index)
        runs.append(
            sheet_speed(
                quantity, lava, accuracy, device, slope=SLOPE, strength=strength,
                effects=replace(SLOPING, **switched),
            )
        )
    return case.joined(runs)


def _run_critical(accuracy: Accuracy, device: str) -> case.Run:
    """Compare the thickness at which a sheet starts to move, and the creep of a thinner one."""
    runs = []

    def sheet(thickness: float, slope: float) -> case.Trial:
        return case.layer(
            replace(ISOTHERMAL, yield_strength=WEIGHT * math.sin(slope)),
            replace(SLOPING, yielding=True), replace(accuracy, longest_step=1e6), device,
            thickness=thickness / math.cos(slope), slope=slope,
        )

    def moves(trial: case.Trial) -> bool:
        return bool(trial.middle('velocity', MIDDLE)[:, 0].any())

    for degrees in (3.0, 10.0, 25.0):
        slope = math.radians(degrees)
        strength = WEIGHT * math.sin(slope)
        expected = exact.critical_thickness(
            strength, slope, density=ISOTHERMAL.density, gravity=GRAVITY
        )
        low, high = 0.97 * expected, 1.03 * expected
        trial = sheet(high, slope)
        if not moves(trial) or moves(sheet(low, slope)):
            low = high = math.nan
        while high - low > 1e-4 * expected:
            thickness = 0.5 * (low + high)
            trial = sheet(thickness, slope)
            low, high = (low, thickness) if moves(trial) else (thickness, high)
        trial.compare(f'thickness at {degrees:g} degrees', 0.5 * (low + high), expected, 'm')
        runs.append(trial.run())
    trial = sheet(0.99, SLOPE)
    start = np.sort(trial.middle('position', MIDDLE)[:, 0])
    trial.advance(1e5)
    end = np.sort(trial.middle('position', MIDDLE)[:, 0])
    way = np.abs(end - start).max() if len(end) == len(start) else math.nan
    trial.compare('creep of 0.99 of it', way, 0.0, 'm', scale=1.0)
    return case.joined([*runs, trial.run()])


def _run_dome(accuracy: Accuracy, device: str) -> case.Run:
    """Compare the final shape of a volume that spreads until it stops.

    It starts as a dome of the same shape, so that the stress exceeds the strength everywhere by
    the same factor.
    """
    volume, strength = 1.5e5, 1e4
    count = max(20, round(4000 * accuracy.refinement**2))
    lava = replace(ISOTHERMAL, yield_strength=strength)
    solution = exact.BinghamDome(volume, strength, lava.density, GRAVITY)
    radius = solution.radius
    area = math.pi * radius**2
    half = 1.3 * radius
    window = case.square(half)
    places = solution.particles(count, SQUEEZE * radius)
    trial = case.Trial(
        Scene(case.plane(window, 0.05 * half), lava=lava), accuracy, device,
        effects=replace(FLAT, yielding=True),
        particles=Particles(places, volume / count, REFERENCE),
        spacing=math.sqrt(area / count), thickness=volume / area, longest_step=1e6,
    )
    trial.advance(SLUMP * lava.viscosity / strength)
    sample = trial.sample()
    distance = np.hypot(*sample.position.T)
    found = math.sqrt(float((distance**2).mean()))
    trial.compare('radius', found, solution.rms_radius, 'm')
    trial.compare_mean(sample.thickness, solution.thickness(distance))
    thin = 0.1 * volume / area
    edge = trial.field(window).mean_radius(thin, half)
    trial.compare('edge', edge, solution.radius_of_thickness(thin), 'm')
    return trial.run()


def _run_ridge(accuracy: Accuracy, device: str) -> case.Run:
    """Compare a narrow strip down a slope that widens until it stops, twelve half-widths long."""
    slope = math.radians(15.0)
    strength = 2.0 * WEIGHT * math.sin(slope)
    lava = replace(ISOTHERMAL, yield_strength=strength)
    solution = exact.Ridge(0.85, strength, slope, WEIGHT)
    half = solution.half_width
    length = 12.0 * half
    held = solution.section / math.cos(slope)
    spacing = half / 14.0 / accuracy.refinement
    fraction, x = case.strip(length, max(20, round(2.0 * half * length / spacing**2)))
    place = np.linspace(-half, half, 20001)
    y = SQUEEZE * case.distributed(fraction, place, solution.thickness(np.abs(place)))
    window = (-0.6 * length, -2.0 * half, 0.7 * length, 2.0 * half)
    trial = case.Trial(
        Scene(case.plane(window, half / 8.0, slope), lava=lava), accuracy, device,
        effects=replace(SLOPING, yielding=True),
        particles=Particles(np.column_stack([x, y]), held * length / len(x), REFERENCE),
        spacing=spacing, thickness=0.5 * held / half, longest_step=1e6,
    )
    trial.advance(SLUMP * lava.viscosity / strength)
    sample = trial.sample()
    middle = np.abs(sample.position[:, 0]) < 0.15 * length
    expected = solution.thickness(np.abs(sample.position[middle, 1])) / math.cos(slope)
    grid = trial.field((-0.15 * length, -2.0 * half, 0.15 * length, 2.0 * half))
    thin = 0.1 * solution.critical
    width = case.half_width(grid.y, grid.thickness.mean(axis=1), thin)
    expected_width = solution.distance_of_thickness(thin * math.cos(slope))
    trial.compare('half-width', width, expected_width, 'm')
    trial.compare_mean(sample.thickness[middle], expected)
    return trial.run()


def _run_laws(accuracy: Accuracy, device: str) -> case.Run:
    """Compare sheets at several temperatures, whose speed reflects viscosity and strength."""
    # A, B [K] and C [K] of a basalt
    a, b, c = -4.55, 5700.0, 600.0
    molten = replace(ISOTHERMAL, vft_a=a, vft_b=b, vft_c=c)
    # quantity, lava, temperature, and its viscosity and strength there
    sheets: list[tuple[str, Lava, float, float, float]] = [
        (f'VFT, {hot:g} K', molten, hot, exact.vft_viscosity(hot, a, b, c), 0.0)
        for hot in (1400.0, 1200.0)
    ]
    for law, exponent in (('einstein-roscoe', 2.5), ('maron-pierce', 2.0)):
        lava = replace(ISOTHERMAL, solidus=1273.0, liquidus=1473.0, crystal_law=law, crystals=0.5)
        # three quarters of the way to the solidus
        factor = exact.crystal_factor(0.375, lava.packing, exponent)
        sheets.append((law, lava, 1323.0, lava.viscosity * factor, 0.0))
    weak = 0.2 * WEIGHT * math.sin(SLOPE)
    # twice as strong, at a temperature 100 K lower
    lava = replace(ISOTHERMAL, yield_strength=weak, yield_rate=math.log(2.0) / 100.0)
    sheets.append(('strength', lava, REFERENCE - 100.0, lava.viscosity, 2.0 * weak))
    return case.joined(
        sheet_speed(
            quantity, lava, accuracy, device, slope=SLOPE, viscosity=viscosity, strength=strength,
            duration=None, temperature=temperature,
            effects=replace(
                SLOPING, vft=lava is molten, crystals=lava.crystals > 0.0, yielding=strength > 0.0
            ),
        )
        for quantity, lava, temperature, viscosity, strength in sheets
    )


def _run_crust(accuracy: Accuracy, device: str) -> case.Run:
    """Compare the speeds of sheets 2 m thick that a crust holds back, up to an age of weeks.

    The stress of the crust is sigma delta / d, and the stress of the sheet rho g d sin b. The lava
    is so viscous that it moves only by millimetres.
    """
    runs, thickness = [], 2.0
    for degrees in (10.0, 30.0, 45.0):
        slope = math.radians(degrees)
        lava = replace(ISOTHERMAL, viscosity=1e12, crust_diffusivity=5e-7)
        # half of the stress at the base when the crust is as thick as the sheet
        strength = 0.5 * WEIGHT * thickness * math.sin(slope)
        trial = case.layer(
            replace(lava, crust_strength=strength),
            replace(SLOPING, crust_strength=True), replace(accuracy, longest_step=1e6), device,
            thickness=thickness / math.cos(slope), slope=slope,
        )
        for days in (1.0, 46.0):
            trial.advance(86400.0 * days)
            crust = math.sqrt(lava.crust_diffusivity * 86400.0 * days)
            expected = exact.herschel_bulkley_velocity(
                thickness, slope, density=lava.density, consistency=lava.viscosity,
                strength=strength * crust / thickness, index=1.0, gravity=GRAVITY,
            )
            found = trial.middle('velocity', MIDDLE)[:, 0].mean() / math.cos(slope)
            trial.compare(f'{days:g} days at {degrees:g} degrees', found, expected, 'm/s')
        runs.append(trial.run())
    return case.joined(runs)


CASES = (
    case.Case('herschel_bulkley', 'sheets of Bingham, power-law and Herschel-Bulkley lava',
              'Herschel & Bulkley 1926', _run_sheets, ('steep', 'yielding', 'power_law')),
    case.Case('critical_thickness', 'sheets at the critical thickness', 'Hulme 1974',
              _run_critical, ('steep', 'yielding')),
    case.Case('material_laws', 'viscosity and strength at several temperatures',
              'Giordano et al. 2008; Roscoe 1952; Maron & Pierce 1956', _run_laws,
              ('steep', 'yielding', 'vft', 'crystals')),
    case.Case('bingham_dome', 'dome left by a fixed volume', 'Nye 1952; Blake 1990', _run_dome,
              ('yielding',)),
    case.Case('crust_strength', 'sheets held back by a crust', 'Castruccio et al. 2013',
              _run_crust, ('steep', 'crust_strength')),
    case.Case('ridge', 'ridge left by a strip on a slope', 'after Hulme 1974', _run_ridge,
              ('steep', 'yielding')),
)
