# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Cases of lava that gains and loses heat, and solidifies.

Errors of temperatures are relative to the change of temperature.
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
from lava_ros.verification.cases import case
from lava_ros.verification.cases.case import FLAT, GRAVITY, ISOTHERMAL, NU, SLOPING

#: Lava too viscous to move, which loses no heat unless a case changes that.
STILL = Lava.paper(density=2500.0, viscosity=1e15, arrhenius=0.0, emissivity=0.0, convection=0.0)

#: Temperatures of vents and of the air [K], and the thickness of sheets [m].
HOT, COLD, THICKNESS = 1423.0, 300.0, 2.0

#: Discharge of silicone oil [m3/s], and radius of the hole [m] (2 to 4 mm).
DISCHARGE, HOLE = 2.2e-8, 0.003

#: Its kinematic viscosity [m2/s], density [kg/m3] and specific heat [J/(kg K)].
VISCOSITY, DENSITY, SPECIFIC_HEAT = 3.56e-3, 954.0, 1500.0

#: Its radiation and convection over the excess temperature [W/(m2 K)]: radiation contributes 6.1
#: to 5.5 as it cools from 315 K to the 293 K of the room, convection 1 to 3 in the article.
LOSS = 5.8 + 2.0


def _sheet(
    name: str, title: str, source: str, solution: Callable[..., float],
    constants: dict[str, Any], effects: tuple[str, ...],
    hours: Sequence[float] = (1.0, 10.0, 100.0), is_of_loss: bool = True,
) -> case.Case:
    """Return the case of temperatures in the middle of a sheet at rest.

    Errors are relative to the loss of temperature if ``is_of_loss``, otherwise to the temperature.
    """

    def measure(accuracy: Accuracy, device: str) -> case.Run:
        lava = replace(STILL, **constants)
        trial = case.layer(
            lava, case.only(*effects), replace(accuracy, longest_step=600.0), device,
            thickness=THICKNESS, spacing=4.0, side=80.0, temperature=HOT,
        )
        for hour in hours:
            trial.advance(3600.0 * hour)
            expected = solution(lava, 3600.0 * hour, initial=HOT, thickness=THICKNESS)
            found = trial.middle('temperature', 16.0).mean()
            scale = HOT - expected if is_of_loss else None
            trial.compare(f'temperature after {hour:g} h', found, expected, 'K', scale)
        return trial.run()

    return case.Case(name, title, source, measure, effects)


#: Slope of a sheet that cools on a steep slope [rad], and hours after which it is measured.
STEEP, STEEP_HOURS = math.radians(30.0), (1.0, 10.0, 100.0)


def _run_steep(accuracy: Accuracy, device: str) -> case.Run:
    """Compare sheets on 30 degrees, whose surface is 1 / cos b times their area on the map."""
    runs = []
    for effect, solution, constants in (
        ('cooling', partial(exact.convecting_sheet, ambient=COLD), {'convection': 50.0}),
        ('ground', partial(exact.column_on_ground, ground=COLD), {'ground_conductivity': 2.0}),
        ('crust', partial(exact.convecting_slab, ambient=COLD),
         {'convection': 50.0, 'conductivity': 2.0, 'crust': True}),
    ):
        lava = replace(STILL, **constants)
        trial = case.layer(
            lava, replace(SLOPING, **{effect: True}), replace(accuracy, longest_step=600.0),
            device, thickness=THICKNESS / math.cos(STEEP), spacing=4.0, side=80.0, slope=STEEP,
            temperature=HOT,
        )
        for hour in STEEP_HOURS:
            trial.advance(3600.0 * hour)
            expected = solution(lava, 3600.0 * hour, initial=HOT, thickness=THICKNESS)
            found = trial.middle('temperature', 16.0).mean()
            trial.compare(f'{effect}, {hour:g} h', found, expected, 'K', HOT - expected)
        runs.append(trial.run())
    return case.joined(runs)


