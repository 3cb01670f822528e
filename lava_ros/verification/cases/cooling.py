# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Cases of lava that stiffens as it cools on its way down a slope of 6 degrees."""

from dataclasses import replace
import math

import numpy as np

from lava_ros.effects import Effects
from lava_ros.scene import Lava, Scene, Vent
from lava_ros.simulation import Particles
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification import exact
from lava_ros.verification.cases import case
from lava_ros.verification.cases.case import FRONT, GRAVITY

#: Lava whose viscosity is 20 times as large after cooling by 100 K.
STIFFENING = Lava.paper(
    density=2600.0, viscosity=1e4, specific_heat=1150.0, arrhenius=0.03, emissivity=0.9,
    convection=50.0, reference_temperature=1360.0,
)

#: Yield strength of 0.3 times its basal stress, which rises as it cools.
STRONG = {'yield_strength': 700.0, 'yield_rate': 0.01}

#: Constants of lava under a crust whose surface is as cold as the air.
UNDER_CRUST = {'emissivity': 0.0, 'convection': 1e5, 'conductivity': 2.0, 'solidus': 900.0}

#: Effects in addition to flow down the slope of the ground.
COOLING = case.only('arrhenius', 'cooling')

#: Temperatures of vents and of the air [K], and the slope [rad].
HOT, COLD, SLOPE = 1360.0, 300.0, math.radians(6.0)

#: Flux of the sheets [m2/s], their width and length [m].
FLUX, WIDTH, LENGTH = 0.1, 180.0, 130.0

#: Length and width [m] of the sheet under a crust. Its sides spread by sqrt(4 D t) = 50 m until
#: the last comparison, and the compared middle is thinner by 1e-3 then.
CRUSTED = 70.0, 300.0

#: Half of the length along the slope over which lava is emitted, and spacing of the sheets'
#: particles at a refinement of 1 [m].
REACH, SPACING = 2.5, 2.0

#: Time at which an advancing sheet is measured [s], and side of the cells of its reference [m].
FRONT_TIME, CELL = 2000.0, 1.25

#: Ends of the slope of the advancing sheet, which flows 7 m up from the fissure, and its width
#: [m]: the middle of a sheet of 180 m loses 0.5 % of its lava to the sides.
TOP, BOTTOM, OPEN_WIDTH = -32.5, 220.0, 300.0

#: Discharge of the point source [m3/s], its radius [m], and time of measuring its flow [s].
DISCHARGE, RADIUS, END = 5.0, 10.0, 7200.0

#: Smallest x, smallest y, largest x, largest y of that flow's ground, and its cells [m].
WINDOW, MAP = (-60.0, -90.0, 420.0, 90.0), 5.0


def _fissure(
    lava: Lava, effects: Effects, accuracy: Accuracy, device: str, *, length: float,
    thickness: float, particles: Particles | None = None, width: float = WIDTH,
    top: float | None = None,
) -> case.Trial:
    """Return a fissure across the slope.

    The ground is ``length`` long below it [m], and the flow is expected to be ``thickness`` thick
    [m]. The slope continues upwards to x = ``top`` [m]; by default a wall above the fissure keeps
    lava from flowing back.
    """
    half = 0.5 * width
    upper = -4.0 * REACH if top is None else top
    ground = case.plane((upper, -half - 20.0, length, half + 20.0), 1.0, SLOPE)
    if top is None:
        x = ground.origin[0] + np.arange(ground.shape[1]) + 0.5
        ground = replace(ground, elevation=ground.elevation + 3.0 * np.maximum(-REACH - x, 0.0))
    vent = Vent((0.0, -half), FLUX * width, radius=REACH, end=(0.0, half), temperature=HOT)
    return case.Trial(
        Scene(ground, (vent,), lava, ambient_temperature=COLD), accuracy, device, effects=effects,
        particles=particles, spacing=SPACING / accuracy.refinement, thickness=thickness,
    )


def _steady(
    solution: exact.CoolingSheet, lava: Lava, accuracy: Accuracy, device: str
) -> case.Trial:
    """Return particles of the steady sheet below such a fissure."""
    place = np.linspace(-REACH, LENGTH, 4001)
    profile = solution.thickness(place + REACH)
    section = float(np.trapezoid(profile, place))
    mean = section / (LENGTH + REACH)
    fraction, y = case.strip(
        WIDTH, round((LENGTH + REACH) * WIDTH * (accuracy.refinement / SPACING) ** 2)
    )
    x = case.distributed(fraction, place, profile)
    particles = Particles(
        np.column_stack([x, y]), section * WIDTH / len(x), solution.temperature(x + REACH)
    )
    names = ['yielding'] * (lava.yield_strength > 0.0)
    effects = case.only('steep', 'arrhenius', 'cooling', *names)
    return _fissure(
        lava, effects, accuracy, device, length=LENGTH + 50.0, thickness=mean, particles=particles
    )


