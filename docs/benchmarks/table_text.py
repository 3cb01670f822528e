# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""CSV files of this folder as tables of pages in docs/.

A table is between ``<!-- table: NAME -->`` and ``<!-- end -->``.
"""

from collections.abc import Callable, Iterator, Mapping
import csv
from pathlib import Path
import re

HERE = Path(__file__).parent

#: Cells of a row of a table.
Line = tuple[str, ...]

#: Functions that yield the rows of tables, by the name of the table.
Tables = Mapping[str, Callable[[], Iterator[Line]]]


def lines_of(name: str | Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file, by default in this folder."""
    with (HERE / name).open(newline='', encoding='utf-8') as file:
        return list(csv.DictReader(file))


def two_digits(number: float) -> str:
    """Format a number with two digits, without an exponent."""
    return f'{float(f"{number:.2g}"):g}'


def percent(fraction: str) -> str:
    """Format a fraction in per cent with two digits."""
    return two_digits(100.0 * float(fraction))


def named(*tables: Callable[[], Iterator[Line]]) -> Tables:
    """Return tables by their names, those of their functions."""
    return {table.__name__: table for table in tables}


def written(page: str, tables: Tables) -> str:
    """Return a page with updated tables."""
    for name, rows in tables.items():
        head, *rest = rows()
        lines = [head, ('---',) * len(head), *rest]
        text = '\n'.join(f'| {" | ".join(line)} |' for line in lines)
        pattern = rf'(<!-- table: {name} -->\n).*?(<!-- end -->)'
        page, count = re.subn(pattern, rf'\g<1>\n{text}\n\n\g<2>', page, flags=re.DOTALL)
        if count != 1:
            raise ValueError(f'the page has {count} tables {name}, expected one')
    return page
