# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure how far down a mapped eruption's flow has come at some times.

python docs/benchmarks/front.py front.csv --case etna2001 [--preset P] [--runs N] [--device D]

Each row is a time with the elevation of the lowest cell that lava had covered at least half by
then: median, lowest and highest of runs in several directions.
"""

import argparse
from pathlib import Path
import platform

from eruptions import version
import numpy as np

from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.replicates import directions, run_together
from lava_ros.hindcast.run import Settings
from lava_ros.simulation.presets import PRESETS
from lava_ros.simulation.setup.defaults import device_of
from lava_ros.verification.rows import write_csv

#: Times since the start [h].
HOURS = (3, 7, 12, 24, 48, 96, 192, 528)


def main() -> None:
    """Run the case of the arguments, and write the rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', type=Path)
    parser.add_argument('--case', required=True, metavar='DIR')
    parser.add_argument('--preset', choices=tuple(PRESETS), default='draft')
    parser.add_argument('--runs', type=int, default=8)
    parser.add_argument('--device')
    parser.add_argument('--machine', default=platform.processor() or platform.machine())
    args = parser.parse_args()
    case = load_case(args.case)
    settings = Settings(args.preset, device=str(device_of(args.device)), maps=1)
    runs = run_together([(case, way) for way in directions(args.runs)], settings)
    elevation = np.asarray(case.scene.terrain.elevation)
    rows = []
    for hours in HOURS:
        lowest = [
            float(np.nanmin(elevation[run.snapshot.half_inundated <= 3600.0 * hours]))
            for run in runs
        ]
        rows.append({
            'case': case.name, 'hours': hours, 'elevation_m': float(np.median(lowest)),
            'lowest_m': min(lowest), 'highest_m': max(lowest), 'preset': args.preset,
            'spacing_m': runs[0].resolution.spacing, 'runs': args.runs,
            'device': runs[0].device, 'machine': args.machine, 'version': version(),
            'command': f'python docs/benchmarks/front.py --preset {args.preset}',
        })
    rows.append({
        **rows[-1], 'hours': 'mapped',
        **dict.fromkeys(
            ('elevation_m', 'lowest_m', 'highest_m'),
            float(elevation[case.footprint].min()),
        ),
    })
    write_csv(rows, args.output)


if __name__ == '__main__':
    main()
