# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Compare runs on cells with runs of particles: areas, stated numerical errors and CPU time.

    python docs/benchmarks/methods.py methods.csv --workers 16 [--case CASE ...] [--scene NAME ...]

The scenes are those of numerical_error.py, each at the presets draft and standard, on one core. A
row is a run. ``difference`` is one minus the Jaccard index of its inundated area and that of the
run of particles at the same preset, ``stated`` its numerical error from coarser runs by the same
method, ``jaccard`` the agreement with the map of a case.
"""

import argparse
from collections.abc import Iterator
from concurrent.futures import as_completed, ProcessPoolExecutor
from dataclasses import replace
import multiprocessing
from pathlib import Path
from tempfile import TemporaryDirectory
import time
from typing import Any

from error_scenes import error_scenes
import numpy as np

from lava_ros.effects import EFFECTS, Effects
from lava_ros.forecast.partner_runs import coarser_partner_of, measure_error, measure_run
from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.run import request_of, Result, Settings, simulate
from lava_ros.hindcast.score import score_snapshot
from lava_ros.runs.scene_run import SceneRun
from lava_ros.simulation import Simulation
from lava_ros.simulation.backend.threads import use_threads
from lava_ros.simulation.carriers import METHODS
from lava_ros.simulation.numerical_error import Areas, difference
from lava_ros.simulation.output.inundation import area_of
from lava_ros.simulation.presets import preset_accuracy
from lava_ros.verification.measure import machine_name
from lava_ros.verification.rows import write_csv

PRESETS = 'draft', 'standard'

#: A run: name of the scene or folder of the case, preset, method.
Job = tuple[str, str, str]


def of_scene(name: str, preset: str, method: str) -> tuple[np.ndarray, dict[str, Any]]:
    """Run a scene; return its inundated area and its row."""
    item = next(item for item in error_scenes() if item.name == name)
    accuracy = replace(preset_accuracy(preset), method=method)

    def begin() -> Simulation:
        return Simulation(item.scene, accuracy=accuracy, device='cpu', horizon=item.horizon)

    # compiles the kernels, on cells also those of effects that are switched on later
    begin().advance(item.duration if method == 'cells' else 1e-3)
    begun = time.process_time()
    simulation = begin()
    simulation.advance(item.duration)
    snapshot = simulation.snapshot()
    cpu = time.process_time() - begun
    error = measure_error(
        item.scene, Areas.of(snapshot), item.duration, accuracy=simulation.accuracy,
        effects=simulation.effects, horizon=item.horizon, device='cpu',
        partner=coarser_partner_of(simulation.accuracy),
    )
    inundated = np.nan_to_num(snapshot.inundated)
    lacking = [one.name for one in simulation.decisions() if one.is_missed]
    return inundated, _row(
        name, preset, method, simulation.accuracy.spacing, cpu,
        area_of(inundated, item.scene.terrain.resolution), error.inundated.total,
        simulation.effects, lacking,
    )


def of_case(folder: str, preset: str, method: str) -> tuple[np.ndarray, dict[str, Any]]:
    """Run a case, as ``of_scene``."""
    case = load_case(folder)
    settings = Settings(preset, None, 'cpu', method=method)
    if method == 'cells':
        # compiles the kernels
        simulate(case, replace(settings, spacing=8.0 * case.scene.terrain.resolution))
    with TemporaryDirectory() as place:
        request = request_of(case, settings, output=Path(place) / 'run')
        begun = time.process_time()
        with SceneRun(request) as made:
            made.run()
            cpu = time.process_time() - begun
            result, error = Result.of_run(made), measure_run(made)
    assert error is not None
    score = score_snapshot(case, result.snapshot)
    effects = Effects(**{name: name in result.effects for name in EFFECTS})
    row = _row(
        case.name, preset, method, result.accuracy.spacing, cpu, score.area,
        error.inundated.total, effects, [],
    )
    row |= {'jaccard': f'{score.jaccard:.3f}', 'area_ratio': f'{score.area / case.area:.3f}'}
    return np.nan_to_num(result.snapshot.inundated), row


def _row(
    name: str, preset: str, method: str, spacing: float | None, cpu: float, area: float,
    stated: float, effects: Effects, lacking: list[str],
) -> dict[str, Any]:
    return {
        'scene': name, 'preset': preset, 'method': method, 'spacing_m': spacing,
        'cpu_s': f'{cpu:.3g}', 'area_m2': f'{area:.4g}', 'stated': f'{stated:.3g}',
        'difference': '', 'jaccard': '', 'area_ratio': '', 'effects': ' '.join(effects),
        'lacking': ' '.join(lacking),
    }


def make(job: Job) -> tuple[Job, np.ndarray, dict[str, Any]]:
    """Make a run on one thread."""
    use_threads(1)
    make_one = of_case if Path(job[0]).is_dir() else of_scene
    return (job, *make_one(*job))


def compared(runs: dict[Job, tuple[np.ndarray, dict[str, Any]]]) -> Iterator[dict[str, Any]]:
    """Yield the rows of runs with their differences from particles."""
    for (name, preset, method), (area, row) in sorted(runs.items()):
        other = runs.get((name, preset, 'particles'))
        if method != 'particles' and other is not None:
            row['difference'] = f'{difference(area, other[0]):.3g}'
        yield row


def main() -> None:
    """Make all runs and write the table; it is complete only at the end."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('output', type=Path)
    parser.add_argument('--workers', type=int, default=1)
    parser.add_argument('--case', action='append', default=[])
    parser.add_argument('--scene', action='append', default=[], help='by default all')
    parser.add_argument('--machine', default=None)
    args = parser.parse_args()
    names = [*args.case, *(args.scene or [item.name for item in error_scenes()])]
    jobs = [(name, preset, method) for preset in PRESETS[::-1] for name in names
            for method in METHODS]
    runs: dict[Job, tuple[np.ndarray, dict[str, Any]]] = {}
    context = multiprocessing.get_context('spawn')
    machine = args.machine or machine_name('cpu')
    with ProcessPoolExecutor(args.workers, mp_context=context) as pool:
        for future in as_completed([pool.submit(make, job) for job in jobs]):
            job, area, row = future.result()
            runs[job] = area, row | {'machine': machine}
            print(row, flush=True)
            write_csv(list(compared(runs)), args.output)


if __name__ == '__main__':
    main()
