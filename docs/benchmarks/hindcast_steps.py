# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Compare integrators and step lengths of hindcasts: time, evaluations and scores.

python docs/benchmarks/hindcast_steps.py OUT.csv --case DIR [--case DIR ...] [--device D]
    [--machine NAME]

Each row is a case at `standard`. The scores are those of eight runs in eight directions. The time
is the median of three simulations of one run, after one that compiles the kernels.
"""

import argparse
from pathlib import Path
import platform
from statistics import median

from eruptions import scored

from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.run import Settings, simulate
from lava_ros.simulation.setup.defaults import device_of
from lava_ros.verification.rows import write_csv

#: Integrators, and displacement in a step over the cell size.
STEPS = (('rkl2', 1.0), ('rkl1', 1.0), ('rkl1', 1.5), ('rkl1', 2.0))

#: Runs whose scores are combined, and repetitions of the timed run.
RUNS, REPETITIONS = 8, 3

#: Material of the runs, and columns that are those of ``eruptions.py``.
MATERIAL = 'etna_basalt'
SCORES = (
    'majority', 'single', 'single_deviation', 'area_ratio', 'length_ratio', 'runs', 'device',
    'machine', 'version', 'command',
)


def main() -> None:
    """Run the cases of the arguments."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', type=Path)
    parser.add_argument('--case', action='append', required=True, metavar='DIR')
    parser.add_argument('--device')
    parser.add_argument('--machine', default=platform.processor() or platform.machine())
    args = parser.parse_args()
    rows: list[dict[str, object]] = []
    for folder in args.case:
        case = load_case(folder, material=MATERIAL)
        for integrator, courant in STEPS:
            settings = Settings(
                device=str(device_of(args.device)), maps=1, courant=courant, integrator=integrator
            )
            times = []
            for _ in range(REPETITIONS + 1):
                one = simulate(case, settings)
                times.append(one.wall_time)
            command = 'python docs/benchmarks/hindcast_steps.py'
            (found,) = scored(
                MATERIAL, [folder], MATERIAL, {}, settings, RUNS, command, args.machine
            )
            steps = one.snapshot.steps
            rows.append({
                'case': case.name,
                'preset': settings.preset,
                'integrator': integrator,
                'courant_number': courant,
                'steps': steps.count,
                'evaluations': steps.evaluations,
                'seconds': median(times[1:]),
                'fastest_s': min(times[1:]),
                'slowest_s': max(times[1:]),
                'repetitions': REPETITIONS,
                **{name: getattr(found, name) for name in SCORES},
            })
            print(rows[-1], flush=True)
            write_csv(rows, args.output)


if __name__ == '__main__':
    main()