def _run_viscous(accuracy: Accuracy, device: str) -> case.Run:
    # a small heat capacity, so that the lava warms by several kelvin
    lava = replace(ISOTHERMAL, specific_heat=1.0)
    warming = partial(exact.warming_by_descent, gravity=GRAVITY, specific_heat=1.0)
    slope, thickness, duration = math.radians(10.0), 1.0, 20.0
    sheet = case.layer(
        lava, replace(SLOPING, viscous_heating=True), accuracy, device,
        thickness=thickness, slope=slope, temperature=HOT,
    )
    sheet.advance(duration)
    warmed = float(sheet.middle('temperature', 24.0).mean()) - HOT
    speed = exact.sheet_velocity(thickness * math.cos(slope), slope, NU, GRAVITY)
    sheet.compare('warming', warmed, warming(speed * math.sin(slope) * duration), 'K')
    # heat of a fixed volume that spreads, and the potential energy that it loses
    volume, count = 1e5, round(2000 * accuracy.refinement**2)
    solution = exact.FixedVolumeSpread(volume, lava.viscosity / lava.density, GRAVITY)
    start, end = solution.time_of_radius(100.0), solution.time_of_radius(160.0)
    trial = case.Trial(
        Scene(case.plane(case.square(250.0), 10.0), lava=lava), accuracy, device,
        effects=replace(FLAT, viscous_heating=True),
        particles=Particles(solution.particles(count, start), volume / count, HOT),
        spacing=math.sqrt(math.pi * 100.0**2 / count), thickness=volume / 3e4,
    )
    trial.advance(end - start)
    sample = trial.sample()
    rise = (sample.volume * (sample.temperature - HOT)).sum() / volume
    # the centre of mass of the profile is at 2 / 5 of its height
    fall = 0.4 * (solution.centre(start) - solution.centre(end))
    trial.compare('heat of spreading', rise, warming(fall), 'K')
    return case.joined([sheet.run(), trial.run()])


def _run_conduction(accuracy: Accuracy, device: str) -> case.Run:
    # the conductivity is so large that a temperature front is wider than the kernel
    lava = replace(STILL, density=1000.0, specific_heat=1000.0, conductivity=1000.0)
    diffusivity, time = 1e-3, 1.6e4
    length, width = 60.0, 14.0
    # as many columns on either side of the step
    spacing = 0.5 * length / round(length * accuracy.refinement)
    position = case.lattice(int(length / spacing), int(width / spacing), spacing)
    first = np.where(position[:, 0] < 0.0, 1000.0, 1400.0)
    trial = case.Trial(
        Scene(case.plane((-40.0, -15.0, 40.0, 15.0), 1.0), lava=lava), accuracy, device,
        effects=replace(FLAT, conduction=True),
        particles=Particles(position, THICKNESS * spacing**2, first),
        spacing=spacing, thickness=THICKNESS,
    )
    trial.advance(time)
    sample = trial.sample()
    x, y = sample.position.T
    middle = (np.abs(y) < 0.2 * width) & (np.abs(x) < 0.4 * length)
    expected = exact.temperature_step(x, time, low=1000.0, high=1400.0, diffusivity=diffusivity)
    apart = np.abs(sample.temperature - expected)[middle].max()
    trial.compare('profile', apart, 0.0, 'K', scale=400.0)
    mean = sample.volume @ sample.temperature / sample.volume.sum()
    trial.compare('heat', mean, first.mean(), 'K')
    return trial.run()


