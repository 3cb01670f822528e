# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Exact solutions against their equations, published values and limits."""

from collections.abc import Callable
from functools import partial
import math

import numpy as np
import pytest
from scipy import sparse
from scipy.integrate import quad, solve_bvp, solve_ivp, trapezoid
from scipy.optimize import brentq
from scipy.sparse.linalg import spsolve

from lava_ros.verification import exact

NU, GRAVITY = 4.0, 9.81

ALPHA = GRAVITY / (3.0 * NU)


def slope_of(function: Callable, place: float, step: float) -> float:
    return (function(place + step) - function(place - step)) / (2.0 * step)


def similarity_profile(rhs: Callable, slope: float, end: float, *, gap: float = 1e-7):
    """Integrate (f^4 / 4, f^3 f', int f) from a front at 1 backwards, where f^3 = slope (1 - x).

    ``rhs(x, f, flux)`` is the derivative of flux = f^3 f'.
    """
    f = (slope * gap) ** (1.0 / 3.0)
    start = [f**4 / 4.0, -slope * f / 3.0, 0.75 * f * gap]

    def derivatives(x, y):
        f = (4.0 * max(y[0], 1e-30)) ** 0.25
        return [y[1], rhs(x, f, y[1]), -f]

    return solve_ivp(
        derivatives, (1.0 - gap, end), start, rtol=1e-10, atol=1e-13, dense_output=True
    )


def test_huppert_solution_satisfies_its_equation():
    """R = 0.894 (g V^3 t / 3 nu)^(1/8), h0 = 0.531 (3 nu V / (g t))^(1/4), as published.

    h_t = (g / 3 nu) (1/r) d/dr (r h^3 dh/dr).
    """
    solution = exact.FixedVolumeSpread(1e5, NU, GRAVITY)
    assert solution.RADIUS == pytest.approx(0.89391, abs=1e-5)
    assert solution.HEIGHT == pytest.approx(0.53113, abs=1e-5)
    time = 1e4
    height = partial(solution.thickness, time=time)
    radius = solution.radius(time)
    volume = quad(lambda r: 2 * math.pi * r * height(r), 0, radius)[0]
    assert volume == pytest.approx(1e5, rel=1e-5)
    r = 0.5 * radius
    spread = slope_of(lambda r: r * height(r) ** 3 * slope_of(height, r, 1e-2), r, 1.0)
    rate = slope_of(lambda t: solution.thickness(r, t), time, 1.0)
    assert ALPHA * spread / r == pytest.approx(rate, rel=1e-3)
    assert height(solution.radius_of_thickness(0.3, time)) == pytest.approx(0.3)
    places = solution.particles(8000, time)
    assert np.hypot(*places.T).max() < radius
    root = math.sqrt((places**2).sum(axis=1).mean())
    assert root == pytest.approx(solution.rms_radius(time), rel=1e-4)
    assert np.abs(places.mean(axis=0)).max() < 1e-3 * radius


def test_constant_flux_coefficient():
    """(x f^3 f')' + x^2 f' / 2 = 0, with a front at 1, has 2 pi int x f = eta_N^(-8/3)."""
    profile = similarity_profile(lambda x, f, flux: -flux / x - 0.5 * x * flux / f**3, 1.5, 1e-3)
    integral = quad(lambda x: x * (4 * profile.sol(x)[0]) ** 0.25, 1e-3, 1 - 1e-7, limit=200)[0]
    front = (2.0 * math.pi * integral) ** -0.375
    assert exact.ConstantFluxSpread.RADIUS == pytest.approx(front, abs=2e-5)
    solution = exact.ConstantFluxSpread(10.0, NU, GRAVITY)
    scale = (ALPHA * 10.0**3) ** 0.125
    assert solution.radius(3600.0) == pytest.approx(front * scale * 60.0, rel=1e-4)
    # thickness at the front against the whole profile
    x = solution.radius_of_thickness(0.3, 3600.0) / solution.radius(3600.0)
    height = (10.0 / ALPHA) ** 0.25 * front ** (2 / 3) * (4 * profile.sol(x)[0]) ** 0.25
    assert height == pytest.approx(0.3, rel=0.01)


