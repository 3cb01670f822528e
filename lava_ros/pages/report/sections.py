# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The parts of the page that are text and tables. Every text from a bag is escaped."""

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from itertools import pairwise
import math
from typing import Any

import numpy as np
import yaml

from lava_ros.maps.arrival import rounding
from lava_ros.maps.frames import Recording
from lava_ros.maps.layers import DEPTHS, DRAINED, HazardLimits, OCCUPANCY_GRID, ZERO_CELSIUS
from lava_ros.maps.numbers import percent, seconds
from lava_ros.maps.place_arrivals import ArrivalTable
from lava_ros.maps.plot import area_words, duration
from lava_ros.pages.report.survey import Survey
from lava_ros.scene.projection import system_name
from lava_ros.simulation.accuracy import COVERED
from lava_ros.simulation.budget import VolumeBudget
from lava_ros.simulation.presets import PRESETS
from lava_ros.simulation.resolution import LEAST_ACROSS


def warnings(recording: Recording, survey: Survey) -> list[str]:
    """What a reader has to know before anything else, as sentences."""
    found = []
    if recording.bag.recovered:
        found.append('The recording was cut off: what came after its last whole message is lost.')
    found += [f'Part of the bag is damaged or missing: {text}.' for text in recording.bag.damage]
    moments, run = recording.timeline.moments, recording.timeline.last_run
    if len(run) < len(moments):
        found.append('The simulation was reset while it was recorded: this is the last run.')
    told = (VolumeBudget.from_texts(item.values) for item in run)
    budgets = [budget for budget in told if budget is not None]
    errors = [budget.error for budget in budgets if not budget.is_conserved]
    if errors:
        found.append(
            f'Volume was not conserved: up to {percent(max(errors))} of it is unaccounted for. Do '
            'not trust these maps.'
        )
    elif budgets:
        found += [f'{text[0].upper()}{text[1:]}.' for text in budgets[-1].warnings()]
    across, width = (run[-1].number(key) for key in ('particles_across', 'flow_width_m'))
    if across < LEAST_ACROSS:
        found.append(
            f'The flow is under-resolved: {across:.2g} particles across about {width:.2g} m. '
            'What it covers is another footprint than that of a finer run.'
        )
    if 'thickness' in survey.saturated:
        layer = survey.frame.layers['thickness'].layer
        if layer.range is not None:
            found.append(
                f'The lava is thicker in places than {layer.range[1]:g} m, the most that the '
                f'layer {layer.name} can say.'
            )
    return found


def facts(recording: Recording, survey: Survey) -> list[tuple[str, str]]:
    """The run in a few numbers: names and values."""
    last = recording.timeline.last_run[-1]
    rows = [
        ('simulated', duration(last.time)),
        *(
            (f'{name}, {COVERED:g} m or more', area_words(area))
            for name, area in (
                ('inundated area', survey.inundated[-1]), ('standing lava', survey.standing[-1])
            )
            if math.isfinite(area)
        ),
    ]
    thickest = survey.frame.thickest
    if math.isfinite(thickest):
        prefix = 'over ' if survey.frame.layers['thickness'].is_saturated else ''
        rows.append(('thickest', f'{prefix}{thickest:.3g} m'))
    if survey.largest.get('thickness', 0.0) > thickest:
        rows.append(('thickest before', f'{survey.largest["thickness"]:.3g} m'))
    if math.isfinite(front := survey.front[-1]):
        shown = f'{front / 1000.0:.2f} km' if front >= 1000.0 else f'{front:.0f} m'
        rows.append(('front, from the nearest vent', shown))
    budget = VolumeBudget.from_texts(last.values)
    if budget is not None:
        rows += [(f'volume {name}', value) for name, value in budget.rows()]
    speed = last.number('mean_speed')
    if speed > 0.0:
        rows.append(('speed', f'{speed:.3g} times real time'))
    return rows