def _run_current(accuracy: Accuracy, device: str) -> case.Run:
    # Garel et al. used silicone oil; this case uses lava
    lava = replace(ISOTHERMAL, emissivity=0.9, convection=50.0)
    discharge = 1.0
    solution = exact.CoolingCurrent(lava, initial=HOT, ambient=COLD, discharge=discharge)
    # until the radius is four thermal radii: the stored heat then grows by 2 % of the supply
    spread = exact.ConstantFluxSpread(discharge, lava.viscosity / lava.density, GRAVITY)
    ground = case.plane(case.square(4.5 * solution.thermal_radius), 10.0)
    vent = Vent((0.0, 0.0), discharge, radius=5.0, temperature=HOT)
    trial = case.Trial(
        Scene(ground, (vent,), lava, ambient_temperature=COLD), accuracy, device,
        effects=replace(FLAT, cooling=True), spacing=8.0 / accuracy.refinement,
    )
    trial.advance((4.0 * solution.thermal_radius / spread.coefficient) ** 2)
    sample = trial.sample()
    distance = np.hypot(*sample.position.T)
    for fraction in (0.5, 1.0):
        ring = np.abs(distance / solution.thermal_radius - fraction) < 0.1
        expected = solution.temperature(distance[ring]).mean()
        found = sample.temperature[ring].mean()
        name = f'temperature at {fraction:g} thermal radii'
        trial.compare(name, found, expected, 'K', HOT - COLD)
    loss = solution.flux(sample.temperature) @ (sample.volume / sample.thickness)
    trial.compare('power of the surface', loss, solution.power, 'W')
    return trial.run()


def _run_freezing(accuracy: Accuracy, device: str) -> case.Run:
    # too stiff to flow, and cools by convection only
    lava = replace(STILL, density=2600.0, viscosity=1e9, convection=25.0, solidus=1300.0)
    lens = exact.FreezingLens(lava, depth=3.0, radius=60.0, first=HOT, ambient=COLD)
    half, spacing = 90.0, 3.0 / accuracy.refinement
    terrain = case.plane(case.square(half), spacing)
    ticks = np.arange(-half, half, spacing) + 0.5 * spacing
    position = case.places(ticks, ticks)
    thickness = lens.thickness(np.hypot(*position.T))
    wet = thickness > 0.0
    trial = case.Trial(
        Scene(terrain, lava=lava, ambient_temperature=COLD), accuracy, device,
        effects=replace(FLAT, cooling=True, solidification=True),
        particles=Particles(position[wet], thickness[wet] * spacing**2, HOT),
        spacing=spacing, thickness=0.5 * lens.depth,
    )

    def frozen() -> float:
        budget = trial.simulation.budget()
        return budget.solidified / budget.emitted

    for fraction in (0.3, 0.6, 0.9):
        trial.advance(fraction * lens.end)
        expected = lens.frozen_fraction(fraction * lens.end)
        trial.compare(f'frozen after {fraction:g} of the time', frozen(), expected, '', scale=1.0)
    trial.advance(1.2 * lens.end)
    trial.compare('frozen in the end', frozen(), 1.0, '')
    x0, y0 = terrain.origin
    rows, columns = terrain.shape
    x, y = np.meshgrid(
        x0 + (np.arange(columns) + 0.5) * spacing, y0 + (np.arange(rows) + 0.5) * spacing
    )
    deposit = trial.simulation.snapshot().frozen
    assert deposit is not None
    trial.compare_mean(deposit, lens.thickness(np.hypot(x, y)), 'deposit')
    # all lava is solid, and no particle remains
    return replace(trial.run(), particles=int(wet.sum()))


