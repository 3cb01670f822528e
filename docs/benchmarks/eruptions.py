# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Score sets of constants on mapped eruptions.

python docs/benchmarks/eruptions.py OUT.csv --case DIR [--case DIR ...] [--set NAME ...]
    [--calibration DIR] [--method M] [--preset P] [--runs N] [--device D]

Each row is a set on a case, with scores of the majority of the runs and of single runs. A set is
written when it is done, and skipped if the table has it at that preset. Sets of a calibration
(``lava calibrate``) are its best one, and for each case the best one for the other cases.
"""

import argparse
from collections.abc import Mapping
import csv
from dataclasses import dataclass
import math
from pathlib import Path
import platform
import shutil
import subprocess
import time

import numpy as np
from table_text import lines_of

import lava_ros
from lava_ros.hindcast.calibration import leave_one_out, near_optimal, read_samples
from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.free_parameters import changed, free_parameters_of, UNITS
from lava_ros.hindcast.replicates import agreement, directions, run_together
from lava_ros.hindcast.run import Settings
from lava_ros.simulation.carriers import METHODS
from lava_ros.simulation.presets import PRESETS
from lava_ros.simulation.setup.defaults import device_of
from lava_ros.verification.rows import write_csv


def fitted() -> dict[str, float]:
    """Return the constants that fit the outline of La Palma of 24 September 2021 best."""
    rows = [row for row in lines_of('lapalma_h200.csv') if row['case'] == '2021-09-24']
    best = max(rows, key=lambda row: float(row['jaccard']))
    return {name: float(best[name]) for name in UNITS if best.get(name)}


#: A lava of ``lava materials`` and constants that replace its own, by the name of the set.
SETS: dict[str, tuple[str, Mapping[str, float]]] = {
    'etna_basalt': ('etna_basalt', {}),
    'etna_basalt_cells': ('etna_basalt_cells', {}),
    'fitted to 24 September': ('etna_basalt', fitted()),
    'published, well crusted': ('etna_magflow', {}),
    'published, poorly insulated': (
        'etna_magflow', {'crust_cover': 0.9, 'crust_cover_decay': 0.16},
    ),
    'published, well crusted, latent heat': ('etna_magflow', {'latent_heat': 3.5e5}),
    'published, bare surface': ('etna_magflow', {'crust_cover': 0.0}),
    'published, crust that thickens': (
        'etna_magflow', {'crust_cover': 0.0, 'crust': 1.0, 'conductivity': 1.0},
    ),
}


@dataclass(frozen=True)
class Row:
    """A set of constants on a case: a row of the CSV."""

    constants: str
    case: str
    preset: str
    spacing_m: float
    runs: int
    majority: float
    single: float
    single_deviation: float
    recall: float
    precision: float
    footprint_ratio: float
    length_ratio: float
    seconds: float
    values: str
    device: str
    machine: str
    version: str
    command: str


def version() -> str:
    """Return the version of the package, with the commit if there is a repository."""
    commit = ''
    if shutil.which('git'):
        done = subprocess.run(
            ['git', 'describe', '--always', '--dirty'], capture_output=True, text=True, check=False
        )
        commit = done.stdout.strip()
    return f'{lava_ros.__version__}+{commit}'.rstrip('+')


def sets_of(calibration: Path, cases: list[str]) -> dict[str, tuple[str, Mapping[str, float]]]:
    """Return the best set of a calibration, and the best sets without one of the cases."""
    table = calibration / 'runs.csv'
    with table.open(encoding='utf-8') as file:
        header = next(csv.reader(file))
    material = load_case(cases[0], material='etna_basalt')
    searched = tuple(header[: header.index('case')])
    unknowns = free_parameters_of(material, searched, dict.fromkeys(searched, (0.1, 1e9)))
    names = [Path(case).name for case in cases]
    trials = read_samples(table, unknowns, names)
    found = {f'calibrated, {calibration.name}': ('etna_basalt', near_optimal(trials)[0].values)}
    for item in leave_one_out(trials, names):
        name = f'calibrated without {item.case}, {calibration.name}'
        found[name] = ('etna_basalt', item.values)
    return found


def scored(
    name: str, folders: list[str], material: str, values: Mapping[str, float],
    settings: Settings, runs: int, command: str, machine: str,
) -> list[Row]:
    """Run a set on every case."""
    cases = [load_case(folder, material=material) for folder in folders]
    crust = {key: bool(value) for key, value in values.items() if key == 'crust'}
    rest = {key: value for key, value in values.items() if key != 'crust'}
    cases = [changed(case, rest).with_lava(crust) for case in cases]
    started = time.monotonic()
    results = run_together(
        [(case, way) for case in cases for way in directions(runs)], settings
    )
    seconds = time.monotonic() - started
    rows = []
    for number, case in enumerate(cases):
        own = results[number * runs : (number + 1) * runs]
        found = agreement(case, [result.snapshot for result in own])
        single = np.array([score.jaccard for score in found.scores])
        rows.append(
            Row(
                constants=name,
                case=case.name,
                preset=settings.preset,
                spacing_m=own[0].resolution.spacing,
                runs=runs,
                majority=found.majority.jaccard,
                single=float(single.mean()),
                single_deviation=float(single.std(ddof=1)) if runs > 1 else math.nan,
                recall=found.majority.recall,
                precision=found.majority.precision,
                footprint_ratio=1.0 + found.majority.footprint_area_error,
                length_ratio=1.0 + found.majority.length_error,
                seconds=seconds,
                values=' '.join(f'{key}={value:.6g}' for key, value in values.items()),
                device=own[0].device,
                machine=machine,
                version=version(),
                command=command,
            )
        )
    return rows


def main() -> None:
    """Run the sets of the arguments."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', type=Path)
    parser.add_argument('--case', action='append', required=True, metavar='DIR')
    parser.add_argument('--set', action='append', default=[], choices=tuple(SETS), dest='sets')
    parser.add_argument('--calibration', type=Path, metavar='DIR')
    parser.add_argument('--method', choices=METHODS, default='particles')
    parser.add_argument('--preset', choices=tuple(PRESETS), default='standard')
    parser.add_argument('--runs', type=int, default=8)
    parser.add_argument('--device')
    parser.add_argument('--machine', default=platform.processor() or platform.machine())
    args = parser.parse_args()
    named = args.sets or ([] if args.calibration else SETS)
    chosen = {name: SETS[name] for name in named}
    if args.calibration:
        chosen |= sets_of(args.calibration, args.case)
    rows: list[dict[str, object]] = []
    if args.output.is_file():
        with args.output.open(newline='', encoding='utf-8') as file:
            rows = list(csv.DictReader(file))
    done = {(row['constants'], row['preset']) for row in rows}
    command = (
        f'python docs/benchmarks/eruptions.py --method {args.method} --preset {args.preset} '
        f'--runs {args.runs}'
    )
    settings = Settings(
        args.preset, device=str(device_of(args.device, args.method)), maps=1, method=args.method
    )
    for name, (material, values) in chosen.items():
        if (name, args.preset) in done:
            continue
        for row in scored(
            name, args.case, material, values, settings, args.runs, command, args.machine
        ):
            print(
                f'{name}, {row.case}, {row.preset}: majority {row.majority:.3f}, single '
                f'{row.single:.3f}, area x{row.footprint_ratio:.2f}, '
                f'length x{row.length_ratio:.2f}, {row.seconds:.0f} s',
                flush=True,
            )
            rows.append(vars(row))
        write_csv(rows, args.output)


if __name__ == '__main__':
    main()
