# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0


"""Measure how inundated areas depend on the resolution: presets from coarse to fine.

    python docs/benchmarks/convergence.py convergence_h100.csv --device cuda:0 --case etna2001

The footprint of a scene is the area that at least half of several rotated and mirrored runs
inundate (hindcast/replicates.py). Decimetres decide where a flow branches, so a single run's
choice is chance. The agreement of the footprints of two halves of the runs shows how far
footprints of the same resolution differ by chance.
"""

import argparse
from collections.abc import Iterator
from itertools import combinations
import math
from pathlib import Path
import shlex
import sys
from typing import Any

from bench_scenes import scenes
from choice import jaccard, noise
import numpy as np

from lava_ros.hindcast.case import Case, load_case
from lava_ros.hindcast.replicates import run_replicates
from lava_ros.hindcast.run import Settings, simulate
from lava_ros.hindcast.score import Score, score_case
from lava_ros.scene import Scene
from lava_ros.simulation.presets import PRESETS
from lava_ros.simulation.resolution import resolution_of
from lava_ros.verification.measure import machine_name
from lava_ros.verification.rows import write_csv

#: Presets, from coarse to fine; all are compared with the last.
LADDER = ('draft', 'standard', 'fine')


def case_of(name: str, scene: Scene, horizon: float) -> Case:
    """Return a case without a mapped flow field."""
    volume = sum(vent.volume_between(0.0, horizon) for vent in scene.vents)
    nothing = np.zeros(scene.terrain.shape, dtype=bool)
    return Case(name, name, '', scene, None, nothing, 0.0, horizon, volume)


def _footprint(
    case: Case, preset: str, device: str, runs: int
) -> tuple[np.ndarray, np.ndarray, Score, dict[str, Any]]:
    """Return cells inundated by each run at a preset, majority footprint, score, and costs."""
    settings = Settings(preset, device=device, maps=1)
    results = run_replicates(case, settings, runs)
    alone = simulate(case, settings)
    maps = np.nan_to_num([result.snapshot.thickness for result in results])
    each = np.array([result.snapshot.footprint for result in results])
    majority = each.mean(axis=0) >= 0.5
    cost = {
        # for a single run, with kernels compiled beforehand
        'seconds': alone.wall_time,
        'particles': max(result.most_particles for result in results),
        'evaluations': alone.snapshot.steps.evaluations,
    }
    return each, majority, score_case(case, maps.mean(axis=0), majority), cost


def compare(case: Case, *, device: str, runs: int) -> Iterator[dict[str, Any]]:
    """Run a case at each preset, rotated and mirrored."""
    found = {preset: _footprint(case, preset, device, runs) for preset in LADDER}
    _, finest, best, _ = found[LADDER[-1]]
    for preset, (each, cells, judged, cost) in found.items():
        resolution = resolution_of(case.scene, PRESETS[preset].accuracy, horizon=case.duration)
        yield {
            'scene': case.name,
            'preset': preset,
            'spacing_m': resolution.spacing,
            # width of the flow from which the spacing follows, and particles across it
            'width_m': resolution.width,
            'across': resolution.across,
            'runs': runs,
            'jaccard': jaccard(cells, finest),
            'noise': noise(each),
            # mean over all pairs of runs
            'single': float(np.mean([jaccard(*pair) for pair in combinations(each, 2)])),
            'area_m2': judged.area,
            'area_ratio': judged.area / best.area,
            # the longest path along the footprint
            'length_m': judged.length,
            'length_ratio': judged.length / best.length,
            # agreement with the mapped footprint
            'score': judged.jaccard if case.footprint.any() else math.nan,
            **cost,
            'simulated_s': case.duration,
        }


def main() -> None:
    """Run the cases, by default the scenes of choice.py, and write the rows so far after each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', metavar='OUT.csv', type=Path)
    parser.add_argument('--device', default='cpu')
    parser.add_argument('--runs', type=int, default=8, help='number of runs of a footprint')
    parser.add_argument('--case', action='append', default=[], help='folder of a mapped eruption')
    args = parser.parse_args()
    origin = {
        'device': args.device,
        'machine': machine_name(args.device),
        'command': f'python {shlex.join(sys.argv)}',
    }
    cases = [load_case(folder) for folder in args.case]
    rows: list[dict[str, Any]] = []
    for case in cases or [case_of(item.name, item.scene, item.horizon) for item in scenes()]:
        rows += ({**row, **origin} for row in compare(case, device=args.device, runs=args.runs))
        write_csv(rows, args.output)
        print(case.name, flush=True)


if __name__ == '__main__':
    main()
