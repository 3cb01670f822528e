# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Write the tables of docs/accuracy/other_codes.md from codes.csv, as tables.py does.

python docs/benchmarks/other_codes.py
"""

from collections import defaultdict
from collections.abc import Iterator
import math
from statistics import median

import numpy as np
from table_text import HERE, Line, lines_of, two_digits, written

PAGE = HERE.parent / 'accuracy/other_codes.md'

#: Name in codes.csv of the exact solution as means over the cells.
EXACT = 'exact solution'

#: Name in codes.csv of the method cells.
CELLS = 'cells'

#: Names of the schemes of finite_volumes.c, the yardsticks.
SCHEMES = ('plain scheme', 'RKL2 scheme')


def signed(error: float) -> str:
    """Format a relative error in per cent with two digits."""
    return f'{100.0 * error:+.2g} %' if math.isfinite(error) else 'none'


def seconds(time: float) -> str:
    """Format a time in seconds, with two digits below 10 s."""
    return f'{time:.0f} s' if time >= 9.95 else f'{time:.2g} s'


def grid_table(first: str, quantity: str, title: str) -> Iterator[Line]:
    """Yield the scores of codes minus those of the exact solution on the same map."""
    rows = [row for row in lines_of('codes.csv') if row['case'].startswith(first)]
    scores = {
        (row['case'], row['code'], row['cell_m'], row['quantity']): float(row['value'])
        for row in rows
    }
    exact = {case: score for (case, code, _, item), score in scores.items()
             if (code, item) == (EXACT, quantity)}
    yield ('code', 'cells', title, 'profile', 'CPU time')
    for row in rows:
        case, code, cell = row['case'], row['code'], row['cell_m']
        if row['quantity'] != quantity or code == EXACT:
            continue
        half = ', half of the plane' if case.endswith('_half') else ''
        yield (
            f'{code}{half}',
            f'{cell} m',
            signed(0.01 * (scores[case, code, cell, quantity] - exact.get(case, 0.0))),
            f'{two_digits(scores[case, code, cell, "profile"])} %',
            seconds(float(row['cpu_s'])),
        )


def same_profile(rows: list[dict[str, str]], case: str, code: str, error: float) -> float:
    """Return the CPU time of a scheme with a profile error, interpolated in logarithms [s].

    Beyond the errors of its cell sizes it is that of the nearest one.
    """
    points = sorted(
        (math.log(float(row['value'])), math.log(float(row['cpu_s'])))
        for row in rows
        if row['case'] == case and row['code'] == code
    )
    return math.exp(np.interp(math.log(error), *np.transpose(points)))


def ratio_table() -> Iterator[Line]:
    """Yield the CPU time of `standard` over that of both schemes with the same profile."""
    rows = [row for row in lines_of('codes.csv') if row['quantity'] == 'profile']
    yield ('flow', 'profile', '`standard`', *(
        word for code in SCHEMES for word in (code, 'ratio')
    ))
    ratios = defaultdict[str, list[float]](list)
    for row in (row for row in rows if row['code'] == 'standard'):
        error, time = float(row['value']), float(row['cpu_s'])
        cells = []
        for code in SCHEMES:
            same = same_profile(rows, row['case'], code, error)
            ratios[code].append(time / same)
            cells += [seconds(same), two_digits(time / same)]
        name = row['case'].replace('_', ' ')
        yield (name, f'{two_digits(error)} %', seconds(time), *cells)
    yield ('median', '', '', *(
        word for code in SCHEMES for word in ('', two_digits(median(ratios[code])))
    ))


def cells_table() -> Iterator[Line]:
    """Yield the CPU time of method cells and of both schemes with the profile of `standard`."""
    rows = [row for row in lines_of('codes.csv') if row['quantity'] == 'profile']
    yield ('flow', 'profile', '`standard`', 'cells', *(
        f'cells over {code}' for code in SCHEMES
    ))
    ratios = defaultdict[str, list[float]](list)
    for row in (row for row in rows if row['code'] == 'standard'):
        error, case = float(row['value']), row['case']
        time = same_profile(rows, case, CELLS, error)
        for code in SCHEMES:
            ratios[code].append(time / same_profile(rows, case, code, error))
        yield (
            case.replace('_', ' '), f'{two_digits(error)} %', seconds(float(row['cpu_s'])),
            seconds(time), *(two_digits(ratios[code][-1]) for code in SCHEMES),
        )
    yield ('median', '', '', '', *(two_digits(median(ratios[code])) for code in SCHEMES))


def same_cells_table() -> Iterator[Line]:
    """Yield the CPU time of method cells over that of both schemes on the same cells."""
    rows = [
        row for row in lines_of('codes.csv')
        if row['quantity'] == 'profile' and row['code'] in (CELLS, *SCHEMES)
    ]
    found = {(row['case'], row['code'], row['cell_m']): float(row['cpu_s']) for row in rows}
    yield ('cells', *(word for code in SCHEMES for word in (f'over {code}', 'median')))
    for cell in dict.fromkeys(row['cell_m'] for row in rows if row['code'] == CELLS):
        line = [f'{cell} m']
        for code in SCHEMES:
            times = sorted(
                time / found[case, code, cell] for (case, name, side), time in found.items()
                if (name, side) == (CELLS, cell)
            )
            line += [
                f'{two_digits(times[0])} to {two_digits(times[-1])}', two_digits(median(times))
            ]
        yield tuple(line)


def scheme_table() -> Iterator[Line]:
    """Yield the profile errors and times of both schemes on the same cells, over all flows."""
    rows = [row for row in lines_of('codes.csv') if row['quantity'] == 'profile']
    found = {(row['case'], row['code'], row['cell_m']): row for row in rows}
    yield ('cells', 'plain over RKL2: CPU time', 'median', 'largest change of the profile')
    for cell in dict.fromkeys(row['cell_m'] for row in rows if row['code'] == SCHEMES[0]):
        pairs = [
            [found[case, code, cell] for code in SCHEMES]
            for case in dict.fromkeys(row['case'] for row in rows)
            if (case, SCHEMES[0], cell) in found
        ]
        times = sorted(float(one['cpu_s']) / float(two['cpu_s']) for one, two in pairs)
        change = max(abs(float(one['value']) - float(two['value'])) for one, two in pairs)
        yield (
            f'{cell} m', f'{two_digits(times[0])} to {two_digits(times[-1])}',
            two_digits(median(times)), f'{two_digits(change)} points',
        )


TABLES = {
    'ratio': ratio_table,
    'cells': cells_table,
    'same': same_cells_table,
    'schemes': scheme_table,
    'flux': lambda: grid_table('constant_flux', 'radius', 'R'),
    'valley': lambda: grid_table('valley', 'front', 'front'),
    'hill': lambda: grid_table('hill', 'area', 'area'),
}


if __name__ == '__main__':
    PAGE.write_text(written(PAGE.read_text(encoding='utf-8'), TABLES), encoding='utf-8')