def _run_sheet(accuracy: Accuracy, device: str) -> case.Run:
    """Compare thickness and temperature along the middle while half of the sheet is replaced.

    They are means over some moments, and over bands of 5 m across the sheet: single particles at
    one place scatter.
    """
    runs = []
    first, last, half = 10.0, 80.0, 40.0
    edges = np.arange(first, last + 2.5, 5.0)
    for name, lava in (('Newtonian', STIFFENING), ('Bingham', replace(STIFFENING, **STRONG))):
        solution = exact.CoolingSheet(
            lava, flux=FLUX, slope=SLOPE, length=LENGTH + REACH, initial=HOT, ambient=COLD,
            gravity=GRAVITY,
        )
        trial = _steady(solution, lava, accuracy, device)
        thicknesses, excesses = [], []
        for moment in (400.0, 600.0, 800.0, 1000.0):
            trial.advance(moment)
            grid = trial.field((first, -half, last, half))
            line, expected = grid.along_x(half), solution.thickness(grid.x + REACH)
            thicknesses.append([_in_bands(grid.x, values, edges) for values in (line, expected)])
            sample = trial.sample()
            x, y = sample.position.T
            middle = np.abs(y) < half
            x, volume = x[middle], sample.volume[middle]
            excess = sample.temperature[middle] - solution.temperature(x + REACH)
            excesses.append(_in_bands(x, volume * excess, edges) / _in_bands(x, volume, edges))
        trial.compare_mean(*np.mean(thicknesses, axis=0), f'thickness, {name}')
        apart = np.abs(np.mean(excesses, axis=0)).mean()
        cooled = HOT - float(solution.temperature(np.array(last)))
        trial.compare(f'temperature, {name}', apart, 0.0, 'K', scale=cooled)
        runs.append(trial.run())
    return case.joined(runs)


