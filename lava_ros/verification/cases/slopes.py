# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Cases of lava that flows down an even slope, and forecasts of its arrival.

Solutions are along the slope, the simulation in plan: x = x_plan / cos b, h = h_vertical cos b.
"""

from dataclasses import replace
import math

import numpy as np

from lava_ros.forecast.forecast_run import ForecastRun
from lava_ros.scene import Scene, Vent
from lava_ros.simulation import Particles
from lava_ros.simulation.accuracy import Accuracy, COVERED
from lava_ros.verification import exact
from lava_ros.verification.cases import case
from lava_ros.verification.cases.case import GRAVITY, ISOTHERMAL, NU, SLOPING

#: Discharge of the point sources [m3/s].
DISCHARGE = 10.0

#: Slope of the strip and of the fissure [rad], and its cosine.
SLOPE = math.radians(20.0)
COSINE = math.cos(SLOPE)


def _run_fixed_area(accuracy: Accuracy, device: str) -> case.Run:
    """Compare a strip along its middle on a slope of 20 degrees, up to a length of 60 h cot b."""
    thickness = 1.0
    run_out = thickness / math.tan(SLOPE)
    last = 60.0 * run_out
    # a triangle-like profile holds (2/3) h_N x_N
    area = 2.0 / 3.0 * thickness * last
    solution = exact.SlopeFixedArea(area, SLOPE, NU, GRAVITY)
    end = solution.time_of_length(last)
    start = solution.time_of_length(last / 1.5)
    width = 24.0 * run_out
    spacing = 0.45 * run_out / accuracy.refinement
    mean = area / last / COSINE
    fraction, y = case.strip(width, round(area * width / (mean * spacing**2)))
    x = solution.length(start) * fraction ** (2.0 / 3.0) * COSINE
    window = (-8.0 * run_out, -width, (last + 8.0 * run_out) * COSINE, width)
    trial = case.Trial(
        Scene(case.plane(window, 1.5 * run_out, SLOPE), lava=ISOTHERMAL), accuracy, device,
        # the area in plan equals the area along the slope: h_vertical dx_plan = h dx
        particles=Particles(np.column_stack([x, y]), area * width / len(fraction), 1400.0),
        effects=SLOPING, spacing=spacing, thickness=mean,
    )
    trial.advance(end - start)
    grid = trial.field(window)
    line = grid.along_x(2.0 * run_out) * COSINE
    trial.compare('front', case.front(grid.x, line, 0.1 * thickness) / COSINE, last, 'm')
    return trial.run()


def _fissure(accuracy: Accuracy, device: str) -> tuple[exact.SlopeFlux, case.Window, case.Trial]:
    """Return a fissure across 20 degrees, on ground to more than 10 run-outs h cot b below."""
    flux = 0.5
    solution = exact.SlopeFlux(flux, SLOPE, NU, GRAVITY)
    run_out = solution.run_out
    width = 24.0 * run_out
    window = (-6.0 * run_out, -width, (10.0 * run_out + 8.0 * run_out) * COSINE, width)
    vent = Vent((0.0, -0.5 * width), flux * width, radius=0.2 * run_out, end=(0.0, 0.5 * width))
    trial = case.Trial(
        Scene(case.plane(window, 0.6 * run_out, SLOPE), (vent,), ISOTHERMAL), accuracy, device,
        effects=SLOPING, spacing=0.2 * run_out / accuracy.refinement,
        thickness=solution.thickness / COSINE,
    )
    return solution, window, trial


def _run_flux(accuracy: Accuracy, device: str) -> case.Run:
    """Compare the arrival of the front of a fissure's flow 10 run-outs h cot b below it."""
    solution, window, trial = _fissure(accuracy, device)
    gauge, threshold = 10.0 * solution.run_out, 0.1 * solution.thickness
    arrival = solution.arrival(gauge, threshold)
    times = arrival * np.linspace(0.5, 1.1, 7)
    fronts = []
    for time in times:
        trial.advance(time)
        grid = trial.field(window)
        line = grid.along_x(4.0 * solution.run_out) * COSINE
        fronts.append(case.front(grid.x, line, threshold) / COSINE)
    # NaN, which counts as an error, if the front is not between the first and the last
    measured = np.interp(gauge, fronts, times, left=math.nan, right=math.nan)
    trial.compare('arrival', measured, arrival, 's')
    trial.compare('speed', case.slope_of(times, np.array(fronts)), solution.speed, 'm/s')
    return trial.run()


