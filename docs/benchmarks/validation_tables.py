# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Tables of flows with a mapped outline: scores, areas and times."""

from collections.abc import Iterable, Iterator, Mapping

from table_text import Line, lines_of

from lava_ros.scene.materials import DEFAULT


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
            f'x {float(row["footprint_ratio"]):.2f}',
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
            + (f', `{row["material"]}`' if row['material'] != DEFAULT else ''),
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
    """Yield the scores of all mapped flows at draft, fitted or not, and of two references."""
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
                f'x {float(row["footprint_ratio"]):.2f}',
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
            f'{float(own[date]["jaccard"]):.2f} (x {float(own[date]["footprint_ratio"]):.2f}, '
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
