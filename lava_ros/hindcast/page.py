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

from collections.abc import Mapping
from dataclasses import asdict
from html import escape
from pathlib import Path
from typing import Any

from lava_ros.hindcast.case import Case
from lava_ros.hindcast.replicates import Agreement
from lava_ros.hindcast.run import Result, Settings
from lava_ros.hindcast.score import Score
from lava_ros.pages.report.still import write_still
from lava_ros.scene.lava import Lava

_DAY = 86400.0

def write_page(
    case: Case,
    settings: Settings,
    result: Result,
    judged: Score,
    picture: Path,
    output: Path,
    several: Agreement | None = None,
) -> None:
    """Write the page of a hindcast as one HTML file that includes the picture, a PNG.

    Raises:
        LavaError: The page cannot be written, or the picture cannot be read.
    """
    sections = (
        f'<h2>Lava</h2>\n<p class="note">{escape(_material(case))}</p>\n<table>\n'
        '<thead><tr><th>constant</th><th>value</th><th>published</th><th>source</th></tr></thead>\n'
        f'<tbody>{_constants(case)}</tbody></table>\n<h2>Run</h2>\n<table><tbody>'
        + ''.join(
            f'<tr><th scope="row">{escape(name)}</th><td>{escape(value)}</td></tr>'
            for name, value in _run(case, settings, result).items()
        )
        + '</tbody></table>'
    )
    write_still(
        output,
        title=f'Hindcast: {case.title}',
        subtitle=case.source or case.name,
        warnings=warnings(case, result),
        facts=facts(judged, several),
        picture=picture,
        shows='Map of hits, misses and false alarms',
        sections=sections,
    )


def facts(judged: Score, several: Agreement | None = None) -> dict[str, str]:
    """The comparison as people read it."""
    told = {
        'Jaccard': f'{judged.jaccard:.3f}',
        'fit, its root': f'{judged.fit:.3f}',
        'recall': f'{judged.recall:.3f}',
        'precision': f'{judged.precision:.3f}',
        'area': f'{judged.area / 1e6:.3g} of {judged.mapped_area / 1e6:.3g} km² '
        f'({100 * judged.area_error:+.0f} %)',
        'length': f'{judged.length / 1e3:.3g} of {judged.mapped_length / 1e3:.3g} km '
        f'({100 * judged.length_error:+.0f} %)',
        'volume': f'{judged.volume / 1e6:.3g} million m³',
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
    said = [f'{text[0].upper()}{text[1:]}.' for text in result.snapshot.budget.warnings()]
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
    accuracy = result.accuracy
    cell = terrain.resolution * settings.coarseness(case)
    events = '; '.join(f'{item.time / _DAY:.2f} d: {item.text}' for item in case.events)
    return {
        'simulated': f'{case.duration / _DAY:.2f} days, {case.volume / 1e6:.2f} million m³',
        'elevation': f'{terrain.shape[0]} x {terrain.shape[1]} cells of {terrain.resolution:g} m'
        + (f', smoothed over {case.low_pass:g} m' if case.low_pass else '')
        + (f', simulated on cells of {cell:g} m' if cell != terrain.resolution else ''),
        'covered means': 'lava at least 0.1 m thick came there',
        'events': events or 'none',
        'preset': f'{settings.preset}: particles {accuracy.spacing:g} m apart where the flow is '
        f'{accuracy.thickness:.2g} m thick, kernel radius {accuracy.ratio:g} times that',
        'resolution': result.resolution.text(),
        'effects': ', '.join(result.effects),
        'steps': f'{snapshot.steps.count} steps, {snapshot.steps.evaluations} evaluations, at '
        f'most {result.most_particles} particles at once',
        'volume': snapshot.budget.text(),
        'wall time': f'{result.wall_time:.1f} s on {result.device}',
    }
