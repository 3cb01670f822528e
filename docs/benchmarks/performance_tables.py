# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Tables of the times of steps and members in docs/PERFORMANCE.md."""

from collections.abc import Iterator

from table_text import Line, lines_of


def steps() -> Iterator[Line]:
    """Yield the time of a step of one simulation, by its number of particles."""
    rows = [row for row in lines_of('steps_h200.csv') if row['benchmark'].endswith(': step')]
    names = list(dict.fromkeys(row['benchmark'].removesuffix(': step') for row in rows))
    yield ('particles', *(f'{name} [us]' for name in names))
    found: dict[str, dict[str, str]] = {}
    for row in rows:
        count = float(row['particles'])
        size = f'{float(f"{count:.1g}"):,.0f}'
        found.setdefault(size, {})[row['benchmark'].removesuffix(': step')] = (
            f'{float(row["value"]):,.4g}'
        )
    for size, line in found.items():
        yield size, *(line.get(name, '') for name in names)


def covered_cells() -> Iterator[Line]:
    """Yield the time of a step by the way in which it records the covered ground."""
    rows = lines_of('covered_cells_h200.csv')
    ways = list(dict.fromkeys(row['covered ground'] for row in rows))
    columns = rows[: len(rows) // len(ways)]
    yield ('covered ground', *(
        f'{row["benchmark"]}, {round(float(row["particles"]), -4):,.0f} [us]' for row in columns
    ))
    for way in ways:
        values = [float(row['value']) for row in rows if row['covered ground'] == way]
        yield way, *(f'{value:,.4g}' for value in values)


def members() -> Iterator[Line]:
    """Yield the speed of the members of a batch, by their number and size."""
    rows = lines_of('members_h200.csv')
    sizes = sorted({int(row['particles']) for row in rows})
    sets = list(dict.fromkeys(row['benchmark'].split(':')[0] for row in rows))
    yield ('members', *(f'{name}, {size:,} particles' for name in sets for size in sizes))
    found = {(row['benchmark'], int(row['particles'])): row for row in rows}
    counts = {int(row['benchmark'].split()[1]) for row in rows}
    for count in sorted(counts):
        line = []
        for name in sets:
            for size in sizes:
                row = found.get((f'{name}: {count} members', size))
                line.append('' if row is None else f'{float(row["value"]) / 1000.0:.2g}')
        yield f'{count:,}', *line


def cell_stages() -> Iterator[Line]:
    """Yield the time of a stage on cells, by the size of the window."""
    rows = lines_of('cell_stages_h200.csv')
    kinds = list(dict.fromkeys(row['lava'] for row in rows))
    yield ('cells of the window', *(f'lava {kind} [us]' for kind in kinds))
    for size in dict.fromkeys(row['cells'] for row in rows):
        yield size, *(row['us_a_stage'] for row in rows if row['cells'] == size)
