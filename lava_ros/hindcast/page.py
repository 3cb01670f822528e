# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Results of a hindcast: GeoTIFF maps, a picture of the comparison, and a page."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
import math
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

import lava_ros
from lava_ros.hindcast.case import Case
from lava_ros.hindcast.replicates import Agreement
from lava_ros.hindcast.run import coarseness, Result
from lava_ros.hindcast.score import Score
from lava_ros.layers.frame import frame_of
from lava_ros.layers.numbers import area_words, duration, percent
from lava_ros.products.gis import Provenance, time_tags, write_grid
from lava_ros.products.raster_layers import NODATA
from lava_ros.products.report.static_page import write_static_page
from lava_ros.products.run_warnings import sentences
from lava_ros.products.sheet import draw_sheet, Panel
from lava_ros.scene.erupting_lava import EruptingLava
from lava_ros.scene.lava import constant_units, Lava
from lava_ros.scene.materials import Material
from lava_ros.scene.projection import system_words
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.carriers import COUNTED, describe_carriers
from lava_ros.simulation.numerical_error import NOT_MEASURED, NumericalError
from lava_ros.simulation.output.inundation import raise_peak
from lava_ros.simulation.output.snapshot import Snapshot
from lava_ros.simulation.selection import Decision

_DAY = 86400.0