def _run_ahead(accuracy: Accuracy, device: str) -> case.Run:
    """Compare arrivals below a fissure on a slope of 20 degrees with the arrivals in a fork.

    The fork starts when the front is 3 of 10 run-outs h cot b below the fissure. Compared are the
    cells from 5 to 10 run-outs down, in a band whose distance from the fissure's ends is 8.
    """
    solution, _, trial = _fissure(accuracy, device)
    run_out = solution.run_out
    last, threshold = 10.0 * run_out, COVERED * COSINE
    end = solution.arrival(last, threshold)
    start = 0.3 * end
    trial.advance(start)
    ahead = ForecastRun(
        trial.simulation.checkpoint(), horizon=1.1 * end - start, threshold=COVERED,
        device=device,
    )
    taken = ahead.simulation.steps
    forecast = ahead.run()
    # a cell is half covered at the end of the step in which the front passes its middle
    step = forecast.horizon / (ahead.simulation.steps - taken)
    terrain = forecast.terrain
    rows, columns = (np.arange(count) + 0.5 for count in terrain.elevation.shape)
    x = (terrain.origin[0] + columns * terrain.resolution) / COSINE
    y = terrain.origin[1] + rows * terrain.resolution
    here = np.ix_(np.abs(y) < 4.0 * run_out, (x > 0.5 * last) & (x < last))
    measured = ahead.peaks.seen(ahead.simulation).half_inundated[here]
    exactly = 0.5 * step + np.broadcast_to(
        [solution.arrival(place, threshold) for place in x[here[1][0]]], measured.shape
    )
    trial.compare('arrival', measured.mean(), exactly.mean(), 's')
    # NaN, which counts as an error, where the front did not arrive
    worst = np.unravel_index(np.argmax(np.abs(measured / exactly - 1.0)), measured.shape)
    trial.compare('worst cell', measured[worst], exactly[worst], 's')
    run, steps = trial.run(), ahead.simulation.snapshot().steps
    return replace(
        run,
        particles=forecast.particle_count,
        steps=steps.count,
        evaluations=steps.evaluations,
        simulated_time=forecast.time + forecast.horizon,
        wall_time=run.wall_time + forecast.duration,
    )


def _source(
    slope: float, window: case.Window, accuracy: Accuracy, device: str, **sizes: float
) -> tuple[exact.ListerScales, case.Window, case.Trial]:
    """Return a small round source at (0, 0) on a slope.

    Lengths are over Lister's scale L: ``window``, which is returned in metres, and ``sizes``,
    namely ``spacing``, ``radius`` of the vent and ``cell``.
    """
    scales = exact.ListerScales(DISCHARGE, slope, NU, GRAVITY)
    x0, y0, x1, y1 = (scales.length * place for place in window)
    spacing, radius, cell = (sizes[name] * scales.length for name in ('spacing', 'radius', 'cell'))
    vent = Vent((0.0, 0.0), DISCHARGE, radius=radius)
    trial = case.Trial(
        Scene(case.plane((x0, y0, x1, y1), cell, slope), (vent,), ISOTHERMAL), accuracy, device,
        effects=SLOPING, spacing=spacing / accuracy.refinement,
        thickness=0.5 * scales.thickness / math.cos(slope),
    )
    return scales, (x0, y0, x1, y1), trial


