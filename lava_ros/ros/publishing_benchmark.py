# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""What grids cost that are taken while the lava is being stepped, and how much memory all takes.

The node's own worker (``lava_ros.ros.worker``) runs a field of lava as fast as it can, in steps of
fixed length, and is asked for a snapshot ten times a second or not at all. Each snapshot becomes
the bytes of one occupancy grid in another thread of the process, as in the node; no message is
sent. Lava covers nearly every cell. Spans of time with and without grids take turns; slower is
against those before and after.

Memory is measured in a process of its own: what Warp's memory pool has given out on the device at
most, and what the driver says is in use there, with the context, the kernels, and whatever else
uses the device.
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

#: Particles by default: on a GPU, and on a CPU.
PARTICLES = {'cuda': 1_000_000, 'cpu': 20_000}

#: Cells along a side of the grids.
GRIDS = (500, 1000, 2000)

#: Time between two grids, and wall time of one measurement [s].
PERIOD, SPAN = 0.1, 2.0

#: Effects by their names in ``effect_sets``; the default layer that is made of each snapshot.
EFFECTS, LAYER = 'green', 'height'

#: Simulated time that the worker is asked for each second [s]: more than there can be.
_ENDLESS = 1e6

#: Particles and cells along a side of what memory is measured of.
LARGE = {'cuda': (10_000_000, 4000), 'cpu': (100_000, 400)}

#: What a process of its own does, and how long it may take [s].
_HOLD = f'from {__name__} import hold; hold({{device!r}}, {{particles}}, {{cells}})'
_PATIENCE = 600.0


def measure(
    device: str, *, particles: int | None, repetitions: int, on_progress: OnProgress
) -> Iterator[dict[str, Any]]:
    """Time steps with and without publishing grids, and measure the memory of a large simulation.

    ``particles`` are stepped, None for the usual number of the device; ``on_progress`` gets the
    name of the next measurement and the share of the work done.
    """
    kind = 'cuda' if wp.get_device(device).is_cuda else 'cpu'
    parts = len(GRIDS) + 1
    for index, cells in enumerate(GRIDS):
        grids = f'grids of {cells} x {cells}'
        on_progress(grids, index / parts)
        stepping = Stepping(particles or PARTICLES[kind], cells, device)
        # turn about: steps get slower as the lava flows on, and other work comes and goes
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
    """A worker that steps a field of lava, of so many particles, as fast as it can."""

    def __init__(self, particles: int, cells: int, device: str) -> None:
        """Start it, and wait until all is compiled."""
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
        """Let it step for a while; LavaError where the simulation fails.

        Returns:
            Steps a second, grids a second, and the median time that the bytes of a grid take to
            make from a snapshot [ms], 0 without grids.
        """
        times, is_over, self._watched.marks = [], threading.Event(), []

        def make_grids() -> None:
            while not is_over.is_set():
                if self._shown.wait(PERIOD):
                    self._shown.clear()
                    start, snapshot = wall_clock.perf_counter(), self.worker.latest
                    assert snapshot is not None
                    # as in the node, and without rclpy
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
    """A simulation, and when it has reached which time (``marks``)."""

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
        """Steps a second."""
        (first, begin), (last, reached) = self.marks[0], self.marks[-1]
        return (reached - begin) / STEP / (last - first)


def hold(device: str, particles: int, cells: int) -> None:
    """Step much lava on a large map, show it, and print what memory it takes [B]."""
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
    """Name, particles, size and unit of what a process of its own holds, nothing on a CPU."""
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
