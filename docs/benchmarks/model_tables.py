# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Tables of the choices in docs/MODEL.md."""

from collections.abc import Iterator

from described_flows import described_flows
from kernel_ratio import time_ratio
from table_text import Line, lines_of


def kernel_radii() -> Iterator[Line]:
    """Yield the errors and CPU times of rules for the kernel radius, by refinement."""
    rows = lines_of('kernel_radius.csv')
    found = {(row['rule'], row['refinement']): row for row in rows}
    rules = list(dict.fromkeys(row['rule'] for row in rows))
    yield ('refinement', *rules)
    for refinement in dict.fromkeys(row['refinement'] for row in rows):
        line = []
        for rule in rules:
            row = found[rule, refinement]
            errors = ', '.join(
                f'{100.0 * float(row[name]):.2g}'
                for name in ('particle_error', 'map_error', 'whole_error', 'noise')
            )
            line.append(f'{errors} %; {float(row["cpu_s"]):.2g} s')
        yield refinement, *line


def kernel_ratios() -> Iterator[Line]:
    """Yield the CPU times of smaller kernels at equal error, over those of the presets' kernel."""
    yield 'kernel radius', 'thickness at the end', 'inundated area'
    rows = lines_of('kernel_ratio.csv')
    for ratio in (2.5, 3.0):
        line = []
        for error in ('thickness_error', 'area_error'):
            gains = sorted(
                time_ratio(rows, scene, ratio, error)
                for scene in dict.fromkeys(row['scene'] for row in rows)
            )
            middle = gains[len(gains) // 2]
            line.append(f'{middle:.2f} ({gains[0]:.2f} to {gains[-1]:.2f})')
        yield f'{ratio:g} spacings', *line


#: Rows of ground.csv in the table of MODEL: label, scene, column, quantity.
GROUNDS = (
    ('V-shaped valley, cells of 5 m: position of the front', 'valley', '5', 'front'),
    ('the same, cells of 10 m', 'valley', '10', 'front'),
    ('bumps 40 and 130 m long, cells of 5 m: thickness', 'rougher', '5', 'profile'),
    ('the same, cells of 10 m', 'rougher', '10', 'profile'),
    ('waves of 40 to 160 m, cells of 5 m: inundated area', 'rough_5m', '5', 'inundated_actual'),
    ('the same, cells of 10 m', 'rough_10m', '10', 'inundated_actual'),
    ('the same, cells of 20 m', 'rough_20m', '20', 'inundated_actual'),
    ('the same, cells of 20 m: part of the ground as stated', 'rough_20m', '20',
     'inundated_ground'),
    ('valley across cells of 10 m: inundated area', 'oblique_valley', '10', 'inundated_actual'),
    ('ground rough at all lengths, cells of 10 m: inundated area', 'fractal', '10',
     'inundated_actual'),
)


def grounds() -> Iterator[Line]:
    """Yield errors on three kinds of ground; of the finest particles of each scene."""
    columns = ('spline', 'third_order', 'through')
    yield ('error, %', 'of the elevations', 'of third order', 'through the elevations')
    rows = lines_of('ground.csv')
    for label, scene, cell, quantity in GROUNDS:
        row = [
            row for row in rows
            if (row['scene'], row['cell_m'], row['quantity']) == (scene, cell, quantity)
        ][-1]
        yield (label, *(f'{float(row[column]):.2g}' for column in columns))


def carriers() -> Iterator[Line]:
    """Yield the errors of carriers of heat on the same cells."""
    yield ('carrier', 'cells', 'front of `cooling_plane`', 'its area',
           'front of a sheet below a wall', 'CPU time over that of van Leer')
    rows = lines_of('cell_heat.csv')
    times = {row['cell']: float(row['cpu']) for row in rows if row['carrier'] == 'van Leer'}
    for row in rows:
        yield (
            row['carrier'], f'{row["cell"]} m', *(
                f'{100.0 * float(row[name]):+.1f} %'
                for name in ('plane front', 'plane area', 'sheet front')
            ), f'{float(row["cpu"]) / times[row["cell"]]:.1f}',
        )


def described() -> Iterator[Line]:
    """Yield the described flows with the kind that follows from their numbers."""
    yield 'flow', 'Q [m³/s]', 'slope', 'Ψ', 'kind of the authors', 'kind found', 'source'
    for flow in described_flows():
        found = flow.found.name
        yield (
            flow.name, f'{flow.found.discharge:g}', f'{flow.found.slope:g}',
            f'{float(f"{flow.found.crust:.2g}"):g}', flow.kind,
            f'**{found}**: {flow.missed_because}' if flow.missed_because else found, flow.source,
        )


def mobility_limits() -> Iterator[Line]:
    """Yield cost and area of a flow by the limit of the mobility."""
    yield ('limit', 'steps', 'CPU time', 'area of the runs', 'Jaccard index of the majorities')
    for row in lines_of('mobility_limit.csv'):
        limit, scatter = row['mobility_limit_m_per_s'], row['area_deviation_km2']
        yield (
            f'{limit} m/s' if limit else 'none', f'{float(row["steps"]):,.0f}',
            f'{float(row["cpu_s"]):.1f} s',
            f'{float(row["area_km2"]):.2f} ± {float(scatter):.2f} km²',
            f'{float(row["jaccard_of_majorities"]):.2f}',
        )
