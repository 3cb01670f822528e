# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Tables of numerical errors, plans and forecasts of known truths."""

from collections.abc import Iterable, Iterator, Mapping
import statistics

from table_text import Line, lines_of, percent

#: Names of the areas in numerical_error.csv, and the number of particles across of its table.
AREAS, MAP_ACROSS = ('inundated', 'standing'), 16.0


def numerical_error() -> Iterator[Line]:
    """Yield the stated and the actual error of a run of each scene, about as fine as for maps."""
    yield (
        'scene', 'cells', 'particles', 'partner runs', 'inundated area: stated',
        'by particles, ground',
        'actual', 'standing: stated', 'actual',
    )
    rows = [row for row in lines_of('numerical_error.csv') if row['method'] == 'particles']
    for scene in dict.fromkeys(row['scene'] for row in rows):
        row = min(
            (row for row in rows if row['scene'] == scene),
            key=lambda row: abs(float(row['across']) / MAP_ACROSS - 1.0),
        )
        cost = float(row['partners_cpu_s']) / float(row['cpu_s'])
        yield (
            scene.replace('_', ' '),
            f'{float(row["cell_m"]):g} m',
            f'{int(row["carriers"]):,}',
            f'{row["partner"].split()[0]}, {100.0 * cost:.0f} % of the time',
            f'{percent(row["inundated_stated"])} %',
            f'{percent(row["inundated_particles"])}, {percent(row["inundated_ground"])}',
            f'**{percent(row["inundated_actual"])} %**',
            f'{percent(row["standing_stated"])} %',
            f'**{percent(row["standing_actual"])} %**',
        )


def numerical_error_counts() -> Iterator[Line]:
    """Yield how many stated errors are close to the actual ones, by the partner runs."""
    yield (
        'runs', 'partner runs', 'area', 'runs', 'within a factor of 1.5', 'of 2', 'of 3',
        'stated over actual, median', 'smallest', 'largest', 'time of the partners, median',
    )
    rows = lines_of('numerical_error.csv')
    for method, partner, prefix in (
        ('particles', 'cells', ''), ('particles', 'cells', 'coarser_'),
        ('particles', 'particles', ''), ('cells', 'cells', ''),
    ):
        found = [
            row for row in rows
            if row['method'] == method and row['partner'].split()[0] == partner
        ]
        costs = [
            float(row[f'{prefix or "partners_"}cpu_s']) / float(row['cpu_s']) for row in found
        ]
        for name in AREAS:
            ratios = [float(row[f'{name}_{prefix}ratio']) for row in found]
            yield (
                method, 'coarser particles instead' if prefix else partner, name,
                f'{len(ratios)}', *(
                    f'{sum(1.0 / factor <= ratio <= factor for ratio in ratios)}'
                    for factor in (1.5, 2.0, 3.0)
                ),
                f'{statistics.median(ratios):.2g}', f'{min(ratios):.2g}', f'{max(ratios):.2g}',
                f'{100.0 * statistics.median(costs):.0f} %',
            )


def plans() -> Iterator[Line]:
    """Yield how much of its time planning takes, and how near its predictions are."""
    rows = lines_of('plan.csv')

    def spread(values: Iterable[float], unit: str = ' %') -> tuple[str, str]:
        ordered = [float(f'{value:.2g}') for value in sorted(values)]
        middle = ordered[len(ordered) // 2]
        return f'{ordered[0]:g} to {ordered[-1]:g}{unit}', f'{middle:g}{unit}'

    def ratio(name: str, other: str, kept: Iterable[Mapping[str, str]]) -> Iterator[float]:
        return (float(row[name]) / float(row[other]) for row in kept)

    used = [row for row in rows if row['is_finest'] == 'False']
    yield (f'{len(rows)} plans', 'range', 'median')
    yield (
        'planning, of the time', *spread(float(row['planning_of_time_percent']) for row in rows)
    )
    yield (
        'time taken over predicted, of runs above 0.1 s',
        *spread(
            ratio('taken_s', 'planned_s', [r for r in rows if float(r['taken_s']) > 0.1]), ''
        ),
    )
    yield (
        f'time taken, of the time, of the {len(used)} plans that are not limited by the ground',
        *spread(float(row['taken_of_time_percent']) for row in used),
    )
    late = sum(float(row['taken_of_time_percent']) > 100.0 for row in rows)
    yield 'runs that take more than the time', f'{late} of {len(rows)}', ''
    yield (
        'error predicted over that by the partner runs of the planned run',
        *spread(ratio('error_planned_percent', 'error_measured_percent', rows), ''),
    )


def twins() -> Iterator[Line]:
    """Yield how often truths arrive before the forecast times, and the reliability."""
    yield (
        'truths', 'particles across', 'before the earliest', 'before P10', 'before P50',
        'before P90', 'reliability', 'lava where no member has any', 'time of the pairs',
    )
    for row in lines_of('twins.csv'):
        # forecasts that are not usable are not corrected
        shown = ('uncorrected', 'ensemble') if row['usable'] == 'True' else ('uncorrected',)
        if row['forecast'] in shown:
            points = f'{float(row["reliability_points"]):.1f} points'
            yield (
                f'{row["truths"]} {row["truths_are"].replace("_", " ")}'
                + (', not corrected' if row['forecast'] == 'uncorrected' else ''),
                f'{float(row["across"]):.0f}'
                + ('' if row['usable'] == 'True' else ', not usable'),
                *(
                    f'{float(row[f"before_{name}"]):.0f} %'
                    for name in ('earliest', 'p10', 'p50', 'p90')
                ),
                points,
                f'{float(row["outside_percent"]):.1f} %',
                f'{float(row["pairs_cost_percent"]):.0f} %',
            )


def twins_outline() -> Iterator[Line]:
    """Yield the Brier score of the same truths without and with an outline."""
    yield ('truths', 'particles across', 'forecast', 'Brier score without the outline', 'with it',
           'reliability with it', 'before P10', 'before P90')
    for row in lines_of('twins.csv'):
        if 'outline' in row['forecast']:
            yield (
                f'{row["truths"]} {row["truths_are"].replace("_", " ")}',
                f'{float(row["across"]):.0f}',
                row['forecast'],
                f'{float(row["brier_without_outline"]):.3f}',
                f'{float(row["brier_score"]):.3f}',
                f'{float(row["reliability_points"]):.1f} points',
                f'{float(row["before_p10"]):.0f} %',
                f'{float(row["before_p90"]):.0f} %',
            )
