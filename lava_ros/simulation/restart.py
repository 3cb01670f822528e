# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Arrays of a solver for a checkpoint, and a solver that continues from one."""

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.simulation.output.checkpoint import Checkpoint
from lava_ros.simulation.output.inundation import standing_cells
from lava_ros.simulation.particles.layout import FAR, fitting
from lava_ros.simulation.solver import Solver
from lava_ros.simulation.step.vents import Emission


def arrays_of(solver: Solver) -> dict[str, np.ndarray]:
    """Copy all arrays that a solver needs to continue, between two steps, by name.

    A GPU captures the next stages again, as it does for a resumed simulation: both then idle
    alike past the next target.
    """
    solver.state.launches.forget()
    arrays = {f'state.{name}': array for name, array in solver.state.save().items()}
    arrays |= {f'vents.{name}': array for name, array in solver.vents.save().items()}
    arrays['arrived.times'] = solver.state.arrived.numpy().copy()
    for effect, step in solver.after_step.items():
        if hasattr(step, 'save'):
            arrays |= {f'{effect}.{name}': array for name, array in step.save().items()}
    return arrays


def restore_arrays(solver: Solver, checkpoint: Checkpoint) -> None:
    """Let a new solver of a checkpoint's scene, effects and accuracy continue from there.

    Raises:
        LavaError: If an array is missing, or does not belong to the scene and the effects.
    """
    parts: dict[str, dict[str, np.ndarray]] = {}
    for name, array in checkpoint.arrays.items():
        owner, _, own_name = name.partition('.')
        parts.setdefault(owner, {})[own_name] = array
    state = parts.pop('state', {})
    # older checkpoints have no highest ground: speeds are not limited by it
    state.setdefault('top', np.full_like(solver.state.top.numpy(), FAR))
    # nor do they distinguish where lava has left
    if np.shape(state.get('left')) == (1,):
        state['left'] = np.append(state['left'], 0.0)
    solver.state.load(state, checkpoint.capacity)
    vents = parts.pop('vents', {})
    emission = Emission.from_arrays(vents, len(checkpoint.scene.vents))
    solver.open_vents(checkpoint.since, emission)
    # the state has the vents' heights; lava that has solidified since may have raised the ground
    if 'counted' in vents:
        shape = (len(checkpoint.scene.vents),)
        is_counted = fitting('vents.counted', vents['counted'], shape, np.int32)
        solver.vents.counted = set(np.flatnonzero(is_counted).tolist())
    else:
        solver.vents.counted = solver.vents.giving(checkpoint.time)
    for effect, step in solver.after_step.items():
        if hasattr(step, 'load'):
            step.load(parts.pop(effect, {}))
    target = solver.state.arrived
    if 'arrived' in parts:
        times = parts.pop('arrived').get('times')
        target.assign(fitting('arrived.times', times, target.shape, np.float32))
    else:
        # older checkpoints have no arrival times: flowing lava gets those of the next step
        for step in solver.after_step.values():
            if hasattr(step, 'thickness'):
                frozen = standing_cells(step.thickness())
                target.assign(np.where(frozen, np.float32(checkpoint.time), np.float32(-1.0)))
    if parts:
        raise LavaError('checkpoint.arrays', sorted(parts), 'those of the effects that are on')
    if solver.time != checkpoint.time:
        right = f'that of the clock, {solver.time:g} s'
        raise LavaError('checkpoint.time', checkpoint.time, right)
    solver.volume_before = checkpoint.emitted
    # the solver was made without the particles
    solver.cover()
