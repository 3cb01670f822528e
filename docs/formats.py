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

"""Write the tables of file formats into docs/FORMATS.md: `python docs/formats.py`."""

from collections.abc import Iterator
from pathlib import Path

from lava_ros.files import rasters

PAGE = Path(__file__).with_name('FORMATS.md')


def raster_rows() -> Iterator[tuple[str, ...]]:
    """Each raster format: what it is, and what reads and writes it."""
    yield ('format', 'file names', 'read by GDAL driver', 'limits', 'written')
    for item in rasters.FORMATS:
        names = ', '.join(f'`{suffix}`' for suffix in item.suffixes)
        yield (item.name, names, item.driver, item.notes, item.written)
    arrays = 'arrays with the names of `lava_ros.scene.terrain_files`'
    yield ('NumPy archive', '`.npz`', '', arrays, '')


#: Tables by the name of their section.
TABLES = {'rasters': raster_rows}


def table(rows: Iterator[tuple[str, ...]]) -> str:
    """Return a table in Markdown; the first row is its head."""
    lines = [f'| {" | ".join(row)} |'.replace('  |', ' |') for row in rows]
    return '\n'.join([lines[0], f'|{"---|" * (lines[0].count("|") - 1)}', *lines[1:], ''])


def page(text: str) -> str:
    """Return the page with its tables as they should be."""
    for name, rows in TABLES.items():
        begin, end = f'<!-- {name}: begin -->\n', f'<!-- {name}: end -->\n'
        before, _, rest = text.partition(begin)
        text = f'{before}{begin}\n{table(rows())}\n{end}{rest.partition(end)[2]}'
    return text


if __name__ == '__main__':
    PAGE.write_text(page(PAGE.read_text(encoding='utf-8')), encoding='utf-8')
