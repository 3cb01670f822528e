# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The one reader of tables of comma-separated values."""

from collections.abc import Sequence
import csv
from io import TextIOWrapper
from pathlib import Path

from lava_ros.errors import LavaError
from lava_ros.files import open_input


def read_table(
    field: str, path: Path, required: Sequence[str], optional: Sequence[str] | None
) -> list[tuple[str, dict[str, str]]]:
    """Read a table whose first line names its columns, separated by commas or semicolons.

    It has the required columns, and maybe the optional ones (None: any). Returns for each row what
    messages call it, and its texts by column. LavaError, which names ``field`` or the line, where
    it cannot be read, has no rows, other columns, a column twice, or rows of another length.
    """
    try:
        with TextIOWrapper(open_input(path), newline='', encoding='utf-8-sig') as file:
            text = file.read()
        # spreadsheets of countries with decimal commas
        separator = ';' if ';' in text.partition('\n')[0] else ','
        text = text.replace(',', '.') if separator == ';' else text
        reader = csv.reader(text.splitlines(), delimiter=separator, skipinitialspace=True)
        lines = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except FileNotFoundError:
        raise LavaError(field, str(path), 'a file that exists') from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise LavaError(field, str(path), f'a readable table of text ({error})') from error
    columns = ','.join(required) or 'of names of columns'
    if len(lines) < 2:
        right = f'a first line {columns} and at least one row'
        raise LavaError(str(path), f'{len(lines)} lines', right)
    header = [cell.strip() for cell in lines[0][1]]
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
        cells = (cell.strip() for cell in row)
        result.append((f'{path}, line {number}', dict(zip(header, cells, strict=True))))
    return result
