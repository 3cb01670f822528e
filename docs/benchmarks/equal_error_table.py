# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Write the tables of CPU time at equal error in README.md, as tables.py does.

python docs/benchmarks/equal_error_table.py
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import takewhile
import math
from statistics import median

from table_text import HERE, Line, lines_of, written

PAGE = HERE / 'README.md'

#: Preset of the rows of method cells.
CELLS = 'cells'

#: Columns of the errors.
ERRORS = ('inundated', 'thickness')


def at_error(runs: Sequence[Mapping[str, str]], name: str, error: float) -> float:
    """Return the CPU time [s] beyond which all runs have at most an error.

    The time is interpolated in logarithms between the coarsest such run and the next coarser one;
    it is infinite if the finest run has a larger error.
    """
    ordered = sorted(runs, key=lambda row: float(row['spacing_m']))
    points = [(float(row[name]), float(row['cpu_s'])) for row in ordered]
    good = list(takewhile(lambda point: point[0] <= error, points))
    if not good:
        return math.inf
    if len(good) == len(points):
        return good[-1][1]
    (low, slow), (high, fast) = good[-1], points[len(good)]
    part = math.log(error / low) / math.log(high / low)
    return slow * min(fast / slow, 1.0) ** part


def two_digits(number: float) -> str:
    """Format a number with two digits, without an exponent."""
    return f'{float(f"{number:.2g}"):g}' if math.isfinite(number) else 'not reached'


def scenes() -> Iterator[tuple[str, Mapping[str, str], list[dict[str, str]]]]:
    """Yield each scene, its run before and its runs after."""
    rows = lines_of('equal_error.csv')
    for scene in dict.fromkeys(row['scene'] for row in rows):
        before, *after = (row for row in rows if row['scene'] == scene)
        yield scene, before, after


def equal_error() -> Iterator[Line]:
    """Yield the CPU time of each method at the error of `standard` before, over its time."""
    yield (
        'scene', 'cells', '`standard` before', 'inundated', 'time of particles', 'of method cells',
        'thickness', 'time of particles', 'of method cells',
    )
    ratios = defaultdict[tuple[str, bool], list[float]](list)
    for scene, before, after in scenes():
        time, columns = float(before['cpu_s']), []
        for name in ERRORS:
            columns.append(f'{two_digits(100.0 * float(before[name]))} %')
            for is_cells in (False, True):
                runs = [row for row in after if (row['preset'] == CELLS) == is_cells]
                ratio = at_error(runs, name, float(before[name])) / time
                ratios[name, is_cells].append(ratio)
                columns.append(two_digits(ratio))
        size = f'{float(before["cell_m"]):g} m'
        yield (scene.replace('_', ' '), size, f'{two_digits(time)} s', *columns)
    middle = {key: f'**{two_digits(median(values))}**' for key, values in ratios.items()}
    yield ('median', '', '', *(
        cell for name in ERRORS for cell in ('', middle[name, False], middle[name, True])
    ))


def presets() -> Iterator[Line]:
    """Yield the time and the errors of presets, over those of `standard` before."""
    yield ('preset', 'CPU time', *(f'error, {name}' for name in ERRORS))
    for preset in ('draft', 'standard'):
        ratios = [
            [float(row[name]) / float(before[name]) for name in ('cpu_s', *ERRORS)]
            for _, before, after in scenes()
            for row in after
            if row['preset'] == preset
        ]
        columns = [sorted(values) for values in zip(*ratios, strict=True)]
        yield (f'`{preset}`', *(
            '{} ({} to {})'.format(*map(two_digits, (median(values), values[0], values[-1])))
            for values in columns
        ))


TABLES = {'equal_error': equal_error, 'equal_error_presets': presets}


if __name__ == '__main__':
    PAGE.write_text(written(PAGE.read_text(encoding='utf-8'), TABLES), encoding='utf-8')
