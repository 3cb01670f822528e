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

"""The page: the template with the parts of a run put in."""

import base64
import hashlib
from html import escape
from importlib import resources
import json
import math
from pathlib import Path
from string import Template
from typing import Any

import lava_ros
from lava_ros.files import file_to_write, write_output
from lava_ros.maps.export import placement_of
from lava_ros.maps.frames import Progress, Recording, silent
from lava_ros.maps.layers import SOURCES
from lava_ros.maps.plot import duration, STYLES
from lava_ros.pages.report import sections
from lava_ros.pages.report.charts import Chart, Curve, svg, thinned
from lava_ros.pages.report.description import describe
from lava_ros.pages.report.maps import pack_maps, relief, View, view_of
from lava_ros.pages.report.survey import Survey, survey

#: Names of the layers on the page, by source.
NAMES = {'thickness': 'height', 'temperature': 'temperature', 'hazard': 'hazard'}


def write_report(
    path: str | Path, output: str | Path, *, progress: Progress = silent
) -> int:
    """Write a self-contained HTML page about a bag, and return its size [bytes].

    Raises:
        LavaError: The bag cannot be read, or the page cannot be written.
    """
    output = file_to_write('output', output, ('.html', '.htm'))
    data = page(Recording(path), progress).encode()
    write_output('output', output, data)
    return len(data)


def page(recording: Recording, progress: Progress = silent) -> str:
    """The HTML page about a recording.

    Raises:
        LavaError: The bag is damaged, or does not have its simulated times.
    """
    seen = survey(recording, progress)
    view = view_of(seen)
    maps = pack_maps(recording, seen, view, progress)
    charts = _charts(recording, seen)
    description = describe(recording.bag.custom_data)
    style, script = _file('report.css'), _file('report.js')
    name = recording.bag.path.resolve().name
    start, end = seen.times[0], seen.times[-1]
    data = _data(recording, seen, view, maps, charts)
    return Template(_file('report.html')).substitute(
        style=style,
        script=script,
        style_hash=_hash(style),
        script_hash=_hash(script),
        title=escape(f'Lava flow after {duration(end)} · {name}'),
        name=escape(name),
        heading=escape(f'Lava flow after {duration(end)}'),
        warnings=sections.warnings_html(sections.warnings(recording, seen)),
        facts=sections.facts_html(sections.facts(recording, seen)),
        switch=_switch(maps),
        last=len(maps['times']) - 1,
        charts=''.join(_figure(item, start, end) for item in charts),
        hazard=sections.hazard_legend(recording),
        depth=sections.depth_table(seen),
        rounding=sections.rounding_note(seen),
        effects=sections.effects_table(description),
        accuracy=sections.accuracy_section(recording, description),
        recorded=sections.recorded_section(recording, seen, description),
        version=escape(lava_ros.__version__),
        data=_json(data),
    )