def _run_lister(accuracy: Accuracy, device: str) -> case.Run:
    """Compare front and half-width on 5 degrees where the flow is thicker than 0.02 h0."""
    slope = math.radians(5.0)
    cosine = math.cos(slope)
    scales, window, trial = _source(
        slope, (-3.0, -7.0, 35.0, 7.0), accuracy, device, spacing=0.18, radius=0.3, cell=0.5
    )
    threshold = 0.02 * scales.thickness
    for time in (20.0, 50.0, 100.0):
        trial.advance(time * scales.time)
        grid = trial.field(window)
        thickness = grid.thickness * cosine
        length = case.front(grid.x, thickness.max(axis=0), threshold) / cosine
        half = case.half_width(grid.y, thickness.max(axis=1), threshold)
        x, y = exact.LISTER_REFERENCE[time]
        trial.compare(f'x at {time:g} T', length / scales.length, x, 'L')
        trial.compare(f'y at {time:g} T', half / scales.length, y, 'L')
    return trial.run()


def _run_smith(accuracy: Accuracy, device: str) -> case.Run:
    """Compare the steady flow eighteen run-outs below a source; it leaves the map soon after.

    The outer tenth of the width carries 4e-4 of the flux, a particle in more than a hundred T,
    so the half-width is taken where the flow is half as thick as on its axis.

    By a finite-volume solution of Lister's equation, the terms that Smith neglects and a source of
    radius 0.5 L instead of a point make this half-width finally 0.2 % larger here, the spread
    0.8 % larger and the axis 0.2 % thinner; twelve run-outs down it is twice as much. The
    half-width has that value after 600 T. The spread, which includes the creeping edges, is 4 %
    below it at 350 T, 1.2 % at 800 T and 0.6 % at 1200 T. The mean over samples between the last
    two is compared.
    """
    slope, station = math.radians(10.0), 18.0
    cosine = math.cos(slope)
    scales, window, trial = _source(
        slope, (-3.0, -11.0, station + 3.0, 11.0), accuracy, device,
        spacing=0.3, radius=0.5, cell=1.0,
    )
    solution = exact.SteadySource(DISCHARGE, slope, NU, GRAVITY)
    unit = scales.length
    x = station * unit
    threshold = 0.5 * solution.axis(x)
    halves, axes, squares = [], [], []
    for time in np.linspace(800.0, 1200.0, 9):
        trial.advance(float(time) * scales.time)
        grid = trial.field(window)
        band = np.abs(grid.x / cosine - x) < 2.0 * unit
        across = grid.thickness[:, band].mean(axis=1) * cosine
        halves.append(case.half_width(grid.y, across, threshold))
        axes.append(across[np.abs(grid.y) < 0.5 * unit].mean())
        position = trial.sample().position
        here = position[np.abs(position[:, 0] / cosine - x) < 2.0 * unit]
        # relative to the width at their distance, because the flow is wider further down
        shares = [y / solution.half_width(down / cosine) for down, y in here]
        squares.append(np.mean(np.square(shares)))
    trial.compare('half-width', np.mean(halves), solution.half_width(x, threshold), 'm')
    width = solution.half_width(x)
    # the profile 1 - s^2 has a mean square of s of 1/5
    trial.compare('spread', width * math.sqrt(np.mean(squares)), width / math.sqrt(5.0), 'm')
    trial.compare('axis thickness', np.mean(axes), solution.axis(x), 'm')
    return trial.run()


CASES = (
    case.Case('slope_fixed_area', 'fixed area down a slope', 'Huppert 1982 (Nature)',
              _run_fixed_area, ('steep',)),
    case.Case('slope_flux', 'constant flux down a slope', 'Huppert 1982 (Nature)', _run_flux,
              ('steep',)),
    case.Case('lister', 'point source on a slope', 'Lister 1992', _run_lister, ('steep',)),
    case.Case('smith', 'steady point source on a slope', 'Smith 1973', _run_smith, ('steep',)),
    case.Case('look_ahead', 'forecast of arrival times', 'Huppert 1982 (Nature)', _run_ahead,
              ('steep',)),
)
