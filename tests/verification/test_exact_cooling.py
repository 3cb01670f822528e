# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Cooling flows: the exact sheet, and finite volumes against exact solutions."""

import csv
from dataclasses import replace
import math
from pathlib import Path

import numpy as np
import pytest

from lava_ros.verification import exact
from lava_ros.verification.cases import cooling
from lava_ros.verification.cases.case import GRAVITY
from scripts import load_script

FLUX, SLOPE, HOT, COLD = cooling.FLUX, cooling.SLOPE, cooling.HOT, cooling.COLD
STRONG = replace(cooling.STIFFENING, **cooling.STRONG)
SCRIPT = Path(__file__).parents[2] / 'docs/benchmarks/cooling_plane.py'
TABLE = SCRIPT.with_suffix('.csv')
reference = load_script(SCRIPT)


def sheet(lava, slope=SLOPE, length=100.0):
    return exact.CoolingSheet(
        lava, flux=FLUX, slope=slope, length=length, initial=HOT, ambient=COLD, gravity=GRAVITY
    )


@pytest.mark.parametrize('lava', [cooling.STIFFENING, STRONG])
@pytest.mark.parametrize('degrees', [6.0, 20.0])
def test_cooling_sheet_carries_its_flux_and_loses_its_heat(lava, degrees):
    slope = math.radians(degrees)
    solution = sheet(lava, slope)
    x = np.linspace(5.0, 95.0, 10)
    thickness, temperature = solution.thickness(x), solution.temperature(x)
    rise = (solution.thickness(x + 0.5) - solution.thickness(x - 0.5)) / 1.0
    cooler = lava.reference_temperature - temperature
    for h, h_x, cold in zip(thickness, rise, cooler, strict=True):
        depth, surface = h * math.cos(slope) ** 2, math.tan(slope) - h_x
        angle = math.asin(surface)
        speed = exact.herschel_bulkley_velocity(
            depth, angle, density=lava.density, gravity=GRAVITY, index=1.0,
            consistency=lava.viscosity * math.exp(lava.arrhenius * cold),
            strength=lava.yield_strength * math.exp(lava.yield_rate * cold),
        )
        assert h * speed == pytest.approx(FLUX, rel=2e-3)
    fall = (solution.temperature(x - 0.5) - solution.temperature(x + 0.5)) / 1.0
    supply = lava.density * lava.specific_heat * FLUX
    assert supply * fall == pytest.approx(exact.surface_loss(lava, temperature, COLD), rel=1e-4)


def test_sheet_of_constant_viscosity_is_uniform():
    solution = sheet(replace(cooling.STIFFENING, arrhenius=0.0))
    thickness = solution.thickness(np.array([0.0, 50.0, 100.0]))
    assert thickness == pytest.approx(thickness[0], rel=1e-6)
    nu = cooling.STIFFENING.viscosity / cooling.STIFFENING.density
    even = exact.SlopeFlux(FLUX * math.cos(SLOPE), SLOPE, nu, GRAVITY)
    assert even.thickness / math.cos(SLOPE) == pytest.approx(thickness[0], rel=0.01)


def test_finite_volumes_approach_the_steady_sheet():
    x, thickness, temperature = reference.front_profile()
    volume = cooling.FLUX * cooling.FRONT_TIME
    assert thickness.sum() * cooling.CELL == pytest.approx(volume, rel=1e-9)
    first, known = x.tolist().index(exact.FRONT_FIRST), np.zeros(len(x))
    known[first : first + len(exact.FRONT_PROFILE)] = exact.FRONT_PROFILE
    assert thickness == pytest.approx(known, abs=5e-4)
    assert temperature.max() <= HOT
    here = (x > 8.0) & (x < 50.0)
    solution = sheet(cooling.STIFFENING)
    # in plan view the scheme omits a factor cos^4 b of the speed
    place = x[here] + cooling.REACH
    expected = solution.thickness(place) * math.cos(SLOPE) ** (4.0 / 3.0)
    assert thickness[here] == pytest.approx(expected, rel=0.005)
    assert temperature[here] == pytest.approx(solution.temperature(place), abs=0.5)


def test_finite_volumes_are_symmetric():
    x = np.arange(-20.0, 20.0, 2.0) + 1.0
    source = np.where(np.hypot(x, x[:, None]) < 5.0, 0.02, 0.0)
    thickness, temperature = reference.cooling_flow(
        cooling.STIFFENING, source, 2.0, 0.0, 200.0, initial=HOT, ambient=COLD, gravity=GRAVITY
    )
    for field in (thickness, temperature):
        assert field == pytest.approx(field.T, rel=1e-9)
        assert field == pytest.approx(field[::-1], rel=1e-9)


def test_reference_of_the_plane_is_the_finest_row_of_a_converging_table():
    with TABLE.open(encoding='utf-8') as file:
        rows = {float(row.pop('cell')): row for row in csv.DictReader(file)}
    counts = {
        cell: np.array([int(value) for key, value in row.items() if key != 'front'])
        for cell, row in rows.items()
    }
    places = np.array([float(key) for key in rows[5.0] if key != 'front'])
    reference = finest = min(rows)
    assert float(rows[reference]['front']) == exact.PLANE_FRONT
    wet = np.flatnonzero(counts[reference])
    assert places[wet[0]] == exact.PLANE_FIRST
    assert counts[reference][wet].tolist() == list(exact.PLANE_CELLS)
    apart = [
        abs(counts[cell] - counts[finest]).sum() / counts[finest].sum()
        for cell in sorted(rows, reverse=True)
    ]
    assert apart == sorted(apart, reverse=True) and apart[-2] < 0.045 < 0.06 < apart[0]