def test_constant_flux_profile():
    solution = exact.ConstantFluxSpread(10.0, NU, GRAVITY)
    radius = solution.radius(3600.0)
    r = np.linspace(0.0, radius, 100_001)
    thickness = solution.thickness(r, 3600.0)
    assert trapezoid(2.0 * math.pi * r * thickness, r) == pytest.approx(36000.0, rel=1e-4)
    ends = np.array([0.0, 1.01 * radius])
    assert solution.flux(ends, 3600.0) == pytest.approx([10.0, 0.0], rel=1e-4)
    # outflow of a circle is the supply less the change of the stored volume
    inner = 0.6 * radius
    grid = np.linspace(0.0, inner, 100_001)

    def held(time):
        return trapezoid(2.0 * math.pi * grid * solution.thickness(grid, time), grid)

    assert solution.flux(inner, 3600.0) == pytest.approx(
        10.0 - slope_of(held, 3600.0, 10.0), rel=1e-3
    )
    near = radius * (1.0 - 1e-4)
    there = solution.radius_of_thickness(float(solution.thickness(near, 3600.0)), 3600.0)
    assert there == pytest.approx(near, rel=1e-5)


def test_plane_fixed_area_satisfies_its_equation():
    solution = exact.PlaneFixedArea(50.0, NU, GRAVITY)
    integral = quad(lambda s: (1 - s * s) ** (1 / 3), 0, 1)[0]
    assert solution.SHAPE == pytest.approx(integral, rel=1e-6)
    assert solution.LENGTH == pytest.approx(1.41124, abs=1e-5)
    time = solution.time_of_length(80.0)
    height = partial(solution.thickness, time=time)
    assert solution.length(time) == pytest.approx(80.0)
    assert quad(height, 0, 80)[0] == pytest.approx(50.0, rel=1e-6)
    speed = -ALPHA * height(79.99) ** 2 * slope_of(height, 79.99, 1e-4)
    assert speed == pytest.approx(slope_of(solution.length, time, 1.0), rel=1e-3)


def test_dam_break_coefficients():
    """(f^3 f')' + x f' / 2 = 0 with f = 1 far behind: front 0.28430 sqrt(3), area 0.25732."""

    def far(front):
        profile = similarity_profile(lambda x, f, flux: -0.5 * x * flux / f**3, 1.5, -12.0 / front)
        return front ** (2 / 3) * (4 * profile.y[0, -1]) ** 0.25 - 1.0, profile

    front = brentq(lambda guess: far(guess)[0], 0.4, 0.6, xtol=1e-8)
    assert exact.DamBreak.FRONT == pytest.approx(front, abs=2e-5)
    assert exact.DamBreak.FRONT / math.sqrt(3.0) == pytest.approx(0.28430)
    passed = front ** (5 / 3) * far(front)[1].sol(0.0)[2]
    assert exact.DamBreak.PASSED == pytest.approx(passed, abs=2e-5)
    solution = exact.DamBreak(2.0, NU, GRAVITY)
    time = solution.time_of_reach(15.0)
    expected = 0.28430 * 2.0 * math.sqrt(GRAVITY * 2.0 * time / NU)
    assert solution.front_of_thickness(0.0, time) == pytest.approx(expected)


def test_fixed_area_on_a_slope():
    """The front moves at g sin b h^2 / (3 nu)."""
    slope = math.radians(20.0)
    solution = exact.SlopeFixedArea(100.0, slope, NU, GRAVITY)
    time = solution.time_of_length(150.0)
    assert solution.length(time) == pytest.approx(150.0)
    area = quad(lambda x: float(solution.thickness(x, time)), 0.0, 150.0)[0]
    assert area == pytest.approx(100.0, rel=1e-6)
    height = float(solution.thickness(150.0 - 1e-9, time))
    speed = slope_of(solution.length, time, 0.1)
    assert speed == pytest.approx(GRAVITY * math.sin(slope) * height**2 / (3 * NU), rel=1e-4)


def test_travelling_front_carries_its_flux():
    slope = math.radians(20.0)
    solution = exact.SlopeFlux(0.5, slope, NU, GRAVITY)
    drive = ALPHA * solution.thickness**3 * math.sin(slope)
    assert drive == pytest.approx(0.5)
    for height in (0.1, 0.5 * solution.thickness, 0.95 * solution.thickness):
        rise = -1.0 / slope_of(solution.behind_toe, height, 1e-5)
        flux = ALPHA * height**3 * (math.sin(slope) - math.cos(slope) * rise)
        assert flux == pytest.approx(solution.speed * height, rel=1e-5)
    # volume of the pond, the sheet and the front up to the toe
    time = 100.0
    toe = brentq(lambda x: solution.arrival(x, 0.0) - time, 0.0, 1e3)
    pond = 0.5 * solution.thickness * solution.run_out
    lacking = quad(solution.behind_toe, 0.0, solution.thickness, limit=200)[0]
    assert pond + solution.thickness * toe - lacking == pytest.approx(0.5 * time, rel=1e-6)
    later = solution.arrival(30.0 + solution.behind_toe(0.1), 0.0)
    assert solution.arrival(30.0, 0.1) == pytest.approx(later)


