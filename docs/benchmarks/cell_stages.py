# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure the wall time of a stage on cells, by the size of the window.

The output is cell_stages_h200.csv:

    python docs/benchmarks/cell_stages.py OUT.csv --device cuda:0

Lava 2 m thick covers a slope with waves, of one temperature or cooling. The time of a stage is
that of all steps of a period over the number of their stages, with the rest of the work of a step.
Steps are so short that each has three stages, the minimum.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
import time
from typing import Any

import numpy as np

from lava_ros.effects import EFFECTS, Effects
from lava_ros.scene import Lava, Scene, Terrain
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.output.snapshot import Particles
from lava_ros.verification.measure import machine_name
from lava_ros.verification.rows import write_csv

#: Sides of the windows [cells].
SIDES = 64, 128, 256, 512

CELL = 5.0

#: Simulated time before the measured one, measured time, and length of a step [s].
BEGIN, PERIOD, STEP = 1.0, 20.0, 0.02

#: Effects that are on, by the lava.
KINDS = {'of one temperature': ('steep',), 'that cools': ('steep', 'arrhenius', 'cooling')}


def make_world(side: int, names: Sequence[str], device: str) -> Simulation:
    """Return lava on all cells of a slope."""
    y, x = np.mgrid[:side, :side] * CELL
    ground = 500.0 - 0.1 * x + 2.0 * np.sin(x / 60.0) * np.cos(y / 45.0)
    lava = Lava.paper(viscosity=1e4)
    inner = (x > CELL) & (y > CELL) & (x < (side - 2) * CELL) & (y < (side - 2) * CELL)
    position = np.stack([x[inner], y[inner]], axis=1)
    particles = Particles(
        position, np.full(len(position), 2.0 * CELL**2), np.full(len(position), 1400.0)
    )
    return Simulation(
        Scene(Terrain(ground, CELL), (), lava), particles=particles,
        effects=Effects(**{name: name in names for name in EFFECTS}),
        accuracy=Accuracy('cells', spacing=CELL, thickness=2.0, longest_step=STEP), device=device,
    )


def measure(side: int, kind: str, device: str) -> dict[str, Any]:
    """Advance lava on a window, and return the row of its stages."""
    world = make_world(side, KINDS[kind], device)
    world.advance(BEGIN)
    before = world.snapshot().steps.evaluations
    begun = time.perf_counter()
    world.advance(BEGIN + PERIOD)
    seconds = time.perf_counter() - begun
    stages = world.snapshot().steps.evaluations - before
    return {
        'cells': f'{side} x {side}', 'lava': kind, 'stages': stages,
        'us_a_stage': f'{1e6 * seconds / stages:.3g}', 'machine': machine_name(device),
    }


def main() -> None:
    """Measure all windows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', type=Path)
    parser.add_argument('--device', required=True)
    args = parser.parse_args()
    rows = [measure(side, kind, args.device) for side in SIDES for kind in KINDS]
    write_csv(rows, args.output)


if __name__ == '__main__':
    main()
