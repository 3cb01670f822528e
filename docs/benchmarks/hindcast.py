# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.


"""What the score of a hindcast depends on: resolution, step, ground, direction, constants.

python docs/benchmarks/hindcast.py CASE_DIR OUT.csv [--preset P] [--device D] [--only NAME ...]

Each row of the table is a run. Rows are written as they come, and runs that are in the table are
not run again.
"""

import argparse
from collections.abc import Callable
import csv
from dataclasses import replace
from pathlib import Path
import platform

import numpy as np

from lava_ros import validation
from lava_ros.hindcast.case import Case, load_case
from lava_ros.hindcast.run import Settings, simulate
from lava_ros.hindcast.score import judge
from lava_ros.hindcast.turned import turned
from lava_ros.hindcast.unknowns import changed, unknowns_of
from lava_ros.materials import Material
from lava_ros.presets import PRESETS

COLUMNS = ('benchmark', 'case', 'value', 'unit', 'machine', 'command')

#: What is written of each run.
NUMBERS = {
    'jaccard': '1', 'recall': '1', 'precision': '1', 'length_error': '1', 'area_error': '1',
    'wall_time': 's', 'steps': '1', 'evaluations': '1', 'particles_at_most': '1',
    'volume_error': '1',
}


def noisy(case: Case, height: float) -> Case:
    """The case on ground with noise of a standard deviation [m], always the same."""
    ground = case.scene.terrain
    noise = np.random.default_rng(1).normal(0.0, height, ground.shape)
    scene = replace(case.scene, terrain=replace(ground, elevation=ground.elevation + noise))
    return replace(case, scene=scene)


def _has_ranges(material: Material) -> bool:
    """Whether anything about a lava has a published range."""
    constants = (material.vent_temperature, *material.constants.values())
    return any(constant.range is not None for constant in constants)


def variations(
    folder: Path, case: Case, preset: str, device: str | None
) -> dict[str, tuple[Callable[[], Case], Settings]]:
    """The runs, by name."""
    usual = Settings(preset, device=device)
    distance = usual.accuracy(case).spacing
    assert distance is not None
    runs: dict[str, tuple[Callable[[], Case], Settings]] = {
        name: (lambda: case, replace(usual, preset=name)) for name in ('draft', 'standard', 'fine')
    }
    for share in (1.4, 0.7):
        spacing = share * distance
        runs[f'spacing {spacing:g} m'] = (lambda: case, replace(usual, spacing=spacing))
    for courant in (0.5, 0.25):
        runs[f'step {courant:g} cells'] = (lambda: case, replace(usual, courant=courant))
    for quarters in (1, 2, 3):
        runs[f'turned by {90 * quarters}'] = (lambda q=quarters: turned(case, q), usual)
    for height in (0.2, 0.5):
        runs[f'noise of {height:g} m'] = (lambda h=height: noisy(case, h), usual)
    for cells in (1.0, 2.0):
        width = cells * case.scene.terrain.resolution
        runs[f'low-pass of {width:g} m'] = (
            lambda w=width: load_case(folder, low_pass_width=w), usual
        )
    discharge = unknowns_of(case, ('discharge',))
    published = unknowns_of(case) if case.material and _has_ranges(case.material) else ()
    for unknown in (*published, *discharge):
        # a fifth of the range either way
        here = unknown.share_of(unknown.usual)
        for share in (here - 0.2, here + 0.2):
            value = unknown.value_at(float(np.clip(share, 0.0, 1.0)))
            runs[f'{unknown.name} {value:.3g} {unknown.unit}'.rstrip()] = (
                lambda n=unknown.name, v=value: changed(case, {n: v}), usual
            )
    return runs


def main() -> None:
    """Run what the arguments name."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('case', type=Path)
    parser.add_argument('output', type=Path)
    parser.add_argument('--preset', choices=tuple(PRESETS), default='standard')
    parser.add_argument('--device')
    parser.add_argument('--machine', default=platform.machine())
    parser.add_argument('--only', nargs='+', metavar='NAME')
    args = parser.parse_args()
    case = load_case(args.case)
    rows: list[list[str]] = []
    if args.output.is_file():
        with args.output.open(newline='', encoding='utf-8') as file:
            rows = list(csv.reader(file))[1:]
    validation.file_to_write('output', args.output)
    done = {row[1] for row in rows}
    command = f'python docs/benchmarks/hindcast.py {case.name} --preset {args.preset}'
    runs = variations(args.case, case, args.preset, args.device)
    for name, (make, settings) in runs.items():
        if name in done or (args.only and name not in args.only):
            continue
        varied = make()
        result = simulate(varied, settings)
        snapshot = result.snapshot
        numbers = {
            **judge(varied, snapshot.thickness).as_dict(),
            'wall_time': result.wall_time,
            'steps': snapshot.steps.count,
            'evaluations': snapshot.steps.evaluations,
            'particles_at_most': result.most_particles,
            'volume_error': snapshot.budget.error,
        }
        machine = f'{args.machine}, {result.device}'
        for number, unit in NUMBERS.items():
            value = f'{float(numbers[number]):.6g}'
            rows.append([f'hindcast {number}', name, value, unit, machine, command])
        print(f'{name}: Jaccard {numbers["jaccard"]:.3f} in {result.wall_time:.1f} s', flush=True)
        with args.output.open('w', newline='', encoding='utf-8') as file:
            writer = csv.writer(file, lineterminator='\n')
            writer.writerow(COLUMNS)
            writer.writerows(rows)


if __name__ == '__main__':
    main()
