# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure the cost of grids that are taken while lava is simulated, and the memory.

It makes publishing_h200.csv:

    python docs/benchmarks/publishing.py cuda:0 > docs/benchmarks/publishing_h200.csv

The node's worker (``lava_ros.ros.worker``) runs a field of lava as fast as it can, in steps of
fixed length, and is asked for a snapshot ten times a second or not at all. Each snapshot becomes
the bytes of one occupancy grid in another thread of the process, as in the node; no message is
sent. Lava covers nearly every cell. Spans of time with and without grids alternate; a span with
grids is compared with those before and after it.

Memory is measured in a process of its own: the most that Warp's memory pool has given out on the
device, and the memory that the driver reports as in use there, with the context, the kernels and
all other programs.
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
from lava_ros.maps.layer_files import load_layers
from lava_ros.ros.worker import SimulationWorker
from lava_ros.verification.benchmarks.effects import effect_sets, lava_field, STEP
from lava_ros.verification.measure import machine_name
from lava_ros.verification.rows import row_of

#: Particles by default: on a GPU, and on a CPU.
PARTICLES = {'cuda': 1_000_000, 'cpu': 20_000}

#: Cells along a side of the grids.
GRIDS = (500, 1000, 2000)

#: Time between two grids, and wall time of one measurement [s].
PERIOD, SPAN = 0.1, 2.0

#: Effects by their names in ``effect_sets``; the default layer that is made of each snapshot.
EFFECTS, LAYER = 'green', 'height'

#: Simulated time that the worker is asked for each second [s]: more than there can be.
ENDLESS = 1e6

#: Particles and cells along a side of what memory is measured of.
LARGE = {'cuda': (10_000_000, 4000), 'cpu': (100_000, 400)}

#: Longest time of the process that measures memory [s].
PATIENCE = 600.0


def measure(device, particles, repetitions):
    """Yield a row for each measurement of steps with and without grids, and of memory."""
    kind = 'cuda' if wp.get_device(device).is_cuda else 'cpu'
    for cells in GRIDS:
        grids = f'grids of {cells} x {cells}'
        stepping = Stepping(particles or PARTICLES[kind], cells, device)
        # they alternate: steps get slower as the lava flows, and other work comes and goes
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
    for benchmark, count, value, unit in held(device, *LARGE[kind]):
        yield row_of(benchmark, count, [value], unit)


class Stepping:
    """A worker that steps a field of lava, of so many particles, as fast as it can."""

    def __init__(self, particles, cells, device):
        """Start it, and wait until all is compiled."""
        layers = load_layers(share_path('msg_configs/default.yaml'))
        (self._layer,) = (layer for layer in layers if layer.name == LAYER)
        self._shown = threading.Event()
        field = lava_field(particles, effect_sets()[EFFECTS], device, cells=cells)
        # it has all attributes of a Simulation
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
        """Let it step for a while.

        Returns:
            Steps a second, grids a second, and the median time that the bytes of a grid take to
            make from a snapshot [ms], 0 without grids.
        """
        times, is_over, self._watched.marks = [], threading.Event(), []

        def make_grids():
            while not is_over.is_set():
                if self._shown.wait(PERIOD):
                    self._shown.clear()
                    start, snapshot = wall_clock.perf_counter(), self.worker.latest
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
            raise RuntimeError(self.worker.status.error)
        return rate, len(times) / elapsed, 1e3 * median(times or [0.0])


class Watched:
    """A simulation, and when it has reached which time (``marks``)."""

    def __init__(self, simulation):
        """Watch a simulation."""
        self._simulation = simulation
        self.marks = []

    def __getattr__(self, name):
        """Everything else is the simulation's."""
        return getattr(self._simulation, name)

    def advance(self, until, *, wall_limit=None):
        """Advance the simulation, and note the wall time."""
        reached = self._simulation.advance(until, wall_limit=wall_limit)
        self.marks.append((wall_clock.perf_counter(), reached))
        return reached

    def rate(self):
        """Steps a second."""
        (first, begin), (last, reached) = self.marks[0], self.marks[-1]
        return (reached - begin) / STEP / (last - first)


def hold(device, particles, cells):
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


def held(device, particles, cells):
    """Name, particles, size and unit of what a process of its own holds, nothing on a CPU."""
    words = [sys.executable, __file__, device, '--hold', str(particles), str(cells)]
    done = subprocess.run(words, check=True, stdout=subprocess.PIPE, timeout=PATIENCE, text=True)
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
