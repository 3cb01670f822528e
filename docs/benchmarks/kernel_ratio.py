# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure what a smaller kernel gains at equal error, on the scenes of bench_scenes.py.

    python docs/benchmarks/kernel_ratio.py kernel_ratio.csv --workers 16

Each scene is run with kernel radii of 2.5, 3 and 3.5 spacings at several spacings. The error is
that of the map of thickness at the end, the sum of |h - reference| over the sum of the reference.
The reference has a kernel of 3.5 spacings and particles twice as close as the finest run. The CPU
time is the least of up to three runs, without compilation, on one thread.
"""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import as_completed, ProcessPoolExecutor
from dataclasses import replace
import functools
import math
import multiprocessing
from pathlib import Path
import time
from typing import Any

from bench_scenes import BenchScene, scenes
import numpy as np

from lava_ros.simulation import Simulation
from lava_ros.simulation.backend.threads import use_threads
from lava_ros.simulation.numerical_error import difference
from lava_ros.simulation.presets import preset_accuracy
from lava_ros.simulation.resolution import resolution_of
from lava_ros.simulation.selection import effects_for
from lava_ros.verification.measure import machine_name
from lava_ros.verification.rows import write_csv

#: Kernel radii over the spacing, the largest of which the presets and the reference have.
RATIOS = (2.5, 3.0, 3.5)

#: Particles across the flow of the runs, and of the reference.
ACROSS, REFERENCE = (8.0, 11.3, 16.0), 32.0

#: A run is repeated while all of them have taken less than this [s], up to three times.
ENOUGH = 0.2

#: Scenes whose fine runs take long on a core, and one of a few particles that freeze.
LEFT_OUT = ('gully', 'valley', 'crater', 'rough', 'lobe')

#: A run: name of the scene, kernel radius over spacing, and particles across the flow.
Job = tuple[str, float, float]


@functools.cache
def _scenes() -> dict[str, BenchScene]:
    return {item.name: item for item in scenes() if item.name not in LEFT_OUT}


def jobs(names: list[str] | None) -> Iterator[Job]:
    """Yield the runs, those of the references first."""
    chosen = [name for name in _scenes() if names is None or name in names]
    for name in chosen:
        yield name, RATIOS[-1], REFERENCE
    for across in sorted(ACROSS, reverse=True):
        for name in chosen:
            for ratio in RATIOS:
                yield name, ratio, across


def run(job: Job) -> tuple[np.ndarray, np.ndarray, int, float]:
    """Return thickness and inundated area at the end, the particles and the CPU time [s]."""
    use_threads(1)
    name, ratio, across = job
    item, draft = _scenes()[name], preset_accuracy('draft')
    found = resolution_of(item.scene, draft, horizon=item.horizon)
    accuracy = replace(
        draft, ratio=ratio, spacing=found.width / across, thickness=found.thickness
    )
    # the effects of the largest kernel
    effects = effects_for(
        item.scene, accuracy=replace(accuracy, ratio=RATIOS[-1]), horizon=item.horizon
    )
    spent: list[float] = []
    while len(spent) < 3 and sum(spent) < ENOUGH:
        simulation = Simulation(
            item.scene, effects=effects, accuracy=accuracy, device='cpu', horizon=item.horizon
        )
        # compiles the kernels
        simulation.advance(1e-3)
        begun = time.process_time()
        simulation.advance(item.duration)
        spent.append(time.process_time() - begun)
    snapshot = simulation.snapshot()
    thickness, area = np.nan_to_num(snapshot.thickness), np.nan_to_num(snapshot.inundated)
    return thickness, area, snapshot.particle_count, min(spent)


def main() -> None:
    """Run all scenes, and write the rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', metavar='OUT.csv', type=Path)
    parser.add_argument('--scene', action='append', help='name of a scene (default: all)')
    parser.add_argument('--workers', type=int, default=1, help='number of processes')
    args = parser.parse_args()
    done = {}
    context = multiprocessing.get_context('spawn')
    with ProcessPoolExecutor(args.workers, mp_context=context) as pool:
        waiting = {pool.submit(run, job): job for job in jobs(args.scene)}
        for future in as_completed(waiting):
            job = waiting[future]
            done[job] = future.result()
            print(*job, f'{done[job][-1]:.3g} s', flush=True)
    rows: list[dict[str, Any]] = []
    for job in jobs(args.scene):
        name, ratio, across = job
        finest = done[name, RATIOS[-1], REFERENCE]
        thickness, area, particles, seconds = done[job]
        if across not in ACROSS:
            continue
        rows.append({
            'scene': name,
            'ratio': ratio,
            'across': across,
            'particles': particles,
            'thickness_error': float(np.abs(thickness - finest[0]).sum() / finest[0].sum()),
            'area_error': difference(area, finest[1]),
            'cpu_s': seconds,
            'reference_across': REFERENCE,
            'reference_cpu_s': finest[3],
            'machine': machine_name('cpu'),
        })
    write_csv(rows, args.output)
    for error in ('thickness_error', 'area_error'):
        for ratio in RATIOS[:-1]:
            names = dict.fromkeys(row['scene'] for row in rows)
            gains = [time_ratio(rows, name, ratio, error) for name in names]
            print(f'{error}: CPU time with {ratio:g} over {RATIOS[-1]:g}, at equal error: '
                  f'median {np.median(gains):.2f}, {min(gains):.2f} to {max(gains):.2f}')


def time_ratio(
    rows: Sequence[Mapping[str, Any]], scene: str, ratio: float, error: str
) -> float:
    """Return the CPU time with a kernel over that with the largest, at equal error.

    The error is that of the largest kernel with 11.3 particles across.
    """
    usual, other = (
        [row for row in rows if row['scene'] == scene and float(row['ratio']) == kernel]
        for kernel in (RATIOS[-1], ratio)
    )
    wanted = next(row for row in usual if float(row['across']) == ACROSS[1])
    logs = np.log([(max(float(row[error]), 1e-9), float(row['cpu_s'])) for row in other])
    # the line through all runs: errors of single runs scatter
    slope, start = np.polyfit(logs[:, 0], logs[:, 1], 1)
    time_taken = math.exp(start + slope * math.log(float(wanted[error])))
    return time_taken / float(wanted['cpu_s'])


if __name__ == '__main__':
    main()
