# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure the wall time of a stage on cells, by the size of the window and the number of worlds.

The output is cell_stages_h200.csv:

    python docs/benchmarks/cell_stages.py OUT.csv --device cuda:0

Lava 2 m thick covers a slope with waves, of one temperature or cooling. The time of a stage is
that of all steps of a period over the number of their stages, with the rest of the work of a step.
Steps are so short that each has three stages, the minimum.
"""

import argparse
from pathlib import Path
import time
from typing import Any

import numpy as np

from lava_ros.effects import Effects
from lava_ros.scene import Lava, Scene, Terrain
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.batch import side_by_side
from lava_ros.simulation.output.snapshot import Particles
from lava_ros.verification.measure import machine_name
from lava_ros.verification.rows import write_csv

#: Sides of the windows [cells], and numbers of worlds; several worlds have the smallest side.
SIDES, WORLDS = (64, 128, 256, 512), (1, 8, 64, 256)

CELL = 5.0

#: Simulated time before the measured one, measured time, and length of a step [s].
BEGIN, PERIOD, STEP = 1.0, 20.0, 0.02

#: Effects by name.
KINDS = {'one temperature': Effects(), 'cooling': Effects(arrhenius=True, cooling=True)}


def make_world(side: int, effects: Effects, device: str) -> Simulation:
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
        Scene(Terrain(ground, CELL), (), lava), particles=particles, effects=effects,
        accuracy=Accuracy('cells', spacing=CELL, thickness=2.0, longest_step=STEP), device=device,
    )


def measure(side: int, count: int, kind: str, device: str) -> dict[str, Any]:
    """Advance worlds together and return the row of their stages."""
    worlds = [make_world(side, KINDS[kind], device) for _ in range(count)]

    def advance(until: float) -> tuple[float, int]:
        begun = time.perf_counter()
        for _ in side_by_side((world.advancing(until) for world in worlds), device):
            pass
        passed = time.perf_counter() - begun
        return passed, sum(world.snapshot().steps.evaluations for world in worlds)

    _, before = advance(BEGIN)
    seconds, after = advance(BEGIN + PERIOD)
    stages = after - before
    return {
        'cells': f'{side} x {side}', 'worlds': count, 'lava': kind,
        'stages_a_world': round(stages / count),
        'us_a_stage': f'{1e6 * seconds * count / stages:.3g}',
        'million_cell_stages_s': f'{1e-6 * stages * side * side / seconds:.3g}',
        'machine': machine_name(device),
    }


def main() -> None:
    """Measure all windows, and then several worlds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', type=Path)
    parser.add_argument('--device', required=True)
    args = parser.parse_args()
    pairs = [*((side, 1) for side in SIDES), *((SIDES[0], count) for count in WORLDS[1:])]
    rows = [measure(side, count, kind, args.device) for side, count in pairs for kind in KINDS]
    write_csv(rows, args.output)


if __name__ == '__main__':
    main()
