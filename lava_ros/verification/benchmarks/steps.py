# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Time of a step with few to many particles, and of other operations that a user waits for.

The lava is the same as in ``benchmarks/effects.py``, in steps of fixed length of one stage.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
import gc
import math
import subprocess
import sys
import time as wall_clock
from typing import Any

import warp as wp

from lava_ros.errors import LavaError
from lava_ros.runs.drive import drive
from lava_ros.verification.benchmarks.effects import (
    effect_sets,
    lava_field,
    STEP,
    step_times,
    timed,
)
from lava_ros.verification.rows import OnProgress, row_of

#: Default numbers of particles: on a GPU, and on a CPU.
PARTICLES = {'cuda': (10_000, 100_000, 1_000_000, 10_000_000), 'cpu': (10_000, 100_000)}

#: Sets of effects, by their names in ``effect_sets``, each including the previous one.
SETS = ('bare', 'green', 'everything with green')

#: A smaller kernel, over the particle spacing, and sets that are also measured with it.
FEWER, FEWER_SETS = 2.6, ('bare', 'green')

#: Minimum time of one measurement [s].
MIN_MEASURED_TIME = 0.25

#: Cells along a side of the published grids, and particles that cover them.
GRIDS, COVERED_BY = (500, 1000, 2000), 100_000

#: Particles of a first snapshot with every effect.
_FIRST_PARTICLES = 10_000


def measure(
    device: str, *, particles: Sequence[int] | None, repetitions: int, on_progress: OnProgress,
) -> Iterator[dict[str, Any]]:
    """Time steps, snapshots, and the start of a process to its first snapshot.

    ``particles`` are the numbers of particles, None for the device's defaults.
    """
    if particles is None:
        particles = PARTICLES['cuda' if wp.get_device(device).is_cuda else 'cpu']
    parts = len(particles) + 2
    for index, number in enumerate(particles):

        def show(name: str, fraction: float, index: int = index, number: int = number) -> None:
            on_progress(f'{name}: {number} particles', (index + fraction) / parts)

        yield from _steps(number, device, repetitions, show)
    for index, cells in enumerate(GRIDS):
        what = f'snapshot of {cells} x {cells} cells'
        on_progress(what, (len(particles) + index / len(GRIDS)) / parts)
        values, count = _snapshots(cells, device, repetitions)
        yield row_of(what, count, values, 'ms')
    on_progress('first snapshot', (parts - 1) / parts)
    values = _starts(device, repetitions)
    yield row_of('start of a process to its first snapshot', _FIRST_PARTICLES, values, 's')


def _steps(
    number: int, device: str, repetitions: int, show: OnProgress
) -> Iterator[dict[str, Any]]:
    """Yield the rows of a number of particles."""
    sets = effect_sets()
    before = used_memory(device)
    show(SETS[0], 0.0)
    simulation = lava_field(number, sets[SETS[0]], device)
    for index, name in enumerate(SETS):
        show(name, index / (len(SETS) + 1))
        # reuse the lava, because creating ten million particles takes longer than measuring them
        if index:
            simulation.set_effects(asdict(sets[name]))
        if simulation.effects != sets[name]:
            raise LavaError('effects', name, 'a set that works with steps of fixed length')
        each, count = step_times(simulation, repetitions, MIN_MEASURED_TIME)
        yield from _pace(name, count, each)
        memory = (used_memory(device) - before) / count
        if memory:
            yield row_of(f'{name}: memory', count, [memory], 'B per particle')
    simulation = lava_field(number, sets[SETS[0]], device, ratio=FEWER)
    neighbours = round(math.pi * FEWER**2)
    for name in FEWER_SETS:
        what = f'{name}, {neighbours} neighbours'
        show(what, len(SETS) / (len(SETS) + 1))
        simulation.set_effects(asdict(sets[name]))
        each, count = step_times(simulation, repetitions, MIN_MEASURED_TIME)
        yield from _pace(what, count, each)


def _pace(what: str, count: int, each: Sequence[float]) -> Iterator[dict[str, Any]]:
    """Yield the time of a step and the rate, from times over the particles [ns]."""
    yield row_of(f'{what}: step', count, [1e-3 * count * time for time in each], 'us')
    yield row_of(f'{what}: rate', count, [1e3 / time for time in each], 'M particle-steps/s')


def _snapshots(cells: int, device: str, repetitions: int) -> tuple[list[float], int]:
    """Return times of a snapshot [ms] with lava on nearly every cell, and the particles."""
    simulation = lava_field(COVERED_BY, effect_sets()['bare'], device, cells=cells)
    simulation.snapshot()
    times = [1e3 * timed(device, simulation.snapshot) for _ in range(repetitions)]
    return times, simulation.particle_count


def first_snapshot(device: str) -> None:
    """Run a step and a snapshot with every effect, as the start of a process."""
    simulation = lava_field(_FIRST_PARTICLES, effect_sets()[SETS[-1]], device)
    drive(simulation, STEP)
    simulation.snapshot()


def _starts(device: str, repetitions: int) -> list[float]:
    """Return times from the start of a process to its first snapshot [s], for several processes.

    The first process fills the kernel cache and is not counted.

    Raises:
        LavaError: If a process fails.
    """
    times = []
    program = f'from {__name__} import first_snapshot; first_snapshot({device!r})'
    command = [sys.executable, '-c', program]
    for _ in range(repetitions + 1):
        start = wall_clock.perf_counter()
        try:
            # it may have to compile kernels
            subprocess.run(command, check=True, capture_output=True, timeout=300.0, text=True)
        except subprocess.SubprocessError as error:
            output = getattr(error, 'stderr', None) or str(error)
            expected = f'a device on which a new process takes a snapshot ({output[-500:]})'
            raise LavaError('--device', device, expected) from error
        times.append(wall_clock.perf_counter() - start)
    return times[1:]


def used_memory(device: str) -> int:
    """Return the allocated memory of a GPU's pool [B], 0 without a pool."""
    found = wp.get_device(device)
    if not found.is_mempool_enabled:
        return 0
    gc.collect()
    wp.synchronize_device(found)
    return int(wp.get_mempool_used_mem_current(found))
