# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""What a step takes on the CPU by the number of threads.

It makes threads_cpu.csv, a run of it for each number, on cores of their own:

    taskset -c 0,2,4,6 python docs/benchmarks/threads.py --machine M > threads_cpu.csv

Threads are as many as cores that it may use. The lava is that of `lava bench steps`.
"""

import argparse
import csv
from statistics import median
import sys

from lava_ros.simulation.backend.threads import threads
from lava_ros.verification.benchmarks.effects import effect_sets, lava_field, STEP, timed

#: Sets of effects, by their names in the benchmark, and particles.
SETS, PARTICLES = ('bare', 'green'), (1000, 10_000, 100_000)

#: Times that each is measured, and the least time that is measured at once [s].
REPETITIONS, LEAST = 5, 0.1


def main():
    """Measure, and print a CSV."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--machine', required=True)
    machine = parser.parse_args().machine
    rows = csv.writer(sys.stdout, lineterminator='\n')
    names = 'benchmark', 'particles', 'threads', 'value', 'unit', 'low', 'high', 'repetitions'
    rows.writerow((*names, 'machine', 'command'))
    for name in SETS:
        for particles in PARTICLES:
            simulation = lava_field(particles, effect_sets()[name], 'cpu')

            def each(steps, simulation=simulation):
                until = simulation.time + steps * STEP
                return timed('cpu', lambda: simulation.advance(until)) / steps

            each(3)
            steps = 1 + int(LEAST / each(2))
            rates = [1e-6 * simulation.particle_count / each(steps) for _ in range(REPETITIONS)]
            values = [f'{value:.4g}' for value in (median(rates), min(rates), max(rates))]
            row = (f'{name}: rate', simulation.particle_count, threads(), values[0])
            row = (*row, 'M particle-steps/s', *values[1:], REPETITIONS, machine)
            rows.writerow((*row, 'python docs/benchmarks/threads.py'))
            sys.stdout.flush()


if __name__ == '__main__':
    main()
