# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Benchmark of the cost of publishing grids during a simulation, and of its memory.

The node's worker (``lava_ros.ros.worker``) simulates a field of lava as fast as possible in steps
of fixed length, with ten snapshots per second or none. Another thread serialises each snapshot as
one occupancy grid, as in the node, but no message is sent. Lava covers nearly every cell.
Intervals with and without grids alternate; each slowdown is relative to those before and after.

Memory is measured in a separate process: the maximum in Warp's memory pool, and the memory that
the driver reports as used on the device, including context, kernels and other processes.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from itertools import pairwise
import json
from statistics import median
import subprocess
import sys
import threading
import time as wall_clock
from typing import Any

import warp as wp

from lava_ros.errors import LavaError
from lava_ros.files.resources import share_path
from lava_ros.maps.layer_files import load_layers
from lava_ros.ros.worker import SimulationWorker
from lava_ros.simulation import Simulation
from lava_ros.verification.benchmarks.effects import effect_sets, lava_field, STEP
from lava_ros.verification.rows import OnProgress, row_of

#: Default number of particles by kind of device.
PARTICLES = {'cuda': 1_000_000, 'cpu': 20_000}

#: Numbers of cells along a side of the grids.
GRIDS = (500, 1000, 2000)

#: Interval between two grids, and wall time of one measurement [s].
PERIOD, SPAN = 0.1, 2.0

#: Name of the set of effects in ``effect_sets``, and name of the serialised default layer.
EFFECTS, LAYER = 'green', 'height'

#: Simulated time per second of the clock [s/s]: more than the worker can reach.
_ENDLESS = 1e6

#: Numbers of particles and of cells along a side for the measurement of memory.
LARGE = {'cuda': (10_000_000, 4000), 'cpu': (100_000, 400)}

#: Program of the separate process, and its maximum duration [s].
_HOLD = f'from {__name__} import hold; hold({{device!r}}, {{particles}}, {{cells}})'
_PATIENCE = 600.0


def measure(
    device: str, *, particles: int | None, repetitions: int, on_progress: OnProgress
) -> Iterator[dict[str, Any]]:
    """Time steps with and without publishing grids, and measure the memory of a large simulation.

    ``particles`` is the number of particles, None for the default of the device; ``on_progress``
    gets the name of the next measurement and the completed fraction of the work.
    """
    kind = 'cuda' if wp.get_device(device).is_cuda else 'cpu'
    parts = len(GRIDS) + 1
    for index, cells in enumerate(GRIDS):
        grids = f'grids of {cells} x {cells}'
        on_progress(grids, index / parts)
        stepping = Stepping(particles or PARTICLES[kind], cells, device)
        # alternate, because steps slow down as the lava spreads and the load of the machine varies
        alone, beside = [stepping.run(with_grids=False)[0]], []
        for _ in range(repetitions):
            beside.append(stepping.run(with_grids=True))
            alone.append(stepping.run(with_grids=False)[0])
        stepping.worker.stop()
        count = stepping.particles
        around = [0.5 * sum(pair) for pair in pairwise(alone)]
        slower = [100.0 * (1.0 - one[0] / two) for one, two in zip(beside, around, strict=True)]
        yield row_of(f'{grids}: steps without', count, alone, 'steps/s')
        yield row_of(f'{grids}: steps beside', count, [each[0] for each in beside], 'steps/s')
        yield row_of(f'{grids}: steps slow by', count, slower, '%')
        yield row_of(f'{grids}: made', count, [each[1] for each in beside], 'grids/s')
        yield row_of(f'{grids}: bytes of one', count, [each[2] for each in beside], 'ms')
    on_progress('memory', (parts - 1) / parts)
    for benchmark, count, value, unit in held(device, *LARGE[kind]):
        yield row_of(benchmark, count, [value], unit)


