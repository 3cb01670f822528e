# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Write tables of pages in docs/ from the CSV files in this folder.

python docs/benchmarks/tables.py

A table is between ``<!-- table: NAME -->`` and ``<!-- end -->``.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
import csv
import math
from pathlib import Path
import re
import statistics

from described_flows import described_flows
from kernel_ratio import time_ratio

HERE = Path(__file__).parent

#: Cells of a row of a table.
Line = tuple[str, ...]


def lines_of(name: str | Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file, by default in the folder of this script."""
    with (HERE / name).open(newline='', encoding='utf-8') as file:
        return list(csv.DictReader(file))


def scores() -> Iterator[Line]:
    """Yield the scores of sets of constants on the mapped flows."""
    yield ('constants', 'flow', 'preset', 'majority', 'single runs', 'area', 'length')
    for row in lines_of('eruptions.csv'):
        yield (
            row['constants'],
            row['case'].removeprefix('etna'),
            f'`{row["preset"]}`, {float(row["spacing_m"]):.2g} m, {row["runs"]} runs',
            f'**{float(row["majority"]):.2f}**',
            f'{float(row["single"]):.2f} ± {float(row["single_deviation"]):.2f}',
            f'x {float(row["area_ratio"]):.2f}',
            f'x {float(row["length_ratio"]):.2f}',
        )


def etna_cells() -> Iterator[Line]:
    """Yield areas and scores of a flow on cells of some sizes, with other rules for the edge."""
    yield ('flow', 'carriers', 'edge as thick as', 'area after five days',
           'area over the mapped one', 'length', 'Jaccard index')
    for row in lines_of('etna_cells.csv'):
        is_cells = row['method'] == 'cells'
        jaccard, area, length = (
            format(float(row[name]), '.2f') if row[name] else ''
            for name in ('jaccard', 'area_ratio', 'length_ratio')
        )
        yield (
            row['case'].removeprefix('etna'),
            (f'cells of {row["cell_m"]} m' if is_cells else 'particles, `draft`')
            + (', other crust' if row['crust'] else ''),
            f'{row["edge"]} of its neighbour' if is_cells else '',
            f'{float(row["area_m2"]) / 1e6:.3f} km²', area and f'x {area}',
            length and f'x {length}', jaccard,
        )


#: Names of the mapped eruptions, and of the sets of constants with the flows that they fit: the
#: beginning of the case and of the date of the outline.
ERUPTIONS = {
    'etna2001': 'Etna 2001', 'etna2006': 'Etna 2006', 'lapalma2021': 'La Palma 2021',
}
MATERIALS = {
    'etna_basalt': ('`etna_basalt`', ('etna',)),
    'fitted to all flows': ('fitted to all flows', ('etna', 'lapalma')),
    'fitted to 24 September': ('fitted to La Palma, 24 September', ('lapalma2021 2021-09-24',)),
    'basalt': ('`basalt`', ()),
}


def _flow_rows() -> dict[tuple[str, str], dict[str, dict[str, str]]]:
    """Return the rows of runs from the onset, by case and outline, and by set."""
    found: dict[tuple[str, str], dict[str, dict[str, str]]] = {}
    for row in lines_of('flows.csv'):
        if not row['from_outline']:
            found.setdefault((row['case'], row['outline']), {})[row['constants']] = row
    return dict(sorted(found.items()))


def flows() -> Iterator[Line]:
    """Yield the scores of all mapped flows at draft, fitted or not, beside two references."""
    yield ('flow', *(title for title, _ in MATERIALS.values()), 'steepest descent',
           'outline before')
    scores: dict[str, dict[str, list[float]]] = {name: {} for name in MATERIALS}
    for (case, outline), rows in _flow_rows().items():
        cells = []
        for name, (_, fitted) in MATERIALS.items():
            score = float(rows[name]['jaccard'])
            scores[name].setdefault(case, []).append(score)
            cells.append(f'{score:.2f}' + ' (fitted)' * f'{case} {outline}'.startswith(fitted))
        first = rows['etna_basalt']
        before = first['persistence']
        date = outline.removesuffix('T12:00:00Z')
        yield (
            f'{ERUPTIONS[case]}{date and f", {date}"}', *cells, f'{float(first["descent"]):.2f}',
            f'{float(before):.2f}' if before else '',
        )
    means = (
        sum(sum(values) / len(values) for values in cases.values()) / len(cases)
        for cases in scores.values()
    )
    yield ('mean of the three eruptions', *(f'**{mean:.2f}**' for mean in means), '', '')


def left_out() -> Iterator[Line]:
    """Yield the scores of each eruption with the set that is best for the two others."""
    rows = lines_of('calibration_flows_h200.csv')
    names = list(dict.fromkeys(row['case'] for row in rows))
    cases = [name.partition(' ')[0] for name in names]
    sets = [rows[first : first + len(names)] for first in range(0, len(rows), len(names))]

    def score(number: int, case: str) -> float:
        own = [float(row['jaccard']) for row in sets[number] if row['case'].startswith(case)]
        return sum(own) / len(own)

    def mean(number: int, wanted: Iterable[str]) -> float:
        return sum(score(number, case) for case in wanted)

    numbers = range(len(sets))
    together = max(numbers, key=lambda number: mean(number, dict.fromkeys(cases)))
    yield ('eruption left out', 'set that is best for the two others', 'its viscosity',
           'best set of all three', 'its own best set')
    for case in dict.fromkeys(cases):
        others = [other for other in dict.fromkeys(cases) if other != case]
        chosen = max(numbers, key=lambda number, others=others: mean(number, others))
        yield (
            ERUPTIONS[case], f'**{score(chosen, case):.2f}**',
            f'{float(sets[chosen][0]["viscosity"]):,.0f} Pa s', f'{score(together, case):.2f}',
            f'{max(score(number, case) for number in numbers):.2f}',
        )


def fluid() -> Iterator[Line]:
    """Yield the cost of fluid lava on the mapped flows, and of a fitted material."""
    yield ('flow', 'material', 'spacing', 'limit', 'CPU time', 'Jaccard index', 'area')
    for (case, outline), rows in _flow_rows().items():
        # the area at the last outline, to which the time belongs
        if outline and not outline.startswith('2021-10-21'):
            continue
        for name in ('etna_basalt', 'basalt'):
            row = rows[name]
            limit, cpu = row['mobility_limit_m_per_s'], row['cpu_s']
            yield (
                ERUPTIONS[case], f'`{name}`', f'{float(row["spacing_m"]):g} m',
                f'{float(limit):g} m/s' if limit else 'none',
                f'{float(cpu):.1f} s' if cpu else '', f'{float(row["jaccard"]):.2f}',
                f'x {float(row["area_ratio"]):.2f}',
            )


def codes() -> Iterator[Line]:
    """Yield the scores of other codes on the same data."""
    yield ('code', 'flow', 'Jaccard', 'parameters')
    for row in sorted(lines_of('eruptions_codes.csv'), key=lambda row: -float(row['jaccard'])):
        flow = row['case'].removeprefix('etna')
        yield row['code'], flow, row['jaccard'], f'{row["constants"]}; {row["source"]}'


def chances() -> Iterator[Line]:
    """Yield the scores of probabilities of the largest ensemble of each case."""
    yield ('flow', 'ensemble', 'mapped area', 'area of 90 to 10 %', 'Brier score',
           'skill where lava could come',
           'skill over all of the ground', 'largest gap', 'a member as the truth: largest gap',
           'its skill', 'with its outline at a third')
    rows = {row['case']: row for row in lines_of('probability_cpu.csv')}.values()
    for row in rows:
        yield (
            ERUPTIONS[row['case']].rstrip(', '),
            f'{row["members"]} members, {float(row["spacing_m"]):.2g} m',
            f'{float(row["mapped_km2"]):.2f} km²',
            f'{float(row["area_p90_km2"]):.2f} to {float(row["area_p10_km2"]):.2f} km²',
            f'{float(row["brier_score"]):.3f}',
            f'**{float(row["brier_skill"]):.2f}**',
            f'**{float(row["brier_skill_of_terrain"]):.2f}**',
            f'{100.0 * float(row["largest_gap"]):.0f} points',
            f'{100.0 * float(row["twin_gap"]):.0f} points',
            f'{float(row["twin_skill"]):.2f}',
            f'{float(row["twin_skill_with_outline"]):.2f}',
        )
    gap = 100.0 * largest_gap([row['reliability'] for row in rows])
    yield ('together', '', '', '', '', '', '', f'{gap:.0f} points', '', '', '')


#: Ensembles of La Palma by the name of their case, which has the default ranges unless it is here.
WAYS = {
    'wide_viscosity': 'viscosity of 1 kPa s to 10 MPa s',
    'wide_viscosity_contours': 'viscosity of 1 kPa s to 10 MPa s',
    'from_24_september': 'from the outline of 24 September, vents of 1 October',
    'from_8_october': 'from the outline of 8 October, vents of 1 October',
}


def dates() -> Iterator[Line]:
    """Yield areas and skills of the ensembles of a case with dated outlines, by date."""
    rows = lines_of('probability_dates.csv')
    first, *others = (
        name for name in dict.fromkeys(row['ensemble'] for row in rows)
        if name != 'published ranges'
    )
    yield ('ensemble', 'outline', 'mapped area', 'area of 90 to 10 %',
           'areas of single members', 'largest gap',
           'Brier skill', 'skill against the outline before',
           *(f'Brier skill {name.replace("T12:00:00Z", "")}' for name in others))

    def skill(row: Mapping[str, str] | None, name: str = 'brier_skill') -> str:
        return f'{float(row[name]):.2f}' if row and row[name] else ''

    keys = ('case', 'terrain', 'members', 'ensemble', 'date')
    found = {tuple(row[key] for key in keys): row for row in rows}
    for (*drawn, ensemble, date), row in found.items():
        if ensemble == first:
            areas = [row[f'{name}_km2'] for name in ('mapped', 'area_p90', 'area_p10')]
            mapped, low, high = (f'{float(area):.2f}' if area else '' for area in areas)
            yield (
                f'{WAYS.get(row["case"], "default ranges")}, ground '
                f'{row["terrain"].split(",")[0]} '
                f'({row["members"]} members, {float(row["spacing_m"]):.2g} m)',
                date.removesuffix('T12:00:00Z'),
                f'{mapped} km²' if mapped else '',
                f'{low} to {high} km²' if low else '',
                f'{float(row["member_low_km2"]):.2f} to {float(row["member_high_km2"]):.2f} km²'
                if row['member_low_km2'] else '',
                f'{100.0 * float(row["largest_gap"]):.0f} points',
                f'**{skill(row)}**',
                skill(row, 'brier_skill_persistence'),
                *(skill(found.get((*drawn, name, date))) for name in others),
            )


#: Runs of La Palma by the outline of their start and the file of their vents.
STARTS = {
    ('', ''): 'from the onset, one vent',
    ('2021-09-24T12:00:00Z', ''): 'from the outline of 24 September, one vent',
    ('2021-09-24T12:00:00Z', 'lapalma_vents'): '... and the vents of 1 October',
    ('2021-09-24T12:00:00Z', 'lapalma_vents_hot'): '... and later lava 40 K hotter',
}


def outlines() -> Iterator[Line]:
    """Yield the scores of the set of 24 September on later outlines of La Palma, by the start."""
    rows = [row for row in lines_of('flows.csv') if row['constants'] == 'fitted to 24 September'
            and row['case'].startswith('lapalma') and row['outline'] > '2021-09-25']
    dates = sorted({row['outline'] for row in rows})
    yield ('run', *(date.removesuffix('T12:00:00Z') for date in dates))
    for start, text in STARTS.items():
        own = {row['outline']: row for row in rows if (row['from_outline'], row['vents']) == start}
        yield (text, *(
            f'{float(own[date]["jaccard"]):.2f} (x {float(own[date]["area_ratio"]):.2f}, '
            f'x {float(own[date]["length_ratio"]):.2f})' for date in dates
        ))
    before = {row['outline']: row for row in rows if not row['from_outline']}
    yield ('outline before', *(f'{float(before[date]["persistence"]):.2f}' for date in dates))
    first = {row['outline']: row for row in rows if row['from_outline']}
    yield ('outline of 24 September', *(
        f'{float(first[date]["persistence_of_start"]):.2f}' for date in dates
    ))


def largest_gap(diagrams: Iterable[str]) -> float:
    """Return the largest gap in the combined bins of diagrams with at least 200 cells."""
    bins: dict[int, list[tuple[float, float, int]]] = {}
    for text in diagrams:
        for point in text.split():
            forecast, observed, count = point.split(':')
            bins.setdefault(min(int(10.0 * float(forecast)), 9), []).append(
                (float(forecast), float(observed), int(count))
            )
    return max(
        abs(sum(count * (forecast - observed) for forecast, observed, count in points)) / cells
        for points in bins.values()
        if (cells := sum(count for *_, count in points)) >= 200
    )


def front() -> Iterator[Line]:
    """Yield the lowest elevation that lava has reached by some times."""
    yield ('time', 'lowest cell', 'of single runs')
    for row in lines_of('front.csv'):
        hours = row['hours']
        is_mapped = hours == 'mapped'
        time = 'mapped flow' if is_mapped else (
            f'{float(hours) / 24:g} d' if float(hours) >= 24 else f'{hours} h'
        )
        between = f'{float(row["lowest_m"]):,.0f} to {float(row["highest_m"]):,.0f} m'
        yield time, f'{float(row["elevation_m"]):,.0f} m', '' if is_mapped else between


def hindcast_steps() -> Iterator[Line]:
    """Yield the time and the scores of hindcasts, by integrator and displacement in a step."""
    yield (
        'flow', 'integrator', 'cells in a step', 'evaluations', 'one run', 'majority',
        'single runs', 'area', 'length',
    )
    for row in lines_of('hindcast_steps_h200.csv'):
        yield (
            row['case'].removeprefix('etna'),
            row['integrator'].upper(),
            f'{float(row["courant_number"]):g}',
            f'{int(row["evaluations"]):,}',
            f'{float(row["seconds"]):.2f} s',
            f'{float(row["majority"]):.3f}',
            f'{float(row["single"]):.3f} ± {float(row["single_deviation"]):.3f}',
            f'x {float(row["area_ratio"]):.2f}',
            f'x {float(row["length_ratio"]):.2f}',
        )


def commands() -> Iterator[Line]:
    """Yield the wall times of whole commands on the mapped flows."""
    yield ('program', 'flow', 'runs', 'command', 'its simulation')
    rows = lines_of('hindcast_command_h200.csv')
    for key in dict.fromkeys((row['program'], row['flow'], row['runs']) for row in rows):
        same = [row for row in rows if (row['program'], row['flow'], row['runs']) == key]
        times = [
            sorted(float(row[name]) for row in same if row[name])
            for name in ('seconds', 'simulation_seconds')
        ]
        yield (*key, *(
            f'{values[0]:.1f} to {values[-1]:.1f} s' if values else '' for values in times
        ))


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


def allowed_delay(window: float, speed: float, heartbeat: float) -> float:
    """Return the delay of a mask for which a rolling window still has it under the robot [s].

    From the side of the window [m], the speed of the robot [m/s] and the heartbeat of the mask [s]
    (docs/NAV2.md), for a robot of 0.3 m in cells of 0.05 m that are updated at 5 Hz.
    """
    radius, cell, updates = 0.3, 0.05, 5.0
    return (0.5 * window - radius - cell) / speed - heartbeat - 1.0 / updates


def rolling_windows() -> Iterator[Line]:
    """Yield the costmaps that have the mask under a moving robot, by window and speed."""
    rows = lines_of('rolling_window.csv')
    kinds = list(dict.fromkeys((row['heartbeat_s'], row['static_layer']) for row in rows))
    yield ('window [m]', 'speed [m/s]', *(
        f'static layer, {float(heartbeat):g} s' if static == 'True' else f'{float(heartbeat):g} s'
        for heartbeat, static in kinds
    ))
    found = {
        (row['window_m'], row['speed_m_s'], row['heartbeat_s'], row['static_layer']): row
        for row in rows
    }
    for window, speed in dict.fromkeys((row['window_m'], row['speed_m_s']) for row in rows):
        line = []
        for heartbeat, static in kinds:
            row = found[window, speed, heartbeat, static]
            delay = allowed_delay(float(window), float(speed), float(heartbeat))
            text = f'{row["whole"]} of {row["costmaps"]}'
            if static != 'True':
                text += f', {"safe" if delay > 0.0 else "**not safe**"} ({delay:.2f} s)'
            line.append(text)
        yield window, speed, *line


def masks() -> Iterator[Line]:
    """Yield the cost of a mask with the shipped heartbeat, and the received masks, by its size."""
    yield ('cells', 'node [% of a core]', 'subscriber [% of a core]', 'received: reliable',
           'received: best_effort')
    rows = lines_of('masks.csv')
    for row in rows:
        if not int(row['due']):
            continue
        idle = next(
            item for item in rows if item['side'] == row['side'] and not int(item['due'])
        )
        side = int(row['side'])
        yield (
            f'{side:,} x {side:,}',
            f'{row["node_percent"]} (without masks {idle["node_percent"]})',
            f'{row["reliable_percent"]} (without masks {idle["reliable_percent"]})',
            f'{row["reliable_received"]} of {row["due"]}',
            f'{row["best_effort_received"]} of {row["due"]}',
        )


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
            f'{_percent(row["inundated_stated"])} %',
            f'{_percent(row["inundated_particles"])}, {_percent(row["inundated_ground"])}',
            f'**{_percent(row["inundated_actual"])} %**',
            f'{_percent(row["standing_stated"])} %',
            f'**{_percent(row["standing_actual"])} %**',
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


def _percent(fraction: str) -> str:
    return f'{float(f"{100.0 * float(fraction):.2g}"):g}'


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
    yield ('carrier', 'cells', 'front of `cooling_plane`', 'its area', 'front of `cooling_front`',
           'CPU time over that of van Leer')
    rows = lines_of('cell_heat.csv')
    times = {row['cell']: float(row['cpu']) for row in rows if row['carrier'] == 'van Leer'}
    for row in rows:
        yield (
            row['carrier'], f'{row["cell"]} m', *(
                f'{100.0 * float(row[name]):+.1f} %'
                for name in ('plane front', 'plane area', 'sheet front')
            ), f'{float(row["cpu"]) / times[row["cell"]]:.1f}',
        )


def methods() -> Iterator[Line]:
    """Yield how runs on cells differ from those of particles at draft, by the kind of flow."""
    rows = [row for row in lines_of('methods.csv') if row['preset'] == 'draft']
    particles = {row['scene']: row for row in rows if row['method'] == 'particles'}
    kinds: dict[str, list[tuple[float, float, float]]] = {}
    for row in rows:
        other = particles.get(row['scene'])
        if row['method'] == 'particles' or other is None:
            continue
        kind = 'cells lack an effect' if row['lacking'] else 'lava does not freeze'
        if not row['lacking'] and 'solidification' in row['effects'].split():
            kind = 'lava freezes'
        stated = math.hypot(float(row['stated']), float(other['stated']))
        ratio = float(row['cpu_s']) / float(other['cpu_s'])
        kinds.setdefault(kind, []).append((float(row['difference']), stated, ratio))
    yield ('flow', 'scenes', 'difference of the inundated areas, median',
           'at most twice the stated errors of both', 'CPU time over that of particles, median')
    for kind, found in sorted(kinds.items(), key=lambda item: -len(item[1])):
        differences, _, ratios = zip(*found, strict=True)
        agreeing = sum(one <= 2.0 * stated for one, stated, _ in found)
        yield (
            kind, str(len(found)), f'{100.0 * statistics.median(differences):.0f} %',
            f'{agreeing} of {len(found)}', _two_digits(str(statistics.median(ratios))),
        )


def method_scores() -> Iterator[Line]:
    """Yield the scores of mapped eruptions by both methods."""
    yield ('flow', 'preset', 'method', 'Jaccard index', 'area', 'CPU time')
    for row in lines_of('methods.csv'):
        if row['jaccard']:
            spacing = float(row['spacing_m'])
            apart = 'cells of' if row['method'] == 'cells' else 'particles'
            yield (
                row['scene'].replace('etna', 'Etna '), f'`{row["preset"]}`',
                f'{apart} {spacing:.2g} m', f'{float(row["jaccard"]):.2f}',
                f'x {float(row["area_ratio"]):.2f}', f'{_two_digits(row["cpu_s"])} s',
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


#: Presets of which the page of presets shows times and errors.
SHOWN_PRESETS = ('draft', 'standard', 'fine')


def preset_costs() -> Iterator[Line]:
    """Yield the CPU time and the actual error of the inundated area, by scene and preset."""
    yield ('scene', 'cells', *(f'`{name}`' for name in SHOWN_PRESETS))
    rows = lines_of('presets.csv')
    for scene in dict.fromkeys(row['scene'] for row in rows):
        found = {row['preset']: row for row in rows if row['scene'] == scene}
        shown = [found[name] for name in SHOWN_PRESETS]
        yield (scene.replace('_', ' '), f'{float(shown[0]["cell_m"]):g} m', *(
            f'{_two_digits(row["cpu_s"])} s, **{_percent(row["inundated_actual"])} %**'
            f' ({_percent(row["inundated_stated"])} % stated)' for row in shown
        ))


def preset_gains() -> Iterator[Line]:
    """Yield what `standard` costs and gains over `draft`, by scene, the least useful first."""
    yield ('scene', 'cells', 'time over `draft`', 'inundated: `draft`', '`standard`',
           'thickness: `draft`', '`standard`')
    rows = [row for row in lines_of('equal_error.csv') if row['version'] == 'after']
    pairs = [
        tuple(next(row for row in rows if (row['scene'], row['preset']) == (scene, preset))
              for preset in SHOWN_PRESETS[:2])
        for scene in dict.fromkeys(row['scene'] for row in rows)
    ]
    pairs.sort(key=lambda pair: -float(pair[1]['inundated']) / float(pair[0]['inundated']))
    for draft, standard in pairs:
        yield (
            draft['scene'].replace('_', ' '),
            f'{float(draft["cell_m"]):g} m',
            f'x {float(standard["cpu_s"]) / float(draft["cpu_s"]):.1f}',
            *(f'{_percent(row[name])} %' for name in ('inundated', 'thickness')
              for row in (draft, standard)),
        )


def preset_scores() -> Iterator[Line]:
    """Yield the scores and times of presets on the mapped flows, both flows together in time."""
    yield ('preset', 'flow', 'spacing', 'Jaccard index, majority of 8 runs', 'single runs',
           'time of 8 runs of both flows')
    for row in lines_of('eruptions.csv'):
        assert row['runs'] == '8'
        yield (
            f'`{row["preset"]}`',
            f'Etna {row["case"].removeprefix("etna")}',
            f'{float(row["spacing_m"]):.2g} m',
            f'**{float(row["majority"]):.2f}**',
            f'{float(row["single"]):.2f} ± {float(row["single_deviation"]):.2f}',
            f'{float(row["seconds"]):.0f} s',
        )


def command_times() -> Iterator[Line]:
    """Yield the wall times of `lava run CASE` on the mapped flows."""
    head, *rows = commands()
    yield head[1:]
    yield from (row[1:] for row in rows if row[0] == 'lava_ros')


def _two_digits(number: str) -> str:
    return f'{float(f"{float(number):.2g}"):g}'


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


Tables = Mapping[str, Callable[[], Iterator[Line]]]

PAGES: Mapping[str, Tables] = {
    '../README.md': {'flows': flows},
    'VALIDATION.md': {
        'flows': flows, 'scores': scores, 'hindcast_steps': hindcast_steps, 'codes': codes,
        'chances': chances, 'dates': dates, 'front': front, 'commands': commands,
        'outlines': outlines, 'left_out': left_out, 'etna_cells': etna_cells,
    },
    'MODEL.md': {
        'carriers': carriers, 'grounds': grounds, 'kernel_radii': kernel_radii,
        'described': described, 'kernel_ratios': kernel_ratios, 'mobility_limits': mobility_limits,
        'fluid': fluid,
    },
    'PERFORMANCE.md': {'steps': steps, 'covered_cells': covered_cells, 'members': members},
    'presets.md': {
        'preset_costs': preset_costs, 'preset_gains': preset_gains,
        'preset_scores': preset_scores, 'command_times': command_times,
        'methods': methods, 'method_scores': method_scores,
    },
    'NAV2.md': {'rolling_windows': rolling_windows, 'masks': masks},
    'how_to/ensemble.md': {'twins': twins, 'twins_outline': twins_outline},
    'benchmarks/README.md': {
        'plans': plans, 'numerical_error': numerical_error,
        'numerical_error_counts': numerical_error_counts,
    },
}


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


if __name__ == '__main__':
    for name, tables in PAGES.items():
        path = HERE.parent / name
        path.write_text(written(path.read_text(encoding='utf-8'), tables), encoding='utf-8')