def warnings_html(texts: Iterable[str]) -> str:
    """Sentences that a reader has to see first."""
    return ''.join(f'<p class="warning" role="alert">{escape(item)}</p>' for item in texts)


def facts_html(rows: Iterable[tuple[str, str]]) -> str:
    """Terms and values, as the content of a list of definitions."""
    return ''.join(
        f'<div><dt>{escape(term)}</dt><dd>{escape(value)}</dd></div>' for term, value in rows
    )


def effects_table(told: Mapping[str, Any]) -> str:
    """Which effects were on, and why; what changed later."""
    if not told['effects']:
        return '<p>The bag does not say.</p>'
    start, *changes = (
        [(duration(float(change['time'])), *_effect(*item)) for item in change['effects'].items()]
        for change in told['effects']
    )
    order = sorted((row[1:] for row in start), key=lambda row: not row[1].startswith('on'))
    html = _table(('effect', 'at the start', 'because'), order, states=1)
    if changes:
        html += '<h3>Changed while it ran</h3>' + _table(
            ('when', 'effect', 'now', 'because'), [row for rows in changes for row in rows],
            states=2,
        )
    return html


def _effect(name: object, text: object) -> tuple[str, str, str]:
    """The name of an effect, whether it is on, and why."""
    state, _, reason = str(text).partition(': ')
    return str(name).replace('_', ' '), state, reason


def hazard_legend(recording: Recording) -> str:
    """What the values of the hazard mean, with the limits it was made with."""
    known = [item.hazard for item in recording.layers.values() if item.source == 'hazard']
    limits = [HazardLimits(), *known][-1]
    lethal, safe = (
        f'{kelvin - ZERO_CELSIUS:g} °C'
        for kelvin in (limits.lethal_temperature, limits.safe_temperature)
    )
    return _table(
        ('hazard index', 'meaning'),
        [
            ('-1', 'outside the terrain: unknown'),
            ('0', 'no lava so far'),
            (str(DRAINED), 'lava has been here and drained away: hot ground or crust'),
            (
                '1 .. 99',
                f'lava cooler than {lethal}, which freezes long before: burial, from 0 to '
                f'{limits.lethal_thickness:g} m, and heat, from {safe} to {lethal}, as if they '
                'struck independently',
            ),
            ('100', f'lethal: {limits.lethal_thickness:g} m of lava or more, or {lethal} or more'),
        ],
    )


def depth_table(survey: Survey) -> str:
    """Area of the lava that stands at the end by its depth, in classes that people can picture."""
    thickness = survey.frame.layers.get('thickness')
    if thickness is None:
        return ''
    depth = thickness.values[survey.frame.standing]
    counts = np.histogram(depth, [0.0, *DEPTHS, np.inf])[0]
    names = ('up to the knee', "up to somebody's height", 'up to a roof', 'over a roof')
    ends = [f'below {DEPTHS[0]:g} m', *(f'{a:g} to {b:g} m' for a, b in pairwise(DEPTHS))]
    ends.append(f'from {DEPTHS[-1]:g} m on')
    cell = survey.frame.resolution**2
    rows = [
        (end, name, area_words(float(count) * cell))
        for end, name, count in zip(ends, names, counts, strict=True)
    ]
    return _table(('depth', 'as deep as', 'area'), rows)


def accuracy_section(recording: Recording, told: Mapping[str, Any]) -> str:
    """The preset, how this run resolved its flow, and what it cost."""
    name = (told['parameters'] or {}).get('preset')
    preset = PRESETS.get(name) if isinstance(name, str) else None
    run = recording.timeline.last_run[-1]
    known = f'{name}: {preset.summary}' if preset is not None else str(name or 'unknown')
    rows = [('preset', known)]
    for key, term, unit in (
        ('spacing_m', 'distance between particles', ' m'),
        ('flow_width_m', 'width of the flow', ' m'),
        ('particles_across', 'particles across the flow', ''),
    ):
        if key in run.values:
            rows.append((term, f'{run.values[key]}{unit}'))
    error = run.number('footprint_error')
    if math.isfinite(error):
        rows.append(('expected error of the footprint', percent(error)))
    rows += [
        ('particles at the end', run.values.get('particles', 'unknown')),
        ('steps', run.values.get('steps', 'unknown')),
        ('device', recording.bag.custom_data.get('device') or 'unknown'),
    ]
    speed = run.number('mean_speed')
    if speed > 0.0:
        rows.append(('computing an hour of the flow took', seconds(3600.0 / speed)))
    return _table(('this run', ''), rows)


