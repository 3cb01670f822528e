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

"""What a hindcast leaves: GeoTIFF maps, a picture beside what was mapped, and a page."""

from collections.abc import Mapping
from dataclasses import asdict
from html import escape
import math
from pathlib import Path
from typing import Any

import numpy as np

import lava_ros
from lava_ros.forecast.picture import frame_of
from lava_ros.hindcast.case import Case
from lava_ros.hindcast.expected_error import ExpectedError
from lava_ros.hindcast.replicates import Agreement
from lava_ros.hindcast.run import Result, Settings
from lava_ros.hindcast.score import covered_by, Score
from lava_ros.maps.gis import NODATA_BYTE, write_grid
from lava_ros.maps.plot import area_words, duration
from lava_ros.maps.sheet import draw_sheet, Panel
from lava_ros.pages.report.page import write_still
from lava_ros.pages.runs import system_words
from lava_ros.scene.lava import Lava
from lava_ros.scene.materials import Material
from lava_ros.simulation.selection import Decision
from lava_ros.simulation.snapshot import Snapshot

_DAY = 86400.0


def write_page(
    case: Case,
    settings: Settings,
    result: Result,
    judged: Score,
    picture: Path,
    output: Path,
    expected: ExpectedError,
    several: Agreement | None = None,
) -> None:
    """Write the page of a hindcast as one HTML file that includes the picture, a PNG.

    LavaError if the page cannot be written, or the picture cannot be read.
    """
    material = case.material
    assert material is not None
    note = f'{material.name}: {material.title}. Constants that are not listed are off.'
    run = ''.join(_row(name, value) for name, value in _run(case, settings, result).items())
    sections = (
        f'<h2>Lava</h2>\n<p class="note">{escape(note)}</p>\n<table>\n'
        '<thead><tr><th>constant</th><th>value</th><th>published</th><th>source</th></tr></thead>\n'
        f'<tbody>{_constants(case, material)}</tbody></table>\n<h2>Run</h2>\n<table><tbody>'
        f'{run}</tbody></table>'
    )
    write_still(
        output,
        title=f'Hindcast: {case.title}',
        subtitle=case.source or case.name,
        warnings=warnings(case, result),
        facts=facts(judged, expected, several),
        picture=picture,
        shows='Map of hits, misses and false alarms',
        sections=sections,
    )


def facts(
    judged: Score, expected: ExpectedError, several: Agreement | None = None
) -> dict[str, str]:
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
        'expected error': expected.text(),
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


def _constants(case: Case, material: Material) -> str:
    """Rows of the constants that are in use: value, range and source of each."""
    usual, rows = asdict(Lava()), []
    used: dict[str, list[Any]] = {
        'vent_temperature': sorted({vent.temperature for vent in case.scene.vents}),
        **{name: [value] for name, value in asdict(case.scene.lava).items()},
    }
    published = {'vent_temperature': material.vent_temperature, **material.constants}
    for name, values in used.items():
        known, source, span = published.get(name), 'case.yaml', ''
        if known is None and values == [usual[name]]:
            continue
        if known is not None:
            is_own = any(value != known.value for value in values)
            source = f'{source}, in place of {known.value}' if is_own else known.source
            if known.range:
                span = f'{known.range[0]:g} to {known.range[1]:g} ({known.range_source})'
        shown = [f'{item:g}' if isinstance(item, float) else str(item) for item in values]
        rows.append(_row(name, ', '.join(shown), span, source))
    return ''.join(rows)


def _row(name: str, *texts: str) -> str:
    cells = ''.join(f'<td>{escape(text)}</td>' for text in texts)
    return f'<tr><th scope="row">{escape(name)}</th>{cells}</tr>'


def _run(case: Case, settings: Settings, result: Result) -> Mapping[str, str]:
    steps, terrain, accuracy = result.snapshot.steps, case.scene.terrain, result.accuracy
    cell = terrain.resolution * settings.coarseness(case)
    events = '; '.join(f'{item.time / _DAY:.2f} d: {item.text}' for item in case.events)
    return {
        'simulated': f'{case.duration / _DAY:.2f} days, {case.volume / 1e6:.2f} million m³',
        'elevation': f'{terrain.shape[0]} x {terrain.shape[1]} cells of {terrain.resolution:g} m'
        + (f', smoothed over {case.low_pass:g} m' if case.low_pass else '')
        + (f', simulated on cells of {cell:g} m' if cell != terrain.resolution else ''),
        'covered means': 'lava at least 0.1 m thick reached the cell',
        'events': events or 'none',
        'preset': f'{settings.preset}: particles {accuracy.spacing:g} m apart where the flow is '
        f'{accuracy.thickness:.2g} m thick, kernel radius {accuracy.ratio:g} times that',
        'resolution': result.resolution.text(),
        'effects': ', '.join(_described(item) for item in result.decisions if item.is_on),
        'steps': f'{steps.count} steps, {steps.evaluations} evaluations, at most '
        f'{result.most_particles} particles at once',
        'volume': result.snapshot.budget.text(),
        'wall time': f'{result.wall_time:.1f} s on {result.device}',
    }


