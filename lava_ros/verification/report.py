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

"""The report as Markdown: presets, what was studied, and every case."""

from __future__ import annotations

from collections.abc import Sequence

from lava_ros.verification.cases import EFFECT_CASES
from lava_ros.verification.front import pareto_front, Point, points, presets_of
from lava_ros.verification.lateral import NAME as LATERAL
from lava_ros.verification.rows import Row
from lava_ros.verification.studies import studies
from lava_ros.verification.tables import percent, seconds, table


def markdown(rows: Sequence[Row], titles: dict[str, str], *, stem: str) -> str:
    """The report as Markdown: presets first, then the studies, then every setting.

    Args:
        rows: The measurements.
        titles: Title of each case by name.
        stem: Name of the CSV and the chart, without suffix.
    """
    commands = [f'`{command}`' for command in dict.fromkeys(row.command for row in rows)]
    machines = ', '.join(dict.fromkeys(row.machine for row in rows))
    lines = [
        f'# Accuracy against time: {machines}',
        '',
        f'Made by {", ".join(commands)}; every measurement is in [{stem}.csv]({stem}.csv). '
        'The error of a case is the largest of its quantities; the cost is wall time for an '
        'hour of the flow, kernels compiled, median of the repetitions. What would have taken too '
        'long was left out. Settings on the front are bold: nothing is both faster and better. '
        'What has no result is `none`, and in the chart a triangle at the errors it does have.',
        '',
        *_charts(rows, stem),
        *_preset_table(points(rows), titles),
        *studies(rows, titles),
    ]
    for name in dict.fromkeys(row.case for row in rows if row.case != LATERAL):
        lines += [f'## {titles.get(name, name)}', '']
        lines += [*_case_table([row for row in rows if row.case == name]), '']
    return '\n'.join(lines)


def _charts(rows: Sequence[Row], stem: str) -> list[str]:
    """The pictures: of the flows, and of the effects where there are any."""
    names = {row.case for row in rows}
    lines = [f'![Error against cost]({stem}.png)', ''] if names - EFFECT_CASES else []
    if names & EFFECT_CASES:
        lines += [f'![Error against cost, effects]({stem}_effects.png)', '']
    return lines


def _preset_table(found: Sequence[Point], titles: dict[str, str]) -> list[str]:
    presets = presets_of(found)
    if not presets:
        return []
    texts = {
        (point.case, point.preset): f'{percent(point.error)} in {seconds(point.cost)}'
        for point in found
        if point.preset
    }
    names = list(dict.fromkeys(case for case, _ in texts))
    body = [
        [titles.get(name, name), *(texts.get((name, preset), '') for preset in presets)]
        for name in names
    ]
    return ['## Presets', '', *table(['case', *presets], body), '']


def _case_table(rows: Sequence[Row]) -> list[str]:
    """Every setting of a case, from cheap to dear; those on the front are bold."""
    quantities = list(dict.fromkeys(row.quantity for row in rows))
    front = {point.setting for point in pareto_front(points(rows))}
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(row.setting, []).append(row)
    body = []
    for setting, group in sorted(groups.items(), key=lambda item: item[1][0].wall_s):
        one = group[0]
        label = f'{one.preset}: {setting}' if one.preset else setting
        errors = {row.quantity: percent(row.error) for row in group}
        body.append(
            [
                f'**{label}**' if setting in front else label,
                *(errors.get(quantity, '') for quantity in quantities),
                f'{one.particles:,}',
                f'{one.steps:,}',
                f'{one.evaluations:,}',
                seconds(one.wall_s_per_simulated_hour),
                f'{seconds(one.low)} to {seconds(one.high)}'
                if one.repetitions > 1
                else seconds(one.wall_s),
            ]
        )
    head = ['setting', *quantities, 'particles', 'steps', 'evaluations', 'cost', 'a run took']
    return table(head, body)
