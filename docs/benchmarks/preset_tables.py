# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Tables of presets and methods in docs/presets.md."""

from collections.abc import Iterator
import math
import statistics

from table_text import Line, lines_of, percent, two_digits
from validation_tables import commands

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
            f'{two_digits(float(row["cpu_s"]))} s, **{percent(row["inundated_actual"])} %**'
            f' ({percent(row["inundated_stated"])} % stated)' for row in shown
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
            *(f'{percent(row[name])} %' for name in ('inundated', 'thickness')
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
        for effect, name in (
            ('solidification', 'lava freezes'), ('insulation', 'lava under a crust'),
            ('helmholtz', 'lateral stress'),
        ):
            if not row['lacking'] and effect in row['effects'].split():
                kind = name
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
            f'{agreeing} of {len(found)}', two_digits(statistics.median(ratios)),
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
                f'x {float(row["area_ratio"]):.2f}', f'{two_digits(float(row["cpu_s"]))} s',
            )
