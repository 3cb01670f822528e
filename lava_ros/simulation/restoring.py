# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Checkpoints of a simulation: what it takes to go on as if it had never stopped."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.simulation.checkpoint import Checkpoint, fitting
from lava_ros.simulation.state import FAR

if TYPE_CHECKING:
    from lava_ros.simulation.simulation import Simulation


def take(simulation: Simulation) -> Checkpoint:
    """Copy all that a simulation needs to go on; it stands between two steps.

    The next stages are captured anew on a GPU, as those of a resumed simulation are: both then
    idle alike past the next target.
    """
    simulation._state.launches.forget()
    arrays = {f'state.{name}': array for name, array in simulation._state.save().items()}
    arrays |= {f'vents.{name}': array for name, array in simulation._vents.save().items()}
    if simulation._notes_arrival:
        arrays['arrived.times'] = simulation._state.arrived.numpy()
    for effect, step in simulation._after_step.items():
        if hasattr(step, 'save'):
            arrays |= {f'{effect}.{name}': array for name, array in step.save().items()}
    return Checkpoint(
        time=simulation.time,
        scene=simulation.scene,
        effects=simulation.effects,
        forced=simulation._forced,
        horizon=simulation._horizon,
        accuracy=simulation.accuracy,
        emitted=simulation._emitted_before,
        since=simulation._vents.since,
        capacity=simulation._state.capacity,
        arrays=arrays,
    )


def restore(simulation: Simulation, checkpoint: Checkpoint) -> Simulation:
    """Make a new simulation of a checkpoint's scene, effects and accuracy go on from there.

    Raises:
        LavaError: An array is missing, or is not of the scene and the effects.
    """
    parts: dict[str, dict[str, np.ndarray]] = {}
    for name, array in checkpoint.arrays.items():
        owner, _, own_name = name.partition('.')
        parts.setdefault(owner, {})[own_name] = array
    state = parts.pop('state', {})
    # what was written before there was a bound goes on without one
    state.setdefault('top', np.full_like(simulation._state.top.numpy(), FAR))
    # and where lava has left was not told apart
    if np.shape(state.get('left')) == (1,):
        state['left'] = np.append(state['left'], 0.0)
    simulation._state.load(state, checkpoint.capacity)
    vents, shape = parts.pop('vents', {}), (len(checkpoint.scene.vents),)
    carried = fitting('vents.carried', vents.get('carried'), shape, np.float64)
    released = fitting('vents.released', vents.get('released'), shape, np.int32)
    simulation._vents = simulation._vent_set(
        checkpoint.scene.vents, since=checkpoint.since, carried=carried
    )
    simulation._vents.load(released)
    # the state has the vents' heights; lava that has frozen since may have raised the ground
    giving = simulation._vents.giving(checkpoint.time, others_than=())
    simulation._counted = simulation._vents, set(giving)
    if simulation._notes_arrival:
        target, times = simulation._state.arrived, parts.pop('arrived')['times']
        target.assign(fitting('arrived.times', times, target.shape, np.float32))
    for effect, step in simulation._after_step.items():
        if hasattr(step, 'load'):
            step.load(parts.pop(effect, {}))
    if parts:
        raise LavaError('checkpoint.arrays', sorted(parts), 'those of the effects that are on')
    if simulation.time != checkpoint.time:
        right = f'that of the clock, {simulation.time:g} s'
        raise LavaError('checkpoint.time', checkpoint.time, right)
    simulation._forced = None if checkpoint.forced is None else dict(checkpoint.forced)
    simulation._emitted_before = checkpoint.emitted
    # it was made without the particles, and knows where vents are only
    simulation._cover()
    return simulation
