# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""HTML pages: a report on a bag with an animated map, and pages of runs."""

import base64
from collections.abc import Mapping, Sequence
import hashlib
import json
from pathlib import Path
import tempfile
from types import MappingProxyType
from typing import Any

from lava_ros.bag.description import described
from lava_ros.files import file_to_write, write_output
from lava_ros.maps.export import georeference_of
from lava_ros.maps.frames import Progress, Recording, silent
from lava_ros.maps.onset import recorded_onset
from lava_ros.maps.page_layout import BANNER
from lava_ros.maps.place_arrivals import ArrivalTable
from lava_ros.maps.plot import barriers_of, duration
from lava_ros.pages.arrivals import table_of
from lava_ros.pages.pictures import draw_runs
from lava_ros.pages.report import sections
from lava_ros.pages.report.charts import Chart, charts_of, svg
from lava_ros.pages.report.static_page import read_asset, render_page, write_static_page
from lava_ros.pages.report.summary import pack_maps, relief, RunSummary, summarize, view_of

#: First warning of a page of runs.
_NOTICE = f'{BANNER.capitalize()}.'


def write_report(
    path: str | Path,
    output: str | Path,
    *,
    node: str | None = None,
    overlays: Sequence[str] = (),
    progress: Progress = silent,
) -> int:
    """Write a self-contained HTML page about a bag, and return its size [bytes].

    ``node`` is the full name or the namespace of a node of the bag; None for the only one.

    Raises:
        LavaError: If the bag or an overlay cannot be read, or the page cannot be written.
    """
    output = file_to_write('output', output, ('.html', '.htm'))
    places = _tables([path], overlays, node)
    data = page(Recording(path, node=node), progress, places=places).encode()
    write_output('output', output, data)
    return len(data)


def _tables(
    paths: Sequence[str | Path], overlays: Sequence[str], node: str | None, **dates: Any
) -> dict[str, ArrivalTable]:
    """Return the arrival of lava at the places of files, by the paths of the runs.

    ``dates`` are ``onset`` and ``zone`` for ``table_of``.
    """
    if not overlays:
        return {}
    return {
        str(path): table_of(path, overlays, field='--overlay', node=node, **dates)
        for path in paths
    }


def page(
    recording: Recording,
    progress: Progress = silent,
    *,
    places: Mapping[str, ArrivalTable] = MappingProxyType({}),
) -> str:
    """Return the HTML page about a recording; ``places`` has the arrival at places by run.

    Raises:
        LavaError: If the bag is damaged or has no simulated times.
    """
    summary = summarize(recording, progress)
    charts = charts_of(recording, summary)
    data = _data(recording, summary, charts, progress)
    style, script = read_asset('report.css'), read_asset('report.js')
    start, end = summary.times[0], summary.times[-1]
    description = described(recording.bag.custom_data)
    layers = [item['name'] for item in data['layers']]
    return render_page(
        'report.html',
        style=style,
        script=script,
        style_hash=_hash(style),
        script_hash=_hash(script),
        name=recording.bag.path.resolve().name,
        heading=f'Lava flow after {duration(end)}',
        warnings=[_NOTICE, *sections.warnings(recording, summary)],
        facts=sections.facts(recording, summary),
        layers=layers if data['arrival'] is None else [*layers, 'arrival'],
        last=len(data['times']) - 1,
        charts=charts,
        svg=svg,
        start=start,
        end=end,
        hazard=sections.hazard_legend(recording),
        depth=sections.depth_table(summary),
        places=sections.place_tables(places),
        effects=sections.effects_tables(description),
        accuracy=sections.accuracy_table(recording, description),
        recorded=sections.recorded_tables(recording, summary),
        described=sections.described_data(recording, description),
        data=_json(data),
    )


def _data(
    recording: Recording, summary: RunSummary, charts: Sequence[Chart], progress: Progress
) -> dict[str, Any]:
    frame, view = summary.frame, view_of(summary)
    place = georeference_of(recording.scene)
    onset = recorded_onset(recording.bag.custom_data)
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
        'vents': summary.vents.tolist(),
        'barriers': [crest.tolist() for crest in barriers_of(frame)],
        'relief': relief(summary, view),
        **pack_maps(recording, summary, view, progress),
        'start': summary.times[0],
        'end': summary.times[-1],
        'onset': None if onset is None else onset.start.timestamp(),
        'charts': [item.data() for item in charts],
    }


def _hash(text: str) -> str:
    """Return the source expression of a script or style for a Content-Security-Policy."""
    return 'sha256-' + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _json(data: Any) -> str:
    """Return JSON that cannot end the HTML element around it."""
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(',', ':'))
    return text.replace('<', '\\u003c').replace('>', '\\u003e').replace('&', '\\u0026')


def write_comparison(paths: Sequence[str], output: str | Path, **options: Any) -> int:
    """Write a page about an ensemble, or about several runs, and return its size [bytes].

    ``options`` are those of ``draw_runs``.

    Raises:
        LavaError: If a run or a file cannot be read, or the page cannot be written.
    """
    output = file_to_write('output', output, ('.html', '.htm'))
    with tempfile.TemporaryDirectory(prefix='lava-report-') as folder:
        picture = Path(folder) / 'maps.png'
        drawn = draw_runs(paths, picture, **options)
        facts = drawn['notes'] | {
            f'{term.replace("_", " ")} of {name}': f'{value:.3g}'
            for name, scores in drawn['scores'].items()
            for term, value in scores.items()
        }
        return write_static_page(
            output,
            picture,
            title=drawn['title'],
            subtitle=drawn['summary'],
            warnings=[_NOTICE],
            facts=facts,
            shows=', '.join(drawn['maps']),
            places=sections.place_tables(
                _tables(
                    paths, options.get('overlays', ()), options.get('node'),
                    onset=options.get('onset'), zone=options.get('zone'),
                )
            ),
        )
