# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure the cost of checkpoints: size, and time in the threads of simulation and node.

The output is checkpoints.csv; each time is the median of five:

    python docs/benchmarks/checkpoints.py 'machine' > docs/benchmarks/checkpoints.csv
"""

import csv
from pathlib import Path
import statistics
import sys
import tempfile

from lava_ros.bag import BagWriter
from lava_ros.bag.checkpoints import NAME
from lava_ros.simulation.output.checkpoint import from_bytes, MEDIA_TYPE
from lava_ros.verification.benchmarks.effects import effect_sets, lava_field, timed

REPETITIONS = 5

PARTICLES = (1_000, 10_000, 100_000, 1_000_000)

#: The effects with the fewest and with the most arrays per particle.
EFFECTS = ('bare', 'everything with inertia')


def median(action):
    """Return the median time of an action [ms]."""
    return statistics.median(1e3 * timed('cpu', action) for _ in range(REPETITIONS))


def measure(effects, particles, directory):
    """Yield the quantities of one size, with their units."""
    simulation = lava_field(particles, effects, 'cpu')
    # a flow compresses less than a regular lattice
    while simulation.steps < 3:
        simulation.advance(simulation.time + 0.1)
    simulation.snapshot()
    checkpoint = simulation.checkpoint()
    data = checkpoint.to_bytes()
    assert from_bytes(data).to_bytes() == data
    with BagWriter(directory / f'{len(list(directory.iterdir()))}', custom_data={}) as writer:

        def write():
            writer.attach(NAME, MEDIA_TYPE, data, 0)
            writer.flush()

        yield 'size', len(data), 'bytes'
        yield 'size per particle', len(data) / checkpoint.particle_count, 'bytes'
        yield 'take (simulation)', median(simulation.checkpoint), 'ms'
        yield 'serialise (simulation)', median(checkpoint.to_bytes), 'ms'
        yield 'write (node)', median(write), 'ms'
        yield 'read', median(lambda: from_bytes(data)), 'ms'


def main():
    """Print the table."""
    table = csv.writer(sys.stdout, lineterminator='\n')
    table.writerow(['benchmark', 'effects', 'particles', 'value', 'unit', 'machine', 'command'])
    command = f"python docs/benchmarks/checkpoints.py '{sys.argv[1]}'"
    with tempfile.TemporaryDirectory() as directory:
        for name in EFFECTS:
            for particles in PARTICLES:
                rows = measure(effect_sets()[name], particles, Path(directory))
                for quantity, value, unit in rows:
                    row = [quantity, name, particles, f'{value:.6g}', unit, sys.argv[1], command]
                    table.writerow(row)


if __name__ == '__main__':
    main()
