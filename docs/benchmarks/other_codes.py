# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Write the tables of docs/accuracy/other_codes.md from codes.csv, as tables.py does.

python docs/benchmarks/other_codes.py
"""

from collections.abc import Iterator
import math
from statistics import median

import numpy as np
from tables import HERE, Line, lines_of, written

PAGE = HERE.parent / 'accuracy/other_codes.md'

#: Name in codes.csv of the exact solution as means over the cells.
EXACT = 'exact solution'


def signed(error: float) -> str:
    """Format a relative error in per cent with two digits."""
    return f'{100.0 * error:+.2g} %' if math.isfinite(error) else 'none'


def seconds(time: float) -> str:
    """Format a time in seconds, with two digits below 10 s."""
    return f'{time:.0f} s' if time >= 9.95 else f'{time:.2g} s'


def two_digits(number: float) -> str:
    """Format a number with two digits, without an exponent."""
    return f'{float(f"{number:.2g}"):g}'


def grid_table(first: str, quantity: str, title: str) -> Iterator[Line]:
    """Yield the scores of codes minus those of the exact solution on the same cells."""
    rows = [row for row in lines_of('codes.csv') if row['case'].startswith(first)]
    scores = {
        (row['case'], row['code'], row['cell_m'], row['quantity']): float(row['value'])
        for row in rows
    }
    yield ('code', 'cells', title, 'profile', 'CPU time')
    for row in rows:
        case, code, cell = row['case'], row['code'], row['cell_m']
        if row['quantity'] != quantity or code == EXACT:
            continue
        score = scores[case, code, cell, quantity] - scores.get((case, EXACT, cell, quantity), 0.0)
        half = ', half of the plane' if case.endswith('_half') else ''
        yield (
            f'{code}{half}',
            f'{cell} m',
            signed(0.01 * score),
            f'{scores[case, code, cell, "profile"]:.2g} %',
            seconds(float(row['cpu_s'])),
        )


def ratio_table() -> Iterator[Line]:
    """Yield the CPU time of `standard` over that of the plain scheme with the same profile.

    The plain scheme's time is interpolated between its cell sizes, in logarithms.
    """
    rows = [row for row in lines_of('codes.csv') if row['quantity'] == 'profile']
    yield ('flow', 'profile', '`standard`', 'plain scheme', 'ratio')
    ratios = []
    for row in (row for row in rows if row['code'] == 'standard'):
        error, time = float(row['value']), float(row['cpu_s'])
        plain = sorted(
            (math.log(float(other['value'])), math.log(float(other['cpu_s'])))
            for other in rows
            if other['case'] == row['case'] and other['code'] == 'plain scheme'
        )
        same = math.exp(np.interp(math.log(error), *np.transpose(plain)))
        ratios.append(time / same)
        name = row['case'].replace('_', ' ')
        yield (name, f'{error:.2g} %', seconds(time), seconds(same), two_digits(ratios[-1]))
    yield ('median', '', '', '', two_digits(median(ratios)))


TABLES = {
    'ratio': ratio_table,
    'flux': lambda: grid_table('constant_flux', 'radius', 'R'),
    'valley': lambda: grid_table('valley', 'front', 'front'),
    'hill': lambda: grid_table('hill', 'area', 'area'),
}


if __name__ == '__main__':
    PAGE.write_text(written(PAGE.read_text(encoding='utf-8'), TABLES), encoding='utf-8')