class Stepping:
    """A worker that simulates a field of lava as fast as possible."""

    def __init__(self, particles: int, cells: int, device: str) -> None:
        """Start the worker, and wait until all kernels are compiled."""
        layers = load_layers(share_path('msg_configs/default.yaml'))
        (self._layer,) = (layer for layer in layers if layer.name == LAYER)
        self._shown = threading.Event()
        field = lava_field(particles, effect_sets()[EFFECTS], device, cells=cells)
        # it has all attributes of a Simulation
        self._watched: Any = _Watched(field)
        self.particles = self._watched.particle_count
        self.worker = SimulationWorker(
            lambda scene: self._watched,
            clock=wall_clock.monotonic,
            time_scale=_ENDLESS,
            on_snapshot=self._shown.set,
        )
        self.worker.start()
        self.worker.set_scene(self._watched.scene).result()
        self.run(with_grids=True)

    def run(self, *, with_grids: bool) -> tuple[float, float, float]:
        """Simulate for ``SPAN`` seconds.

        Returns:
            Steps per second, grids per second, and the median time to serialise a grid from a
            snapshot [ms], 0 without grids.

        Raises:
            LavaError: If the simulation fails.
        """
        times, is_over, self._watched.marks = [], threading.Event(), []

        def make_grids() -> None:
            while not is_over.is_set():
                if self._shown.wait(PERIOD):
                    self._shown.clear()
                    start, snapshot = wall_clock.perf_counter(), self.worker.latest
                    assert snapshot is not None
                    # as in the node, but without rclpy
                    array('b').frombytes(self._layer.grid_values(snapshot).data.cast('B'))
                    times.append(wall_clock.perf_counter() - start)

        maker = threading.Thread(target=make_grids)
        maker.start()
        start = wall_clock.perf_counter()
        while wall_clock.perf_counter() < start + SPAN or len(self._watched.marks) < 3:
            if with_grids:
                self.worker.request_snapshot()
            wall_clock.sleep(PERIOD)
        elapsed, rate = wall_clock.perf_counter() - start, self._watched.rate()
        is_over.set()
        maker.join()
        if self.worker.status.error:
            raise LavaError('worker', self.worker.status.error, 'no failure')
        return rate, len(times) / elapsed, 1e3 * median(times or [0.0])


class _Watched:
    """A simulation that records when it reached each time (``marks``)."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self.marks: list[tuple[float, float]] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._simulation, name)

    def advance(self, until: float, *, wall_limit: float | None = None) -> float:
        reached = self._simulation.advance(until, wall_limit=wall_limit)
        self.marks.append((wall_clock.perf_counter(), reached))
        return reached

    def rate(self) -> float:
        """Return the number of steps per second."""
        (first, begin), (last, reached) = self.marks[0], self.marks[-1]
        return (reached - begin) / STEP / (last - first)


def hold(device: str, particles: int, cells: int) -> None:
    """Simulate many particles on a large map, make a snapshot, and print the memory used [B]."""
    found = wp.get_device(device)
    simulation = lava_field(particles, effect_sets()[EFFECTS], device, cells=cells)
    for _ in range(2):
        simulation.advance(simulation.time + 40 * STEP)
        simulation.begin_snapshot().result()
    wp.synchronize_device(found)
    sizes = {'particles': simulation.particle_count}
    if found.is_mempool_enabled:
        sizes['at most in the pool'] = wp.get_mempool_used_mem_high(found)
        sizes['now in the pool'] = wp.get_mempool_used_mem_current(found)
    if found.is_cuda:
        sizes['in use on the device'] = found.total_memory - found.free_memory
    print(json.dumps(sizes))


def held(device: str, particles: int, cells: int) -> Iterator[tuple[str, int, float, str]]:
    """Yield name, particles, size and unit of a separate process's memory; nothing on a CPU."""
    call = _HOLD.format(device=device, particles=particles, cells=cells)
    try:
        done = subprocess.run(
            [sys.executable, '-c', call],
            check=True,
            capture_output=True,
            timeout=_PATIENCE,
            text=True,
        )
    except subprocess.SubprocessError as error:
        output = getattr(error, 'stderr', None) or str(error)
        raise LavaError('memory', device, f'enough memory ({output[-500:]})') from error
    sizes = json.loads(done.stdout.splitlines()[-1])
    count = sizes.pop('particles')
    for name, size in sizes.items():
        yield f'map of {cells} x {cells}: memory {name}', count, 1e-9 * size, 'GB'
