# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure the cost of reading grids from a running simulation, and the memory.

The output is publishing_h200.csv:

    python docs/benchmarks/publishing.py cuda:0 > docs/benchmarks/publishing_h200.csv

The node's worker (``lava_ros.live.worker``) runs a field of lava at full speed, in steps of fixed
length, with ten snapshots per second or none. Another thread of the process converts each snapshot
to the bytes of an occupancy grid, like in the node; no message is sent. Lava covers nearly all
cells. Periods with and without grids alternate; a period with grids is compared with the periods
before and after it.

Memory is measured in a separate process: the peak of Warp's memory pool on the device, and the
used memory that the driver reports, including the context, the kernels and all other programs.
"""

import argparse
from array import array
import csv
from itertools import pairwise
import json
from statistics import median
import subprocess
import sys
import threading
import time as wall_clock

import warp as wp

from lava_ros.files.resources import share_path
from lava_ros.layers.layer_files import load_layers
from lava_ros.live.worker import SimulationWorker
from lava_ros.verification.benchmarks.effects import effect_sets, lava_field, STEP
from lava_ros.verification.measure import machine_name
from lava_ros.verification.rows import row_of

#: Default number of particles by kind of device.
PARTICLES = {'cuda': 1_000_000, 'cpu': 20_000}

#: Cells along a side of the grids.
GRIDS = (500, 1000, 2000)

#: Time between two grids, and wall time of one measurement [s].
PERIOD, SPAN = 0.1, 2.0

#: Effects by their name in ``effect_sets``, and the default layer of each grid.
EFFECTS, LAYER = 'green', 'height'

#: Time scale that the worker cannot reach.
ENDLESS = 1e6

#: Particles, and cells along a side, of the memory measurement.
LARGE = {'cuda': (10_000_000, 4000), 'cpu': (100_000, 400)}

#: Timeout of the process that measures memory [s].
TIMEOUT = 600.0


def measure(device, particles, repetitions):
    """Yield a row for each measurement of steps with and without grids, and of memory."""
    kind = 'cuda' if wp.get_device(device).is_cuda else 'cpu'
    for cells in GRIDS:
        grids = f'grids of {cells} x {cells}'
        stepping = Stepping(particles or PARTICLES[kind], cells, device)
        # alternate, because the speed of steps changes with the flow and with other work
        alone, busy = [stepping.run(with_grids=False)[0]], []
        for _ in range(repetitions):
            busy.append(stepping.run(with_grids=True))
            alone.append(stepping.run(with_grids=False)[0])
        stepping.worker.stop()
        count = stepping.particles
        around = [0.5 * sum(pair) for pair in pairwise(alone)]
        slower = [100.0 * (1.0 - one[0] / two) for one, two in zip(busy, around, strict=True)]
        yield row_of(f'{grids}: steps without', count, alone, 'steps/s')
        yield row_of(f'{grids}: steps beside', count, [each[0] for each in busy], 'steps/s')
        yield row_of(f'{grids}: steps slow by', count, slower, '%')
        yield row_of(f'{grids}: made', count, [each[1] for each in busy], 'grids/s')
        yield row_of(f'{grids}: bytes of one', count, [each[2] for each in busy], 'ms')
    for benchmark, count, value, unit in held(device, *LARGE[kind]):
        yield row_of(benchmark, count, [value], unit)


class Stepping:
    """Worker that steps a field of lava at full speed."""

    def __init__(self, particles, cells, device):
        """Start the worker, and wait for the compilation."""
        layers = load_layers(share_path('msg_configs/default.yaml'))
        (self._layer,) = (layer for layer in layers if layer.name == LAYER)
        self._shown = threading.Event()
        field = lava_field(particles, effect_sets()[EFFECTS], device, cells=cells)
        # has all attributes of a Simulation
        self._watched = Watched(field)
        self.particles = self._watched.particle_count
        self.worker = SimulationWorker(
            lambda scene: self._watched,
            clock=wall_clock.monotonic,
            time_scale=ENDLESS,
            on_snapshot=self._shown.set,
        )
        self.worker.start()
        self.worker.set_scene(self._watched.scene).result()
        self.run(with_grids=True)

    def run(self, *, with_grids):
        """Run the worker for a time.

        Returns:
            Steps per second, grids per second, and the median time to convert a snapshot to the
            bytes of a grid [ms], 0 without grids.
        """
        times, is_over, self._watched.marks = [], threading.Event(), []

        def make_grids():
            while not is_over.is_set():
                if self._shown.wait(PERIOD):
                    self._shown.clear()
                    start, snapshot = wall_clock.perf_counter(), self.worker.latest
                    # like in the node, but without rclpy
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
            raise RuntimeError(self.worker.status.error)
        return rate, len(times) / elapsed, 1e3 * median(times or [0.0])


class Watched:
    """A simulation with the wall times of its steps (``marks``)."""

    def __init__(self, simulation):
        """Wrap a simulation."""
        self._simulation = simulation
        self.marks = []

    def __getattr__(self, name):
        """Return an attribute of the simulation."""
        return getattr(self._simulation, name)

    def advance(self, until, *, wall_limit=None):
        """Advance the simulation, and record the wall time."""
        reached = self._simulation.advance(until, wall_limit=wall_limit)
        self.marks.append((wall_clock.perf_counter(), reached))
        return reached

    def rate(self):
        """Return the number of steps per second."""
        (first, begin), (last, reached) = self.marks[0], self.marks[-1]
        return (reached - begin) / STEP / (last - first)


def hold(device, particles, cells):
    """Step a large simulation, read a grid, and print the used memory [B]."""
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


def held(device, particles, cells):
    """Yield name, particles, size and unit of the memory of a process; nothing on a CPU."""
    words = [sys.executable, __file__, device, '--hold', str(particles), str(cells)]
    done = subprocess.run(words, check=True, stdout=subprocess.PIPE, timeout=TIMEOUT, text=True)
    sizes = json.loads(done.stdout.splitlines()[-1])
    count = sizes.pop('particles')
    for name, size in sizes.items():
        yield f'map of {cells} x {cells}: memory {name}', count, 1e-9 * size, 'GB'


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('device')
    parser.add_argument('--particles', type=int)
    parser.add_argument('--repetitions', type=int, default=5)
    parser.add_argument('--hold', type=int, nargs=2, metavar=('PARTICLES', 'CELLS'))
    args = parser.parse_args()
    if args.hold:
        hold(args.device, *args.hold)
        return
    command = f'python docs/benchmarks/publishing.py {args.device}'
    command += f' --repetitions {args.repetitions}'
    origin = {'device': args.device, 'machine': machine_name(args.device), 'command': command}
    table = None
    for row in measure(args.device, args.particles, args.repetitions):
        row |= origin
        if table is None:
            table = csv.DictWriter(sys.stdout, list(row), lineterminator='\n')
            table.writeheader()
        table.writerow(row)
        sys.stdout.flush()


if __name__ == '__main__':
    main()
