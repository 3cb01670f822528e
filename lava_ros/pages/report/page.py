# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""HTML pages: of a run, with a map that moves; and with one picture and without a script."""

import base64
from collections.abc import Iterable, Mapping, Sequence
import hashlib
from html import escape
from importlib import resources
import json
from pathlib import Path
from string import Template
import tempfile
from typing import Any

import lava_ros
from lava_ros.bag.description import described
from lava_ros.errors import LavaError
from lava_ros.files import file_to_write, write_output
from lava_ros.maps.export import placement_of
from lava_ros.maps.frames import Progress, Recording, silent
from lava_ros.maps.place_arrivals import ArrivalTable
from lava_ros.maps.plot import barriers_of, duration
from lava_ros.pages.arrivals import table_of
from lava_ros.pages.pictures import draw_runs
from lava_ros.pages.report import sections
from lava_ros.pages.report.charts import Chart, charts_of
from lava_ros.pages.report.sections import facts_html, warnings_html
from lava_ros.pages.report.survey import pack_maps, relief, Survey, survey, view_of

_STILL = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy"
 content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<link rel="icon" href="data:,">
<title>{title}</title>
<style>{style}
img {{ display: block; max-width: 100%; max-height: 90vh; margin: 1rem auto; }}</style>
</head>
<body>
<header><h1>{title}</h1><p class="subtitle">{subtitle}</p></header>
<main>
{warnings}
<dl class="facts">{facts}</dl>
<img src="data:image/png;base64,{picture}" alt="{shows}">
{sections}
</main>
<footer><p>lava_ros {version}</p></footer>
</body>
</html>
"""


def write_report(
    path: str | Path,
    output: str | Path,
    *,
    overlays: Sequence[str] = (),
    progress: Progress = silent,
) -> int:
    """Write a self-contained HTML page about a bag, and return its size [bytes].

    Raises:
        LavaError: The bag or a file of ``overlays`` cannot be read, or the page cannot be written.
    """
    output = file_to_write('output', output, ('.html', '.htm'))
    places = sections.places_section(_tables([path], overlays))
    data = page(Recording(path), progress, places=places).encode()
    write_output('output', output, data)
    return len(data)


def _tables(paths: Sequence[str | Path], overlays: Sequence[str]) -> dict[str, ArrivalTable]:
    """When lava of runs arrives at the places of files, by the paths of the runs."""
    if not overlays:
        return {}
    return {str(path): table_of(path, overlays, field='--overlay') for path in paths}


def page(recording: Recording, progress: Progress = silent, *, places: str = '') -> str:
    """The HTML page about a recording; ``places`` is a section of it that is made elsewhere.

    Raises:
        LavaError: The bag is damaged, or does not have its simulated times.
    """
    seen = survey(recording, progress)
    charts = charts_of(recording, seen)
    data = _data(recording, seen, charts, progress)
    style, script = _file('report.css'), _file('report.js')
    name = recording.bag.path.resolve().name
    start, end = seen.times[0], seen.times[-1]
    told = described(recording.bag.custom_data)
    return Template(_file('report.html')).substitute(
        style=style,
        script=script,
        style_hash=_hash(style),
        script_hash=_hash(script),
        title=escape(f'Lava flow after {duration(end)} · {name}'),
        name=escape(name),
        heading=escape(f'Lava flow after {duration(end)}'),
        warnings=warnings_html(sections.warnings(recording, seen)),
        facts=facts_html(sections.facts(recording, seen)),
        switch=_switch(data),
        last=len(data['times']) - 1,
        charts=''.join(item.figure(start, end) for item in charts),
        hazard=sections.hazard_legend(recording),
        depth=sections.depth_table(seen),
        places=places,
        rounding=sections.rounding_note(seen),
        effects=sections.effects_table(told),
        accuracy=sections.accuracy_section(recording, told),
        recorded=sections.recorded_section(recording, seen, told),
        version=escape(lava_ros.__version__),
        data=_json(data),
    )


def _data(
    recording: Recording, seen: Survey, charts: Sequence[Chart], progress: Progress
) -> dict[str, Any]:
    frame, view = seen.frame, view_of(seen)
    place = placement_of(recording.scene)
    maps = pack_maps(recording, seen, view, progress)
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
        'barriers': [crest.tolist() for crest in barriers_of(frame)],
        'relief': relief(seen, view),
        'times': maps['times'],
        'areas': maps['areas'],
        'start': seen.times[0],
        'end': seen.times[-1],
        'layers': maps['layers'],
        'arrival': maps['arrival'],
        'charts': [item.data() for item in charts],
    }


def _switch(data: dict[str, Any]) -> str:
    names = [item['name'] for item in data['layers']]
    names += ['arrival'] if data['arrival'] is not None else []
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


def write_still(
    output: Path,
    *,
    title: str,
    subtitle: str,
    warnings: Iterable[str],
    facts: Mapping[str, str],
    picture: Path,
    shows: str,
    sections: str = '',
) -> int:
    """Write a self-contained HTML page about a PNG.

    ``shows`` describes the picture; ``sections`` is HTML that follows it.

    Returns:
        Size of the page [bytes].

    Raises:
        LavaError: The page cannot be written, or the picture cannot be read.
    """
    try:
        image = base64.b64encode(picture.read_bytes()).decode()
    except OSError as error:
        raise LavaError('output', str(picture), f'a readable picture ({error})') from error
    text = _STILL.format(
        title=escape(title),
        subtitle=escape(subtitle),
        style=_file('report.css'),
        warnings=warnings_html(warnings),
        facts=facts_html(facts.items()),
        picture=image,
        shows=escape(shows),
        sections=sections,
        version=escape(lava_ros.__version__),
    )
    write_output('output', output, text)
    return len(text.encode())


def write_comparison(paths: Sequence[str], output: str | Path, **options: Any) -> int:
    """Write a page about an ensemble, or about several runs, and return its size [bytes].

    ``options`` are those of ``draw_runs``.

    Raises:
        LavaError: A run or a file cannot be read, or the page cannot be written.
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
        return write_still(
            output,
            title=drawn['title'],
            subtitle=drawn['summary'],
            warnings=[f'{drawn["banner"].capitalize()}.'],
            facts=facts,
            picture=picture,
            shows=', '.join(drawn['maps']),
            sections=sections.places_section(_tables(paths, options.get('overlays', ()))),
        )
