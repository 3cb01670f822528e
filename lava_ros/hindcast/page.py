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


"""One page about a hindcast: numbers, map, constants and where they are from."""

import base64
from collections.abc import Mapping
from dataclasses import asdict
from html import escape
from importlib import resources
import os
from pathlib import Path
from typing import Any

import lava_ros
from lava_ros.errors import LavaError
from lava_ros.hindcast.case import Case
from lava_ros.hindcast.run import Result, Settings
from lava_ros.hindcast.score import Score, THRESHOLD
from lava_ros.hindcast.several import Agreement
from lava_ros.lava import Lava

_DAY = 86400.0

_PAGE = """<!DOCTYPE html>
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
<img src="data:image/png;base64,{picture}" alt="Map of hits, misses and false alarms">
<h2>Lava</h2>
<p class="note">{material}</p>
<table>
<thead><tr><th>constant</th><th>value</th><th>published</th><th>source</th></tr></thead>
<tbody>{constants}</tbody></table>
<h2>Run</h2>
<table><tbody>{settings}</tbody></table>
</main>
<footer><p>lava_ros {version}</p></footer>
</body>
</html>
"""


def write_page(
    case: Case,
    settings: Settings,
    result: Result,
    judged: Score,
    picture: Path,
    output: Path,
    several: Agreement | None = None,
) -> None:
    """Write the page; it needs no other file.

    Args:
        case: The case.
        settings: How it was run.
        result: What came of it.
        judged: The comparison with the map.
        picture: The map of hits, misses and false alarms, a PNG.
        output: The page.
        several: What more runs have come to.

    Raises:
        LavaError: The page cannot be written, or the picture not be read.
    """
    try:
        image = base64.b64encode(picture.read_bytes()).decode()
        text = _PAGE.format(
            title=escape(f'Hindcast: {case.title}'),
            subtitle=escape(case.source or case.name),
            style=resources.files('lava_ros.report').joinpath('report.css').read_text('utf-8'),
            warnings=''.join(
                f'<p class="warning" role="alert">{escape(item)}</p>'
                for item in warnings(case, result)
            ),
            facts=''.join(
                f'<div><dt>{escape(term)}</dt><dd>{escape(value)}</dd></div>'
                for term, value in facts(judged, several).items()
            ),
            picture=image,
            material=escape(_material(case)),
            constants=_constants(case),
            settings=''.join(
                f'<tr><th scope="row">{escape(name)}</th><td>{escape(value)}</td></tr>'
                for name, value in _run(case, settings, result).items()
            ),
            version=escape(lava_ros.__version__),
        )
        partial = output.with_name(f'.{output.name}.partial')
        partial.write_text(text, encoding='utf-8')
        os.replace(partial, output)
    except OSError as error:
        raise LavaError('output', str(output), f'a file to write ({error})') from error


def facts(judged: Score, several: Agreement | None = None) -> dict[str, str]:
    """The comparison as people read it."""
    told = {
        'Jaccard': f'{judged.jaccard:.3f}',
        'fit, its root': f'{judged.fit:.3f}',
        'recall': f'{judged.recall:.3f}',
        'precision': f'{judged.precision:.3f}',
        'area': f'{judged.area / 1e6:.2f} of {judged.mapped_area / 1e6:.2f} km² '
        f'({100 * judged.area_error:+.0f} %)',
        'length': f'{judged.length / 1e3:.2f} of {judged.mapped_length / 1e3:.2f} km '
        f'({100 * judged.length_error:+.0f} %)',
        'volume': f'{judged.volume / 1e6:.2f} million m³',
        'mean thickness': f'{judged.mean_thickness:.1f} m '
        f'(mapped area: {judged.mapped_thickness:.1f} m)',
        'median, largest thickness': f'{judged.median_thickness:.1f} m, {judged.thickest:.1f} m',
    }
    if several is not None:
        found = several.as_dict()
        told[f'Jaccard of {found["count"]} runs'] = (
            f'{found["mean"]:.3f} on average, standard deviation '
            f'{found["standard_deviation"]:.3f}, {found["lowest"]:.3f} to {found["highest"]:.3f}'
        )
        told['Jaccard of their majority'] = (
            f'{several.majority.jaccard:.3f} (where at least half of them have lava)'
        )
    return told


