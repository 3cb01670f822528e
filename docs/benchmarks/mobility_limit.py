# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure the cost and the area of a mapped eruption by the limit of the mobility.

python docs/benchmarks/mobility_limit.py OUT.csv --case DIR [--material NAME] [--until SECONDS]
"""

import argparse
from pathlib import Path
import platform
import time

from eruptions import version

from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.run import Run, Settings
from lava_ros.hindcast.score import jaccard
from lava_ros.verification.rows import write_csv

#: Maxima of du/ds [m/s], and spacing [m].
LIMITS, SPACING = (None, 4.2, 1.4, 0.42), 13.9


def main() -> None:
    """Write a row for each limit."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', metavar='OUT.csv', type=Path)
    parser.add_argument('--case', required=True, metavar='DIR')
    parser.add_argument('--material', default='basalt')
    parser.add_argument('--until', type=float, default=216000.0)
    parser.add_argument('--machine', default=platform.processor() or platform.machine())
    args = parser.parse_args()
    case, rows, unlimited = load_case(args.case, material=args.material), [], None
    for limit in LIMITS:
        settings = Settings(
            'draft', spacing=SPACING, device='cpu', maps=1, mobility_limit=limit
        )
        simulation = Run(case, settings)._simulation
        begun = time.process_time()
        simulation.advance(args.until)
        seconds = time.process_time() - begun
        footprint = simulation.snapshot().footprint
        unlimited = footprint if unlimited is None else unlimited
        rows.append({
            'case': case.name, 'material': args.material, 'spacing_m': SPACING,
            'until_s': args.until, 'mobility_limit_m_per_s': '' if limit is None else limit,
            'steps': simulation.steps, 'cpu_s': seconds,
            'area_km2': footprint.sum() * case.scene.terrain.resolution**2 / 1e6,
            'jaccard_with_unlimited': jaccard(footprint, unlimited),
            'device': 'cpu', 'machine': args.machine, 'version': version(),
            'command': f'python docs/benchmarks/mobility_limit.py --until {args.until:g}',
        })
        write_csv(rows, args.output)


if __name__ == '__main__':
    main()