def recorded_section(recording: Recording, survey: Survey, told: Mapping[str, Any]) -> str:
    """What the bag holds, and the scene it says it is of."""
    bag, frame = recording.bag, survey.frame
    rows, columns = frame.elevation.shape
    terrain = recording.scene.get('terrain')
    terrain = terrain if isinstance(terrain, dict) else {}
    lines = [
        ('bag', bag.path.name),
        ('state', 'cut off; what was written before is here' if bag.recovered else 'finished'),
        ('size', f'{bag.size / 1e6:.2f} MB in {len(bag.files)} file(s)'),
        ('recording lasted', duration(bag.duration_ns / 1e9)),
        ('maps shown on this page', f'{len(survey.times)} frames of the last run'),
        ('terrain', f'{columns} x {rows} cells of {frame.resolution:g} m'),
        ('coordinate system', system_name(terrain.get('epsg'), terrain.get('wkt'))),
        ('recorded by', f'lava_ros {bag.custom_data.get("version") or "of unknown version"}'),
    ]
    html = _table(('recording', ''), lines)
    html += _table(
        ('topic', 'type', 'messages'),
        [
            (item.name, item.message_type, 'unknown' if item.count is None else str(item.count))
            for item in bag.topics.values()
        ],
    )
    for title, data in (('Scene', recording.scene), ('Parameters', told['parameters'])):
        if data:
            text = yaml.safe_dump(data, sort_keys=False, allow_unicode=True)
            html += f'<details><summary>{title}</summary><pre>{escape(text)}</pre></details>'
    return html


def rounding_note(survey: Survey) -> str:
    """How finely the values of each layer were recorded."""
    notes = []
    for source, shown in sorted(survey.frame.layers.items()):
        layer = shown.layer
        if layer.message == OCCUPANCY_GRID and layer.range is not None and source != 'hazard':
            step = 2.0 * rounding(layer)
            unit = 'm' if source == 'thickness' else '°C'
            notes.append(f'{layer.name} in steps of {step:g} {unit}')
    text = ', '.join(notes)
    return f'<p class="note">Recorded as grids: {escape(text)}.</p>' if notes else ''


def places_section(tables: Mapping[str, ArrivalTable]) -> str:
    """When lava arrives at places, of each run by its name; empty without any run."""
    if not tables:
        return ''
    html = '<section aria-labelledby="places-title"><h2 id="places-title">Arrival at places</h2>'
    for name, table in tables.items():
        head, *rows = table.as_texts()
        heading = f'<h3>{escape(name)}</h3>' if len(tables) > 1 else ''
        html += f'{heading}<p class="note">{escape(table.summary)}.</p>{_table(head, rows)}'
    return html + '</section>'


def _table(
    head: Sequence[str], body: Iterable[Sequence[str]], *, states: int | None = None
) -> str:
    """A table; the column ``states`` has ``on`` or ``off``."""

    def cell(index: int, text: str) -> str:
        mark = f' class="{"on" if text == "on" else "off"}"' if index == states else ''
        return f'<td{mark}>{escape(text)}</td>'

    titles = ''.join(f'<th scope="col">{escape(item)}</th>' for item in head)
    lines = ''.join(
        f'<tr>{"".join(cell(*item) for item in enumerate(row))}</tr>' for row in body
    )
    return (
        f'<div class="scroll"><table><thead><tr>{titles}</tr></thead>'
        f'<tbody>{lines}</tbody></table></div>'
    )
