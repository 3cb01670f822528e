# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Checks of the numbers in a checkpoint, before memory is allocated for them.

A checksum shows that a checkpoint is undamaged, not that a simulation wrote it.
"""

from collections.abc import Iterable, Iterator
from dataclasses import fields
import math

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.scene import Scene
from lava_ros.scene.terrain import PARTS
from lava_ros.scene.vent_keys import VENT_TEMPERATURE_RANGE
from lava_ros.simulation.output.budget import VolumeBudget
from lava_ros.simulation.output.checkpoint import Checkpoint
from lava_ros.simulation.particles.solidified import THICKNESS_UNIT

#: Fraction of the emitted volume that the sums of a checkpoint may differ from it.
TOLERANCE = 1e-3

#: Ratio of the capacity to the number of particles, and the capacity for few particles.
SPARE, FEW = 16, 1 << 18

#: Warming by the speed at which lava may erupt, 1,000 m/s [K].
MAX_WARMING = 500.0

#: Maximum component of a velocity [m/s]: ten times the speed at which lava may erupt.
MAX_SPEED = 1e4

#: Maximum rounding error of a temperature [K].
MAX_REMAINDER = 1.0

#: Maximum phase of a vent (``Emission``): overlapping vents have the smallest different ones.
MAX_PHASE = 1e6


def capacity_for(checkpoint: Checkpoint) -> int:
    """Return the capacity of the checkpoint [particles], less if its contents do not need it."""
    return min(checkpoint.capacity, max(SPARE * checkpoint.particle_count, FEW))


def check_contents(checkpoint: Checkpoint) -> None:
    """Raise LavaError for numbers that no simulation of the scene and its past vents has."""
    for name, values, minimum, maximum, expected in _ranges(checkpoint):
        # NaN compares as False
        if not ((values >= minimum) & (values <= maximum)).all():
            wrong = values[~((values >= minimum) & (values <= maximum))]
            raise LavaError(f'checkpoint.{name}', float(wrong.flat[0]), expected)


def check_restored(checkpoint: Checkpoint, unused: Iterable[str], time: float) -> None:
    """Check what a solver has read of a checkpoint.

    Args:
        checkpoint: The checkpoint.
        unused: Names of arrays, or of their owners, that the solver has not read.
        time: Simulated time of the solver's clock [s].

    Raises:
        LavaError: If an array is left, or the clock has another time than the checkpoint.
    """
    if names := sorted(unused):
        raise LavaError('checkpoint.arrays', names, 'those of a simulation')
    if time != checkpoint.time:
        raise LavaError('checkpoint.time', checkpoint.time, f'that of the clock, {time:g} s')


def check_conserved(budget: VolumeBudget) -> None:
    """Raise LavaError if the volumes of a resumed simulation do not add up."""
    if not budget.error <= TOLERANCE:
        found = f'{budget.flowing:g} m3 flowing, {budget.solidified:g} m3 solidified, '
        found += f'{budget.lost:g} m3 lost and {budget.waiting:g} m3 waiting in the vents'
        expected = f'together the {budget.emitted:g} m3 that were emitted'
        raise LavaError('checkpoint.volume', found, expected)


def _ranges(
    checkpoint: Checkpoint,
) -> Iterator[tuple[str, np.ndarray, float, float, str]]:
    """Yield the name, values, minimum, maximum, and description of the range of valid values."""
    scene, arrays, time = checkpoint.scene, checkpoint.arrays, checkpoint.time
    yield 'time', np.array(time), 0.0, math.inf, 'at least 0 s'
    yield 'since', np.array(checkpoint.since), 0.0, time, f'0 s to {time:g} s, its time'
    yield 'emitted', np.array(checkpoint.emitted), 0.0, math.inf, 'at least 0 m3'
    emitted = checkpoint.emitted
    emitted += sum(vent.volume_between(checkpoint.since, time) for vent in scene.vents)
    all_of_it = f'from 0 to the {emitted:g} m3 that were emitted'
    limit = (1.0 + TOLERANCE) * emitted + 1e-9
    particles = arrays['state.particle'].astype(np.float64)
    yield 'state.particle, volume', particles[:, 2].sum(), 0.0, limit, all_of_it
    for name in ('state.left', 'cells.left'):
        yield name, arrays.get(name, np.zeros(1)), 0.0, limit, all_of_it
    coldest, hottest = temperature_range(scene)
    expected = f'a temperature from {coldest:g} to {hottest:.0f} K'
    yield 'state.particle, temperature', particles[:, 3], coldest, hottest, expected
    if (columns := arrays.get('cells.thickness')) is not None:
        temperature = arrays.get('heat.temperature', np.zeros(1))
        if temperature.shape == columns.shape:
            temperature = temperature[columns > 0.0]
        yield 'heat.temperature', temperature, coldest, hottest, expected
        fluidity = arrays.get('cells.fluidity', np.zeros(1))
        yield 'cells.fluidity', fluidity, 0.0, math.inf, 'at least 0 1/(Pa s)'
        strength = arrays.get('cells.strength', np.zeros(1))
        yield 'cells.strength', strength, 0.0, math.inf, 'at least 0 Pa'
        # a step finds the largest in float32
        largest = float(columns.max(initial=0.0)) * (1.0 - float(np.finfo(np.float32).eps))
        thickest, rate = np.split(arrays.get('cells.peaks', np.zeros(2)), [1])
        yield 'cells.peaks', thickest, largest, math.inf, f'at least {largest:g} m'
        yield 'cells.peaks', rate, 0.0, math.inf, 'at least 0 1/s'
    remainder = arrays.get('state.temperature_remainder', np.zeros(1))
    expected = f'at most {MAX_REMAINDER:g} K'
    yield 'state.temperature_remainder', remainder, -MAX_REMAINDER, MAX_REMAINDER, expected
    terrain = scene.terrain
    sides = 0.5 * np.array(terrain.shape[::-1]) * terrain.resolution
    # lava crosses the border by less than a cell before it counts as lost
    margin = terrain.resolution + (checkpoint.accuracy.spacing or terrain.resolution)
    for axis, side in zip('xy', sides + margin, strict=True):
        places = particles[:, 'xy'.index(axis)]
        yield f'state.particle, {axis}', places, -side, side, f'at most {side:g} m from the centre'
    remainder = arrays.get('state.remainder', np.zeros(1))
    expected = f'at most {terrain.resolution:g} m'
    yield 'state.remainder', remainder, -terrain.resolution, terrain.resolution, expected
    expected = f'-1, or a time from 0 to {time:g} s'
    for name in ('arrived.times', 'arrived.half_inundated'):
        yield name, arrays.get(name, np.zeros(1)), -1.0, time, expected
    squares, every = arrays.get('arrived.squares', np.zeros(1)), (1 << PARTS * PARTS) - 1
    yield 'arrived.squares', squares, 0, every, f'from 0 to {every}, the squares of a cell'
    bounds = arrays.get('arrived.bounds', np.zeros(4)).ravel()
    for part, count, what in zip((0, 2), terrain.shape, ('rows', 'columns'), strict=True):
        yield 'arrived.bounds', bounds[part : part + 2], 0, count, f'at most {count} {what}'
    velocity = arrays.get('state.velocity', np.zeros(1))
    expected = f'from {-MAX_SPEED:g} to {MAX_SPEED:g} m/s'
    yield 'state.velocity', velocity, -MAX_SPEED, MAX_SPEED, expected
    phase = arrays.get('vents.phase', np.zeros(1))
    yield 'vents.phase', phase, 0.0, MAX_PHASE, f'from 0 to {MAX_PHASE:g}'
    downhill = arrays.get('vents.downhill', np.zeros(1))
    yield 'vents.downhill', downhill, -1.0, 1.0, 'from -1 to 1 half turns'
    cell = THICKNESS_UNIT * terrain.resolution**2
    for name in ('solidified.deposit', 'solidified.placed'):
        volume = arrays.get(name, np.zeros(1)).astype(np.float64) * cell
        yield f'{name}, volume of a cell', volume, 0.0, 2.0 * limit, all_of_it


def temperature_range(scene: Scene) -> tuple[float, float]:
    """Return the minimum and maximum temperature of lava [K].

    Lava cools to the coldest air that a scene may have. It erupts at a temperature in the range of
    vents, and viscous heating adds at most its kinetic energy and that of its way down.
    """
    (ambient,) = (item for item in fields(scene) if item.name == 'ambient_temperature')
    coldest, _ = ambient.metadata['limits']
    way_down = float(np.nanmax(scene.terrain.elevation) - np.nanmin(scene.terrain.elevation))
    warmer = scene.gravity * way_down / scene.lava.specific_heat
    return float(coldest), VENT_TEMPERATURE_RANGE[1] + warmer + MAX_WARMING
