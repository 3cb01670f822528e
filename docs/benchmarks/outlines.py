# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Score sets of constants on the dated outlines of a mapped eruption.

python docs/benchmarks/outlines.py OUT.csv --case DIR [--set NAME ...] [--device D] [--machine M]

Each row is a set on an outline: the majority of the runs, and two references without a model of
lava (``lava_ros/hindcast/score.py``). The fitted set is the best one of lapalma_h200.csv on the
outline of 24 September 2021.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path
import platform
import time
from typing import Any

from eruptions import fitted, version
from tables import lines_of

from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.free_parameters import changed
from lava_ros.hindcast.replicates import directions, run_together
from lava_ros.hindcast.run import Settings
from lava_ros.hindcast.score import refer, score_outlines
from lava_ros.simulation.setup.defaults import device_of
from lava_ros.verification.rows import write_csv


@dataclass(frozen=True)
class Variant:
    """A lava of ``lava materials`` with other constants, and how it is run."""

    material: str
    values: dict[str, float]
    preset: str
    spacing: float | None
    runs: int


#: Variants by name. Vents of basalt at 1,175 degrees Celsius: Castro and Feisel (2022).
VARIANTS = {
    'etna_basalt': Variant('etna_basalt', {}, 'draft', 32.0, 1),
    'fitted to 24 September': Variant('etna_basalt', fitted(), 'draft', 32.0, 1),
    'basalt': Variant('basalt', {'vent_temperature': 1448.15}, 'draft', 32.0, 1),
}


def scored(name: str, folder: str, device: str, machine: str) -> list[dict[str, Any]]:
    """Run a variant and return its rows."""
    item = VARIANTS[name]
    case = changed(load_case(folder, material=item.material), item.values)
    settings = Settings(item.preset, item.spacing, device, maps=1)
    begun = time.monotonic()
    results = run_together([(case, way) for way in directions(item.runs)], settings)
    seconds = time.monotonic() - begun
    scores = score_outlines(case, [result.snapshot for result in results])
    references = refer(case, {score.outline: score.area_error for score in scores})
    return [
        {
            'constants': name, 'case': case.name, 'outline': score.outline,
            'preset': item.preset, 'spacing_m': results[0].resolution.spacing,
            'runs': item.runs, 'jaccard': score.jaccard, 'area_ratio': 1.0 + score.area_error,
            'length_ratio': 1.0 + score.length_error,
            'persistence': references[score.outline].persistence,
            'descent': references[score.outline].descent, 'seconds': seconds,
            'values': ' '.join(f'{key}={value:.6g}' for key, value in item.values.items()),
            'device': results[0].device, 'machine': machine, 'version': version(),
            'command': 'python docs/benchmarks/outlines.py',
        }
        for score in scores
    ]


def main() -> None:
    """Run the variants, and write the rows so far after each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', metavar='OUT.csv', type=Path)
    parser.add_argument('--case', required=True, metavar='DIR')
    parser.add_argument('--set', action='append', choices=VARIANTS, dest='sets')
    parser.add_argument('--device')
    parser.add_argument('--machine', default=platform.processor() or platform.machine())
    args = parser.parse_args()
    kept = lines_of(args.output.resolve()) if args.output.exists() else []
    chosen = args.sets or list(VARIANTS)
    rows: list[dict[str, Any]] = [row for row in kept if row['constants'] not in chosen]
    for name in chosen:
        rows += scored(name, args.case, str(device_of(args.device)), args.machine)
        write_csv(rows, args.output)
        print(name, *(f'{row["outline"][:10]} {row["jaccard"]:.3f}' for row in rows
                      if row['constants'] == name), f'{rows[-1]["seconds"]:.0f} s', flush=True)


if __name__ == '__main__':
    main()
