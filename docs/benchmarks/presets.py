# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure the spacing, the error and the time of the presets on the scenes of error_scenes.py.

    python docs/benchmarks/presets.py presets.csv --folder RUNS --workers 16

The folder is that of numerical_error.py, whose reference runs give the actual errors. A row has
the first guess, the spacing that pilots choose, their CPU time and that of the run, and the error
as the pilots expect it, as partner runs state it, and as it is.
"""

import argparse
from concurrent.futures import as_completed, ProcessPoolExecutor
from dataclasses import replace
import math
import multiprocessing
from pathlib import Path
import time
from typing import Any

from error_scenes import error_scenes
from numerical_error import cut, make, make_all, runs_of

from lava_ros.forecast.preset_spacing import choose_spacing
from lava_ros.simulation import Simulation
from lava_ros.simulation.backend.threads import use_threads
from lava_ros.simulation.numerical_error import Areas, difference
from lava_ros.simulation.presets import preset_accuracy, PRESETS
from lava_ros.simulation.resolution import resolution_of, resolved_accuracy
from lava_ros.verification.measure import machine_name
from lava_ros.verification.rows import write_csv

#: The presets that have a target.
NAMES = tuple(name for name, preset in PRESETS.items() if preset.target is not None)


#: A scene and a preset.
Job = tuple[str, str]


def measure(job: Job, folder: Path) -> dict[str, Any]:
    """Return the row of a job without the actual errors."""
    scene, preset = job
    use_threads(1)
    runs = runs_of(scene, folder)
    item = runs.item
    accuracy = resolved_accuracy(preset_accuracy(preset), item.scene, horizon=item.horizon)
    guess = resolution_of(item.scene, accuracy, horizon=item.horizon)

    def simulate(distance: float, end: float) -> tuple[float, int]:
        begun = time.process_time()
        simulation = Simulation(
            item.scene, effects=runs.effects, accuracy=replace(accuracy, spacing=distance),
            device='cpu', horizon=item.horizon,
        )
        simulation.advance(end)
        return time.process_time() - begun, simulation.snapshot().particle_count

    # compiles the kernels
    simulate(2.0 * guess.spacing, 1e-3)
    begun = time.process_time()
    choice = choose_spacing(
        item.scene, preset, accuracy, effects=runs.effects, horizon=item.horizon, device='cpu'
    )
    pilots_time = time.process_time() - begun
    seconds, count = simulate(choice.spacing, item.duration)
    tag = tag_of(preset, choice.spacing)
    for one in runs.jobs_at(tag, choice.spacing):
        runs.make(one)
    stated, *_ = runs.stated(choice.spacing)
    row = {
        'scene': scene,
        'preset': preset,
        'cell_m': item.scene.terrain.resolution,
        'first_guess_m': guess.spacing,
        'spacing_m': choice.spacing,
        'across': guess.width / choice.spacing,
        'particles': count,
        'pilots': choice.pilots,
        'pilots_cpu_s': pilots_time,
        'cpu_s': seconds,
    }
    for name in Areas._fields:
        part, expected = getattr(stated, name), choice.error and getattr(choice.error, name)
        row |= {
            f'{name}_expected': expected.total if expected else math.nan,
            f'{name}_particles': part.lava,
            f'{name}_ground': part.ground,
            f'{name}_stated': part.total,
        }
    return row


def tag_of(preset: str, spacing: float) -> str:
    """Return the name of the runs of a spacing."""
    return f'{preset}_{spacing:g}'


def with_actual_error(row: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return a row with the errors relative to the reference run of its scene."""
    runs = runs_of(row['scene'], folder)
    _, reference, finest = runs.levels()
    best = runs.read(reference).areas
    one = runs.read(f'{tag_of(row["preset"], row["spacing_m"])}_A').areas
    actual = {
        f'{name}_actual': difference(area, other)
        for name, area, other in zip(Areas._fields, one, cut(best, one), strict=True)
    }
    return {**row, **actual, 'reference_spacing_m': finest, 'machine': machine_name('cpu')}


def main() -> None:
    """Measure all scenes, and write the rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', metavar='OUT.csv', type=Path)
    parser.add_argument('--folder', type=Path, required=True, help='folder of the areas')
    parser.add_argument('--scene', action='append', help='name of a scene (default: all)')
    parser.add_argument('--preset', action='append', choices=NAMES, help='(default: all)')
    parser.add_argument('--workers', type=int, default=1, help='number of processes')
    args = parser.parse_args()
    names = [item.name for item in error_scenes() if not args.scene or item.name in args.scene]
    jobs = [(scene, preset) for scene in names for preset in args.preset or NAMES]
    context = multiprocessing.get_context('spawn')
    with ProcessPoolExecutor(args.workers, mp_context=context) as pool:
        all_runs = [runs_of(name, args.folder) for name in names]
        make_all([runs.first() for runs in all_runs], args.folder, pool)
        # the longest first
        references = [pool.submit(make, next(runs.jobs()), args.folder) for runs in all_runs]
        waiting = {
            pool.submit(measure, job, args.folder): job
            for job in sorted(jobs, key=lambda job: -NAMES.index(job[1]))
        }
        rows = {}
        for future in as_completed(waiting):
            rows[waiting[future]] = future.result()
            print(*waiting[future], flush=True)
            if all(reference.done() for reference in references):
                done = [with_actual_error(rows[job], args.folder) for job in jobs if job in rows]
                write_csv(done, args.output)
        for reference in references:
            print(*reference.result(), flush=True)
    write_csv([with_actual_error(rows[job], args.folder) for job in jobs], args.output)


if __name__ == '__main__':
    main()
