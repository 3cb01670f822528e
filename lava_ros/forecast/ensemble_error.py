# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Numerical error of an ensemble, measured on a run with the inputs of its scene."""

from lava_ros.errors import refusing
from lava_ros.forecast.partner_runs import measure_error
from lava_ros.forecast.store import Store
from lava_ros.runs.drive import drive
from lava_ros.simulation import Simulation
from lava_ros.simulation.numerical_error import Areas, NumericalError

#: Minimum number of members for a measurement: the run and its partner runs take a little more
#: than one member, so at most a tenth of the time of the ensemble.
MIN_MEMBERS = 12


def measure_ensemble_error(
    store: Store, members: int, *, device: str | None = None
) -> NumericalError | None:
    """Measure the error, or return the error of an earlier measurement in ``run.json``.

    Args:
        store: Folder of the ensemble, in which the error is kept.
        members: Number of members.
        device: Warp device; None for the first GPU, or the CPU without one.

    Returns:
        The error; None with fewer than ``MIN_MEMBERS`` members, or without lava.

    Raises:
        LavaError: If a run fails, or the file cannot be written.
    """
    if known := store.record.get('numerical_error'):
        expected = 'a folder with an undamaged run.json'
        with refusing('--output', str(store.path), expected, KeyError, TypeError):
            return NumericalError.from_dict(known)
    plan = store.plan
    if members < MIN_MEMBERS or not plan.scene.vents:
        return None
    simulation = Simulation(
        plan.scene, accuracy=plan.accuracy, effects=plan.effects, device=device,
        horizon=plan.horizon,
    )
    drive(simulation, plan.horizon)
    error = measure_error(
        plan.scene, Areas.of(simulation.snapshot()), plan.horizon, accuracy=simulation.accuracy,
        effects=plan.effects, horizon=plan.horizon, device=device,
    )
    store.put({'numerical_error': error.as_dict()})
    return error
