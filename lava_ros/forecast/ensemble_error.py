# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Numerical error of an ensemble, measured on a run with the inputs of its scene."""

import json
from pathlib import Path

from lava_ros.errors import refusing
from lava_ros.files import open_input, write_output
from lava_ros.files.yaml import parse_json
from lava_ros.forecast.members import Plan
from lava_ros.forecast.partner_runs import measure_error
from lava_ros.runs.drive import drive
from lava_ros.simulation import Simulation
from lava_ros.simulation.numerical_error import Areas, NumericalError

#: Minimum number of members for a measurement: the run and its partner runs take a little more
#: than one member, so at most a tenth of the time of the ensemble.
MIN_MEMBERS = 12

#: File with the error, in the folder of the ensemble.
FILE = 'numerical_error.json'


def measure_ensemble_error(
    plan: Plan, members: int, folder: Path, *, device: str | None = None
) -> NumericalError | None:
    """Measure the error, or read the error that an earlier call with the same effects has stored.

    Args:
        plan: Plan of the members.
        members: Their number.
        folder: Folder of the ensemble.
        device: Warp device; None for the first GPU, or the CPU without one.

    Returns:
        The error; None with fewer than ``MIN_MEMBERS`` members, or without lava.

    Raises:
        LavaError: If a run fails, or the file cannot be written.
    """
    path, effects = folder / FILE, list(plan.effects)
    stored, known = stored_error(folder)
    if stored is not None and known == effects:
        return stored
    if members < MIN_MEMBERS or not plan.scene.vents:
        return None
    # the solver loads Warp, which readers of the file do not need

    simulation = Simulation(
        plan.scene, accuracy=plan.accuracy, effects=plan.effects, device=device,
        horizon=plan.horizon,
    )
    drive(simulation, plan.horizon)
    run = Areas.of(simulation.snapshot())
    error = measure_error(
        plan.scene, run, plan.horizon, accuracy=simulation.accuracy, effects=plan.effects,
        horizon=plan.horizon, device=device,
    )
    text = json.dumps({**error.as_dict(), 'effects': effects}, indent=1) + '\n'
    write_output('--output', path, text)
    return error


def stored_error(folder: Path) -> tuple[NumericalError | None, list[str]]:
    """Return the error in a folder and the effects of its run; None and [] if there is none.

    Raises:
        LavaError: If its file is not valid.
    """
    path = folder / FILE
    if not path.is_file():
        return None, []
    expected = 'the numerical error of an ensemble; delete the file to measure it again'
    with (
        refusing('ensemble', str(path), expected, OSError, KeyError, TypeError, ValueError),
        open_input(path) as file,
    ):
        plain = parse_json(FILE, file.read())
        return NumericalError.from_dict(plain), list(plain['effects'])
