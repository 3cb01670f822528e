# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Centre of mass of an advancing sheet, on cells and below a wall.

Particles stay at the foot of a wall above the fissure: an error that falls with the spacing, and
that the case cooling_front does not have.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from lava_ros.simulation.presets import PRESETS
from lava_ros.verification.cases import cooling
from scripts import load_script

pytestmark = pytest.mark.nightly

reference = load_script(Path(__file__).parents[2] / 'docs/benchmarks/cooling_plane.py')

#: Side of the cells of the finite volumes [m]; on half of it the centre of mass changes by 3e-4.
CELL = 0.625


def walled(accuracy, device):
    """Return the sheet of the case below a wall."""
    return cooling._fissure(
        cooling.STIFFENING, cooling.COOLING, accuracy, device, length=cooling.BOTTOM,
        thickness=1.5, width=cooling.OPEN_WIDTH,
    )


@cache
def finite_volumes(top):
    """Return the centre of mass [m] by finite volumes, on a slope that begins at a place [m]."""
    return cooling.centre_of_mass(*reference.front_profile(CELL, top=top)[:2])


def behind(make, method, refinements):
    """Return by how much the centre of mass of a sheet is behind [m], by refinement."""
    exact, found = finite_volumes(-cooling.REACH if make is walled else cooling.TOP), []
    for refinement in refinements:
        accuracy = replace(PRESETS['standard'].accuracy, refinement=refinement, method=method)
        trial = make(accuracy, 'cpu')
        trial.advance(cooling.FRONT_TIME)
        found.append(exact - cooling.centre_of_mass(*cooling.middle_of(trial)))
    return np.array(found)


def order(refinements, values):
    """Return the order in the spacing of errors of one sign."""
    return -np.polyfit(np.log(refinements), np.log(values), 1)[0]


def test_centre_of_mass_on_cells_has_its_order():
    # measured 1.8; test_cases.py has the order of particles
    refinements = 0.25, 0.5, 1.0
    found = behind(cooling.advancing_sheet, 'cells', refinements)
    # each finer one is nearer
    assert (found > 0.0).all() and (np.diff(found) < 0.0).all()
    assert order(refinements, found) > 1.0


def test_lava_at_the_foot_of_a_wall_falls_with_the_spacing():
    # measured 1.0; with fewer particles the wall has no row of its own
    refinements = 0.5, 0.7, 1.0
    found = behind(walled, 'particles', refinements)
    assert (np.diff(found) < 0.0).all()
    assert order(refinements, found) > 0.6
    # most of the error at the usual spacing, which an open slope does not have
    assert found[-1] > 2.0 * behind(cooling.advancing_sheet, 'particles', (1.0,))[0]