def _in_bands(x: np.ndarray, values: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the sums of values at places over the bands between edges."""
    return np.histogram(x, edges, weights=values)[0]


def advancing_sheet(accuracy: Accuracy, device: str) -> case.Trial:
    """Return the sheet of ``cooling_front``, from a fissure on an open slope."""
    return _fissure(
        STIFFENING, COOLING, accuracy, device, length=BOTTOM, thickness=1.5, width=OPEN_WIDTH,
        top=TOP,
    )


def middle_of(trial: case.Trial) -> tuple[np.ndarray, np.ndarray]:
    """Return places x and thickness [m] along the middle 60 m of an advancing sheet."""
    grid = trial.field((TOP, -30.0, BOTTOM - 10.0, 30.0))
    return grid.x, grid.along_x(30.0)


def centre_of_mass(x: np.ndarray, thickness: np.ndarray) -> float:
    """Return the mean place x of the lava of a profile [m]."""
    return float((x * thickness).sum() / thickness.sum())


def _run_front(accuracy: Accuracy, device: str) -> case.Run:
    """Compare an advancing sheet in the middle of a wide fissure.

    Maps smear the front over the kernel radius. That moves its edge forward, while the lava is
    behind, so the error of the edge has either sign. It does not move the centre of mass.
    """
    trial = advancing_sheet(accuracy, device)
    trial.advance(FRONT_TIME)
    x = exact.FRONT_FIRST + np.arange(len(exact.FRONT_PROFILE)) * CELL
    profile = np.array(exact.FRONT_PROFILE)
    place, line = middle_of(trial)
    trial.compare(
        'centre of mass', centre_of_mass(place, line), centre_of_mass(x, profile), 'm'
    )
    trial.compare_mean(line, np.interp(place, x, profile))
    return trial.run()


def _run_plane(accuracy: Accuracy, device: str) -> case.Run:
    """Compare footprint and front of a point source's flow."""
    vent = Vent((0.0, 0.0), DISCHARGE, radius=RADIUS, temperature=HOT)
    # groups of symmetric particles would stay on the axes, and the front would lag behind
    accuracy = replace(accuracy, symmetric=False)
    trial = case.Trial(
        Scene(case.plane(WINDOW, MAP, SLOPE), (vent,), STIFFENING, ambient_temperature=COLD),
        accuracy, device, effects=COOLING, spacing=2.14 / accuracy.refinement, thickness=1.5,
    )
    trial.advance(END)
    wet = trial.simulation.snapshot().footprint
    rows, columns = (np.arange(count) for count in wet.shape)
    offset = np.abs(rows - 0.5 * (len(rows) - 1))
    first = round((exact.PLANE_FIRST - WINDOW[0]) / MAP - 0.5)
    counts = np.zeros(len(columns))
    counts[first : first + len(exact.PLANE_CELLS)] = exact.PLANE_CELLS
    reference = offset[:, None] < counts
    apart = 1.0 - (wet & reference).sum() / (wet | reference).sum()
    trial.compare('footprint', apart, 0.0, '', scale=1.0)
    grid = trial.field((200.0, -60.0, 330.0, 60.0))
    front = case.front(grid.x, grid.thickness.max(axis=0), FRONT)
    trial.compare('front', front, exact.PLANE_FRONT, 'm')
    return trial.run()


def _fissure_profile(thickness: float, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Return places x [m], evenly spaced up to a length, and thickness [m] of a steady sheet.

    Lava at rest, with a level surface, lies above the fissure. In the fissure the flux F(x) grows
    linearly, and the slope of the surface is tan(SLOPE) F(x) / FLUX (h / h(x))^3, h far below.
    """
    x = np.linspace(TOP, length, 20001)
    flux = np.clip(0.5 * (x / REACH + 1.0), 0.0, 1.0)
    profile = np.full(x.shape, thickness)
    for i in range(np.searchsorted(x, REACH), 0, -1):
        fall = flux[i] * (thickness / max(profile[i], 1e-6)) ** 3
        below = profile[i] - (x[i] - x[i - 1]) * math.tan(SLOPE) * (1.0 - fall)
        profile[i - 1] = max(below, 0.0)
    return x, profile


def _run_insulated(accuracy: Accuracy, device: str) -> case.Run:
    """Compare the temperature along a sheet that moves under a crust, which stays in place.

    The crust is as old as the simulation. A column at x is a mixture of lava from all of the
    fissure, and where lava comes out far up, it takes longest to leave: its thickness times its
    speed is the flux so far.
    """
    lava = replace(STIFFENING, arrhenius=0.0, **UNDER_CRUST)
    weight = lava.density * GRAVITY * math.sin(SLOPE)
    normal = (3.0 * lava.viscosity * FLUX * math.cos(SLOPE) / weight) ** (1.0 / 3.0)
    thickness = normal / math.cos(SLOPE)
    speed = FLUX / thickness
    length, width = CRUSTED
    place, profile = _fissure_profile(thickness, length)
    # times to leave the fissure, from the middles of its parts
    edges = np.linspace(-REACH, REACH, 2001)
    middles = 0.5 * (edges[1:] + edges[:-1])
    flux = 0.5 * FLUX * (middles / REACH + 1.0)
    passing = np.diff(edges) * np.interp(middles, place, profile) / flux
    leaving = passing[::-1].cumsum()[::-1] - 0.5 * passing
    section = float(np.trapezoid(profile, place))
    count = round(section / thickness * width * (accuracy.refinement / SPACING) ** 2)
    fraction, y = case.strip(width, count)
    x = case.distributed(fraction, place, profile)
    trial = _fissure(
        lava, case.only('steep', 'insulation'), accuracy, device, length=length + 100.0,
        thickness=thickness, width=width, top=TOP,
        particles=Particles(np.column_stack([x, y]), section * width / count, HOT),
    )
    for moment in (300.0, 600.0):
        trial.advance(moment)
        sample = trial.sample()
        x, y = sample.position.T
        compared = (np.abs(y) < 40.0) & (x > 10.0) & (x < 50.0)
        ages = (x[compared, None] - REACH) / speed + leaving[::20]
        grown = exact.stefan_crust(lava, moment, ambient=COLD)
        grown = grown - exact.stefan_crust(lava, np.maximum(moment - ages, 0.0), ambient=COLD)
        expected = (HOT - lava.solidus) * float(grown.mean()) / normal
        found = HOT - sample.temperature[compared].mean()
        trial.compare(f'cooling after {moment:g} s', found, expected, 'K')
    return trial.run()


CASES = (
    case.Case('cooling_sheet', 'steady sheet that stiffens as it cools', 'heat balance',
              _run_sheet, ('steep', 'arrhenius', 'cooling', 'yielding')),
    case.Case('cooling_front', 'sheet that stiffens as it cools, on its way', 'finite volumes',
              _run_front, ('arrhenius', 'cooling')),
    case.Case('cooling_plane', 'point source that stiffens as it cools', 'finite volumes',
              _run_plane, ('arrhenius', 'cooling')),
    case.Case('insulated_sheet', 'sheet that moves under a crust', 'Stefan problem (Neumann)',
              _run_insulated, ('steep', 'insulation')),
)