def test_smith_satisfies_its_equation():
    assert exact.SteadySource.WIDTH == pytest.approx(2.29317, abs=1e-5)
    assert exact.SteadySource.HEIGHT == pytest.approx(1.12685, abs=1e-5)
    ratio = exact.SteadySource.HEIGHT / exact.SteadySource.WIDTH**2
    assert ratio == pytest.approx(3.0 / 14.0)
    s, f = np.polynomial.Polynomial([0.0, 1.0]), np.polynomial.Polynomial([1.0, 0.0, -1.0])
    down, across = -3.0 / 7.0 * (s * f**3).deriv(), 3.0 / 14.0 * (f**3 * f.deriv()).deriv()
    assert across.coef == pytest.approx(down.coef)
    slope = math.radians(10.0)
    solution = exact.SteadySource(10.0, slope, NU, GRAVITY)
    for x in (50.0, 500.0):
        width, axis = solution.half_width(x), solution.axis(x)
        cubes = quad(lambda s: (axis * (1 - s * s)) ** 3 * width, -1.0, 1.0)[0]  # noqa: B023
        assert ALPHA * math.sin(slope) * cubes == pytest.approx(10.0)
    half = solution.half_width(50.0, 0.5 * solution.axis(50.0))
    assert half == pytest.approx(solution.half_width(50.0) / math.sqrt(2.0))


def test_lister_scales_balance_supply_and_speeds():
    slope = math.radians(5.0)
    scales = exact.ListerScales(10.0, slope, NU, GRAVITY)
    assert 10.0 * scales.time == pytest.approx(scales.length**2 * scales.thickness)
    down = ALPHA * math.sin(slope) * scales.thickness**2 * scales.time
    assert down == pytest.approx(scales.length)
    # late, the flow's length grows as t^(7/9) and its width as t^(1/3) (Lister 1992)
    (x0, y0), (x1, y1) = exact.LISTER_REFERENCE[50.0], exact.LISTER_REFERENCE[200.0]
    assert math.log(x1 / x0, 4.0) == pytest.approx(7.0 / 9.0, abs=0.02)
    assert math.log(y1 / y0, 4.0) == pytest.approx(1.0 / 3.0, abs=0.03)


@pytest.mark.parametrize('ratio', [1.0, 2.5, 5.0])
def test_channel_velocity_is_that_of_stokes_flow(ratio):
    """Finite differences of lap u = -1 in a channel, u = 0 on bed and walls, du/dz = 0 on top."""
    count = 40
    step, across = 1.0 / count, round(ratio * count)

    def second_difference(cells: int, last: float) -> sparse.spmatrix:
        # walls are half a cell beyond the outer cells
        middle = np.full(cells, -2.0)
        middle[0], middle[-1] = -3.0, last
        return sparse.diags_array([np.ones(cells - 1), middle, np.ones(cells - 1)],
                                  offsets=[-1, 0, 1])

    up, sideways = second_difference(count, -1.0), second_difference(across, -3.0)
    laplacian = sparse.kronsum(sideways, up, format='csc') / step**2
    speed = spsolve(laplacian, -np.ones(count * across))
    mean = exact.channel_mean_velocity(2.0 * ratio, 2.0)
    assert 3.0 * speed.mean() == pytest.approx(mean, rel=2e-3)


@pytest.mark.parametrize('wavelength', [2.0, 4.0, 20.0])
def test_wave_response_is_that_of_stokes_flow(wavelength):
    """The mean of U'' = x^2 U - 1 over depth, U = 0 at the bed, U' = 0 on top, times 3."""
    x = 2.0 * math.pi / wavelength
    solved = solve_bvp(
        lambda z, u: np.array([u[1], x**2 * u[0] - 1.0]), lambda a, b: np.array([a[0], b[1]]),
        np.linspace(0.0, 1.0, 51), np.zeros((2, 51)), tol=1e-8,
    )
    mean = quad(lambda z: solved.sol(z)[0], 0.0, 1.0)[0]
    assert exact.wave_response(math.pi / wavelength, 2.0) == pytest.approx(3.0 * mean, rel=1e-6)


