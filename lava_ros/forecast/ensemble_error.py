# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The numerical error of an ensemble: that of a run with the inputs of its scene."""

import json
from pathlib import Path

from lava_ros.files import write_output
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
    """Measure the error, or read that of an earlier call with the same effects.

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
    if path.is_file():
        plain = json.loads(path.read_text(encoding='utf-8'))
        if plain['effects'] == effects:
            return NumericalError.from_dict(plain)
    if members < MIN_MEMBERS or not plan.scene.vents:
        return None
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
