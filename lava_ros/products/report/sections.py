# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Texts and tables of the report; the templates arrange and escape them."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
import math
from typing import Any, NamedTuple

import numpy as np

from lava_ros.files.yaml import dump_yaml
from lava_ros.layers.layer import (
    DEPTHS,
    DRAINED,
    HAZARD_CLASSES,
    HazardLimits,
    ZERO_CELSIUS,
)
from lava_ros.layers.numbers import area_words, duration, seconds
from lava_ros.layers.recording import Recording
from lava_ros.products.report.summary import RunSummary
from lava_ros.products.run_warnings import method_of, warnings_of_recording
from lava_ros.scene.erupting_lava import EruptingLava
from lava_ros.scene.projection import system_name
from lava_ros.simulation.carriers import across_key, count_key, COUNTED
from lava_ros.simulation.numerical_error import NOT_MEASURED
from lava_ros.simulation.output.budget import VolumeBudget
from lava_ros.simulation.output.inundation import standing_part
from lava_ros.simulation.presets import PRESETS


class Table(NamedTuple):
    """Titles of columns, and rows of texts; the column ``states`` contains ``on`` or ``off``."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    states: int | None = None


def warnings(recording: Recording, summary: RunSummary) -> list[str]:
    """Return the warnings at the top of the page, as sentences."""
    found = warnings_of_recording(recording, recording.timeline.last_run)
    if 'thickness' in summary.saturated:
        layer = summary.frame.layers['thickness'].layer
        if layer.range is not None:
            found.append(
                f'The lava is thicker in places than {layer.range[1]:g} m, the maximum of the '
                f'layer {layer.name}.'
            )
    return found


def facts(recording: Recording, summary: RunSummary) -> list[tuple[str, str]]:
    """Return names and values of the main results of a run, and the lava of its vents."""
    last = recording.timeline.last_run[-1]
    rows = [
        ('simulated', duration(last.time)),
        *(
            (f'{name}, {summary.frame.threshold:g} m or more', area_words(area))
            for name, area in (
                ('inundated area', summary.inundated[-1]), ('standing area', summary.standing[-1])
            )
            if math.isfinite(area)
        ),
    ]
    thickest = summary.frame.thickest
    if math.isfinite(thickest):
        prefix = 'over ' if summary.frame.layers['thickness'].is_saturated else ''
        rows.append(('maximum thickness', f'{prefix}{thickest:.3g} m'))
    if summary.largest.get('thickness', 0.0) > thickest:
        rows.append(('peak thickness', f'{summary.largest["thickness"]:.3g} m'))
    if math.isfinite(front := summary.front[-1]):
        shown = f'{front / 1000.0:.2f} km' if front >= 1000.0 else f'{front:.0f} m'
        rows.append(('front, from the nearest vent', shown))
    budget = VolumeBudget.from_texts(last.values)
    if budget is not None:
        rows += [(f'volume {name}', text.replace('m3', 'm³')) for name, text in budget.rows()]
    rows.append(('numerical error', last.values.get('numerical_error', NOT_MEASURED)))
    if (lava := EruptingLava.described(recording.scene)) is not None:
        rows.append(('lava', lava.text()))
    speed = last.number('mean_speed')
    if speed > 0.0:
        rows.append(('mean speed', f'{float(f"{speed:.3g}"):,g} times real time'))
    return rows


def effects_tables(description: Mapping[str, Any]) -> list[tuple[str, Table]]:
    """Return tables with titles: effects at the start with reasons, and later changes."""
    if not description['effects']:
        return []
    start, *changes = (
        [(duration(float(change['time'])), *_effect(*item)) for item in change['effects'].items()]
        for change in description['effects']
    )
    order = sorted((row[1:] for row in start), key=lambda row: not row[1].startswith('on'))
    tables = [('', Table(('effect', 'at the start', 'reason'), order, states=1))]
    if changes:
        rows = [row for rows in changes for row in rows]
        head = ('time', 'effect', 'state', 'reason')
        tables.append(('Changes during the run', Table(head, rows, states=2)))
    return tables


def _effect(name: object, text: object) -> tuple[str, str, str]:
    state, _, reason = str(text).partition(': ')
    return str(name).replace('_', ' '), state, reason


def hazard_legend(recording: Recording) -> Table:
    """Return the meaning of hazard index values, with the limits of the recording."""
    known = [item.hazard for item in recording.layers.values() if item.source == 'hazard']
    limits = [HazardLimits(), *known][-1]
    lethal, safe = (
        f'{kelvin - ZERO_CELSIUS:g} °C'
        for kelvin in (limits.lethal_temperature, limits.safe_temperature)
    )
    harmful, fatal = HAZARD_CLASSES.values()
    return Table(
        ('hazard index', 'meaning'),
        [
            ('-1', 'outside the terrain: unknown'),
            ('0', 'no lava so far'),
            (str(DRAINED), f'{harmful}: hot ground or crust'),
            (
                '1 to 99',
                f'the same class: lava cooler than {lethal}, which freezes long before: burial, '
                f'from 0 to {limits.lethal_thickness:g} m, and heat, from {safe} to {lethal}, '
                'combined like independent events',
            ),
            ('100', f'{fatal}: {limits.lethal_thickness:g} m or more, or {lethal} or more'),
        ],
    )


def depth_table(summary: RunSummary) -> Table | None:
    """Return the area of standing lava at the end by classes of its thickness."""
    thickness = summary.frame.layers.get('thickness')
    if thickness is None:
        return None
    depth, parts = thickness.values, standing_part(summary.frame.standing, summary.frame.inundated)
    bounds = [0.0, *DEPTHS, np.inf]
    areas = [summary.frame.area(parts * ((depth >= a) & (depth < b))) for a, b in pairwise(bounds)]
    names = ('up to the knee', 'up to the height of a person', 'up to a roof', 'over a roof')
    ends = [f'below {DEPTHS[0]:g} m', *(f'{a:g} to {b:g} m' for a, b in pairwise(DEPTHS))]
    ends.append(f'{DEPTHS[-1]:g} m or more')
    rows = list(zip(ends, names, map(area_words, areas), strict=True))
    return Table(('depth', 'as deep as', 'area'), rows)


def accuracy_table(recording: Recording, description: Mapping[str, Any]) -> Table:
    """Return the preset, the resolution of the flow, and the computational cost of a run."""
    name = (description['parameters'] or {}).get('preset')
    preset = PRESETS.get(name) if isinstance(name, str) else None
    run = recording.timeline.last_run[-1]
    known = f'{name}: {preset.summary}' if preset is not None else str(name or 'unknown')
    method = method_of(run)
    distance = 'size of the cells' if method == 'cells' else 'distance between particles'
    rows = [('preset', known)]
    for key, term, unit in (
        ('spacing_m', distance, ' m'),
        ('flow_width_m', 'width of the flow', ' m'),
        (across_key(method), f'{method} across the flow', ''),
    ):
        if key in run.values:
            rows.append((term, f'{run.values[key]}{unit}'))
    rows += [
        ('numerical error', run.values.get('numerical_error', NOT_MEASURED)),
        (f'{COUNTED[method]} at the end', run.values.get(count_key(method), 'unknown')),
        ('steps', run.values.get('steps', 'unknown')),
        ('device', recording.bag.custom_data.get('device') or 'unknown'),
    ]
    speed = run.number('mean_speed')
    if speed > 0.0:
        rows.append(('wall time per simulated hour', seconds(3600.0 / speed)))
    return Table(('this run', ''), rows)


def recorded_tables(recording: Recording, summary: RunSummary) -> list[Table]:
    """Return tables of the contents of the bag."""
    bag, frame = recording.bag, summary.frame
    rows, columns = frame.elevation.shape
    terrain = recording.scene.get('terrain', {})
    lines = [
        ('bag', bag.path.name),
        ('state', 'cut off; earlier messages are complete' if bag.recovered else 'finished'),
        ('size', f'{bag.size / 1e6:.2f} MB in {len(bag.files)} file(s)'),
        ('duration of the recording', duration(bag.duration_ns / 1e9)),
        ('maps of the last run', f'{len(summary.times)}'),
        ('terrain', f'{columns} x {rows} cells of {frame.resolution:g} m'),
        ('coordinate system', system_name(terrain.get('epsg'), terrain.get('wkt'))),
        ('recorded by', f'lava_ros {bag.custom_data.get("version") or "of unknown version"}'),
    ]
    topics = [
        (item.name, item.message_type, 'unknown' if item.count is None else str(item.count))
        for item in bag.topics.values()
    ]
    return [
        Table(('recording', ''), lines), Table(('topic', 'type', 'messages'), topics),
    ]


def described_data(recording: Recording, description: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the recorded scene and parameters as YAML with titles."""
    return [
        (title, dump_yaml(data, allow_unicode=True))
        for title, data in (('Scene', recording.scene), ('Parameters', description['parameters']))
        if data
    ]