def _run_oil(accuracy: Accuracy, device: str) -> case.Run:
    """Compare front, heat loss of the surface, and its temperature, as the front advances.

    The constants are those of Garel, Kaminski, Tait & Limare 2012 (J. Geophys. Res. 117),
    experiment C14, the third benchmark (BM3) of Cordonnier, Lev & Garel 2015, as in the public
    case of interThermalRadConvFoam (github.com/BiElisa/interThermalRadConvFoam, run/BM3), which
    took them from the article. The measurements of the experiment were not available: this
    compares with the exact solution of the paper's balance, advection against the heat loss of the
    surface, for an isoviscous current with one temperature per column. The loss to the plate is
    omitted.
    """
    # Vents cannot emit lava as cold as this. With a loss proportional to the difference, and
    # constant viscosity, the scale of temperatures is free.
    hot, cold = 700.0, 600.0
    capacity = DENSITY * SPECIFIC_HEAT
    spread = exact.ConstantFluxSpread(DISCHARGE, VISCOSITY, GRAVITY)
    solution = exact.CoolingSpread(spread, loss=LOSS, capacity=capacity)
    thermal = math.sqrt(capacity * DISCHARGE / (math.pi * LOSS))
    half = 3.6 * thermal
    window = case.square(half)
    vent = Vent((0.0, 0.0), DISCHARGE, radius=HOLE, temperature=hot)
    oil = Lava.paper(
        density=DENSITY, viscosity=VISCOSITY * DENSITY, arrhenius=0.0, specific_heat=SPECIFIC_HEAT,
        emissivity=0.0, convection=LOSS,
    )
    trial = case.Trial(
        Scene(case.plane(window, 0.005), (vent,), oil, ambient_temperature=cold),
        accuracy, device, effects=replace(FLAT, cooling=True),
        spacing=0.0035 / accuracy.refinement, thickness=2e-3,
    )
    for radius in (1.0, 2.0, 3.0):
        time = (radius * thermal / spread.coefficient) ** 2
        trial.advance(time)
        sample = trial.sample()
        difference = (sample.temperature - cold) / (hot - cold)
        power = LOSS * difference @ (sample.volume / sample.thickness) / (capacity * DISCHARGE)
        trial.compare(f'power at {radius:g} thermal radii', power, solution.power(time), '1')
    distance = np.hypot(*sample.position.T)
    for fraction in (0.5, 1.0, 1.5):
        ring = np.abs(distance / thermal - fraction) < 0.1
        expected = solution.difference(distance[ring], time).mean()
        what, found = f'temperature at {fraction:g} thermal radii', difference[ring].mean()
        trial.compare(what, found, expected, '1', scale=1.0)
    least = 0.5e-3
    front = trial.field(window).mean_radius(least, half)
    trial.compare('front', front, spread.radius_of_thickness(least, time), 'm')
    return trial.run()


CASES = (
    _sheet('radiating_sheet', 'sheet that cools by radiation', 'Stefan-Boltzmann law',
           partial(exact.radiating_sheet, ambient=COLD), {'emissivity': 0.9}, ('cooling',),
           (1.0, 10.0, 24.0), False),
    _sheet('ground', 'sheet that warms the ground', 'Carslaw & Jaeger 1959',
           partial(exact.column_on_ground, ground=COLD), {'ground_conductivity': 2.0},
           ('ground',)),
    _sheet('crust', 'sheet that cools under a crust', 'Carslaw & Jaeger 1959',
           partial(exact.convecting_slab, ambient=COLD),
           {'convection': 50.0, 'conductivity': 2.0, 'crust': True}, ('crust',)),
    # so much convection that the surface is as cold as the air
    _sheet('insulation', 'sheet under a crust that grows', 'Stefan problem (Neumann)',
           partial(exact.insulated_sheet, ambient=COLD),
           {'convection': 1e5, 'conductivity': 2.0, 'solidus': 1250.0}, ('insulation',)),
    # 16 kW/m2 at first: solid after two days
    _sheet('latent_heat', 'sheet that crystallises', 'enthalpy balance',
           partial(exact.crystallising_sheet, ambient=COLD),
           {'convection': 50.0, 'latent_heat': 3.5e5, 'liquidus': 1400.0, 'solidus': 1250.0},
           ('cooling', 'latent_heat')),
    case.Case('steep_sheet', 'sheets that cool on 30 degrees',
              'heat balance; Carslaw & Jaeger 1959', _run_steep,
              ('steep', 'cooling', 'ground', 'crust')),
    case.Case('viscous_heating', 'lava that warms as it descends', 'energy balance', _run_viscous,
              ('viscous_heating', 'steep')),
    case.Case('conduction', 'step of temperature', 'error function', _run_conduction,
              ('conduction',)),
    case.Case('cooling_current', 'steady current that cools as it spreads',
              'heat balance; Garel et al. 2012', _run_current, ('cooling',)),
    case.Case(
        'freezing_lens', 'lava at rest that freezes from its rim', 'Newton cooling', _run_freezing,
        ('cooling', 'solidification'),
    ),
    case.Case('silicone_oil', 'hot silicone oil that spreads and cools on a plate',
              'heat balance, constants of Garel et al. 2012', _run_oil, ('cooling',)),
)
