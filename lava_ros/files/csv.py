# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The one reader of tables of text."""

from collections.abc import Sequence
import csv
from pathlib import Path
import re

from lava_ros.errors import LavaError
from lava_ros.files import open_input

#: Longest table that is read [bytes].
MAX_BYTES = 64 * 2**20

#: A number with a decimal comma.
_COMMA = re.compile(r'[-+]?\d*,\d+(?:[eE][-+]?\d+)?')


def read_table(
    field: str, path: Path, required: Sequence[str], optional: Sequence[str] | None
) -> list[tuple[str, dict[str, str]]]:
    """Read a table whose first line names its columns.

    Values are separated by tabs, semicolons, commas or spaces, the first of them that the first
    line has. Lines that begin with ``#`` are comments, and so is the rest of a line after `` #``.
    Numbers may have decimal commas where commas separate nothing.

    It has the required columns, and maybe the optional ones (None: any). Returns for each row what
    messages call it, and its texts by column. LavaError, which names ``field`` or the line, where
    it cannot be read, has no rows, other columns, a column twice, or rows of another length.
    """
    try:
        with open_input(path) as file:
            data = file.read(MAX_BYTES + 1)
        if len(data) > MAX_BYTES:
            raise LavaError(field, str(path), f'a table of at most {MAX_BYTES} bytes')
        text = [
            '' if line.lstrip().startswith('#') else re.sub(r'\s#.*', '', line)
            for line in data.decode('utf-8-sig').splitlines()
        ]
        first = next((line for line in text if line.strip()), '').strip()
        separator = next((item for item in '\t;, ' if item in first), ',')
        reader = csv.reader(text, delimiter=separator, skipinitialspace=True)
        lines = [
            (reader.line_num, [_cell(cell, separator) for cell in row])
            for row in reader if any(cell.strip() for cell in row)
        ]
    except FileNotFoundError:
        raise LavaError(field, str(path), 'a file that exists') from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise LavaError(field, str(path), f'a readable table of text ({error})') from error
    columns = ','.join(required) or 'of names of columns'
    if len(lines) < 2:
        right = f'a first line {columns} and at least one row'
        raise LavaError(str(path), f'{len(lines)} lines', right)
    header = lines[0][1]
    allowed = header if optional is None else (*required, *optional)
    unknown = [name for name in header if name not in allowed]
    if any(name not in header for name in required) or unknown:
        more = f', and maybe {", ".join(optional)}' if optional else ''
        raise LavaError(f'{path}, first line', ','.join(header), f'the columns {columns}{more}')
    twice = [name for index, name in enumerate(header) if name in header[:index]]
    if twice:
        raise LavaError(f'{path}, first line', ','.join(header), f'the column {twice[0]} once')
    result = []
    for number, row in lines[1:]:
        if len(row) != len(header):
            raise LavaError(f'{path}, line {number}', ','.join(row), f'{len(header)} values')
        result.append((f'{path}, line {number}', dict(zip(header, row, strict=True))))
    return result


def _cell(text: str, separator: str) -> str:
    """Return the text of a cell with a decimal point."""
    text = text.strip()
    return text.replace(',', '.') if separator != ',' and _COMMA.fullmatch(text) else text