def warnings(case: Case, result: Result) -> list[str]:
    """What a reader has to know about the result."""
    budget, said = result.snapshot.budget, []
    if budget.left > 1e-3 * budget.emitted:
        share = 100.0 * budget.left / budget.emitted
        said.append(f'{share:.1f} % of the lava left the elevation: the flow is cut off there.')
    if budget.error > 1e-5:
        said.append(f'The volume budget is off by {budget.error:.1e}.')
    if result.resolution.is_coarse:
        said.append(f'{result.resolution.text()}.')
    if case.low_pass:
        said.append(f'The elevation was smoothed over {case.low_pass:g} m.')
    return said


def _material(case: Case) -> str:
    material = case.material
    assert material is not None
    return f'{material.name}: {material.title}. Constants that are not listed are off.'


def _constants(case: Case) -> str:
    """Rows of the constants that are in use: value, range and source of each."""
    lava, usual = asdict(case.scene.lava), asdict(Lava())
    material = case.material
    assert material is not None
    temperatures = sorted({vent.temperature for vent in case.scene.vents})
    shown = ', '.join(f'{value:g}' for value in temperatures)
    rows = [_row('vent_temperature', shown, material.vent_temperature, temperatures)]
    for name, value in lava.items():
        known = material.constants.get(name)
        if known is not None or value != usual[name]:
            text = f'{value:g}' if isinstance(value, float) else str(value)
            rows.append(_row(name, text, known, [value]))
    return ''.join(rows)


def _row(name: str, shown: str, known: Any, values: list[Any]) -> str:
    if known is None or any(value != known.value for value in values):
        source = 'case.yaml' + ('' if known is None else f', in place of {known.value}')
    else:
        source = known.source
    span = ''
    if known is not None and known.range:
        span = f'{known.range[0]:g} to {known.range[1]:g} ({known.range_source})'
    cells = ''.join(f'<td>{escape(item)}</td>' for item in (shown, span, source))
    return f'<tr><th scope="row">{escape(name)}</th>{cells}</tr>'


def _run(case: Case, settings: Settings, result: Result) -> Mapping[str, str]:
    snapshot, terrain = result.snapshot, case.scene.terrain
    accuracy, budget = result.accuracy, result.snapshot.budget
    cell = terrain.resolution * settings.coarseness(case)
    events = '; '.join(f'{item.time / _DAY:.2f} d: {item.text}' for item in case.events)
    return {
        'simulated': f'{case.duration / _DAY:.2f} days, {case.volume / 1e6:.2f} million m³',
        'elevation': f'{terrain.shape[0]} x {terrain.shape[1]} cells of {terrain.resolution:g} m'
        + (f', smoothed over {case.low_pass:g} m' if case.low_pass else '')
        + (f', simulated on cells of {cell:g} m' if cell != terrain.resolution else ''),
        'covered means': f'at least {THRESHOLD:g} m of lava at the end',
        'events': events or 'none',
        'preset': f'{settings.preset}: particles {accuracy.spacing:g} m apart where the flow is '
        f'{accuracy.thickness:.2g} m thick, kernel radius {accuracy.ratio:g} times that',
        'resolution': result.resolution.text(),
        'effects': ', '.join(result.effects),
        'steps': f'{snapshot.steps.count} steps, {snapshot.steps.evaluations} evaluations, at '
        f'most {result.most_particles} particles at once',
        'volume': f'emitted {budget.emitted:.6g} m³, still fluid {budget.held:.6g} m³, frozen '
        f'{budget.frozen:.6g} m³, left {budget.left:.6g} m³, unaccounted {budget.error:.1e}',
        'wall time': f'{result.wall_time:.1f} s on {result.device}',
    }
