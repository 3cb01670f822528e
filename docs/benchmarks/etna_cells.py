# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Find out why a mapped flow covers less on cells than with particles.

python docs/benchmarks/etna_cells.py OUT.csv --case etna2006 --day 5
    [--only CELL[:EDGE[:crust]] ...]

A row is a run on cells of a size [m] (0: particles at `draft`): the areas that are covered at
least half after some days and at the end, and the scores of the end. ``EDGE`` is the fraction of
its thickest neighbour that a cell loses heat as at least, the solver's without. Runs with another
fraction and on cells of 5 m end after these days. Those with `crust` have a crust that loses less
heat, within the published ranges.
"""

import argparse
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from eruptions import CRUST
import numpy as np

from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.run import Settings, simulate
from lava_ros.hindcast.score import score_snapshot
from lava_ros.simulation.cells import heated_step
from lava_ros.simulation.cells.state import EDGE
from lava_ros.verification.measure import machine_name
from lava_ros.verification.rows import write_csv

#: Size of cells [m], and fraction of the thickest neighbour.
RUNS = ('0', '0::crust', '20', '10', '10::crust', '5', '20:0.6', '10:0.6', '20:1', '10:1')

#: Size of cells on which only the first days are simulated [m].
FINE = 5.0


def run(job: tuple[str, str, float]) -> dict[str, Any]:
    """Make a run of a folder; the kernels of a process have one ``EDGE``."""
    folder, name, day = job
    spacing, edge, crust = (*name.split(':'), '', '')[:3]
    cell, fraction = float(spacing), float(edge or EDGE)
    vars(heated_step)['EDGE'] = fraction
    case = load_case(folder)
    if crust:
        case = case.with_lava(CRUST)
    is_whole = cell != FINE and fraction == EDGE
    if not is_whole:
        case = replace(case, end=case.start + 86400.0 * day)
    settings = Settings(
        'standard' if cell else 'draft', cell or None, 'cpu', maps=1,
        method='cells' if cell else 'particles',
    )
    snapshot = simulate(case, settings).snapshot
    assert snapshot.half_inundated is not None
    area = case.scene.terrain.resolution**2
    row = {
        'case': case.name, 'crust': crust, 'method': settings.method, 'cell_m': spacing,
        'edge': f'{fraction:g}' if cell else '', 'day': f'{day:g}',
        'area_m2': int(area * np.sum(snapshot.half_inundated <= 86400.0 * day)),
        'end_area_m2': '', 'jaccard': '', 'area_ratio': '', 'length_ratio': '',
        'machine': machine_name('cpu'),
    }
    if is_whole:
        score = score_snapshot(case, snapshot)
        row |= {
            'end_area_m2': int(score.area), 'jaccard': f'{score.jaccard:.3f}',
            'area_ratio': f'{score.area / case.area:.3f}',
            'length_ratio': f'{1.0 + score.length_error:.3f}',
        }
    return row


def main() -> None:
    """Make the runs of the arguments, each in a process of its own."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', type=Path)
    parser.add_argument('--case', required=True, metavar='DIR')
    parser.add_argument('--day', type=float, default=5.0)
    parser.add_argument('--only', nargs='*', default=RUNS)
    args = parser.parse_args()
    jobs = [(args.case, name, args.day) for name in args.only]
    rows = []
    with get_context('spawn').Pool(1, maxtasksperchild=1) as pool:
        for row in pool.imap(run, jobs, chunksize=1):
            print(row, flush=True)
            rows.append(row)
            write_csv(rows, args.output)


if __name__ == '__main__':
    main()