WEIGHT = 2600.0 * 9.81


@pytest.mark.parametrize('index', [0.5, 1.0, 2.0])
@pytest.mark.parametrize('strength', [0.0, 900.0])
def test_sheet_is_the_integral_of_its_strain_rate(index, strength):
    """The strain rate is ((tau - tau_y) / K)^(1/n)."""
    thickness, slope, consistency = 1.4, 0.2, 3e3
    pull = WEIGHT * math.sin(slope)

    def strain_rate(z):
        return (max(pull * (thickness - z) - strength, 0.0) / consistency) ** (1.0 / index)

    # the shear at z moves all lava above
    sheared = thickness - strength / pull
    flux = quad(lambda z: strain_rate(z) * (thickness - z), 0.0, sheared)[0]
    found = exact.herschel_bulkley_velocity(
        thickness, slope, density=2600.0, consistency=consistency, strength=strength, index=index,
        gravity=9.81,
    )
    assert found == pytest.approx(flux / thickness, rel=1e-9)


def test_sheet_has_a_newtonian_limit_and_a_critical_thickness():
    newtonian = exact.sheet_velocity(1.4, 0.2, 3e3 / 2600.0, 9.81)
    options = {'density': 2600.0, 'consistency': 3e3, 'index': 1.0, 'gravity': 9.81}
    found = exact.herschel_bulkley_velocity(1.4, 0.2, strength=0.0, **options)
    assert found == pytest.approx(newtonian)
    critical = exact.critical_thickness(900.0, 0.2, density=2600.0, gravity=9.81)
    speeds = [
        exact.herschel_bulkley_velocity(ratio * critical, 0.2, strength=900.0, **options)
        for ratio in (0.999, 1.001)
    ]
    assert speeds[0] == 0.0 < speeds[1]


def test_dome_has_its_volume_and_the_yield_stress():
    """The dome has rho g h |dh/dr| = tau_y."""
    dome = exact.BinghamDome(1.5e5, 1e4, 2600.0, 9.81)
    volume = quad(lambda r: 2 * math.pi * r * dome.thickness(r), 0, dome.radius)[0]
    moment = quad(lambda r: 2 * math.pi * r**3 * dome.thickness(r), 0, dome.radius)[0]
    assert volume == pytest.approx(1.5e5, rel=1e-6)
    assert dome.rms_radius == pytest.approx(math.sqrt(moment / volume), rel=1e-6)
    r = np.array([10.0, 50.0, 90.0])
    stress = -WEIGHT * dome.thickness(r) * slope_of(dome.thickness, r, 1e-4)
    assert stress == pytest.approx(1e4, rel=1e-6)
    assert dome.thickness(dome.radius_of_thickness(2.0)) == pytest.approx(2.0)
    places = dome.particles(2000, dome.radius)
    assert np.sqrt((places**2).sum(axis=1).mean()) == pytest.approx(dome.rms_radius, rel=1e-4)


def test_ridge_has_the_yield_stress_everywhere():
    slope, strength = math.radians(20.0), 5e3
    ridge = exact.Ridge(0.9, strength, slope, WEIGHT)
    section = 2.0 * quad(ridge.thickness, 0, ridge.half_width)[0]
    assert section == pytest.approx(ridge.section, rel=1e-6)
    assert ridge.thickness(np.array(0.0)) == pytest.approx(0.9 * ridge.critical)
    y = np.linspace(0.05, 0.95, 7) * ridge.half_width
    rise = slope_of(ridge.thickness, y, 1e-6)
    stress = WEIGHT * ridge.thickness(y) * np.hypot(math.sin(slope), math.cos(slope) * rise)
    assert stress == pytest.approx(strength, rel=1e-5)
    assert ridge.thickness(ridge.distance_of_thickness(0.1)) == pytest.approx(0.1)


def test_levee_is_twice_as_wide_as_that_of_hulme():
    slope, strength = math.radians(5.0), 5e3
    ridge = exact.Ridge(1.0, strength, slope, WEIGHT)
    hulme = strength / (2.0 * WEIGHT * math.sin(slope) ** 2)
    assert ridge.half_width == pytest.approx(2.0 * math.cos(slope) * hulme)
    near = 1e-3 * ridge.half_width
    parabola = math.sqrt(2.0 * strength * near / (WEIGHT * math.cos(slope)))
    edge = ridge.thickness(np.array(ridge.half_width - near))
    assert edge == pytest.approx(parabola, rel=1e-3)
