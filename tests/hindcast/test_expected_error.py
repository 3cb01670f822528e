# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Expected error of an inundated area: its parts, and its accuracy."""

import csv
from dataclasses import replace
import math
from pathlib import Path

import numpy as np
import pytest

from lava_ros.hindcast.case import Case
from lava_ros.hindcast.expected_error import COARSER, difference, estimate_error, ORDER
from lava_ros.hindcast.replicates import Agreement
from lava_ros.hindcast.run import Result, Settings, simulate
from lava_ros.hindcast.score import score_case

MEASURED = Path(__file__).parents[2] / 'docs/benchmarks/convergence_h100.csv'


SETTINGS = Settings('draft', device='cpu', maps=1)


@pytest.fixture(scope='module')
def result(valley: Case) -> Result:
    """Simulate the case."""
    return simulate(valley, SETTINGS)


def test_error_of_the_spacing_is_that_of_a_pilot(valley, result):
    """A coarser run and the order of convergence give the error of the particle spacing."""
    found = estimate_error(valley, SETTINGS, result)
    coarser = replace(SETTINGS, spacing=COARSER * result.accuracy.spacing)
    pilot = simulate(valley, coarser)
    apart = difference(pilot.snapshot.inundated, result.snapshot.inundated)
    assert 0.0 < apart < 1.0
    nothing = np.zeros((3, 3), dtype=bool)
    assert (difference(nothing, nothing), difference(nothing, ~nothing)) == (0.0, 1.0)
    assert found.particles == pytest.approx(apart / (COARSER**ORDER - 1.0))
    assert found.cells == result.resolution.cell_error > 0.0
    assert math.isnan(found.chance) and found.as_dict()['chance'] is None
    assert found.total == pytest.approx(math.hypot(found.particles, found.cells, found.effects))
    assert 'chance' not in found.text()


def test_chance_is_the_expected_difference_of_two_runs(valley, result):
    covered = result.snapshot.inundated
    one = score_case(valley, result.snapshot.thickness, covered)
    fraction = covered * 1.0
    fork = np.argwhere(covered)[: int(covered.sum()) // 2]
    fraction[tuple(fork.T)] = 0.5
    forked = Agreement((one,) * 4, fraction, result.snapshot.thickness, one)
    found = estimate_error(valley, SETTINGS, result, forked)
    # with two of four runs in a cell, two runs differ there with a probability of 2/3
    apart = 2.0 / 3.0 * len(fork)
    union = covered.sum() - len(fork) + len(fork) * 0.5 + 0.5 * apart
    assert found.chance == pytest.approx(apart / union)
    assert found.total > found.chance
    assert 'chance' in found.text()
    agreed = Agreement((one,) * 4, covered * 1.0, result.snapshot.thickness, one)
    assert estimate_error(valley, SETTINGS, result, agreed).chance == 0.0


@pytest.mark.parametrize('preset', ['draft', 'standard'])
def test_expected_error_is_within_a_factor_of_two_of_the_actual_error(preset):
    """This holds in 16 of 18 cases; in a V-shaped valley whole rows of cells change at once."""
    with MEASURED.open(encoding='utf-8') as file:
        rows = [row for row in csv.DictReader(file) if row['preset'] == preset]
    # the runs that are compared share the terrain and the effects
    ratios = {
        row['scene']: float(row['actual'])
        / math.hypot(float(row['expected_particles']), float(row['chance']))
        for row in rows
    }
    assert len(ratios) == 18
    assert sum(0.5 <= ratio <= 2.0 for ratio in ratios.values()) >= 16
    assert {name for name, ratio in ratios.items() if ratio > 3.0} <= {'valley'}
    for row in rows:
        names = 'expected_particles', 'expected_cells', 'chance'
        assert float(row['actual']) <= 3.0 * math.hypot(*(float(row[name]) for name in names))