def _data(
    recording: Recording,
    seen: Survey,
    view: View,
    maps: dict[str, Any],
    charts: list[Chart],
) -> dict[str, Any]:
    frame = seen.frame
    place = placement_of(recording.scene)
    layers = [
        {
            'name': NAMES[source],
            'title': STYLES[source].title,
            'unit': {'thickness': 'm', 'temperature': '°C', 'hazard': ''}[source],
            'colours': list(STYLES[source].colours),
            **maps['layers'][source],
        }
        for source in SOURCES
        if source in maps['layers']
    ]
    arrival = maps['arrival']
    if arrival is not None:
        arrival = {'title': 'Arrival', 'colours': list(STYLES['arrival'].colours), **arrival}
    rows, columns = (
        -(-(last - first) // view.factor) for first, last in (view.rows, view.columns)
    )
    return {
        'rows': rows,
        'columns': columns,
        'cell': frame.resolution * view.factor,
        'west': frame.origin[0] + view.columns[0] * frame.resolution,
        'south': frame.origin[1] + view.rows[0] * frame.resolution,
        'offset': list(place.offset),
        'epsg': place.epsg,
        'vents': seen.vents.tolist(),
        'relief': relief(seen, view),
        'times': maps['times'],
        'areas': maps['areas'],
        'start': seen.times[0],
        'end': seen.times[-1],
        'layers': layers,
        'arrival': arrival,
        'charts': [_chart_data(item) for item in charts],
    }


def _charts(recording: Recording, seen: Survey) -> list[Chart]:
    run = recording.timeline.last_run
    told = [item.time for item in run]

    def volume(label: str, name: str) -> Curve:
        return Curve(label, told, [item.number(name) for item in run])

    volumes = [volume('emitted', 'volume_emitted_m3'), volume('held', 'volume_held_m3')]
    others = [
        volume('left the terrain', 'volume_left_m3'),
        volume('of that into cells without data', 'volume_in_holes_m3'),
        volume('frozen', 'volume_frozen_m3'),
        volume('late in the vents', 'volume_late_m3'),
    ]
    volumes += [curve for curve in others if any(value > 0.0 for value in curve.values)]
    area = Curve('covered', seen.times, seen.area)
    front = Curve('from the nearest vent', seen.times, seen.front)
    hottest = Curve('hottest cell', seen.times, seen.hottest)
    return [
        _scaled('volume', 'Volume', 'm³', volumes),
        _scaled('area', 'Area', 'm²', [area]),
        _scaled('front', 'Distance of the front', 'm', [front]),
        Chart('temperature', 'Highest temperature', '°C', 1.0, [hottest]),
    ]


def _scaled(key: str, title: str, unit: str, curves: list[Curve]) -> Chart:
    """A chart in thousands or millions where that is easier to read."""
    most = max((v for item in curves for v in item.values if math.isfinite(v)), default=0.0)
    # the least value for a larger unit, its name and its size
    least, name, size = {
        'm³': (1e6, 'million m³', 1e6),
        'm²': (1e5, 'km²', 1e6),
        'm': (1e3, 'km', 1e3),
    }[unit]
    if most < least:
        name, size = unit, 1.0
    return Chart(key, title, name, 1.0 / size, curves)


def _chart_data(chart: Chart) -> dict[str, Any]:
    curves = [thinned(item) for item in chart.curves]
    return {
        'key': chart.key,
        'unit': chart.unit,
        'curves': [
            {
                'times': [round(time, 1) for time in item.times],
                'values': [
                    float(f'{value * chart.scale:.5g}') if math.isfinite(value) else None
                    for value in item.values
                ],
            }
            for item in curves
        ],
    }


def _figure(chart: Chart, start: float, end: float) -> str:
    legend = ''.join(
        f'<li class="c{index}"><span>{escape(item.label)}</span> '
        f'<output data-curve="{escape(chart.key)}" data-index="{index}"></output></li>'
        for index, item in enumerate(chart.curves)
    )
    return (
        f'<figure class="chart"><figcaption>{escape(chart.title)} [{escape(chart.unit)}]'
        f'</figcaption>{svg(chart, start, end)}<ul class="key">{legend}</ul></figure>'
    )


def _switch(maps: dict[str, Any]) -> str:
    names = [NAMES[source] for source in SOURCES if source in maps['layers']]
    names += ['arrival'] if maps['arrival'] is not None else []
    return ''.join(
        f'<label><input type="radio" name="layer" value="{name}"'
        f'{" checked" if index == 0 else ""}><span>{name}</span></label>'
        for index, name in enumerate(names)
    )


def _file(name: str) -> str:
    return resources.files('lava_ros.pages.report').joinpath(name).read_text(encoding='utf-8')


def _hash(text: str) -> str:
    """The source expression of a script or style in a Content-Security-Policy."""
    return 'sha256-' + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _json(data: Any) -> str:
    """JSON that cannot end the element it is in."""
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(',', ':'))
    return text.replace('<', '\\u003c').replace('>', '\\u003e').replace('&', '\\u0026')
