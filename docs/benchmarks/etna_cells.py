# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Find out why a mapped flow covers less on cells than with particles.

python docs/benchmarks/etna_cells.py OUT.csv --case etna2006 --day 5
    [--limiters | --only CELL[:EDGE[:fitted[:LIMITER[:STEPS]]]] ...]

A row is a run on cells of a size [m] (0: particles at `draft`): the area of the cells that are
covered at least half after some days, and the inundated area and the scores of the end. ``EDGE``
is the fraction of its thickest neighbour that a cell loses heat as at least, the solver's without.
Runs with another fraction and on cells of 5 m end after these days. Those with `fitted` have the
constants that fit on cells of 10 m, ``CELLS``.

Runs that name a limiter of the temperature's slope (`LIMITERS`; `third` is the solver's), or the
length of steps over that of others, end after these days, too. They have the volume that is solid
then, and the mean temperature of the lava that flows. `--limiters` makes those of
etna_limiters.csv.
"""

import argparse
from contextlib import closing
from dataclasses import replace
from pathlib import Path
import re
from typing import Any

import numpy as np

from lava_ros.forecast.pool import Pool
from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.run import Settings, simulate
from lava_ros.hindcast.score import score_snapshot
from lava_ros.simulation.cells import flow, heated_step
from lava_ros.simulation.cells.state import EDGE
from lava_ros.verification.measure import machine_name
from lava_ros.verification.rows import write_csv

#: Size of cells [m], and fraction of the thickest neighbour.
RUNS = (
    '0', '0::fitted', '20', '20::fitted', '10', '10::fitted', '5', '20:0.6', '10:0.6', '20:1',
    '10:1',
)

#: Material that is fitted to the flows of Etna on cells.
CELLS = 'etna_basalt_cells'

#: Limited slope of the temperature by the differences behind and ahead, in C++ with ``least`` and
#: ``most``; None is that of the solver.
LIMITERS: dict[str, str | None] = {
    'third': None,
    'first order': 'return 0.0f;',
    'none': 'return (behind + 2.0f * ahead) * (1.0f / 3.0f);',
    'twice the smaller': """
        return 2.0f * (most(0.0f, least(behind, ahead)) + least(0.0f, most(behind, ahead)));
    """,
    'superbee': """
        const float rise = most(least(2.0f * behind, ahead), least(behind, 2.0f * ahead));
        const float fall = least(most(2.0f * behind, ahead), most(behind, 2.0f * ahead));
        return most(0.0f, rise) + least(0.0f, fall);
    """,
}

#: Runs with limiters, as in ``RUNS``.
LIMITED = (
    '2.5:::third', '2.5:::twice the smaller', '2.5:0.6::superbee',
    '5:::third', '5:::first order', '5:::twice the smaller', '5:0.5::superbee',
    '10:::third', '10:::first order', '10:::none', '10:::twice the smaller', '10:0.5::superbee',
    '10:::third:0.125', '20:::third', '20:0.5::superbee', '20:::third:0.125',
)

#: Size of cells on which only the first days are simulated [m].
FINE = 5.0


def run(job: tuple[str, str, float]) -> dict[str, Any]:
    """Make a run of a folder; the kernels of a process have one set of constants."""
    folder, name, day = job
    spacing, edge, fitted, limiter, steps = (*name.split(':'), '', '', '', '')[:5]
    cell, fraction = float(spacing), float(edge or EDGE)
    vars(heated_step)['EDGE'] = fraction
    vars(flow)['HEATED_DISPLACEMENT'] *= float(steps or 1.0)
    limit_slopes(LIMITERS[limiter or 'third'])
    case = load_case(folder, material=CELLS if fitted else None)
    is_whole = cell != FINE and fraction == EDGE and not limiter
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
        'case': case.name, 'material': case.material.name, 'method': settings.method,
        'cell_m': spacing, 'edge': f'{fraction:g}' if cell else '', 'day': f'{day:g}',
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
    if limiter:
        assert snapshot.frozen is not None
        flowing = np.nan_to_num(snapshot.thickness - snapshot.frozen)
        hot = flowing > 0.0
        row |= {
            'limiter': limiter, 'steps': steps, 'evaluations': snapshot.steps.evaluations,
            'solid_m3': int(area * np.nansum(snapshot.frozen)),
            'temperature_k': f'{np.average(snapshot.temperature[hot], weights=flowing[hot]):.1f}',
        }
    return row


def limit_slopes(law: str | None) -> None:
    """Replace the limiter of the temperature's slope in the solver."""
    if law:
        source, count = re.subn(
            r'(auto limited = .*?{\n).*?(\n    };)', lambda match: match[1] + law + match[2],
            vars(heated_step)['_TRANSPORT'], flags=re.DOTALL,
        )
        assert count == 1
        vars(heated_step)['_TRANSPORT'] = source


def main() -> None:
    """Make the runs of the arguments, each in a process of its own."""
    # the processes import this file by its name
    from etna_cells import run as work

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', type=Path)
    parser.add_argument('--case', required=True, metavar='DIR')
    parser.add_argument('--day', type=float, default=5.0)
    parser.add_argument('--only', nargs='*', default=RUNS)
    parser.add_argument('--limiters', action='store_const', const=LIMITED, dest='only')
    args = parser.parse_args()
    rows = []
    for name in args.only:
        with closing(Pool(work, 1)) as pool:
            ((_, row),) = pool([(args.case, name, args.day)])
        print(row, flush=True)
        rows.append(row)
        write_csv(rows, args.output)


if __name__ == '__main__':
    main()
