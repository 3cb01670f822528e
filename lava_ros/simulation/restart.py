# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The arrays of a checkpoint, copied from a solver and restored to one."""

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.simulation.output.checkpoint import Checkpoint
from lava_ros.simulation.output.checkpoint_contents import (
    capacity_for,
    check_conserved,
    check_contents,
)
from lava_ros.simulation.particles.layout import fitting
from lava_ros.simulation.solver import Solver
from lava_ros.simulation.step.vents import Emission


def arrays_of(solver: Solver) -> dict[str, np.ndarray]:
    """Copy all arrays from which a solver can be resumed, between two steps, by name.

    A GPU then captures the next stages again, as it does for a resumed simulation: both idle for
    the same number of stages past the next target.
    """
    solver.state.launches.forget()
    arrays = {f'state.{name}': array for name, array in solver.state.save().items()}
    arrays |= {f'vents.{name}': array for name, array in solver.vents.save().items()}
    arrays |= {f'arrived.{name}': item for name, item in solver.covered.save().items()}
    if solver.raised is not None:
        arrays |= {f'solidified.{name}': item for name, item in solver.raised.save().items()}
    return arrays


def restore_arrays(solver: Solver, checkpoint: Checkpoint) -> None:
    """Restore the arrays of a checkpoint to a new solver of its scene, effects and accuracy.

    Raises:
        LavaError: If an array is missing, does not belong to the scene and the effects, or has
            numbers that no simulation has.
    """
    check_contents(checkpoint)
    parts: dict[str, dict[str, np.ndarray]] = {}
    for name, array in checkpoint.arrays.items():
        owner, _, own_name = name.partition('.')
        parts.setdefault(owner, {})[own_name] = array
    # lava may have solidified before the effect was switched off
    if solver.raised is not None or 'solidified' in parts:
        solver.own_terrain().load(parts.pop('solidified', {}))
    solver.state.load(parts.pop('state', {}), capacity_for(checkpoint))
    vents = parts.pop('vents', {})
    emission = Emission.from_arrays(vents, len(checkpoint.scene.vents))
    solver.open_vents(checkpoint.since, emission)
    # the state has the vents' heights; lava that has solidified since may have raised the ground
    shape = (len(checkpoint.scene.vents),)
    is_counted = fitting('vents.counted', vents.get('counted'), shape, np.int32)
    solver.vents.counted = set(np.flatnonzero(is_counted).tolist())
    arrived = parts.pop('arrived', None)
    if arrived is not None:
        solver.covered.load(arrived)
    if parts:
        raise LavaError('checkpoint.arrays', sorted(parts), 'those of a simulation')
    time = solver.state.time
    if time != checkpoint.time:
        raise LavaError('checkpoint.time', checkpoint.time, f'that of the clock, {time:g} s')
    solver.volume_before = checkpoint.emitted
    # the neighbour grid was created without the particles
    solver.cover()
    if arrived is None:
        solver.record_covered_ground()
    check_conserved(solver.budget())