def _described(decision: Decision) -> str:
    """Name of an effect that is on, with the time from which it was if that is not the start."""
    if math.isnan(decision.since):
        return decision.name
    return f'{decision.name} (from {duration(decision.since)} on)'


#: What a cell of the comparison says.
NEITHER, HIT, MISS, FALSE_ALARM, UNKNOWN = 0, 1, 2, 3, NODATA_BYTE


def comparison(snapshot: Snapshot, footprint: np.ndarray) -> np.ndarray:
    """Hits, misses and false alarms, uint8, shape [rows, columns]."""
    table = np.array([[NEITHER, MISS], [FALSE_ALARM, HIT]], np.uint8)
    codes = table[covered_by(snapshot).astype(int), footprint.astype(int)]
    codes[~snapshot.terrain.has_data & ~footprint] = UNKNOWN
    return codes


def write_maps(
    case: Case, result: Result, folder: Path, several: Agreement | None = None
) -> list[Path]:
    """Write the maps of a hindcast, north up, on the grid of its elevation; return their paths.

    ``several``, the agreement of several runs, adds a map of the share of them that covers each
    cell. LavaError if rasterio is not installed, or a file cannot be written.
    """
    snapshot, terrain = result.snapshot, case.scene.terrain
    assert snapshot.arrived is not None
    dry = np.where(terrain.has_data, 0.0, np.nan)
    thickness = np.where(terrain.has_data, snapshot.thickness, np.nan)
    maps = {
        'thickness': (thickness, 'm', 'thickness of the lava at the end; 0: none'),
        'peak_thickness': (result.peak + dry, 'm', 'largest thickness in any map; 0: none'),
        'arrival': (snapshot.arrived, 's', 'time when lava came; no data: none came'),
        'temperature': (snapshot.temperature - 273.15, 'degC', 'temperature; no data: no lava'),
    }
    if several is not None:
        meaning = f'share of {len(several.scores)} runs whose lava came there'
        maps['runs'] = (several.share + dry, '1', meaning)
    codes = comparison(snapshot, case.footprint)
    maps['comparison'] = (codes, '1', '0: neither, 1: hit, 2: miss, 3: false alarm')
    return [
        write_grid(folder / f'{name}.tif', values, terrain, unit=unit, meaning=meaning)
        for name, (values, unit, meaning) in maps.items()
    ]


def draw_comparison(case: Case, snapshot: Snapshot, judged: Score, output: Path) -> None:
    """Draw hits, misses and false alarms of a flow at its end; the suffix chooses the format.

    LavaError if matplotlib is not installed, or the picture cannot be written.
    """
    codes = comparison(snapshot, case.footprint).astype(np.float64)
    codes[(codes < HIT) | (codes > FALSE_ALARM)] = np.nan
    cell = case.scene.terrain.resolution**2
    areas = {'hit': judged.hits, 'miss': judged.misses, 'false alarm': judged.false_alarms}
    fissures = [(item.position, item.end) for item in case.scene.vents if item.end is not None]
    shares = [f'{name} {area_words(count * cell)}' for name, count in areas.items()]
    facts = {
        'mapped': f'{area_words(case.area)}, {case.volume / 1e6:.3g} million m³ in '
        f'{duration(case.duration)}',
        'model': f'lava_ros {lava_ros.__version__}, depth-averaged lava as particles',
        'coordinates': system_words(case.scene.terrain.epsg, case.scene.terrain.wkt),
    }
    if case.source:
        facts['source'] = case.source
    draw_sheet(
        [Panel(frame_of(case.scene), 'comparison', codes, fissures=fissures)],
        output,
        title=case.title,
        subtitle='  ·  '.join([f'Jaccard {judged.jaccard:.3f}', *shares]),
        notes=facts,
    )