def write_page(
    case: Case,
    preset: str,
    result: Result,
    judged: Score,
    picture: Path,
    output: Path,
    error: NumericalError | None,
    remarks: Sequence[str] = (),
    several: Agreement | None = None,
    dated: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Write the page of a hindcast as one HTML file that includes the picture, a PNG.

    ``remarks`` are the warnings of the run.

    Raises:
        LavaError: If the page cannot be written, or the picture cannot be read.
    """
    material = case.material
    note = f'{material.name}: {material.title}. Laws of constants that are not listed are off.'
    constants, sources = _constants(case, material)
    write_static_page(
        output,
        [('Map of hits, misses and false alarms', picture)],
        template='hindcast.html',
        title=f'Hindcast: {case.title}',
        subtitle=case.source or case.name,
        warnings=sentences(*remarks),
        facts={
            'lava': EruptingLava.of(case.scene).text(),
            **facts(judged, result, error, several, dated),
        },
        lava=note,
        constants=constants,
        sources=sources,
        run=_run(case, preset, result),
    )


def facts(
    judged: Score, result: Result, error: NumericalError | None,
    several: Agreement | None = None, dated: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, str]:
    """Return the comparison as text by label; ``dated`` adds the scores of dated outlines."""
    texts = {
        'Jaccard': f'{judged.jaccard:.3f}',
        'fit index': f'{judged.fit:.3f}',
        'recall': f'{judged.recall:.3f}',
        'precision': f'{judged.precision:.3f}',
        'inundated area': f'{judged.area / 1e6:.3f} of {judged.mapped_area / 1e6:.3f} km² '
        f'({100 * judged.area_error:+.0f} %)',
        'standing area': f'{judged.standing_area / 1e6:.3f} km² at the end',
        'runout length': f'{judged.length / 1e3:.3g} of {judged.mapped_length / 1e3:.3g} km '
        f'({100 * judged.length_error:+.0f} %)',
        'volume on the map': f'{judged.volume / 1e6:.3g} million m³',
        'mean thickness': f'{judged.mean_thickness:.1f} m '
        f'(mapped area: {judged.mapped_thickness:.1f} m)',
        'numerical error': NOT_MEASURED if error is None else error.text(),
        'effects left out': f'{percent(result.effects_error)} of the inundated area',
        'median, largest thickness': f'{judged.median_thickness:.1f} m, {judged.thickest:.1f} m',
    }
    if result.resolution.kind is not None:
        texts['kind of flow'] = result.resolution.kind.text()
    if several is not None:
        found = several.as_dict()
        texts[f'Jaccard of {found["count"]} runs'] = (
            f'{found["mean"]:.3f} on average, standard deviation '
            f'{found["standard_deviation"]:.3f}, {found["lowest"]:.3f} to {found["highest"]:.3f}'
        )
        texts['Jaccard of the majority'] = (
            f'{several.majority.jaccard:.3f} (where at least half of them have lava)'
        )
        texts['mean difference of two runs'] = f'{percent(several.chance)} on average'
    return {**texts, **dated}


def _constants(case: Case, material: Material) -> tuple[list[tuple[str, ...]], list[str]]:
    usual, units = asdict(Lava.paper()), constant_units()
    used: dict[str, list[Any]] = {
        'vent_temperature': sorted({vent.temperature for vent in case.scene.vents}),
        **{name: [value] for name, value in asdict(case.scene.lava).items()},
    }
    published = {'vent_temperature': material.vent_temperature, **material.constants}
    sources: dict[str, int] = {}

    def cited(source: str) -> str:
        return f'[{sources.setdefault(source, len(sources) + 1)}]'

    rows: list[tuple[str, ...]] = [
        (name, f'{one.value:g}', 'wt%', '', cited(one.source) if one.source else 'case.yaml')
        for name, one in material.composition.items()
    ]
    for name, values in used.items():
        known, span = published.get(name), ''
        source = 'vents of the case' if name == 'vent_temperature' else 'case.yaml'
        if known is None and values == [usual[name]]:
            continue
        if known is not None:
            is_own = any(value != known.value for value in values)
            source = f'{source}, in place of {known.value}' if is_own else cited(known.source)
            if known.range:
                span = f'{known.range[0]:g} to {known.range[1]:g} {cited(known.range_source)}'
        shown = [f'{item:g}' if isinstance(item, float) else str(item) for item in values]
        rows.append((name, ', '.join(shown), units[name], span, source))
    return rows, list(sources)


def _run(case: Case, preset: str, result: Result) -> Mapping[str, str]:
    steps, terrain, accuracy = result.snapshot.steps, case.scene.terrain, result.accuracy
    cell = terrain.resolution * coarseness(case, accuracy)
    events = '; '.join(f'{item.time / _DAY:.2f} d: {item.text}' for item in case.scene.events)
    return {
        'simulated': f'{case.duration / _DAY:.2f} days, {case.volume / 1e6:.2f} million m³',
        'elevation': f'{terrain.shape[0]} x {terrain.shape[1]} cells of {terrain.resolution:g} m'
        + (f', smoothed over {case.low_pass:g} m' if case.low_pass else '')
        + (f', simulated on cells of {cell:g} m' if cell != terrain.resolution else ''),
        'inundated area': f'covered by lava at least {result.snapshot.threshold:g} m thick so far',
        'events': events or 'none',
        'preset': f'{preset}: {_carriers(accuracy)}',
        'resolution': result.resolution.text(),
        'effects': ', '.join(_described(item) for item in result.decisions if item.is_on),
        'steps': f'{steps.count} steps, {steps.evaluations} evaluations, at most '
        f'{result.most_particles} {COUNTED[accuracy.method]} at once',
        'volume': result.snapshot.budget.text(),
        'wall time': f'{result.wall_time:.1f} s on {result.device}',
    }


def _carriers(accuracy: Accuracy) -> str:
    if accuracy.method == 'cells':
        return f'cells of {accuracy.spacing:g} m'
    return (
        f'particles {accuracy.spacing:g} m apart where the flow is {accuracy.thickness:.2g} m '
        f'thick, kernel radius {accuracy.ratio:g} times that'
    )


def _described(decision: Decision) -> str:
    """Return the name of an active effect, with its start if it was off at first."""
    if math.isnan(decision.since):
        return decision.name
    return f'{decision.name} (from {duration(decision.since)} on)'


#: Codes of the cells of a comparison.
NEITHER, HIT, MISS, FALSE_ALARM, UNKNOWN = 0, 1, 2, 3, NODATA


def comparison(snapshot: Snapshot, footprint: np.ndarray) -> np.ndarray:
    """Return the codes of hits, misses and false alarms, int16, shape [rows, columns]."""
    table = np.array([[NEITHER, MISS], [FALSE_ALARM, HIT]], np.int16)
    codes = table[snapshot.footprint.astype(int), footprint.astype(int)]
    codes[~snapshot.terrain.has_data & ~footprint] = UNKNOWN
    return codes


def write_maps(
    case: Case,
    preset: str,
    result: Result,
    peak: np.ndarray,
    folder: Path,
    several: Agreement | None = None,
) -> list[Path]:
    """Write the maps of a hindcast, north up, on the grid of its elevation; return their paths.

    ``peak`` is the largest thickness in any map [m], shape [rows, columns]. ``several`` adds a map
    of the percentage of replicates that inundate each cell.

    Raises:
        LavaError: If rasterio is not installed, or a file cannot be written.
    """
    snapshot, terrain = result.snapshot, result.snapshot.terrain
    assert snapshot.arrived is not None and snapshot.inundated is not None
    codes = comparison(snapshot, case.footprint).astype(np.float32)
    maps = {
        'thickness': snapshot.thickness,
        'peak_thickness': raise_peak(peak, snapshot.arrived, snapshot.threshold),
        'arrival': snapshot.arrived,
        'inundated': snapshot.inundated,
        'temperature': snapshot.temperature - 273.15,
        'comparison': np.where(codes == UNKNOWN, np.float32(np.nan), codes),
    }
    if several is not None:
        maps['runs'] = 100.0 * several.share
    origin = Provenance(case.name, result.effects, preset, onset=case.onset)
    compared = replace(origin, observation=f'mapped flow field of {case.name}')
    tags = {
        'inundation_threshold_m': repr(snapshot.threshold),
        **time_tags(snapshot.time, case.onset),
    }
    more = {'inundated': {'inundated_area_m2': repr(snapshot.area(snapshot.inundated))}}
    return [
        write_grid(
            folder / f'{name}.tif', name, np.where(terrain.has_data, values, np.float32(np.nan)),
            terrain, compared if name == 'comparison' else origin, tags | more.get(name, {}),
        )[0]
        for name, values in maps.items()
    ]


def draw_comparison(
    case: Case, result: Result, judged: Score, output: Path, error: NumericalError | None
) -> None:
    """Draw hits, misses and false alarms of a flow at its end; the suffix sets the format.

    Raises:
        LavaError: If matplotlib is not installed, or the picture cannot be written.
    """
    snapshot = result.snapshot
    codes = comparison(snapshot, case.footprint).astype(np.float64)
    codes[(codes < HIT) | (codes > FALSE_ALARM)] = np.nan
    cell = case.scene.terrain.resolution**2
    areas = {'hit': judged.hits, 'miss': judged.misses, 'false alarm': judged.false_alarms}
    parts = [f'{name} {area_words(count * cell)}' for name, count in areas.items()]
    facts = {
        'mapped': f'{area_words(case.area)}, {case.volume / 1e6:.3g} million m³ in '
        f'{duration(case.duration)}',
        'lava': EruptingLava.of(case.scene).text(),
        'model': f'lava_ros {lava_ros.__version__}, '
        f'{describe_carriers(result.accuracy.method)}, numerical error '
        f'{NOT_MEASURED if error is None else error.brief()}',
        'coordinates': system_words(case.scene.terrain.epsg, case.scene.terrain.wkt),
    }
    if case.source:
        facts['source'] = case.source
    # including barriers built during the eruption
    frame = frame_of(replace(case.scene, terrain=snapshot.terrain))
    draw_sheet(
        [Panel(frame, 'comparison', codes)],
        output,
        title=case.title,
        subtitle='  ·  '.join([f'Jaccard {judged.jaccard:.3f}', *parts]),
        notes=facts,
    )
