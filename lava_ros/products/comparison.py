# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Comparison of two runs, or two ensembles of the same members, without and with barriers."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros.files import write_output
from lava_ros.files.csv import format_table
from lava_ros.layers.numbers import area_words, duration
from lava_ros.layers.place_arrivals import OFF_MAP
from lava_ros.products.arrivals import table_of
from lava_ros.products.gis import PROBABILITIES, Provenance, write_grid
from lava_ros.products.run_page import read_run, Run
from lava_ros.products.sheet import draw_sheet, Panel
from lava_ros.scene.features import load_files

#: Files of a comparison: the map of the difference, the picture, and the table of places.
CHANGE, PICTURE, TABLE = 'probability_change', 'barriers.png', 'places.csv'

#: Columns of the table of places: each place, and its values without and with barriers.
_VALUES = ('probability_percent', 'arrival_p10_s', 'arrival_p50_s', 'arrival_p90_s')
_CASES = ('without', 'with')
COLUMNS = ('name', 'kind', *(f'{value}_{case}' for value in _VALUES for case in _CASES))


def compare_runs(
    without: Path, with_barriers: Path, output: Path, *, places: Sequence[str] = (),
    lines: Sequence[str] = (), built: float = 0.0, origin: Provenance,
) -> dict[str, Any]:
    """Compare two runs or two ensembles, and write maps, a picture, and a table of places.

    The change of a run is -100 or 100 where lava comes only without or only with barriers.

    Args:
        without: Folder of the run or the ensemble without barriers.
        with_barriers: Folder of the run or the ensemble with barriers.
        output: Folder for the files.
        places: Files of points, lines and areas; without files there is no table.
        lines: Files of barriers that are built later and are not part of the terrain.
        built: Simulated time at which the barriers are built [s].
        origin: Origin of the maps, for their tags.

    Returns:
        Inundated areas [m2], of ensembles by minimum probability, and places, without and with
        barriers, and the written ``files``.

    Raises:
        LavaError: If a run or a file of places cannot be read, or a file cannot be written.
    """
    overlays = load_files('--places', [*places, *lines])
    runs = [read_run(path, wanted=('arrival',)) for path in (without, with_barriers)]
    likely = [_probability(run) for run in runs]
    terrain = runs[1].terrain
    change = np.where(terrain.has_data, likely[1] - likely[0], np.nan)
    files = write_grid(output / f'{CHANGE}.tif', CHANGE, change, terrain, origin)[:1]
    each = dict(zip(_CASES, map(_areas, runs), strict=True))
    areas = {
        name: {case: found[name] for case, found in each.items()} for name in each['without']
    }
    shown, middle, drawn = 'arrival', 'inundated', 'barriers'
    if runs[0].ensemble is not None:
        shown, middle, drawn = 'inundation_probability', 'at least 50 %', 'change'
    panels = [
        replace(run.panels[shown], title=f'{case.capitalize()} barriers')
        for run, case in zip(runs, _CASES, strict=True) if shown in run.panels
    ]
    frame = runs[1].panels['thickness'].frame
    differs = np.where(change != 0.0, change, np.nan)
    if drawn == 'barriers':
        differs = np.select([differs < 0.0, differs > 0.0], [1.0, 2.0], np.nan)
    panels.append(Panel(frame, drawn, differs, 'Change'))
    texts = [area_words(areas[middle][case]) for case in _CASES]
    at = ' at 50 % or more' if runs[0].ensemble is not None else ''
    subtitle = f'{texts[0]}{at} without barriers, {texts[1]} with barriers'
    draw_sheet(
        panels, output / PICTURE, title=f'Effect of barriers: {runs[0].title}',
        subtitle=f'{subtitle} built after {duration(built)}' if built else subtitle,
        overlays={
            name: [item.on(terrain) for item in items] for name, items in overlays.items()
        },
        notes={
            term: text for term, text in runs[1].facts.items()
            if term in ('effusion rate', 'lava', 'runs', 'inundation', 'warning', 'model')
        },
    )
    files.append(output / PICTURE)
    rows = []
    if places:
        # the files of places come first
        found = list(overlays.values())[: len(dict.fromkeys(places))]
        features = [item for items in found for item in items]
        tables = [
            table_of(path, features).as_dict()['places'] for path in (without, with_barriers)
        ]
        rows = [
            {'name': pair[0]['name'], 'kind': pair[0]['kind']} | {
                f'{value}_{case}': row[value]
                for value in _VALUES for case, row in zip(_CASES, pair, strict=True)
            }
            for pair in zip(*tables, strict=True)
        ]
        write_output('--output', output / TABLE, format_table(COLUMNS, rows))
        files.append(output / TABLE)
    return {'area_m2': areas, 'places': rows, 'files': [str(path) for path in files]}


def _probability(run: Run) -> np.ndarray:
    """Return the probability of inundation [%]; that of a single run is 0 or 100."""
    if run.ensemble is not None:
        known: np.ndarray = np.nan_to_num(run.panels['inundation_probability'].values)
        return known
    arrival = run.panels.get('arrival')
    if arrival is None:
        # no lava
        return np.zeros(run.terrain.shape)
    return np.where(np.isfinite(arrival.values), 100.0, 0.0)


def _areas(run: Run) -> dict[str, float]:
    """Return the inundated area of a run, or those of an ensemble by probability [m2]."""
    if run.ensemble is not None:
        return {f'at least {least:g} %': run.ensemble.areas[least] for least in PROBABILITIES}
    frame = run.panels['thickness'].frame
    return {'inundated': 0.0 if frame.inundated is None else frame.area(frame.inundated)}


def place_texts(rows: Sequence[dict[str, Any]], *, is_ensemble: bool) -> list[tuple[str, ...]]:
    """Format the table of places for people: titles, then a row for each place.

    A single run has one time of arrival and no probability.
    """
    def probability(row: Mapping[str, Any], case: str) -> str:
        value = row[f'probability_percent_{case}']
        return OFF_MAP if value is None else f'{value:.0f} %'

    def moment(row: Mapping[str, Any], case: str) -> str:
        value = row[f'arrival_p50_s_{case}']
        if value is not None:
            return duration(value)
        if is_ensemble:
            return '-'
        return OFF_MAP if row[f'probability_percent_{case}'] is None else 'not reached'

    columns = {'probability': probability, 'arrival (50 %)': moment}
    if not is_ensemble:
        columns = {'arrival': moment}
    titles = [text for name in columns for text in (f'{name} without', 'with')]
    return [('place', *titles), *(
        (row['name'], *(value(row, case) for value in columns.values() for case in _CASES))
        for row in rows
    )]
