# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Text tables."""

from collections.abc import Iterable, Mapping, Sequence
import csv
from io import StringIO
from pathlib import Path
import re
from typing import Any

from lava_ros.errors import LavaError, refusing
from lava_ros.files import check_exists, open_input

#: Maximum size of a table [bytes].
MAX_BYTES = 64 * 2**20


def read_table(
    field: str, path: Path, columns: Sequence[str] | None = None
) -> list[tuple[str, dict[str, str]]]:
    """Read a table whose first line names its columns.

    The separator is the first of tab, semicolon, comma and space that occurs in the first line.
    Lines that begin with ``#``, and text after ``#`` between spaces, are comments. Numbers may
    have decimal commas unless the separator is a comma.

    Args:
        field: Name of the field in errors.
        path: Path of the table.
        columns: Names of the columns in any order; None: any columns.

    Returns:
        For each row, its name in errors and its texts by column.

    Raises:
        LavaError: If the table cannot be read, has no rows, other columns or a column twice, has
            both decimal points and decimal commas, or if a row has the wrong length.
    """
    check_exists(field, path)
    with refusing(field, str(path), 'a table of text in UTF-8', OSError, ValueError, csv.Error):
        with open_input(path) as file:
            data = file.read(MAX_BYTES + 1)
        if len(data) > MAX_BYTES:
            raise LavaError(field, str(path), f'a table of at most {MAX_BYTES} bytes')
        text = [
            '' if line.lstrip().startswith('#') else re.sub(r'\s#(\s.*|$)', '', line)
            for line in data.decode('utf-8-sig').splitlines()
        ]
        first = next((line for line in text if line.strip()), '').strip()
        separator = next((item for item in '\t;, ' if item in first), ',')
        reader = csv.reader(text, delimiter=separator, skipinitialspace=True)
        lines = [
            (reader.line_num, [cell.strip() for cell in row])
            for row in reader if any(cell.strip() for cell in row)
        ]
    if separator != ',':
        _use_points(path, lines)
    names = ','.join(columns or ['of names of columns'])
    if len(lines) < 2:
        expected = f'a first line {names} and at least one row'
        raise LavaError(f'number of lines in {path}', len(lines), expected)
    header = lines[0][1]
    if columns is not None and {*header} != {*columns}:
        raise LavaError(f'{path}, first line', ','.join(header), f'the columns {names}')
    if twice := [name for index, name in enumerate(header) if name in header[:index]]:
        raise LavaError(f'{path}, first line', ','.join(header), f'the column {twice[0]} once')
    result = []
    for number, row in lines[1:]:
        if len(row) != len(header):
            raise LavaError(f'{path}, line {number}', ','.join(row), f'{len(header)} values')
        result.append((f'{path}, line {number}', dict(zip(header, row, strict=True))))
    return result


def _use_points(path: Path, lines: Iterable[tuple[int, list[str]]]) -> None:
    """Replace decimal commas by points; raise LavaError if a table has both."""
    known = ''
    for line, row in lines:
        for index, cell in enumerate(row):
            if number := re.fullmatch(r'[-+]?\d*([.,])\d+(?:[eE][-+]?\d+)?', cell):
                known = known or cell
                if number[1] not in known:
                    expected = f'the decimal mark of {known}, without separators of thousands'
                    raise LavaError(f'{path}, line {line}', cell, expected)
                row[index] = cell.replace(',', '.')


def format_table(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> str:
    """Format rows as CSV; missing and unknown (None) values are empty."""
    text = StringIO()
    writer = csv.DictWriter(text, columns, lineterminator='\n')
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
