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
from pathlib import Path
from typing import Any

import numpy as np

import lava_ros
from lava_ros.forecast.picture import frame_of
from lava_ros.hindcast.case import Case
from lava_ros.hindcast.replicates import Agreement
from lava_ros.hindcast.run import Result, Settings
from lava_ros.hindcast.score import covered_by, Score
from lava_ros.maps.gis import NODATA_BYTE, write_grid
from lava_ros.maps.plot import area_words, duration
from lava_ros.maps.sheet import draw_sheet, Panel
from lava_ros.pages.report.page import write_still
from lava_ros.pages.runs import system_words
from lava_ros.scene.lava import Lava
from lava_ros.simulation.snapshot import Snapshot

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
        'covered means': 'lava at least 0.1 m thick reached the cell',
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


#: What a cell of the comparison says.
NEITHER, HIT, MISS, FALSE_ALARM, UNKNOWN = 0, 1, 2, 3, NODATA_BYTE


def comparison(snapshot: Snapshot, footprint: np.ndarray) -> np.ndarray:
    """Hits, misses and false alarms, uint8, shape [rows, columns]."""
    covered = covered_by(snapshot)
    codes = np.full(footprint.shape, NEITHER, np.uint8)
    codes[covered & footprint] = HIT
    codes[~covered & footprint] = MISS
    codes[covered & ~footprint] = FALSE_ALARM
    codes[~snapshot.terrain.has_data & ~footprint] = UNKNOWN
    return codes


def write_maps(
    case: Case, result: Result, folder: Path, several: Agreement | None = None
) -> list[Path]:
    """Write the maps of a hindcast, north up, on the grid of its elevation.

    ``several`` is the agreement of several runs; it adds a map of the share of them that covers
    each cell.

    Returns:
        The paths of the files.

    Raises:
        LavaError: rasterio is not installed, or a file cannot be written.
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
    files = [
        write_grid(folder / f'{name}.tif', values, terrain, unit=unit, meaning=meaning)
        for name, (values, unit, meaning) in maps.items()
    ]
    meaning = '0: neither, 1: hit, 2: miss, 3: false alarm'
    codes = comparison(snapshot, case.footprint)
    path = folder / 'comparison.tif'
    return [*files, write_grid(path, codes, terrain, unit='1', meaning=meaning)]


def draw_comparison(case: Case, snapshot: Snapshot, judged: Score, output: Path) -> None:
    """Draw hits, misses and false alarms of a flow at its end; the suffix chooses the format.

    Raises:
        LavaError: matplotlib is not installed, or the picture cannot be written.
    """
    codes = comparison(snapshot, case.footprint).astype(np.float64)
    codes[(codes < HIT) | (codes > FALSE_ALARM)] = np.nan
    cell = case.scene.terrain.resolution**2
    areas = {'hit': judged.hits, 'miss': judged.misses, 'false alarm': judged.false_alarms}
    vents = case.scene.vents
    fissures = [(vent.position, vent.end) for vent in vents if vent.end is not None]
    facts = {
        'mapped': f'{area_words(case.area)}, {case.volume / 1e6:.3g} million m³ in '
        f'{duration(case.duration)}',
        'model': f'lava_ros {lava_ros.__version__}, depth-averaged lava as particles',
        'coordinates': system_words(case.scene.terrain.epsg),
    }
    if case.source:
        facts['source'] = case.source
    draw_sheet(
        [Panel(frame_of(case.scene), 'comparison', codes, fissures=fissures)],
        output,
        title=case.title,
        subtitle='  ·  '.join(
            [
                f'Jaccard {judged.jaccard:.3f}',
                *(f'{name} {area_words(count * cell)}' for name, count in areas.items()),
            ]
        ),
        notes=facts,
    )
